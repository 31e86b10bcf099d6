"""Verifier: whether paths are free, where they are not, and how near they come to obstacles, whoever planned them.

It shares no code with what finds paths: no clearance field, no grid of obstacles, no kernel of
:mod:`trailmark.collision`, and curves are driven by a formula of their own. Obstacles are their edges in an R-tree; a
motion is certified by conservative advancement, the interval halved until every edge is farther away than any point of
the robot moves. Without an edge ever met, what lies outside of what in one state does so all along.

Touching is allowed: the robot that must meet nothing is its footprint less a rim.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.formats.grid import CellObstacles, cells_of
from trailmark.path import Path
from trailmark.penetration import Penetration, bounds_depth, outside_of
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.touching import TOUCHING_TOLERANCE, eroded, overlap_core
from trailmark.verify.advance import Close, least_distance, meetings
from trailmark.verify.motions import Motions, OneWayCheck, merged
from trailmark.world import Robot, World

__all__ = ["MISSED", "RIM", "Hit", "Verifier"]

RIM = 1e-6
"""Metres of a planner's own paths that are not looked at: where they touch, they may overlap by 1e-7 m, and rounding is
another here. No deeper overlap is missed, but of tips: an erosion draws a corner of angle 2a back by RIM / sin(a)."""

PIECE, MAX_PIECES = 4.0, 64
"""Circumradii that a piece of a motion is long for which nearby edges are looked up, and pieces of a motion at most."""

RESOLUTION, SHARE, COARSEST = 1e-4, 1e-6, 1e-2
"""Metres by which the ends of a collision may be off; of a long path that share of its length, so much at most."""

SHORTEST = 1e-9
"""Metres: what lies between two meetings that are nearer to one another is not looked at."""

MISSED = 1e-5
"""Metres, and radians, that a curve may end off its knot, for radii and coordinates up to 1e5 m."""

OFF_HEADING = 1e-8
"""Metres, and metres for each metre, by which a drive ahead may lead aside, for rounding."""

ALL, RUN = 2**62, 16
"""Intervals, which are never so many; consecutive edges of a ring that share a box in the tree."""

IntArray = NDArray[np.int64]
Depths = Callable[[FloatArray], FloatArray]


class Hit(NamedTuple):
    """An interval of a path on which the robot collides.

    Attributes:
        begin: place on the motions' scale.
        end: likewise.
        name: the obstacle's id, its index if it has none, ``bounds`` or ``boundary``.
        depths: how deep the robot is in it, metres, (n,), at configurations (n, 3).
    """

    begin: float
    end: float
    name: str | int
    depths: Depths


class Verifier:
    """Verifies paths of one robot in one world.

    Args:
        world: obstacles, bounds, boundary, one-way zones.
        robot: footprint, with the clearance that it keeps.
        rim: metres by which the footprint is eroded; None for all that counts as touching and no more, tips included.
    """

    def __init__(self, world: World, robot: Robot, rim: float | None = None) -> None:
        self.world, self.robot, self._rim = world, robot, TOUCHING_TOLERANCE if rim is None else rim
        shape = robot.footprint
        self._radius, self._parts = robot.clearance, list[shapely.Polygon]()
        self._body = self._whole = np.zeros((1, 4))
        if isinstance(shape, Disc):
            self._radius += max(shape.radius - self._rim, 0.5 * shape.radius)
        else:
            ring = robot.outline.rings()[0]
            parts = overlap_core(ring) if rim is None else shapely.get_parts(eroded(shapely.Polygon(ring), rim))
            # All of a footprint so thin that nothing would be left.
            self._parts = [part for part in parts if not part.is_empty] or [robot.outline.shapely()]
            self._whole = closed(ring)
            self._body = np.concatenate([closed(ring) for part in self._parts for ring in _coordinates(part)])
        cells = cells_of(world)
        self._index: EdgeIndex | CellIndex = EdgeIndex(world) if cells is None else CellIndex(world, cells)
        self.one_way = OneWayCheck(world.zones)
        self._last: tuple[Path, Motions] | None = None
        self._penetrations: dict[int, Penetration] = {}
        self._boxes: FloatArray | None = None

    def motions(self, path: Path) -> Motions:
        """Return a path's motions, on the robot's scale; of the same path again the same, and what is near them."""
        last = self._last
        if last is None or last[0] is not path:
            last = self._last = path, Motions.of(path, self.robot.sweep_radius)
        return last[1]

    def fault(self, path: Path, start: FloatArray, goal: FloatArray) -> str | None:
        """Return what is wrong with a path, or None if it leads from start to goal, is free and can be driven.

        Args:
            path: as it is to be returned.
            start: configuration, shape (3,).
            goal: configuration, shape (3,).
        """
        for name, q, state in (("start", start, path.states[0]), ("goal", goal, path.states[-1])):
            if not np.array_equal(q, state):
                return f"the path's {name} is {state.tolist()}, expected {np.asarray(q).tolist()}"
        motions = self.motions(path)
        if motions.off > MISSED:
            return f"a curve ends {motions.off:g} m or radians off its knot"
        if (problem := self._fault_at(path.states[0])) is not None:
            return problem
        if self.robot.drive == "differential" and (problem := _undriven(motions, self.robot.reverse)) is not None:
            return problem
        for motion, begin, end in self._meetings(motions, 1).tolist():
            where = f"at {0.5 * (begin + end):.6f} of its way"
            return f"motion {motion:.0f} from {motions.way.starts[int(motion)].tolist()} meets an obstacle {where}"
        for zone, begin, _, off in self.one_way.wrong_ways(motions):
            motion, _ = motions.motion(begin)
            q = motions.way.starts[motion].tolist()
            return f"motion {motion} from {q} goes {off:.6f} rad off one-way zone {zone}'s heading"
        return None

    def hits(self, motions: Motions) -> list[Hit]:
        """Return the intervals on which the robot collides with anything, obstacle by obstacle; none if it is free.

        Their ends are known to 0.1 mm.
        """
        if self._fault_at(motions.way.starts[0]) is None and not len(self._meetings(motions, 1)):
            return []
        found = []
        rows = self._meetings(motions, ALL)
        for begin, end in _intervals(motions, rows, lambda q: self._fault_at(q) is not None):
            part, hits = motions.part(begin, end), list[Hit]()
            candidates = list(self._near(*part.box()))
            if len(candidates) > 1:
                for name, shape, inside, depths in candidates:
                    edges, runs = edges_of([shape])
                    all_near = np.zeros(len(part.way.starts), np.int64), np.array([0, len(runs) - 1])
                    close = Close(*all_near, np.arange(len(runs) - 1), runs, edges)
                    rows = self._meet(part, close, ALL)
                    hits += [Hit(begin + a, begin + b, name, depths) for a, b in _intervals(part, rows, inside)]
            if not hits:
                # There is but one, or rounding hides all: what is deepest in the middle.
                middle = motions.poses(0.5 * (begin + end))
                name, _, _, depths = max(candidates, key=lambda candidate: float(candidate[3](middle)[0]))
                hits = [Hit(begin, end, name, depths)]
            found += hits
        return sorted(found, key=lambda hit: (hit.begin, hit.end, str(hit.name)))

    def clearance(self, motions: Motions, tolerance: float) -> tuple[float, float]:
        """Return the least clearance (metres) along a path that is free, and the place on its scale where that is.

        It is a configuration's own, and the true one at most the tolerance (metres) less. That of the robot itself,
        whatever clearance it is to keep.
        """
        shape = self.robot.footprint
        radius = shape.radius if isinstance(shape, Disc) else 0.0
        cap = self.robot.circumradius
        while True:
            close = self._edges_near(motions, cap)
            least, motion, share = least_distance(self._whole, radius, motions.way, close, cap, tolerance)
            if motion >= 0 or cap > 1e9:
                return float(least), float(motions.place(max(motion, 0), share))
            cap *= 4.0

    def _meetings(self, motions: Motions, most: int) -> FloatArray:
        """Return intervals in which the robot may meet an edge, rows (motion, from, to); at most so many."""
        return self._meet(motions, self._edges_near(motions, self.robot.circumradius), most)

    def _meet(self, motions: Motions, close: Close, most: int) -> FloatArray:
        resolution = min(max(RESOLUTION, SHARE * motions.total), COARSEST)
        return np.asarray(meetings(self._body, self._radius, motions.way, close, resolution, most))

    def _edges_near(self, motions: Motions, cap: float) -> Close:
        """Return the edges within ``cap`` metres of the robot anywhere in each group.

        Long motions are looked up in pieces: the box of a slanting one holds many obstacles that it does not come near.
        Short ones are so together.
        """
        if motions.near is not None and motions.near[0] == cap:
            return motions.near[1]
        reach, lengths = self.robot.circumradius, motions.lengths
        longest = PIECE * reach
        count = np.ceil(np.clip(lengths / longest, 1.0, MAX_PIECES)).astype(np.int64)
        count[motions.arcs] = 1
        alone, along = count > 1, np.floor((np.cumsum(lengths) - lengths) / longest)
        group = np.cumsum(np.append(False, alone[1:] | alone[:-1] | (along[1:] != along[:-1])))
        of = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)) / count[of]
        way = np.where(motions.arcs[:, None], 0.0, motions.way.moves[:, :2])
        begin = motions.way.starts[of, :2] + share[:, None] * way[of]
        end = begin + (way / count[:, None])[of]
        room = (np.where(motions.arcs, lengths, 0.0) + reach + cap)[of, None]
        box = np.flatnonzero(np.append(True, group[of[1:]] != group[of[:-1]]) | alone[of])
        low = np.minimum.reduceat(np.minimum(begin, end) - room, box)
        high = np.maximum.reduceat(np.maximum(begin, end) + room, box)
        close = self._index.near(low, high, group[of[box]], group)
        motions.near = cap, close
        return close

    def _fault_at(self, q: FloatArray) -> str | None:
        """Return what is wrong with a state: overlap, one inside the other included."""
        xmin, ymin, xmax, ymax = self.world.bounds
        body, radius = self._placed(q), self._radius
        box = shapely.total_bounds(body)
        low, high = box[:2] - radius, box[2:] + radius
        if min(low[0] - xmin, low[1] - ymin, xmax - high[0], ymax - high[1]) < 0.0:
            return f"state {q.tolist()} reaches over the bounds"
        if self.world.boundary is not None and self._leaves(self.world.boundary, q):
            return f"state {q.tolist()} reaches over the boundary"
        for shape in self._index.shapes_near(low, high):
            if self._overlaps(shape, q):
                known = self.world.obstacles
                name = known.index(shape) if isinstance(known, tuple) else f"cells in {shape.bounding_box()}"
                return f"state {q.tolist()} overlaps obstacle {name}"
        return None

    def _placed(self, q: FloatArray) -> NDArray[Any]:
        """Return the parts of the robot less its rim at a configuration, (3,); of a disc the centre."""
        if not self._parts:
            return np.array([shapely.Point(q[:2])])
        rings = [[se2.transform(q, ring) for ring in _coordinates(part)] for part in self._parts]
        return np.array([shapely.Polygon(outer, holes) for outer, *holes in rings])

    def _overlaps(self, shape: Shape, q: FloatArray) -> bool:
        """Return whether the robot at a configuration, (3,), overlaps a shape."""
        body = self._placed(q)
        if isinstance(shape, Disc):
            return bool(shapely.distance(shapely.Point(shape.center), body).min() < self._radius + shape.radius)
        region = shape.polygon().shapely()
        if self._radius > 0.0:
            return bool(shapely.distance(region, body).min() < self._radius)
        return bool(shapely.intersects(region, body).any())

    def _leaves(self, region: Polygon, q: FloatArray) -> bool:
        """Return whether the robot at a configuration, (3,), reaches out of a region."""
        body, inside = self._placed(q), region.shapely()
        return bool(
            not shapely.covers(inside, body).all() or shapely.distance(inside.exterior, body).min() < self._radius
        )

    def _near(
        self, low: FloatArray, high: FloatArray
    ) -> Iterator[tuple[str | int, Shape, Callable[[FloatArray], bool], Depths]]:
        """Yield what may block the robot whose reference point is in a box: name, shape, overlap, depths."""
        world, body, reach = self.world, self.robot.footprint, self.robot.circumradius + SHORTEST
        low, high = low - reach, high + reach
        if (low < world.bounds[:2]).any() or (high > world.bounds[2:]).any():
            around = frame(world.bounds)
            yield "bounds", around, partial(self._leaves, around), partial(bounds_depth, body, world.bounds)
        if world.boundary is not None:
            if -1 not in self._penetrations:
                outside = outside_of(world.boundary, 2.0 * world.extent + 8.0 * self.robot.circumradius)
                self._penetrations[-1] = Penetration(body, outside)
            yield "boundary", world.boundary, partial(self._leaves, world.boundary), self._penetrations[-1].at
        if self._boxes is None:
            self._boxes = np.array([shape.bounding_box() for shape in world.obstacles]).reshape(-1, 4)
        boxes = self._boxes
        for i in np.flatnonzero((boxes[:, :2] <= high).all(axis=1) & (boxes[:, 2:] >= low).all(axis=1)).tolist():
            shape, name = world.obstacles[i], world.ids[i] if world.ids else None
            if i not in self._penetrations:
                self._penetrations[i] = Penetration(body, shape)
            yield (i if name is None else name), shape, partial(self._overlaps, shape), self._penetrations[i].at


def _intervals(
    motions: Motions, rows: FloatArray, overlapping: Callable[[FloatArray], bool]
) -> list[tuple[float, float]]:
    """Return the places from and to which the robot overlaps something.

    Args:
        motions: of the path.
        rows: the intervals in which it meets an edge of that, (n, 3).
        overlapping: tells of a configuration, shape (3,), that meets none.
    """
    met = merged(np.column_stack([motions.place(rows[:, 0], rows[:, k]) for k in (1, 2)]))
    ends = [0.0, *(place for each in met for place in each), motions.total]
    # Between two meetings it is inside all along, or outside.
    gaps = zip(ends[::2], ends[1::2], strict=True)
    inside = [(a, b) for a, b in gaps if b - a > SHORTEST or not met if overlapping(motions.poses(0.5 * (a + b))[0])]
    return merged(met + inside)


def _coordinates(part: shapely.Polygon) -> list[FloatArray]:
    """Return the rings of a polygon, not closed, each of shape (n, 2)."""
    return [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]


def _undriven(motions: Motions, reverse: bool) -> str | None:
    """Return what motions a differential drive cannot make; None if it can all."""
    moves, heading = motions.way.moves, motions.way.starts[:, 2]
    ahead = np.cos(heading) * moves[:, 0] + np.sin(heading) * moves[:, 1]
    aside = np.abs(np.cos(heading) * moves[:, 1] - np.sin(heading) * moves[:, 0])
    turns_only = motions.lengths == 0.0
    drives_only = (moves[:, 2] == 0.0) & (aside <= OFF_HEADING * (1.0 + motions.lengths)) & (reverse | (ahead >= 0.0))
    wrong = np.flatnonzero(~(turns_only | drives_only))
    return f"motion {wrong[0]} is neither a turn in place nor a drive ahead" if len(wrong) else None


# --- The edges of all that blocks, and which of them are near.


class EdgeIndex:
    """The edges of bounds, boundary and obstacles in runs of a few, in an R-tree.

    Args:
        world: obstacles, bounds, boundary.
    """

    def __init__(self, world: World) -> None:
        self._obstacles = world.obstacles
        boundary = () if world.boundary is None else (world.boundary,)
        self._edges, self._runs = edges_of([frame(world.bounds), *boundary, *world.obstacles])
        self._boxes = np.array([shape.bounding_box() for shape in world.obstacles]).reshape(-1, 4).T
        low = np.minimum(self._edges[:, :2], self._edges[:, 2:4]) - self._edges[:, 4:]
        high = np.maximum(self._edges[:, :2], self._edges[:, 2:4]) + self._edges[:, 4:]
        low, high = np.minimum.reduceat(low, self._runs[:-1]), np.maximum.reduceat(high, self._runs[:-1])
        self._tree = shapely.STRtree(shapely.box(*low.T, *high.T))
        # It is made by the first query: now, not within a query's time.
        self._tree.query(shapely.box(0.0, 0.0, 0.0, 0.0))

    def near(self, low: FloatArray, high: FloatArray, boxes: IntArray, groups: IntArray) -> Close:
        """Return the edges near any of the boxes of each group of motions.

        Args:
            low: lower left corners of the boxes, (n, 2), metres.
            high: their upper right corners, (n, 2).
            boxes: which group each box is of, (n,), rising.
            groups: of the motions, (m,), rising.
        """
        box, run = self._tree.query(shapely.box(*low.T, *high.T))
        first, items = _once_in_each(boxes[box], run, len(self._runs), groups[-1] + 1)
        return Close(groups, first, items, self._runs, self._edges)

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the obstacles whose bounding boxes meet the box from ``low`` to ``high``, shapes (2,)."""
        left, bottom, right, top = self._boxes
        near = (left <= high[0]) & (right >= low[0]) & (bottom <= high[1]) & (top >= low[1])
        return [self._obstacles[i] for i in np.flatnonzero(near)]


