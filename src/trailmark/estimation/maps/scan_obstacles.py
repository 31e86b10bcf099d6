"""What a map's tracks and its grid come to: walls, discs, groups of cells, and the unknown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.maps.evidence import EvidenceGrid
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.maps.obstacle_estimates import wall_estimate
from trailmark.estimation.scans.tracks import DiscTracks, LineTracks
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Shape
from trailmark.world import ObstacleEstimate

__all__ = ["MapObstacles", "find_obstacles"]

BoolArray = NDArray[np.bool_]
Found = list[tuple[ObstacleEstimate, FloatArray]]
"""Obstacles, each with its end points, shape (n, 2)."""

GAP = 0.3
"""Metres between stretches of a wall that count as joined, unless beams passed between them."""

MIN_WALL = 0.2
"""Shortest stretch that becomes a wall, metres."""

THICKNESS = 0.05
"""Metres that walls reach behind the front that was seen."""

EXPLAINED = 0.1
"""Metres from a wall or disc within which occupied cells count as part of it; a cell in any case: its points lie
anywhere in theirs."""

MAX_UNKNOWN_CELLS = 4
"""Cells of an unknown patch, met by no beam, up to which it counts as free like what is around it."""

PIERCED = 0.05
"""Share of a disc's inner cells that beams went through, from which on it is none: short arcs, such as the two faces at
the end of a thin wall, fit circles that reach into free space. Of real posts and columns no inner cell is passed."""


class MapObstacles(NamedTuple):
    """The obstacles of a map."""

    walls: Found
    """Stretches of lines."""
    discs: Found
    heaps: list[ObstacleEstimate]
    """Groups of occupied cells that no wall and no disc explains."""
    unknown: list[Shape]
    """What no beam has reached, if that counts as blocked."""


def find_obstacles(
    lines: LineTracks, discs: DiscTracks, grid: EvidenceGrid, x: FloatArray, s: MappingSettings
) -> MapObstacles:
    """Return the obstacles that confirmed tracks and a grid come to.

    Args:
        lines: confirmed.
        discs: confirmed.
        grid: hits and passes.
        x: where the robot was, shape (m, 3).
        s: how to go about it.
    """
    occupied = grid.occupied()
    seen_free = (grid.passes > 0) & ~occupied
    if s.unknown == "blocked":
        seen_free = _reached(seen_free | _small_patches((grid.passes == 0) & (grid.hits == 0)), grid, x)
    walls = _walls(lines, grid, occupied, s)
    posts = _posts(discs, grid, occupied)
    if s.unknown == "blocked":
        walls, posts = (_facing(found, seen_free, grid) for found in (walls, posts))
    explained = _explained(occupied, [estimate.mean for estimate, _ in walls + posts], grid)
    heaps, unknown = _cells(grid, occupied & ~explained, explained, seen_free, s)
    return MapObstacles(walls, posts, heaps, unknown)


def _walls(tracks: LineTracks, grid: EvidenceGrid, occupied: BoolArray, s: MappingSettings) -> Found:
    """Return the stretches of the lines where walls stand, each with its end points."""
    width, walls = 2.0 * grid.cell, []
    for at in range(len(tracks)):
        rho, alpha = tracks.states[at]
        across, along = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
        points = np.concatenate(tracks.readings[at])
        points = points[np.abs(points @ across - rho) <= EXPLAINED]
        if len(points) == 0:
            continue
        places = points @ along
        bins = np.floor((places - places.min()) / width).astype(np.intp)
        middle = places.min() + width * (np.arange(bins.max() + 1) + 0.5)
        # Half a bin along the line, and a cell to either side of it.
        shifts = [u * 0.25 * width * along + v * grid.cell * across for u in (-1, 1) for v in (-1, 0, 1)]
        around_wall = [grid.cells(rho * across + middle[:, None] * along + shift) for shift in shifts]
        solid = np.any([occupied[where] for where in around_wall], axis=0)
        passed = ~solid & np.all([grid.passes[where] > 0 for where in around_wall], axis=0)
        standing = (np.bincount(bins) >= 2) & solid
        for first, last in _stretches(standing, passed, round(GAP / width)):
            own = (bins >= first) & (bins <= last)
            span = (float(places[own].min()), float(places[own].max()))
            if span[1] - span[0] >= MIN_WALL:
                covariance = tracks.covariance(at)
                cells = grid.cells(points[own])
                along_sigma = math.sqrt(_place_variance(grid.hits[cells], grid.variance[cells], s))
                wall = wall_estimate((rho, alpha), covariance, span, thickness=THICKNESS, along_sigma=along_sigma)
                walls.append((wall, points[own]))
    return walls


def _stretches(standing: BoolArray, passed: BoolArray, gap: int) -> list[tuple[int, int]]:
    """Return first and last of the runs of ``standing``, joined over at most ``gap`` bins that nothing passed."""
    runs = list[tuple[int, int]]()
    for at in np.flatnonzero(standing).tolist():
        if runs and at - runs[-1][1] - 1 <= gap and not passed[runs[-1][1] + 1 : at].any():
            runs[-1] = runs[-1][0], at
        else:
            runs.append((at, at))
    return runs


def _posts(tracks: DiscTracks, grid: EvidenceGrid, occupied: BoolArray) -> Found:
    """Return the discs that still stand and that no beam went through, each with its end points."""
    from scipy import ndimage

    near, found = ndimage.binary_dilation(occupied), []
    passed = (grid.passes > 0) & ~occupied
    for at in range(len(tracks)):
        x, y, radius = (float(v) for v in tracks.states[at])
        points = np.concatenate(tracks.readings[at])
        if radius > 0.0 and near[grid.cells(points)].mean() > 0.5:
            disc = Disc((x, y), radius)
            if _share_inside(passed, disc, grid) <= PIERCED:
                found.append((ObstacleEstimate(disc, tracks.covariance(at)), points))
    return found


def _share_inside(mask: BoolArray, disc: Disc, grid: EvidenceGrid) -> float:
    """Return the share of a mask in the cells whose centres lie half a cell or more within a disc; 0 if none do."""
    centre = np.asarray(disc.center)
    rows, columns = grid.cells(centre + disc.radius * np.array([[-1.0, -1.0], [1.0, 1.0]]))
    around = mask[rows[0] : rows[1] + 1, columns[0] : columns[1] + 1]
    places = grid.centres(np.ones_like(around)) + grid.cell * np.array([columns[0], rows[0]])
    inner = np.hypot(*(places - centre).T) <= disc.radius - 0.5 * grid.cell
    return float(around.ravel()[inner].mean()) if inner.any() else 0.0


def _facing(found: Found, reached: BoolArray, grid: EvidenceGrid) -> Found:
    """Leave out what stands beyond the reach of the robot: the unknown that is blocked covers it."""
    from scipy import ndimage

    near = ndimage.binary_dilation(reached, iterations=4)
    return [(estimate, points) for estimate, points in found if near[grid.cells(points)].mean() > 0.2]


def _explained(occupied: BoolArray, shapes: Sequence[Shape], grid: EvidenceGrid) -> BoolArray:
    """Return which of the occupied cells belong to shapes."""
    import shapely

    explained, reach = np.zeros_like(occupied), max(EXPLAINED, grid.cell)
    if shapes and occupied.any():
        tree = shapely.STRtree([shape.polygon(1e-2).shapely() for shape in shapes])
        inside, _ = tree.query(shapely.points(grid.centres(occupied)), predicate="dwithin", distance=reach)
        rows, columns = np.nonzero(occupied)
        explained[rows[inside], columns[inside]] = True
    return explained


def _small_patches(unseen: BoolArray) -> BoolArray:
    """Return the cells of patches of so few cells that they count as free."""
    from scipy import ndimage

    labels, count = ndimage.label(unseen)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    return np.asarray(unseen & (sizes[labels] <= MAX_UNKNOWN_CELLS))


def _reached(free: BoolArray, grid: EvidenceGrid, x: FloatArray) -> BoolArray:
    """Return the free cells that are joined to where the robot was."""
    from scipy import ndimage

    labels, _ = ndimage.label(free)
    own = np.unique(labels[grid.cells(x[:, :2])])
    return np.asarray(np.isin(labels, own[own > 0]))


def _cells(
    grid: EvidenceGrid, rest: BoolArray, explained: BoolArray, reached: BoolArray, s: MappingSettings
) -> tuple[list[ObstacleEstimate], list[Shape]]:
    """Return what cells must stand for: the occupied ones that nothing explains, and the unknown."""
    from scipy import ndimage

    from trailmark.formats.grid import grid_polygons

    origin, unknown = (*grid.origin, 0.0), list[Shape]()
    if s.unknown == "blocked":
        near = ndimage.binary_dilation(reached, iterations=2)
        rest, explained = rest & near, explained & near
        unknown = list(grid_polygons(~(reached | rest | explained), grid.cell, origin))
    heaps = []
    for polygon in grid_polygons(rest, grid.cell, origin):
        rows, columns = grid.cells(polygon.vertices)
        around = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        own = rest[around]
        variance = _place_variance(grid.hits[around][own], grid.variance[around][own], s)
        heaps.append(ObstacleEstimate(polygon, variance * np.eye(2)))
    return heaps, unknown


def _place_variance(hits: NDArray[np.int32], variance: NDArray[np.float32], s: MappingSettings) -> float:
    """Return the variance of a place that end points in cells, (n,) each, tell: of one reading and of one pose.

    Only so much is assumed to average out: the errors of consecutive poses are alike.
    """
    return s.scan.sigma_range**2 + float(variance.sum()) / max(1, int(hits.sum()))
