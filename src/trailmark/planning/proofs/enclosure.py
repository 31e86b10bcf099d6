"""Enclosure: a proof that no path exists, with the robot's shape and headings.

Cells of SE(2) in which every configuration collides are blocked: the robot's core, which it covers wherever in the cell
it is, meets an obstacle. If a flood over the other cells that begins at one end of a query never comes to the other, no
path joins them. It is tried with ever smaller cells, from both ends by turns: the narrower part of space is soonest
filled. What is shut in around one configuration is so for all that lie in the same cells: so places are shut off, if
all headings there are, in one enclosure or in several, or collide.

Source: cells of C-space for proofs: Lozano-Pérez, "Spatial planning: a configuration space approach", IEEE Trans.
Computers 1983.
"""

from __future__ import annotations

from itertools import product
from math import ceil, floor, log2, pi, sqrt
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.jit import array_callee, njit
from trailmark.planning.proofs.cells import (
    BLOCKED,
    ENCLOSED,
    FREE,
    LEVEL,
    LEVELS,
    UNDER_WAY,
    Blocking,
    Division,
    Flood,
    I,
    J,
    K,
    begin,
    decided,
    leads_across,
    new_flood,
    resume,
)
from trailmark.planning.proofs.region import MARGIN, Stop
from trailmark.se2 import FloatArray
from trailmark.world import Robot

__all__ = ["Enclosure", "Space", "core", "discs", "enclosed", "enclosure", "pivot", "shut_off"]

SLICE = 1_000
"""Cells taken from the queue between two looks at the clock: a few milliseconds."""

BALANCE = 2.0
"""Turning within a cell moves the robot by no more than this times half a cell's edge, from some level on."""

SHARES = (0.1, 0.3)
"""Shares of what a configuration may move within a larger cell that its centre must be clear by to count as free.

The smaller, the fewer cells, and the likelier a flood comes through where there is no way; what is proven is so anyway.
"""

DEPTH = 5
"""Levels that are tried as the finest, one after the other, for each share."""

BASE_CELLS = 1 << 14
"""Cells of level 0 at most."""

QUARTER, COARSE, DISCS = 4, 0.03, 24
"""Of a core: chords for each quarter of a circle, and the share of the distance to the edges' sweeps that its corners
may be simplified by. Discs inside the robot, at most."""

ROUNDING = 1e-12
"""Metres beside a cell's edge where rounding may put a place on either side: neither is taken for granted."""

DEEPER, TURNS = 4, 32
"""Levels by which cells at a place are divided further, to tell whether the robot collides there: each halves what is
left untold; and headings at a place that enclosures are looked for around."""


class Enclosure(NamedTuple):
    """A proof: cells of SE(2) that hold all that the robot can reach from one end of a query, and not the other end.

    Attributes:
        end: 0 if that is the start, 1 if it is the goal.
        centers: of the cells, (x, y) of the pivot and heading, shape (n, 3).
        extents: half of what the cells extend over, shape (n, 3).
        pivot: the point of the robot, in its own frame, whose place is told, shape (2,).
        rim_centers: of the blocked cells around them, in none of which the robot is free anywhere, shape (m, 3).
        rim_extents: half of what those extend over, shape (m, 3).
    """

    end: int
    centers: FloatArray
    extents: FloatArray
    pivot: FloatArray
    rim_centers: FloatArray
    rim_extents: FloatArray


def enclosed(checker: StateChecker, start: ArrayLike, goal: ArrayLike, **options: Any) -> bool:
    """Return whether it is proven that no path joins two valid configurations: arguments as :func:`enclosure`."""
    return enclosure(checker, start, goal, **options) is not None


