"""Scan matching: clouds of end points, local maps made of some, the search for a pose, its refinement and covariance.

A local map holds how likely an end point is at each cell, at several resolutions, and its nearest surface point. The
search is by branch and bound over these (Olson 2009, "Real-time correlative scan matching"; Hess et al. 2016,
"Real-time loop closure in 2D LIDAR SLAM"), the refinement point to line (Censi 2008, "An ICP variant using a
point-to-line metric") with a robust kernel. The covariance is that of the correlation surface around a match, so that
the direction of a corridor, along which nothing holds the scan, is known as such.
"""

from __future__ import annotations

from math import atan2, ceil, cos, exp, floor, hypot, radians, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.records import Scan
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray, wrap

NORMAL_BEAMS = 5  # Beams to either side that a surface's direction is found from.
NORMAL_REACH = 0.25  # Metres from a point within which these neighbours count, where the beams are that dense.
SPARSE = 0.4  # Metres between neighbouring beams from which on a point of no known surface shows no shape of its own.
# Times the beams' spacing up to which points may lie apart: two beams' steps on a surface met at 20 degrees.
GRAZED = 6.0


class PointCloud(NamedTuple):
    """End points of beams, in one frame."""

    points: FloatArray  # Shape (n, 2), metres.
    # Shape (n, 2): unit vectors across the surface, towards the scanner; zero where no straight surface was
    # found.
    normals: FloatArray
    spacing: FloatArray  # Shape (n,): metres by which neighbouring beams lie apart at each point.


def point_cloud(scan: Scan, max_range: float) -> PointCloud:
    """Return the end points of a scan that lie within ``max_range`` metres, in the robot's frame."""
    points, normals, spacing = _cloud(
        np.asarray(scan.ranges, dtype=np.float64),
        float(scan.angle_min),
        float(scan.angle_increment),
        min(float(scan.range_max), np.nextafter(max_range, np.inf)),
    )
    return transformed(PointCloud(points, normals, spacing), np.asarray(scan.mount, dtype=np.float64))


def surface_cloud(scan: Scan, max_range: float) -> PointCloud:
    """Return the end points that scans are matched by; see :func:`point_cloud`.

    Without those of which no surface is known where beams lie far apart: the next scan meets other points there.
    """
    cloud = point_cloud(scan, max_range)
    kept = cloud.normals.any(axis=1) | (cloud.spacing <= SPARSE)
    return PointCloud(*(array[kept] for array in cloud))


def transformed(cloud: PointCloud, pose: FloatArray) -> PointCloud:
    """Return a cloud of the frame at ``pose``, shape (3,), in the frame that the pose is given in."""
    c, s = cos(pose[2]), sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    return PointCloud(cloud.points @ turn + pose[:2], cloud.normals @ turn, cloud.spacing)


