"""What is true of a world that was explored, by shapely and scipy: nothing of this is shared with what explores.

A disc around the robot (of its circumradius) decides where it can get to. What can be seen from there is found for
squares of :data:`SIDE`, along straight lines between their centres and places of a grid of :data:`STEP`, both larger in
worlds over :data:`LARGE`, in proportion. The shortest tour from which all of that is seen, as far as a greedy cover and
local search find it, is the lower anchor of what an exploration drives: who plans it knows the map.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from scipy.spatial import cKDTree

from trailmark.world import World

__all__ = ["Truth", "boundary_errors", "overlaps", "seen_share", "tour_length", "truth_of"]

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

SIDE, STEP = 0.2, 0.25
"""Metres."""

LARGE = 60.0
"""Metres: of a world's longer side."""

COVERED = 0.995
"""Share of what can be seen that the anchor's tour sees: no exploration need see more to be complete."""

SPACING = 0.05
"""Metres between points of a boundary."""

FLATTEST = np.radians(10.0)
"""Of lines of sight, to the surface that they end at: at flatter ones nothing is told (Borges & Aldon 2004)."""

BEFORE = 2e-3
"""Metres before a surface, where a line of sight to it ends."""

MISSED = 0.25
"""Metres: a point of a surface that is farther from the map's is missing there, and is counted as such."""

ROUNDNESS = 1e-3
"""Metres by which polygons for discs reach beyond them."""


class Truth(NamedTuple):
    """A world as it is."""

    solids: Any
    """All obstacles, a geometry of shapely, prepared."""
    room: Any
    """The bounds, a box of shapely."""
    places: FloatArray
    """Where the robot can get to, shape (m, 2), the start first."""
    ways: sparse.csr_array
    """Lengths of the ways between neighbouring places, shape (m, m), metres."""
    targets: FloatArray
    """What can be seen from there, shape (n, 2)."""
    surface: FloatArray
    """Points of obstacles' outlines that can be seen from there, shape (m, 2)."""
    max_range: float
    """Of the sensor, metres."""
    scale: float
    """By which :data:`SIDE` and :data:`STEP` are larger."""


def truth_of(world: World, max_range: float) -> Truth:
    """Return the truth about a world with a robot and a query, for a sensor that sees all around."""
    room = shapely.box(*world.bounds)
    shapes = [shape.polygon(ROUNDNESS).shapely() for shape in world.obstacles]
    if world.boundary is not None:  # what lies outside is solid
        shapes.append(room.difference(world.boundary.shapely()))
    solids = shapely.union_all(shapes)
    start = np.array(world.query().start[:2])
    reach = world.robot.circumradius
    region = _part_with(room.buffer(-reach).difference(solids.buffer(reach - ROUNDNESS, quad_segs=32)), start)
    shapely.prepare(solids)
    shapely.prepare(region)
    xmin, ymin, xmax, ymax = world.bounds
    scale = max(1.0, max(xmax - xmin, ymax - ymin) / LARGE)
    grid = _grid(world.bounds, scale * STEP)
    places = np.concatenate([start[None], grid[shapely.contains_xy(region, *grid.T)]])
    ways = _ways(places, region, scale * STEP)
    _, label = csgraph.connected_components(ways, directed=False)
    mine = label == label[0]
    places, ways = places[mine], ways[mine][:, mine]
    points = _grid(world.bounds, scale * SIDE)
    points = points[~shapely.intersects_xy(solids, *points.T)]
    seen = np.zeros(len(points), dtype=bool)
    order = np.random.default_rng(0).permutation(len(places))
    for view in places[order]:
        left = np.flatnonzero(~seen & (np.hypot(*(points - view).T) <= max_range))
        seen[left] = _in_sight(solids, view, points[left])
    surface = _surface_in_sight(solids, room, places[order], max_range)
    return Truth(solids, room, places, ways, points[seen], surface, max_range, scale)


def seen_share(truth: Truth, state: NDArray[np.uint8], origin: tuple[float, float], cell: float) -> float:
    """Return the share of what can be seen that a grid of cells, row 0 with the smallest y, has as not 0."""
    columns, rows = np.floor((truth.targets - np.array(origin)) / cell).astype(int).T
    return float((state[np.clip(rows, 0, len(state) - 1), np.clip(columns, 0, state.shape[1] - 1)] != 0).mean())