def enclosure(
    checker: StateChecker,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    seconds: float = np.inf,
    stop: Stop | None = None,
    budget: int = 2_000_000,
    space: Space | None = None,
) -> Enclosure | None:
    """Return a proof that no path, of whatever continuous motions, joins two valid configurations.

    Args:
        checker: the world and the robot; for round ones, whose triangles tell all, nothing is proven here.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        seconds: time at most, kept to about 10 ms.
        stop: asked every few milliseconds whether to end early.
        budget: cells taken at most.
        space: how it is divided; by default in the way that tells most.

    Returns:
        None if there is a path, or nobody knows.

    Raises:
        ConfigurationError: other shapes, or values that are not finite.
    """
    deadline = perf_counter() + seconds
    states = [se2.configurations(q, name=name) for q, name in ((start, "start"), (goal, "goal"))]
    for state, name in zip(states, ("start", "goal"), strict=True):
        if state.ndim != 1:
            raise ConfigurationError(f"{name}: expected shape (3,), got {state.shape}")
    if checker.robot.sweep_radius == 0.0:
        return None
    space = space or Space(checker)
    # With the pivot's position in place of the reference point's.
    poses = np.array([[*se2.transform(q, space.pivot[None])[0], q[2]] for q in states])
    orders = (poses, poses[::-1].copy())
    floods = [new_flood(space.division) for _ in orders]
    for share, finest in product(SHARES, range(space.first, min(space.first + DEPTH, LEVELS))):
        by = space.blocking(finest, share)
        floods = [Flood(*begin(flood, by, order)) for flood, order in zip(floods, orders, strict=True)]
        answer, n = UNDER_WAY, 0
        while answer == UNDER_WAY:
            if perf_counter() >= deadline or budget <= 0 or (stop is not None and stop()):
                return None
            answer, taken, flood = resume(floods[n], by, orders[n][1], SLICE)
            floods[n] = Flood(*flood)
            budget -= taken
            if answer == ENCLOSED:
                across, rim, reached = leads_across(floods[n], by)
                if across:
                    return None
                return Enclosure(n, *space.boxes(floods[n], reached), space.pivot, *space.boxes(floods[n], rim))
            # Where one comes to the other end, the other comes too: on to smaller cells.
            n = 1 - n
    return None


