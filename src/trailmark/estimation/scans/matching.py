"""Scan matching: a cloud of end points is moved onto the lines of a local map, from a pose near by.

Point-to-line refinement (Censi 2008, "An ICP variant using a point-to-line metric") with a robust kernel. Where the
first guess may lie far off, :mod:`trailmark.estimation.scans.correlation` comes before it.
"""

from __future__ import annotations

from math import atan2, cos, floor, sin
from typing import NamedTuple

import numpy as np

from trailmark.estimation.scans.clouds import PointCloud, transformed
from trailmark.estimation.scans.local_map import SIGMA, LocalMap
from trailmark.jit import njit
from trailmark.se2 import FloatArray, wrap

__all__ = ["NO_PRIOR", "Match", "facing_score", "refine", "refine_by_faces"]

FACING = 0.5
"""Cosine of the angle between the directions of a point's surface and of the map's, at least, where they are one."""

FACING_SHARE = 0.9
"""Share of a match's score, at least, that points on surfaces facing as theirs have in it: otherwise it is compared
with the match near the guess. Behind a door in a thin wall, matches that take its one face for the other have up to
0.7; right ones have nearly 1."""

FACING_MARGIN = 0.1
"""By how much the mean likelihood of the points has to be better under the match near the guess for it to be taken,
those at surfaces that face another way counted as negative."""

NO_PRIOR = np.zeros((3, 3))
"""Information about a guess of which nothing is known."""


class Match(NamedTuple):
    """Where a cloud lies in a local map."""

    pose: FloatArray
    """Shape (3,)."""
    score: float
    """Mean likelihood of the points, between 0 and 1."""


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

    Args:
        area: the map.
        cloud: in the frame at the pose, one point or more.
        pose: shape (3,).
    """
    points, normals, _ = transformed(cloud, pose)
    column, row = np.floor((points - [area.x0, area.y0]) / area.cell).astype(np.intp).T
    rows, columns = area.nearest.shape
    inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    row, column = row[inside], column[inside]
    across, own, ray = area.normals[area.nearest[row, column]], normals[inside], points[inside] - pose[:2]
    seen = (across * ray).sum(axis=1) <= 0.0
    same = np.where(own.any(axis=1), (across * own).sum(axis=1) >= FACING, seen) | ~across.any(axis=1)
    return float(area.likelihood[0, row, column][same].sum()) / (255.0 * len(points))


def refine_by_faces(
    area: LocalMap, cloud: PointCloud, start: FloatArray, guess: FloatArray, information: FloatArray
) -> Match:
    """Return the pose near ``start``, unless the cloud's surfaces face as the map's do near the guess alone.

    A search asks how near points come to surfaces, not how these face.

    Args:
        area: the map.
        cloud: in the frame at the pose, one point or more.
        start: from where on, shape (3,).
        guess: what is known beforehand, shape (3,).
        information: inverse covariance of the guess, shape (3, 3).
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