def overlaps(truth: Truth, world: World, poses: FloatArray) -> int:
    """Return in how many poses, shape (n, 3), the robot reaches into an obstacle or over the bounds by over 1 mm."""
    outline = world.robot.outline.vertices
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x = poses[:, :1] + cos * outline[:, 0] - sin * outline[:, 1]
    y = poses[:, 1:2] + sin * outline[:, 0] + cos * outline[:, 1]
    bodies = np.stack([x, y], axis=-1)
    shrunk = shapely.buffer(shapely.polygons(bodies), -2e-3)
    return int((shapely.intersects(truth.solids, shrunk) | ~shapely.covers(truth.room, shrunk)).sum())


def boundary_errors(truth: Truth, made: World) -> dict[str, float]:
    """Return how far a map's surfaces lie from the true ones: of the true ones that can be seen, and of the map's own.

    Returns:
        ``rms``: metres, of the distances from points of true surfaces to the map's nearest surface, without those
        that are missing; ``missing``: their share; ``inside``: metres, root mean square of how far points of the map's
        surfaces reach into true free space.
    """
    known = made.estimates or (None,) * len(made.obstacles)
    shapes = [shape for shape, estimate in zip(made.obstacles, known, strict=True) if estimate is not None]
    outlines = shapely.union_all([shape.polygon(ROUNDNESS).shapely() for shape in shapes])
    if outlines.is_empty:
        return {"rms": np.nan, "missing": 1.0, "inside": np.nan}
    off = shapely.distance(shapely.points(truth.surface), outlines.boundary)
    own = shapely.points(_along(outlines.boundary))
    solid = shapely.union_all([truth.solids, truth.room.exterior])
    into = shapely.distance(own, solid)[shapely.intersects(truth.room, own)]
    found = off[off <= MISSED]
    return {
        "rms": float(np.sqrt((found**2).mean())) if len(found) else np.nan,
        "missing": float((off > MISSED).mean()),
        "inside": float(np.sqrt((into**2).mean())),
    }