class CellIndex:
    """What :class:`EdgeIndex` is, of a grid map's cells, whose places need no tree to be found.

    A run is an edge of bounds or boundary, or the four edges of an occupied cell beside a free one.

    Args:
        world: bounds and boundary.
        cells: all its obstacles.
    """

    def __init__(self, world: World, cells: CellObstacles) -> None:
        boundary = () if world.boundary is None else (world.boundary,)
        self._fixed = edges_of([frame(world.bounds), *boundary])[0]
        occupied = self._occupied = cells.occupied
        rows, columns = occupied.shape
        # The same products that the polygons' corners are.
        self._x = np.arange(columns + 1) * cells.cell + cells.origin[0]
        self._y = np.arange(rows + 1) * cells.cell + cells.origin[1]
        wide = np.pad(occupied, 1)
        self._rim = occupied & ~(wide[1:-1, :-2] & wide[1:-1, 2:] & wide[:-2, 1:-1] & wide[2:, 1:-1])

    def near(self, low: FloatArray, high: FloatArray, boxes: IntArray, groups: IntArray) -> Close:
        """Return what :meth:`EdgeIndex.near` does; the runs and edges are those of the cells near any box only."""
        found, fixed, count = [np.empty(0, np.int64)], len(self._fixed), groups[-1] + 1
        for rows, columns in zip(self._window(self._y, low, high, 1), self._window(self._x, low, high, 0), strict=True):
            row, column = np.nonzero(self._rim[rows, columns])
            found.append((row + rows.start) * self._rim.shape[1] + column + columns.start)
        cells, run = np.unique(np.concatenate(found), return_inverse=True)
        group = np.repeat(boxes, [len(each) for each in found[1:]])
        group = np.concatenate([np.repeat(np.arange(count), fixed), group])
        run = np.concatenate([np.tile(np.arange(fixed), count), fixed + run])
        first, items = _once_in_each(group, run, fixed + len(cells), count)
        row, column = np.divmod(cells, self._rim.shape[1])
        x1, x2, y1, y2 = self._x[column], self._x[column + 1], self._y[row], self._y[row + 1]
        around = np.column_stack([x1, y1, x2, y1, x2, y1, x2, y2, x2, y2, x1, y2, x1, y2, x1, y1]).reshape(-1, 4)
        edges = np.concatenate([self._fixed, np.column_stack([around, np.zeros(len(around))])])
        runs = np.concatenate([np.arange(fixed), fixed + 4 * np.arange(len(cells) + 1)]).astype(np.int64)
        return Close(groups, first, items, runs, edges)

    def shapes_near(self, low: FloatArray, high: FloatArray) -> list[Shape]:
        """Return the occupied cells that meet the box from ``low`` to ``high``, shapes (2,)."""
        ((rows,), (columns,)) = (
            self._window(line, low[None], high[None], i) for i, line in ((1, self._y), (0, self._x))
        )
        found: list[Shape] = []
        for row, column in np.argwhere(self._occupied[rows, columns]):
            i, j = row + rows.start, column + columns.start
            x1, x2, y1, y2 = self._x[j], self._x[j + 1], self._y[i], self._y[i + 1]
            found.append(Polygon.unchecked(np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])))
        return found

    def _window(self, lines: FloatArray, low: FloatArray, high: FloatArray, axis: int) -> list[slice]:
        """Return which cells between lines across an axis meet boxes, shapes (n, 2)."""
        first = np.maximum(np.searchsorted(lines, low[:, axis]) - 1, 0).tolist()
        last = np.searchsorted(lines, high[:, axis], side="right").tolist()
        return [slice(a, b) for a, b in zip(first, last, strict=True)]