class Space:
    """How a world's SE(2) is divided for a robot.

    Attributes:
        pivot: the point of the robot (its frame, shape (2,)) whose place stands for it.
        first: the first level worth trying as the finest; none is if it is LEVELS.

    Args:
        checker: the world and the robot.
        point: another pivot, shape (2,); by default the one about which cells tell most.
    """

    def __init__(self, checker: StateChecker, point: FloatArray | None = None) -> None:
        footprint, robot = checker.footprint, checker.robot
        self.pivot = pivot(robot) if point is None else point
        outline = footprint.outline - self.pivot
        sweep = float(np.hypot(*outline.T).max()) * (1.0 + 1e-12)
        radius = sweep + footprint.dilation
        shift = np.array([*self.pivot, 0.0])
        about = footprint._replace(
            outline=outline,
            core=footprint.core - self.pivot,
            cover=footprint.cover - shift,
            inner=discs(outline) + np.array([0.0, 0.0, footprint.dilation]),
            circumradius=radius,
            sweep_radius=sweep,
        )
        self._grid, self._field, self._robot = checker.grid, checker.field, about
        # Wider than where the pivot of a valid configuration can be: it lies in the footprint's smallest circle.
        xmin, ymin, xmax, ymax = checker.world.bounds
        width, height = xmax - xmin + 4.0 * radius, ymax - ymin + 4.0 * radius
        edge = max(4.0 * radius, sqrt(width * height / BASE_CELLS))
        half: FloatArray = 0.5 * edge * 0.5 ** np.arange(LEVELS, dtype=np.float64)
        wanted = [ceil(log2(sweep * pi / (BALANCE * each))) for each in half]
        turns = np.array([min(level, max(0, most)) for level, most in enumerate(wanted)], np.int64)
        self.division = Division(
            xmin - 2.0 * radius, ymin - 2.0 * radius, ceil(width / edge), ceil(height / edge), half, turns
        )
        self._turn = pi / np.exp2(turns)
        self._spread = sqrt(2.0) * half + 2.0 * sweep * np.sin(0.5 * self._turn)
        self._cores: list[list[FloatArray]] = []
        self.first = int(np.count_nonzero(half > 0.5 * robot.inscribed_disc.radius))

    def blocking(self, finest: int, share: float) -> Blocking:
        """Return what cells are judged by, with the cores of all levels up to ``finest``."""
        for level in range(len(self._cores), finest + 1):
            shift = sqrt(2.0) * float(self.division.half[level])
            self._cores.append(core(self._robot.outline, shift, float(self._turn[level])))
        rings = [ring for level in self._cores for ring in level]
        cores = np.cumsum([0, *map(len, self._cores), *[0] * (LEVELS - len(self._cores))])
        return Blocking(
            self.division,
            finest,
            share * np.maximum(0.0, self._spread - self._spread[finest]),
            np.concatenate([np.empty((0, 2)), *rings]),
            np.cumsum([0, *map(len, rings)]).astype(np.int64),
            cores.astype(np.int64),
            np.empty((max(map(len, rings), default=1), 2)),
            self._grid,
            self._field,
            self._robot,
        )

    def boxes(self, flood: Flood, cells: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """Return the middle (n, 3) and half the extent (n, 3) of cells, of the pivot's place."""
        rows, division = flood.cells[cells], self.division
        half, turn = division.half[rows[:, LEVEL]], self._turn[rows[:, LEVEL]]
        x, y = (o + (2 * rows[:, c] + 1) * half for o, c in ((division.x0, I), (division.y0, J)))
        centers = np.column_stack([x, y, (2 * rows[:, K] + 1) * turn - pi])
        return centers, np.column_stack([half, half, turn])


# --- What the robot covers wherever in a cell it is.


def core(outline: FloatArray, shift: float, turn: float) -> list[FloatArray]:
    """Return polygons that the robot covers with MARGIN to spare after any shift and turn.

    A point of the footprint is covered still unless an edge passes over it. Each edge, turned by up to ``turn`` either
    way, stays within the hull of its two extreme positions, grown by the rise of its ends' arcs over their chords;
    shifts grow that by ``shift``. So what lies farther from all those hulls is covered.

    Args:
        outline: vertices about the pivot, shape (v, 2), counter-clockwise, metres.
        shift: metres, at most, in any direction.
        turn: radians, at most, either way about the pivot.

    Returns:
        Rings of shape (n, 2), none if nothing is left or turns are too large to be worth a look.
    """
    if turn > 0.25 * np.pi:
        return []
    radius = float(np.hypot(*outline.T).max())
    rise = radius * (1.0 - np.cos(turn))
    reach = shift + rise + MARGIN
    hulls = shapely.convex_hull(shapely.multipoints(_turned(outline, turn)))
    # Chords lie inside of circles, and simplifying moves corners: a little more, and measured again at the end.
    bands = shapely.buffer(hulls, reach * (1.0 + 2.0 * COARSE) / np.cos(np.pi / (4 * QUARTER)), quad_segs=QUARTER)
    robot = shapely.Polygon(outline)
    left = shapely.difference(robot, shapely.union_all(bands))
    found = []
    for part in shapely.get_parts(left):
        simple = shapely.simplify(part, COARSE * reach) if part.geom_type == "Polygon" else part
        if _is_core(simple, robot, hulls, reach):
            found.append(np.ascontiguousarray(shapely.get_coordinates(shapely.orient_polygons(simple).exterior)[:-1]))
    area = [shapely.Polygon(ring).area for ring in found]
    return [ring for ring, size in zip(found, area, strict=True) if size > 0.02 * sum(area)]


def _turned(outline: FloatArray, turn: float) -> FloatArray:
    """Return both ends of each edge turned either way, shape (v, 4, 2)."""
    ends = np.concatenate([outline, np.roll(outline, -1, axis=0)], axis=1).reshape(-1, 2, 2)
    c, s = np.cos(turn), np.sin(turn)
    left, right = ends @ np.array([[c, s], [-s, c]]), ends @ np.array([[c, -s], [s, c]])
    return np.concatenate([left, right], axis=1)


def _is_core(part: Any, robot: Any, hulls: Any, reach: float) -> bool:
    """Return whether a part is a polygon without holes inside the robot, and far enough from all hulls."""
    if part.geom_type != "Polygon" or part.is_empty or not part.is_valid or len(part.interiors):
        return False
    return bool(shapely.covers(robot, part) and (shapely.distance(hulls, part) >= reach).all())


def discs(outline: FloatArray, most: int = DISCS) -> FloatArray:
    """Return discs inside the robot, all over it, the largest first.

    Args:
        outline: vertices, shape (v, 2), metres.
        most: how many, at most.

    Returns:
        Rows x, y, radius; shape (n, 3).
    """
    robot = shapely.Polygon(outline)
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = max(float(np.sqrt(np.prod(high - low))) / 64.0, float((high - low).max()) / 400.0)
    x, y = (np.linspace(a, b, 2 + 2 * int(0.5 * (b - a) / step) + 1) for a, b in zip(low, high, strict=True))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    places = places[shapely.contains_xy(robot, places)]
    radius = shapely.distance(robot.exterior, shapely.points(places)) * (1.0 - 1e-9)
    order = np.argsort(-radius, kind="stable")
    rows = np.column_stack([places, radius])[order]
    # None lies near a larger one; ever fewer, until they are not too many.
    apart = 0.6 * rows[:, 2]
    while True:
        found: list[FloatArray] = []
        left = np.ones(len(rows), np.bool_)
        while left.any() and len(found) <= most:
            best = int(np.argmax(left))
            found.append(rows[best])
            left &= np.hypot(*(rows[:, :2] - rows[best, :2]).T) > apart[best]
        if len(found) <= most:
            return np.array(found).reshape(-1, 3)
        apart = np.maximum(1.2 * apart, 0.6 * rows[0, 2])


def pivot(robot: Robot) -> FloatArray:
    """Return the point (robot frame, shape (2,)) whose place stands for the robot's: turns about it leave most covered.

    One of the centre of the smallest circle around the footprint, the inscribed disc's, and their middle.
    """
    outline = np.asarray(robot.outline.rings()[0])
    around = shapely.get_coordinates(shapely.minimum_bounding_circle(shapely.Polygon(outline)).centroid)[0]
    inscribed = np.array(robot.inscribed_disc.center)
    shift = 0.25 * robot.inscribed_disc.radius
    area = []
    candidates = (around, inscribed, 0.5 * (around + inscribed))
    for candidate in candidates:
        rings = core(outline - candidate, shift, shift / robot.circumradius)
        area.append(sum(shapely.Polygon(ring).area for ring in rings))
    return candidates[int(np.argmax(area))]


# --- Places to which no path leads, with whatever heading.


def shut_off(
    checker: StateChecker,
    start: FloatArray,
    around: FloatArray,
    places: FloatArray,
    *,
    seconds: float = np.inf,
    stop: Stop | None = None,
    budget: int = 2_000_000,
) -> NDArray[np.bool_]:
    """Return the places to which, proven, no path of whatever continuous motions leads from the start, shape (n,).

    Args:
        checker: the world and the robot; for round ones nothing is proven here.
        start: valid, shape (3,).
        around: a place, x, y, shape (2,): what is shut in around it is looked at, with all headings with which the
            robot fits there.
        places: x, y, shape (n, 2): where the robot's reference point would be.
        seconds: time at most, kept to about 10 ms.
        stop: asked every few milliseconds whether to end early.
        budget: cells taken at most for each heading.
    """
    deadline = perf_counter() + seconds
    if checker.robot.sweep_radius == 0.0:
        return np.zeros(len(places), np.bool_)
    # About the reference point, so that a place is a column of cells.
    space = Space(checker, np.zeros(2))
    level = min(space.first + DEPTH, LEVELS) - 1
    order = np.lexsort((places[:, 1], places[:, 0]))
    at = np.ascontiguousarray(places[order], dtype=np.float64)
    covered = np.zeros((len(at), 1 << int(space.division.turns[level])), np.bool_)
    own = np.zeros((1, covered.shape[1]), np.bool_)
    headings = np.asarray(se2.wrap(np.arange(TURNS) * 2.0 * np.pi / TURNS))
    goals = np.column_stack([np.tile(around, (TURNS, 1)), headings])
    for goal in goals[np.asarray(checker.valid(goals), dtype=bool)]:
        if own[0, int((goal[2] + np.pi) / (2.0 * np.pi) * own.shape[1]) % own.shape[1]]:
            continue
        left = deadline - perf_counter()
        found = enclosure(checker, start, goal, seconds=left, stop=stop, budget=budget, space=space)
        if found is None:
            break
        for some, known in ((at, covered), (goal[None, :2].copy(), own)):
            inside = np.zeros_like(known)
            _note_inside(found.centers, found.extents, -ROUNDING if found.end == 1 else ROUNDING, some, inside)
            known |= inside == (found.end == 1)
        if found.end == 0:
            break  # what it does not hold is shut off, whatever the heading
    # Collisions are looked for where they matter: where no heading is shut in, nothing is told.
    finest = min(level + DEEPER, LEVELS - 1)
    _note_collisions(space.blocking(finest, SHARES[0]), level, at, covered)
    shut = np.zeros(len(at), np.bool_)
    shut[order] = covered.all(axis=1)
    return shut


@njit(nogil=True)
def _note_inside(
    centers: FloatArray, extents: FloatArray, wider: float, places: FloatArray, inside: NDArray[np.bool_]
) -> None:
    """Note in which parts of a turn, shape (n, parts), places in the order of x are in some box, so much wider."""
    n, parts = inside.shape
    for b in range(len(centers)):
        x, y, theta = centers[b]
        first = round((theta - extents[b, 2] + pi) / (2.0 * pi) * parts)
        last = round((theta + extents[b, 2] + pi) / (2.0 * pi) * parts)
        for p in range(np.searchsorted(places[:, 0], x - extents[b, 0] - wider), n):
            if places[p, 0] > x + extents[b, 0] + wider:
                break
            if abs(places[p, 1] - y) <= extents[b, 1] + wider:
                inside[p, first:last] = True


@njit(nogil=True)
def _note_collisions(by: Blocking, level: int, places: FloatArray, covered: NDArray[np.bool_]) -> None:
    """Note in which other parts of a turn the robot collides whatever its heading, where some of them are noted."""
    for p in range(len(places)):
        if covered[p].any():
            for k in range(covered.shape[1]):
                if not covered[p, k]:
                    covered[p, k] = _collides(by, level, places[p], k)
                    if not covered[p, k]:
                        break


@array_callee
def _collides(by: Blocking, level: int, place: FloatArray, part: int) -> bool:
    """Return whether the robot, proven, collides at a place with all headings of a part of a level's turn.

    Where a cell around it does not tell, smaller ones do: near to a collision a cell is never blocked as a whole.
    """
    division, finest = by.division, by.finest
    levels, parts, count = np.empty(2 * finest + 2, np.int64), np.empty(2 * finest + 2, np.int64), 1
    levels[0], parts[0] = level, part
    while count > 0:
        count -= 1
        at, k = levels[count], parts[count]
        half, turns = division.half[at], division.turns[at]
        x = division.x0 + (2.0 * floor((place[0] - division.x0) / (2.0 * half)) + 1.0) * half
        y = division.y0 + (2.0 * floor((place[1] - division.y0) / (2.0 * half)) + 1.0) * half
        kind = decided(at, x, y, (2 * k + 1) * pi / (1 << turns) - pi, by)
        if kind == BLOCKED:
            continue
        if kind == FREE or at == finest:
            return False
        for child in range(1 << (division.turns[at + 1] - turns)):
            levels[count], parts[count] = at + 1, (k << (division.turns[at + 1] - turns)) + child
            count += 1
    return True