def tour_length(truth: Truth) -> float:
    """Return the length (metres) of a tour from the start that sees nearly all that can be seen."""
    _, first = np.unique(np.floor(truth.places / (2.0 * truth.scale * STEP)), axis=0, return_index=True)
    views = np.unique(np.append(first, 0))
    targets = truth.targets[:: max(1, len(truth.targets) // 2500)]
    sees = np.zeros((len(views), len(targets)), dtype=bool)
    for i, view in enumerate(truth.places[views]):
        near = np.flatnonzero(np.hypot(*(targets - view).T) <= truth.max_range)
        sees[i, near] = _in_sight(truth.solids, view, targets[near])
    chosen = _cover(sees)
    lengths, before = csgraph.dijkstra(truth.ways, indices=views[chosen], return_predecessors=True, directed=False)
    costs = lengths[:, views[chosen]]
    nearest = np.asarray(cKDTree(truth.places[views]).query(truth.places)[1])
    order = _open_tour(costs)
    dropped = True
    while dropped:  # what is seen on the way needs no place of its own
        dropped = False
        for node in order[1:]:
            less = [k for k in order if k != node]
            if _seen_along(less, chosen, views, before, nearest, sees).mean() >= COVERED * sees.any(axis=0).mean():
                order, dropped = _improved([*less], costs), True
                break
    return float(sum(costs[a, b] for a, b in itertools.pairwise(order)))


def _seen_along(
    order: list[int],
    chosen: list[int],
    views: NDArray[np.intp],
    before: NDArray[np.int32],
    nearest: NDArray[np.intp],
    sees: BoolArray,
) -> BoolArray:
    """Return which targets are seen from the places along a tour."""
    seen = np.zeros(sees.shape[1], dtype=bool)
    for a, b in itertools.pairwise(order):
        place = int(views[chosen[b]])
        while place >= 0:
            seen |= sees[nearest[place]]
            place = int(before[a, place])
    return seen


def _cover(sees: BoolArray) -> list[int]:
    """Return a greedy choice of rows that cover nearly all columns that any covers; row 0, the start, is the first."""
    chosen, left = [0], sees.any(axis=0) & ~sees[0]
    few = (1.0 - COVERED) * sees.any(axis=0).sum()
    while left.sum() > few:
        best = int(np.argmax(sees[:, left].sum(axis=1)))
        chosen.append(best)
        left &= ~sees[best]
    return chosen


def _open_tour(costs: FloatArray) -> list[int]:
    """Return an order of all nodes that begins with 0: the nearest next, then 2-opt and moved nodes."""
    order, left = [0], set(range(1, len(costs)))
    while left:
        order.append(min(left, key=lambda k: float(costs[order[-1], k])))
        left.discard(order[-1])
    return _improved(order, costs)


def _improved(order: list[int], costs: FloatArray) -> list[int]:
    """Return an order that no reversal of a part and no move of one node makes shorter."""

    def length(nodes: list[int]) -> float:
        return float(costs[nodes[:-1], nodes[1:]].sum())

    best, again = length(order), True
    while again:
        again = False
        for i in range(1, len(order)):
            for j in range(i + 1, len(order) + 1):
                moved = order[:i] + order[i + 1 : j] + [order[i]] + order[j:]
                for other in (order[:i] + order[i:j][::-1] + order[j:], moved):
                    if length(other) < best - 1e-9:
                        order, best, again = other, length(other), True
    return order


def _part_with(region: Any, point: FloatArray) -> Any:
    """Return the part of a geometry that is nearest to a point."""
    parts = getattr(region, "geoms", [region])
    return min(parts, key=lambda part: float(part.distance(shapely.Point(point))))


def _ways(places: FloatArray, region: Any, step: float) -> sparse.csr_array:
    """Return the graph of places up to a knight's move apart whose straight lines stay in a region."""
    pairs = cKDTree(places).query_pairs(2.3 * step, output_type="ndarray")
    lines = shapely.linestrings(places[pairs])
    pairs = pairs[shapely.covers(region, lines)]
    length = np.hypot(*(places[pairs[:, 0]] - places[pairs[:, 1]]).T)
    graph = sparse.coo_array((length, (pairs[:, 0], pairs[:, 1])), shape=(len(places), len(places)))
    return sparse.csr_array(graph + graph.T)


def _surface_in_sight(solids: Any, room: Any, places: FloatArray, max_range: float) -> FloatArray:
    """Return the points of outlines that can be seen from places, shape (n, 2)."""
    lines = shapely.segmentize(shapely.intersection(solids.boundary, room), SPACING)  # the bounds are no discovery
    ends, line = shapely.get_coordinates(shapely.get_parts(shapely.line_merge(lines)), return_index=True)
    a, b = (side[line[1:] == line[:-1]] for side in (ends[:-1], ends[1:]))
    a, b = (side[np.hypot(*(b - a).T) > 1e-9] for side in (a, b))
    points, normals = 0.5 * (a + b), np.column_stack([a[:, 1] - b[:, 1], b[:, 0] - a[:, 0]])
    normals /= np.hypot(*normals.T)[:, None]
    normals[shapely.intersects_xy(solids, *(points + BEFORE * normals).T)] *= -1.0
    targets = points + BEFORE * normals
    seen = shapely.intersects_xy(solids, *targets.T)  # between two obstacles that all but touch
    points, normals, targets, seen = points[~seen], normals[~seen], targets[~seen], seen[~seen]
    for view in places:
        away = view - targets
        distance = np.hypot(*away.T)
        facing = (away * normals).sum(axis=1) >= np.sin(FLATTEST) * distance
        left = np.flatnonzero(~seen & facing & (distance <= max_range))
        seen[left] = _in_sight(solids, view, targets[left])
    return np.asarray(points[seen])


def _in_sight(solids: Any, view: FloatArray, points: FloatArray) -> BoolArray:
    ends = np.stack([np.broadcast_to(view, points.shape), points], axis=1)
    return ~np.asarray(shapely.intersects(solids, shapely.linestrings(ends)))


def _grid(bounds: tuple[float, float, float, float], step: float) -> FloatArray:
    xs, ys = (np.arange(bounds[k] + 0.5 * step, bounds[k + 2], step) for k in (0, 1))
    return np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)


def _along(lines: Any) -> FloatArray:
    """Return points along lines."""
    return np.asarray(shapely.get_coordinates(shapely.segmentize(lines, SPACING)))