def closed(ring: FloatArray) -> FloatArray:
    """Return the edges of a ring, shape (n, 4)."""
    return np.hstack([ring, np.concatenate([ring[1:], ring[:1]])])


def frame(bounds: tuple[float, float, float, float]) -> Polygon:
    """Return bounds as a polygon."""
    xmin, ymin, xmax, ymax = bounds
    return Polygon.unchecked(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]))


def edges_of(shapes: Sequence[Shape]) -> tuple[FloatArray, IntArray]:
    """Return the edges of shapes, (e, 5), in any order, and where each run of them begins, (r + 1,)."""
    rings = [shape.corners() for shape in shapes if isinstance(shape, Rectangle)]
    rings += [ring for shape in shapes if isinstance(shape, Polygon) for ring in (shape.vertices, *shape.holes)]
    discs = [(*s.center, *s.center, s.radius) for s in shapes if isinstance(s, Disc)]
    ends = list(accumulate(map(len, rings), initial=0))
    edges = np.zeros((ends[-1], 5))
    if rings:
        vertices = np.concatenate(rings)
        after = np.arange(1, len(vertices) + 1)
        after[np.array(ends[1:]) - 1] = ends[:-1]
        edges[:, :2], edges[:, 2:4] = vertices, vertices[after]
    runs = [start for begin, end in pairwise(ends) for start in range(begin, end, RUN)]
    runs += range(ends[-1], ends[-1] + len(discs) + 1)
    return np.concatenate([edges, np.array(discs).reshape(-1, 5)]), np.array(runs, np.int64)


def _once_in_each(groups: IntArray, runs: IntArray, most: int, count: int) -> tuple[IntArray, IntArray]:
    """Return where each group's runs begin, (count + 1,), and its runs, each once, of pairs of a group and a run."""
    pairs = np.unique(groups * most + runs)
    return np.searchsorted(pairs, np.arange(count + 1) * most).astype(np.int64), pairs % most