def joined(clouds: list[PointCloud], poses: FloatArray) -> PointCloud:
    """Return several clouds, each in the frame at its row of ``poses`` (n, 3), as one in the poses' frame."""
    parts = [transformed(cloud, pose) for cloud, pose in zip(clouds, poses, strict=True)]
    return PointCloud(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


@njit
def _cloud(ranges, first, step, limit):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return points, normals (the narrow axis of the neighbours' scatter, if it is narrow enough) and spacing."""
    n = len(ranges)
    places = np.empty((n, 2))
    good = np.zeros(n, dtype=np.bool_)
    count = 0
    for i in range(n):
        r = ranges[i]
        if r > 0.0 and r < limit:  # NaN is neither
            good[i] = True
            places[i, 0], places[i, 1] = r * cos(first + i * step), r * sin(first + i * step)
            count += 1
    points, normals, spacing = np.empty((count, 2)), np.zeros((count, 2)), np.empty(count)
    at = 0
    for i in range(n):
        if not good[i]:
            continue
        x, y = places[i]
        points[at, 0], points[at, 1], spacing[at] = x, y, abs(step) * ranges[i]
        # Far away neighbours lie farther apart.
        reach = max(NORMAL_REACH, GRAZED * spacing[at])
        m, sx, sy, sxx, sxy, syy = 0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(max(0, i - NORMAL_BEAMS), min(n, i + NORMAL_BEAMS + 1)):
            if good[j]:
                dx, dy = places[j, 0] - x, places[j, 1] - y
                if hypot(dx, dy) <= reach:
                    m += 1
                    sx += dx
                    sy += dy
                    sxx += dx * dx
                    sxy += dx * dy
                    syy += dy * dy
        if m >= 3:
            sxx, sxy, syy = sxx - sx * sx / m, sxy - sx * sy / m, syy - sy * sy / m
            half = hypot(0.5 * (sxx - syy), sxy)
            wide, narrow = 0.5 * (sxx + syy) + half, 0.5 * (sxx + syy) - half
            if narrow <= 0.1 * wide and narrow <= 0.03**2 * m:
                angle = 0.5 * atan2(2.0 * sxy, sxx - syy)
                nx, ny = -sin(angle), cos(angle)
                side = -1.0 if nx * x + ny * y > 0.0 else 1.0
                normals[at, 0], normals[at, 1] = side * nx, side * ny
        at += 1
    return points, normals, spacing


CELL = 0.05  # Side of a cell, metres: what the points of a surface scatter by.
# Metres by which an end point may lie off the surface that it belongs to: the scanner's noise, the cells and the
# errors of the scans that the map is made of.
SIGMA = 0.1
# Metres from a surface point to the cells that know it: beyond, a point's likelihood is under 0.04 % of the best.
REACH = 0.4
# Cosine of the angle between the directions of neighbouring end points, at least, that lie on one surface.
ALONG = 0.97
# Metres, and in metres for each metre that they lie apart: how far each may lie off the other's line.
ASIDE = 0.02, 0.1
LEVELS = 6  # Resolutions of the likelihood: a cell of level k has the largest of 2^k x 2^k cells.
# Metres behind a surface up to which points count as in view: poses err, and what stands at walls is cluttered.
BEHIND = 0.5
VIEW_GAP = 0.06  # Radians between end points up to which a scan has seen what lies between them.


class LocalMap(NamedTuple):
    """Surface points, and grids around them; row 0 has the smallest y."""

    x0: float  # Outer corner of cell (0, 0), metres.
    y0: float
    cell: float  # Metres.
    points: FloatArray  # Shape (m, 2): the mean of the end points of each cell.
    normals: FloatArray  # Shape (m, 2): their mean direction, zero where there is none.
    nearest: NDArray[np.int32]  # Shape (rows, columns): the nearest point; -1 where none is within REACH.
    # Shape (levels, rows, columns): of level 0, 255·exp(−d²/2σ²) at the distance d of the nearest point; of level
    # k, the largest of level 0 over the rows r to r + 2^k − 1 and as many columns.
    likelihood: NDArray[np.uint8]


def local_map(
    cloud: PointCloud,
    bounds: tuple[float, float, float, float] | None = None,
    levels: int = LEVELS,
    gap: float = np.inf,
) -> LocalMap:
    """Return the local map of a cloud.

    Where beams lie so far apart that the points of a surface would count each for itself, the next scan's, met in
    between, would seem to lie elsewhere: the line between neighbours on one surface is filled in.

    Args:
        cloud: points of one scan, or of several.
        bounds: xmin, ymin, xmax, ymax to which it is cut.
        levels: resolutions.
        gap: metres from which on the line between neighbours is filled in.
    """
    points, normals = _surfaces(cloud, gap)
    if bounds is not None:
        low, high = np.array(bounds[:2]), np.array(bounds[2:])
        inside = ((points >= low) & (points <= high)).all(axis=1)
        points, normals = points[inside], normals[inside]
    if len(points) == 0:
        points, normals = np.zeros((1, 2)) if bounds is None else 0.5 * (low + high)[None] + 1e6, np.zeros((1, 2))
    x0, y0 = points.min(axis=0) - (REACH + CELL * 2**levels)
    columns, rows = (int(v) for v in np.ceil((points.max(axis=0) + REACH - [x0, y0]) / CELL) + 1)
    place = ((points - [x0, y0]) / CELL).astype(np.int64)
    _, at, counts = np.unique(place[:, 1] * columns + place[:, 0], return_inverse=True, return_counts=True)
    sums = [np.bincount(at, values, len(counts)) / counts for values in (*points.T, *normals.T)]
    means, across = np.column_stack(sums[:2]), np.column_stack(sums[2:])
    length = np.hypot(*across.T)
    # Points of two sides of something thin, or of a corner, have no direction in common.
    across = np.where((length > 0.7)[:, None], across / np.maximum(length, 1e-9)[:, None], 0.0)
    nearest, likelihood = _grids(means, float(x0), float(y0), rows, columns, levels)
    for k in range(1, levels):
        half, below, level = 2 ** (k - 1), likelihood[k - 1], likelihood[k]
        level[:] = below
        np.maximum(level[:-half], below[half:], out=level[:-half])
        np.maximum(level[:, :-half], level[:, half:].copy(), out=level[:, :-half])
    return LocalMap(float(x0), float(y0), CELL, means, across, nearest, likelihood)


def _surfaces(cloud: PointCloud, gap: float) -> tuple[FloatArray, FloatArray]:
    """Return the points of a map and their normals, shape (n, 2) each; see :func:`local_map`."""
    points, normals, spacing = cloud
    step = np.diff(points, axis=0)
    apart = np.hypot(*step.T)
    offsets = np.abs([(step * normals[:-1]).sum(axis=1), (step * normals[1:]).sum(axis=1)]).max(axis=0, initial=0.0)
    filled = (apart > gap) & (apart <= GRAZED * np.maximum(spacing[:-1], spacing[1:]))
    filled &= ((normals[:-1] * normals[1:]).sum(axis=1) >= ALONG) & (offsets <= ASIDE[0] + ASIDE[1] * apart)
    first = np.flatnonzero(filled)
    counts = np.ceil(apart[first] / CELL).astype(np.intp) - 1
    own = np.repeat(first, counts)
    number = np.arange(1, len(own) + 1) - np.repeat(np.cumsum(counts) - counts, counts)
    between = points[own] + (number / (np.repeat(counts, counts) + 1))[:, None] * step[own]
    return np.concatenate([points, between]), np.concatenate([normals, normals[own]])


def levels_for(window: float) -> int:
    """Return how many resolutions a search over ``window`` metres to either side makes use of."""
    return max(1, min(LEVELS, 1 + int(np.log2(max(1.0, np.ceil(window / CELL))))))


@njit
def _grids(points, x0, y0, rows, columns, levels):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return each cell's nearest point, and the likelihood with its first level filled in."""
    nearest = np.full((rows, columns), -1, dtype=np.int32)
    squares = np.full((rows, columns), np.inf, dtype=np.float32)
    likelihood = np.zeros((levels, rows, columns), dtype=np.uint8)
    k = ceil(REACH / CELL)
    limit = np.float32((REACH / CELL) ** 2)
    for i in range(len(points)):
        px, py = (points[i, 0] - x0) / CELL, (points[i, 1] - y0) / CELL
        column, row = floor(px), floor(py)
        for r in range(max(0, row - k), min(rows, row + k + 1)):
            across = np.float32((r + 0.5 - py) ** 2)
            for c in range(max(0, column - k), min(columns, column + k + 1)):
                square = across + np.float32((c + 0.5 - px) ** 2)
                if square <= limit and square < squares[r, c]:
                    squares[r, c] = square
                    nearest[r, c] = i
    factor = -0.5 * (CELL / SIGMA) ** 2
    for r in range(rows):
        for c in range(columns):
            if nearest[r, c] >= 0:
                likelihood[0, r, c] = np.uint8(255.0 * exp(factor * squares[r, c]) + 0.5)
    return nearest, likelihood


def off_surfaces(area: LocalMap, points: FloatArray) -> FloatArray:
    """Return how far points, shape (n, 2), lie from the nearest of a map's, shape (n,), metres; infinite over REACH."""
    inside, row, column = _cells_of(area, points)
    away = np.full(len(points), np.inf)
    at = area.nearest[row, column]
    away[inside] = np.where(at >= 0, np.hypot(*(points[inside] - area.points[at]).T), np.inf)
    return away


def _cells_of(area: LocalMap, points: FloatArray) -> tuple[NDArray[np.bool_], NDArray[np.intp], NDArray[np.intp]]:
    """Return which points, shape (n, 2), lie in a map's grid, and the rows and columns of those."""
    column, row = np.floor((points - [area.x0, area.y0]) / area.cell).astype(np.intp).T
    rows, columns = area.nearest.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    return inside, row[inside], column[inside]


def in_view(cloud: PointCloud, points: FloatArray) -> NDArray[np.bool_]:
    """Return which points lie where a scan's beams passed, or at the surfaces that they met, shape (n,).

    Args:
        cloud: the scan's end points, in the frame of its robot.
        points: shape (n, 2), in that frame.
    """
    if len(cloud.points) < 2:
        return np.zeros(len(points), dtype=bool)
    bearings, ranges = np.arctan2(cloud.points[:, 1], cloud.points[:, 0]), np.hypot(*cloud.points.T)
    order = np.argsort(bearings)
    bearings, ranges = bearings[order], ranges[order]
    bearing, distance = np.arctan2(points[:, 1], points[:, 0]), np.hypot(*points.T)
    after = np.searchsorted(bearings, bearing).clip(1, len(bearings) - 1)
    right, left = bearings[after - 1], bearings[after]
    between = (right <= bearing) & (bearing <= left) & (left - right <= VIEW_GAP)
    return np.asarray(between & (distance <= np.maximum(ranges[after - 1], ranges[after]) + BEHIND))


# Cosine of the angle between the directions of a point's surface and of the map's, at least, where they are one.
FACING = 0.5
# Share of a match's score, at least, that points on surfaces facing as theirs have in it: otherwise it is compared
# with the match near the guess. Behind a door in a thin wall, matches that take its one face for the other have up to
# 0.7; right ones have nearly 1.
FACING_SHARE = 0.9
# By how much the mean likelihood of the points has to be better under the match near the guess for it to be taken,
# those at surfaces that face another way counted as negative.
FACING_MARGIN = 0.1
NO_PRIOR = np.zeros((3, 3))  # Information about a guess of which nothing is known.


class Match(NamedTuple):
    """Where a cloud lies in a local map."""

    pose: FloatArray  # Shape (3,).
    score: float  # Mean likelihood of the points, between 0 and 1.


def refine(
    area: LocalMap,
    cloud: PointCloud,
    pose: FloatArray,
    *,
    information: FloatArray = NO_PRIOR,
    guess: FloatArray | None = None,
) -> Match:
    """Return the pose near ``pose`` that moves the cloud's points onto the map's lines.

    Args:
        area: the map.
        cloud: in the frame at the pose.
        pose: from where on, shape (3,).
        information: inverse covariance of the guess, shape (3, 3).
        guess: what is known beforehand, shape (3,); ``pose`` by default.
    """
    mean = np.asarray(pose if guess is None else guess, dtype=np.float64)
    found, score = _refine(
        area.nearest, area.likelihood[0], area.x0, area.y0, area.cell, area.points, area.normals,
        cloud.points, cloud.normals, np.asarray(pose, dtype=np.float64), mean, information,
    )  # fmt: skip
    found[2] = wrap(found[2])
    return Match(found, score)


def facing_score(area: LocalMap, cloud: PointCloud, pose: FloatArray) -> float:
    """Return the mean likelihood of points under a pose, where those at surfaces that face another way count as 0.

    The faces of a thin wall lie a wall's thickness apart: points of the one do not lie on the other, however near, and
    none is seen from behind.
    """
    points, normals, _ = transformed(cloud, pose)
    inside, row, column = _cells_of(area, points)
    across, own, ray = area.normals[area.nearest[row, column]], normals[inside], points[inside] - pose[:2]
    seen = (across * ray).sum(axis=1) <= 0.0
    same = np.where(own.any(axis=1), (across * own).sum(axis=1) >= FACING, seen) | ~across.any(axis=1)
    return float(area.likelihood[0, row, column][same].sum()) / (255.0 * len(points))


def refine_by_faces(
    area: LocalMap, cloud: PointCloud, start: FloatArray, guess: FloatArray, information: FloatArray
) -> Match:
    """Return the pose near ``start``, unless the cloud's surfaces face as the map's do near the guess alone.

    A search asks how near points come to surfaces, not how these face; see :func:`refine`.
    """
    match = refine(area, cloud, start, information=information, guess=guess)
    facing = facing_score(area, cloud, match.pose)
    if facing >= FACING_SHARE * match.score:
        return match
    near = refine(area, cloud, guess, information=information)
    near_facing = facing_score(area, cloud, near.pose)
    return near if 2.0 * near_facing - near.score > 2.0 * facing - match.score + FACING_MARGIN else match


@njit
def _refine(nearest, likelihood, x0, y0, cell, lines, across, points, normals, pose, mean, information):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the pose after Gauss-Newton steps, and the mean likelihood of its points."""
    rows, columns = nearest.shape
    x, y, theta = pose
    H, b, J = np.empty((3, 3)), np.empty(3), np.empty(3)  # noqa: N806 # the normal equations' own symbols
    score = 0.0
    for step in range(30):
        # What lies farther off than this is taken to belong elsewhere; less so as the pose gets better.
        scale = max(0.05, 0.25 * 0.7**step)
        c, s = cos(theta), sin(theta)
        H[:] = information
        dx, dy = mean[0] - x, mean[1] - y
        turn = atan2(sin(mean[2] - theta), cos(mean[2] - theta))
        for i in range(3):
            b[i] = information[i, 0] * dx + information[i, 1] * dy + information[i, 2] * turn
        score = 0.0
        for i in range(len(points)):
            rx, ry = c * points[i, 0] - s * points[i, 1], s * points[i, 0] + c * points[i, 1]
            column, row = floor((x + rx - x0) / cell), floor((y + ry - y0) / cell)
            if not (0 <= row < rows and 0 <= column < columns):
                continue
            score += likelihood[row, column]
            j = nearest[row, column]
            if j < 0:
                continue
            ex, ey = x + rx - lines[j, 0], y + ry - lines[j, 1]
            nx, ny = across[j]
            mx, my = c * normals[i, 0] - s * normals[i, 1], s * normals[i, 0] + c * normals[i, 1]
            if nx == 0.0 and ny == 0.0:
                # No line: the point itself, which the scanner's beams need not have met again.
                weight = 0.25 / (SIGMA**2 * (1.0 + (ex * ex + ey * ey) / scale**2) ** 2)
                for axis in range(2):
                    J[0], J[1] = 1.0 - axis, float(axis)
                    J[2] = -ry if axis == 0 else rx
                    error = ex if axis == 0 else ey
                    for a in range(3):
                        b[a] -= weight * J[a] * error
                        for d in range(3):
                            H[a, d] += weight * J[a] * J[d]
                continue
            # The other face of a thin wall, or another surface; a face is not seen from behind.
            if (mx * nx + my * ny < FACING) if mx != 0.0 or my != 0.0 else nx * rx + ny * ry > 0.0:
                continue
            error = nx * ex + ny * ey
            weight = 1.0 / (SIGMA**2 * (1.0 + (error / scale) ** 2) ** 2)
            J[0], J[1], J[2] = nx, ny, ny * rx - nx * ry
            for a in range(3):
                b[a] -= weight * J[a] * error
                for d in range(3):
                    H[a, d] += weight * J[a] * J[d]
        for a in range(3):
            H[a, a] += 1e-6
        delta = np.linalg.solve(H, b)
        x, y, theta = x + delta[0], y + delta[1], theta + delta[2]
        if step > 5 and abs(delta[0]) + abs(delta[1]) < 1e-4 and abs(delta[2]) < 1e-5:
            break
    return np.array([x, y, theta]), score / (255.0 * max(1, len(points)))


FREE = 1.0  # Metres: the standard deviation along a direction in which the map does not hold the scan.


class Window(NamedTuple):
    """How far from the first guess a match is searched for, to either side."""

    xy: float  # Metres along x and along y.
    theta: float  # Radians.


# How far a pose lies from another, at least, that is another place: metres, or radians.
ELSEWHERE = Window(0.5, radians(15.0))


def search(
    area: LocalMap,
    points: FloatArray,
    guess: FloatArray,
    window: Window,
    *,
    information: FloatArray = NO_PRIOR,
    coarseness: int = 1,
    min_score: float = 0.0,
    apart_from: FloatArray | None = None,
) -> Match | None:
    """Return the pose of the window under which the points are likeliest, to a cell and the angle that is worth one.

    Args:
        area: the map.
        points: shape (n, 2), in the frame at the pose that is searched for.
        guess: the window's centre, shape (3,).
        window: how large it is.
        information: inverse covariance of the guess, shape (3, 3), of which the diagonal counts. A point that the map
            explains counts as much as a factor e of likelihood.
        coarseness: the angles tried move far points by so many cells.
        min_score: a match must have more.
        apart_from: leave out the poses that are nearer to this one than ELSEWHERE.

    Returns:
        The match, or None where none has more than ``min_score``.
    """
    if len(points) == 0:
        return None
    step = coarseness * angle_step(points, area.cell)
    turns = ceil(window.theta / step)
    cells = ceil(window.xy / area.cell)
    level = max(0, min(len(area.likelihood) - 1, int(np.log2(max(1, cells)))))
    other = np.array([np.inf, np.inf, 0.0]) if apart_from is None else np.asarray(apart_from, dtype=np.float64)
    found, score, penalty = _search(
        area.likelihood, area.x0, area.y0, area.cell, np.ascontiguousarray(points), np.asarray(guess, dtype=np.float64),
        cells, turns, step, level, np.diag(information).copy(), float(min_score), other,
    )  # fmt: skip
    return Match(found, score + penalty) if score > min_score else None


def angle_step(points: FloatArray, cell: float) -> float:
    """Return the angle (radians) that moves the far points of a cloud by a cell."""
    far = float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.9))
    return cell / min(max(far, 1.0), 20.0)


def match_covariance(
    area: LocalMap, points: FloatArray, pose: FloatArray, half: float = 0.5, scatter: float = SIGMA
) -> tuple[FloatArray, bool]:
    """Return the covariance of a match by the correlation surface, and whether a direction is left open.

    The surface counts as the likelihood's logarithm, a point in the map's middle as 1 (Olson 2009, section III-D).

    Args:
        area: the map.
        points: shape (n, 2).
        pose: the match, shape (3,).
        half: metres to either side that the surface is looked at.
        scatter: metres by which end points lie off the map's surfaces, one standard deviation: the map takes SIGMA.

    Returns:
        Shape (3, 3), of x, y (in the map's axes), theta; and whether the map leaves the place along some direction
        open, which then has the standard deviation FREE.
    """
    step, cells = angle_step(points, area.cell), ceil(half / area.cell)
    covariance = _surface(
        area.likelihood[0], area.x0, area.y0, area.cell, points, np.asarray(pose, dtype=np.float64), cells, 5, step
    )
    covariance += np.diag([area.cell**2, area.cell**2, step**2]) / 12.0
    values, vectors = np.linalg.eigh(covariance[:2, :2])
    covariance *= (scatter / SIGMA) ** 2
    # Wider than half of a surface that is level from one end to the other.
    if values[1] <= half**2 / 6.0:
        return covariance, False
    open_way = np.append(vectors[:, 1], 0.0)
    return covariance + FREE**2 * np.outer(open_way, open_way), True


@callee
def _sum(level, xs, ys, dx, dy):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the sum of one resolution's likelihood over cells, moved by (dx, dy) cells."""
    rows, columns = level.shape
    total = 0
    for i in range(len(xs)):
        r, c = ys[i] + dy, xs[i] + dx
        if 0 <= r < rows and 0 <= c < columns:
            total += level[r, c]
    return total


@callee
def _cells(points, x, y, theta, x0, y0, cell, xs, ys):  # type: ignore[no-untyped-def]  # numba infers the types
    """Write the column and the row of each point under a pose."""
    c, s = cos(theta), sin(theta)
    for i in range(len(points)):
        xs[i] = floor((x + c * points[i, 0] - s * points[i, 1] - x0) / cell)
        ys[i] = floor((y + s * points[i, 0] + c * points[i, 1] - y0) / cell)


@callee
def _nearest_square(low, high):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the smallest square of the whole numbers from ``low`` to ``high``."""
    return 0.0 if low <= 0 <= high else float(min(low * low, high * high))


@njit
def _search(levels, x0, y0, cell, points, guess, cells, turns, step, top, weights, min_score, other):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the best pose of the lattice, its score less the guess's penalty, and that penalty, by branch and bound.

    A node is a square of 2^level x 2^level places at one heading. Its bound: the sum of that level's likelihood.
    """
    n, rotations = len(points), 2 * turns + 1
    xs, ys = np.empty((rotations, n), dtype=np.int32), np.empty((rotations, n), dtype=np.int32)
    for k in range(rotations):
        _cells(points, guess[0], guess[1], guess[2] + (k - turns) * step, x0, y0, cell, xs[k], ys[k])
    side = 2**top
    tiles = (2 * cells + side) // side
    count = rotations * tiles * tiles
    bounds = np.empty(count)
    per = 1.0 / (255.0 * n)
    wx, wy, wt = 0.5 * weights[0] * cell**2 / n, 0.5 * weights[1] * cell**2 / n, 0.5 * weights[2] * step**2 / n
    for k in range(rotations):
        for i in range(tiles):
            for j in range(tiles):
                dx, dy = i * side - cells, j * side - cells
                penalty = wt * (k - turns) ** 2
                penalty += wx * _nearest_square(dx, dx + side - 1) + wy * _nearest_square(dy, dy + side - 1)
                bounds[(k * tiles + i) * tiles + j] = per * _sum(levels[top], xs[k], ys[k], dx, dy) - penalty
    best, lost, place = min_score, 0.0, guess.copy()
    stack, values = np.empty((4 * top + 4, 3), dtype=np.int64), np.empty(4 * top + 4)
    for at in np.argsort(-bounds):
        if bounds[at] <= best:
            break
        k = at // (tiles * tiles)
        stack[0] = (at // tiles) % tiles * side - cells, at % tiles * side - cells, top
        values[0] = bounds[at]
        height = 1
        while height > 0:
            height -= 1
            if values[height] <= best:
                continue
            dx, dy, level = stack[height]
            if level == 0:
                x, y, theta = guess[0] + dx * cell, guess[1] + dy * cell, guess[2] + (k - turns) * step
                turned = abs(atan2(sin(theta - other[2]), cos(theta - other[2])))
                if turned < ELSEWHERE.theta and (x - other[0]) ** 2 + (y - other[1]) ** 2 < ELSEWHERE.xy**2:
                    continue
                best = values[height]
                lost = wt * (k - turns) ** 2 + wx * dx**2 + wy * dy**2
                place[0], place[1], place[2] = x, y, theta
                continue
            half = 2 ** (level - 1)
            first = height
            for ex in (0, half):
                for ey in (0, half):
                    cx, cy = dx + ex, dy + ey
                    if cx > cells or cy > cells:
                        continue
                    value = per * _sum(levels[level - 1], xs[k], ys[k], cx, cy) - wt * (k - turns) ** 2
                    value -= wx * _nearest_square(cx, cx + half - 1) + wy * _nearest_square(cy, cy + half - 1)
                    if value <= best:
                        continue
                    # The best child on top of the stack.
                    spot = height
                    while spot > first and values[spot - 1] > value:
                        values[spot], stack[spot] = values[spot - 1], stack[spot - 1]
                        spot -= 1
                    values[spot] = value
                    stack[spot] = cx, cy, level - 1
                    height += 1
    return place, best, lost


@njit
def _surface(likelihood, x0, y0, cell, points, pose, cells, turns, step):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the covariance of x, y, theta by the correlation surface, shape (3, 3)."""
    n, width = len(points), 2 * cells + 1
    rows, columns = likelihood.shape
    xs, ys = np.empty(n, dtype=np.int32), np.empty(n, dtype=np.int32)
    sums = np.empty((2 * turns + 1, width, width))
    whole = np.empty((width, width), dtype=np.int32)
    for k in range(2 * turns + 1):
        _cells(points, pose[0], pose[1], pose[2] + (k - turns) * step, x0, y0, cell, xs, ys)
        whole[:] = 0
        # Point by point: what lies around one is added row by row, many cells at a time. Unsigned indices, since numba
        # would ask of each signed one whether it counts from the end.
        for p in range(n):
            row, column = ys[p] - cells, xs[p] - cells
            first, last = max(0, -column), min(width, columns - column)
            for i in range(max(0, -row), min(width, rows - row)):
                for j in range(first, last):
                    whole[np.uint32(i), np.uint32(j)] += likelihood[np.uint32(row + i), np.uint32(column + j)]
        sums[k] = whole.T / 255.0  # by x, then by y
    top = sums.max()
    moments, total = np.zeros((3, 3)), 0.0
    d = np.empty(3)
    for k in range(2 * turns + 1):
        for i in range(width):
            for j in range(width):
                weight = exp(sums[k, i, j] - top)
                if weight < 1e-9:
                    continue
                d[0], d[1], d[2] = (i - cells) * cell, (j - cells) * cell, (k - turns) * step
                total += weight
                for a in range(3):
                    for b in range(3):
                        moments[a, b] += weight * d[a] * d[b]
    return moments / total
