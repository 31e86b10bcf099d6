"""Escape: the shortest way out of what the robot stands in, along which it is never deeper in it.

Out of keep-out zones it is never deeper in any of them, so that each is closed once it is left, and clear of all else;
out of obstacles it is never deeper in any connected part of what blocks it. The penetration depth is the length of the
shortest translation to a place where the robot is free (Dobkin, Hershberger, Kirkpatrick & Suri, "Computing the
intersection-depth of polyhedra", Algorithmica 9, 1993). Along that very translation it falls by a metre for each metre:
no place along it has a nearer way out, by the triangle inequality. Of several parts, though, one may get deeper while
another is left. Then, and for a car or a differential drive, which do not move sideways, arcs, or straight drives and
turns in place, along which no depth rises, are sought one after the other until they lead out, the shortest first (A*);
who moves sideways takes that translation if there are none. So are motions out of several keep-out zones. What leads
out of zones is not sampled: an audit (:mod:`trailmark.verify`) certifies that none is entered deeper, or again, and the
motions are certified against all else. From where the robot is out, the query is planned as any other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from heapq import heappop, heappush
from itertools import pairwise
from math import pi
from time import perf_counter
from typing import Any

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves.words import drive
from trailmark.motion import Motion
from trailmark.penetration import Penetration, outside_of
from trailmark.planning.incumbent import Budget, Incumbent, OnProgress, vertices_of
from trailmark.planning.model import WorldModel
from trailmark.planning.result import PlanProgress, PlanResult
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape
from trailmark.trajectories import path_of
from trailmark.verify import PathAuditor
from trailmark.verify.auditor import RISE
from trailmark.world import World, keep_outs
from trailmark.world.zones import KeepOutZone

__all__ = ["plan_out_of_zones", "way_out", "ways_out_of_zones"]

BEYOND = (1e-6, 1e-5, 1e-4, 1e-3)
"""Metres from all that blocks, tried in turn: rounding may leave the nearest free place itself in contact."""

ARC_STEP, LONGEST_ARC, LONGEST_DRIVE = 0.02, 1.0, 2.0
"""Steps of a car's arcs, and how long they are at most, in turning radii; circumradii that a straight drive out of an
obstacle is long at most."""

TURN_STEPS, LONGEST_TURN = 60, 3.1
"""Steps of a turn in place, and radians: less than half a turn, which would have no direction."""

DEEPER, SECONDS, CHORDS = 1e-6, 0.5, 32
"""Metres by which rounding may let the depth rise along a drive; seconds that motions out of obstacles are looked for
at least; and the chords of a quarter of a disc there."""

FINE, GROWTH, COARSE, PLACES = 0.02, 1.1, 0.25, 400
"""Circumradii of the first step along a straight motion, how much longer each next one is, the longest out of zones,
and how many there are at most."""

FEW, EDGES = 8, 8
"""States along a motion whose depths are computed at first; edges of zones, along and across which motions lead."""

EAGER, EXPANDED = 1.5, 300
"""Times the depth that several motions in a row are expected to take: a single one that leads out comes before them;
and places that motions out of zones are sought from, at most."""

SAME = 0.1
"""Circumradii, and radians, within which two places are one."""

WAYS, WAYS_SHARE, TRY_SHARE, REST_SHARE = 5, 0.5, 0.2, 0.8
"""Ways out that are tried, for beside a zone there may be no room to go on. Of the time, for the first of them; of what
is left then, to find any path from where it ends, and for the best one from there, before a bound is proven."""

Blocks = tuple[FloatArray, list[Penetration]]
"""Boxes around all that blocks, but for the bounds, shape (n, 4), and how deep the robot is in each."""


def way_out(checker: StateChecker, q: FloatArray, seconds: float = 0.0) -> FloatArray | None:
    """Return the states, shape (n, 3), from an invalid configuration to a valid one; None if none was found.

    Args:
        checker: of the world and the robot.
        q: configuration, shape (3,).
        seconds: to look for several motions, or those of a car or a differential drive; SECONDS at least.
    """
    robot, end = checker.robot, perf_counter() + max(seconds, SECONDS)
    straight = _shift_out(checker, q, checker) if _moves_sideways(checker) else None
    longest = max(LONGEST_DRIVE * robot.circumradius, LONGEST_ARC * (robot.turning_radius or 0.0))
    reach = 2.0 * max(longest, 0.0 if straight is None else float(np.hypot(*(straight[1] - q)[:2])))
    parts = _blocked_near(checker, q, reach)
    depths = [Penetration(robot.footprint, part, robot.clearance) for part in parts]

    def certified(rows: FloatArray) -> bool:
        count = 1 + int(np.hypot(*np.diff(rows[:, :2], axis=0).T).sum() / (FINE * robot.circumradius))
        states = np.vstack([a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a) for a, b in pairwise(rows)])
        return not any(_rises(depth.at(states)[None]).any() for depth in depths)

    search = _Search(checker, depths, longest, lambda: end - perf_counter())
    if _moves_sideways(checker):
        search = replace(search, regions=parts, certified=certified)
    return next(search.ways(q, straight), straight)


def ways_out_of_zones(
    motion: Motion, others: Motion, names: tuple[str, ...], q: FloatArray, seconds_left: Callable[[], float]
) -> Iterator[FloatArray]:
    """Yield ways out of keep-out zones, shape (n, 3), the shortest first: certified, and never deeper in any.

    Args:
        motion: in the world with all zones.
        others: in the world without these.
        names: of the zones that the robot overlaps.
        q: where it does, shape (3,).
        seconds_left: time to look for them.
    """
    checker = motion.checker
    robot, world, reach = checker.robot, checker.world, 4.0 * checker.robot.circumradius
    regions = [keep_outs(world)[name] for name in names]
    boxes = np.array([region.bounding_box() for region in regions])
    low = np.maximum(np.minimum(boxes[:, :2].min(axis=0), q[:2]) - reach, world.bounds[:2])
    high = np.minimum(np.maximum(boxes[:, 2:].max(axis=0), q[:2]) + reach, world.bounds[2:])
    zones = checker.edited(World("", (*low.tolist(), *high.tolist()), zones=tuple(KeepOutZone(r) for r in regions)))
    auditor = PathAuditor(zones, rise=RISE)

    def certified(rows: FloatArray) -> bool:
        path = path_of(motion, rows)
        return bool(others.motions_valid(rows[:-1], rows[1:]).all()) and auditor.audit(path).free

    # What keeps a clearance is in a zone as soon as it is too near.
    depths = [Penetration(robot.footprint, region, robot.clearance) for region in regions]
    search = _Search(checker, depths, float(np.hypot(*(high - low))), seconds_left, regions, others.checker, certified)
    straight = _shift_out(zones, q, checker) if _moves_sideways(checker) else None
    return search.ways(q, straight)


@dataclass(frozen=True)
class _Search:
    """A best-first search for motions, one after the other, that lead out and are never deeper in any region.

    Attributes:
        checker: tells where the robot is out.
        depths: how deep it is in each region.
        longest: that a straight motion is, metres.
        seconds_left: to look for ways out.
        regions: along and across whose edges who moves sideways may go.
        others: tells where else the robot collides; None: all that blocks it is in ``depths``.
        certified: whether motions over states (n, 3) may be taken.
    """

    checker: StateChecker
    depths: list[Penetration]
    longest: float
    seconds_left: Callable[[], float]
    regions: list[Polygon] | None = None
    others: StateChecker | None = None
    certified: Callable[[FloatArray], bool] = lambda rows: True

    def depth(self, states: FloatArray) -> FloatArray:
        """Return the depth in each region, metres, at configurations (n, 3), shape (m, n)."""
        return np.array([each.at(states) for each in self.depths])

    def ways(self, q: FloatArray, straight: FloatArray | None = None) -> Iterator[FloatArray]:
        """Yield ways out of a configuration, the shortest first; ``straight`` is one that nothing is shorter than."""
        robot = self.checker.robot
        # As far as the depth is, it is to go at least: what is not out yet waits for what is.
        heap = [(float(self.depth(q[None]).max(initial=0.0)), 0, 0.0, q[None], False)]
        if straight is not None:
            length = float(np.hypot(*(straight[1] - q)[:2]))
            heap = [(length, -1, length, straight, True), (length, 0, 0.0, q[None], False)]
        seen, count, expanded = set[tuple[int, ...]](), 1, 0
        while heap and self.seconds_left() > 0.0:
            _, _, cost, rows, out = heappop(heap)
            here = rows[-1]
            cell = np.round(here / (SAME * np.array([robot.circumradius, robot.circumradius, 1.0]))).astype(int)
            key = (*cell.tolist(), out)
            if key in seen or (out and not self.certified(rows)) or (not out and expanded == EXPANDED):
                continue
            seen.add(key)
            if out:
                yield rows
                continue
            expanded += 1
            for states, costs in _motions(self.checker, here, self.longest, self.regions):
                for k, depth, free in self._stops(here, states):
                    count += 1
                    arc = robot.turning_radius is not None and states[k, 2] != here[2]
                    way = states[: k + 1] if arc else states[k : k + 1]
                    there = cost + float(costs[k])
                    heappush(heap, (there + EAGER * depth, count, there, np.vstack([rows, way]), free))

    def _stops(self, here: FloatArray, states: FloatArray) -> Iterator[tuple[int, float, bool]]:
        """Yield indices of states (n, 3) along a motion at which another may begin, the depth there, and if it is out.

        Nowhere before is the robot deeper in any region than earlier.
        """
        last = len(states) if self.others is None else _first(~self.others.states_free(states))
        found = self.depth(here[None])
        # A few at first: most motions lead deeper soon.
        while (looked := found.shape[1] - 1) < last:
            found = np.hstack([found, self.depth(states[looked : min(last, 2 * looked + FEW)])])
            rises = _rises(found)
            last = min(last, _first(rises) if rises.any() else last)
            # Once it is out, the rest of the motion is no matter.
            if not found[:, -1].any() and self.checker.valid(states[found.shape[1] - 2]):
                break
        last = min(last, found.shape[1] - 1)
        if last == 0:
            return
        free = self.checker.states_free(states[:last])
        stops = {_first(free)} if free.any() else {last - 1, last // 2, last // 4}
        if len(self.depths) > 1:
            # A place just out of one of several regions is one to turn off at.
            stops |= {_first(row == 0.0) for row in found[:, 1 : last + 1]}
        for k in stops:
            if k < last:
                yield k, float(found[:, k + 1].max()), bool(free[k])


def _rises(depths: FloatArray) -> NDArray[np.bool_]:
    """Return where any of some depths (m, n) is more than before, shape (n - 1,)."""
    rises = depths[:, 1:] > np.minimum.accumulate(depths, axis=1)[:, :-1] + DEEPER
    return np.asarray(rises.any(axis=0))


def _first(flags: ArrayLike) -> int:
    """Return the index of the first that is True, of shape (n,); how many there are if none is."""
    rows = np.asarray(flags)
    return int(np.argmax(rows)) if rows.any() else len(rows)


def _moves_sideways(checker: StateChecker) -> bool:
    robot = checker.robot
    return robot.turning_radius is None and (robot.drive != "differential" or checker.footprint.is_disc)


def _motions(
    checker: StateChecker, q: FloatArray, longest: float, regions: list[Polygon] | None = None
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the states along motions from a configuration on, shape (n, 3), and their costs, shape (n,).

    They are straight motions of ``longest`` metres at most, for who moves sideways along the edges of regions to leave,
    and across; a car's arcs; and turns in place. Steps are even but where there are regions.
    """
    robot, turning, sideways = checker.robot, checker.robot.turning_radius, _moves_sideways(checker)
    steps = np.minimum(FINE * GROWTH ** np.arange(PLACES), FINE if regions is None else COARSE)
    lengths: FloatArray = np.cumsum(robot.circumradius * steps, dtype=np.float64)
    lengths = lengths[: 1 + np.searchsorted(lengths, longest)]
    ways = (1.0, -1.0) if robot.reverse else (1.0,)
    if turning is not None:
        arcs: FloatArray = np.arange(1.0, round(LONGEST_ARC / ARC_STEP) + 1.0) * ARC_STEP * turning
        for way, side in ((way, side) for way in ways for side in (1.0, -1.0)):
            yield _wrapped(np.array([drive(q[0], q[1], q[2], side, way * s, turning) for s in arcs])), arcs
    angles = q[2] + np.array([0.0, pi][: len(ways)])
    if sideways:
        edges = [np.stack([r, np.roll(r, -1, axis=0)], axis=1) for region in regions or () for r in region.rings()]
        every = np.concatenate(edges)
        near = np.argsort(shapely.distance(shapely.linestrings(every), shapely.Point(q[:2])))[:EDGES]
        along = np.arctan2(*(every[near, 1] - every[near, 0]).T[::-1])
        angles = np.concatenate([along, np.arange(4) * 0.125 * pi])
        angles = np.unique(np.round(se2.wrap(angles[:, None] + 0.5 * pi * np.arange(4)), 9))
    for angle in angles:
        yield q + lengths[:, None] * np.array([np.cos(angle), np.sin(angle), 0.0]), lengths
    if turning is None and not sideways:
        turns = np.linspace(LONGEST_TURN / TURN_STEPS, LONGEST_TURN, TURN_STEPS)
        for side in (1.0, -1.0):
            yield _wrapped(q + side * turns[:, None] * np.array([0.0, 0.0, 1.0])), se2.ROTATION_WEIGHT * turns


def _wrapped(states: FloatArray) -> FloatArray:
    states[:, 2] = se2.wrap(states[:, 2])
    return states


def _blocked_near(checker: StateChecker, q: FloatArray, reach: float) -> list[Polygon]:
    """Return the connected parts of all that blocks the robot within ``reach`` metres."""
    world, room = checker.world, reach + checker.robot.circumradius + checker.robot.clearance
    window = shapely.box(*(q[:2] - room), *(q[:2] + room))
    outside = shapely.difference(window, shapely.box(*world.bounds))
    beyond = [] if world.boundary is None else [outside_of(world.boundary, world.extent).shapely()]
    near = [shape for shape in world.obstacles if shapely.intersects(window, shapely.box(*shape.bounding_box()))]
    all_ = shapely.union_all([outside, *beyond, *(_polygon(shape) for shape in near)])
    parts = shapely.get_parts(shapely.intersection(all_, window))
    rings = [(part.exterior, part.interiors) for part in parts if part.geom_type == "Polygon"]
    corners = [
        (shapely.get_coordinates(out)[:-1], [shapely.get_coordinates(r)[:-1] for r in ins]) for out, ins in rings
    ]
    return [Polygon(out, tuple(ins)) for out, ins in corners]


def _polygon(shape: Shape) -> shapely.Polygon:
    """Return a shape; a disc's chords lie around it."""
    if not isinstance(shape, Disc):
        return shape.polygon().shapely()
    return shapely.buffer(shapely.Point(shape.center), shape.radius / np.cos(0.25 * pi / CHORDS), quad_segs=CHORDS)


def _shift_out(checker: StateChecker, q: FloatArray, all_: StateChecker) -> FloatArray | None:
    """Return the shortest translation out of what blocks a checker to where another one's robot is valid, (2, 3)."""
    reach, blocks = 2.0 * checker.robot.circumradius, _blocks(checker)
    while True:
        free = _free_shifts(checker, blocks, q, reach)
        for beyond in BEYOND:
            shift = _shortest(shapely.buffer(free, -beyond, quad_segs=4), reach)
            if shift is None:
                break
            out = q.copy()
            out[:2] += shift
            if all_.valid(out):
                return np.array([q, out])
        if reach > checker.world.extent:
            return None
        reach *= 2.0


def _free_shifts(checker: StateChecker, blocks: Blocks, q: FloatArray, reach: float) -> shapely.Geometry:
    """Return the translations (metres) by at most ``reach`` along x and y to where the robot is free."""
    low, high = q[:2] - checker.robot.circumradius - reach, q[:2] + checker.robot.circumradius + reach
    boxes, depths = blocks
    near = np.flatnonzero((low <= boxes[:, 2:]).all(axis=1) & (high >= boxes[:, :2]).all(axis=1))
    blocked = shapely.union_all([depths[i].overlapping(q, reach) for i in near])
    xmin, ymin, xmax, ymax = checker.world.bounds
    footprint = checker.footprint
    placed = q[None, :2] if footprint.is_disc else se2.transform(q, footprint.outline)
    low, high = placed.min(axis=0) - footprint.dilation, placed.max(axis=0) + footprint.dilation
    box = np.array([xmin - low[0], ymin - low[1], xmax - high[0], ymax - high[1]])
    box = np.array([*np.maximum(box[:2], -reach), *np.minimum(box[2:], reach)])
    if (box[:2] >= box[2:]).any():
        return shapely.Polygon()
    return shapely.difference(shapely.box(*box), blocked)


def _shortest(free: shapely.Geometry, reach: float) -> FloatArray | None:
    """Return the shortest of some translations, shape (2,), if it is no longer than ``reach`` (metres)."""
    if free.is_empty:
        return None
    shift = shapely.get_coordinates(shapely.shortest_line(shapely.Point(0.0, 0.0), free))[-1]
    # Farther away, something beyond the window might be nearer.
    return shift if np.hypot(*shift) <= reach else None


def _blocks(checker: StateChecker) -> Blocks:
    """Return all that blocks a checker's robot, but for the bounds."""
    world, robot = checker.world, checker.robot
    outside = [] if world.boundary is None else [outside_of(world.boundary, world.extent)]
    shapes = [*world.obstacles, *outside]
    boxes = np.array([shape.bounding_box() for shape in shapes]).reshape(-1, 4)
    return boxes, [Penetration(robot.footprint, shape, robot.clearance) for shape in shapes]


def plan_out_of_zones(
    model: WorldModel,
    zones: tuple[str, ...],
    start: ArrayLike,
    goal: Any,
    budget: Budget,
    plan: Callable[..., PlanResult],
    on_progress: OnProgress | None = None,
    rest: Callable[[FloatArray, Budget], PlanResult] | None = None,
) -> PlanResult:
    """Return the answer to a query that starts in keep-out zones.

    Lower bounds, and proofs that there is no path, are those of the world without these zones, in which a path that is
    allowed is one too. Whoever calls holds the lock of the model's roadmap.

    Args:
        model: of the world.
        zones: the names of those that the start lies in (:func:`trailmark.planning.model.zones_at`).
        start: configuration, shape (3,).
        goal: what ``plan`` takes for one; in no keep-out zone, if it is one configuration.
        budget: what the query may take.
        plan: answers a query that starts in no zone: a model, start, goal, budget and ``on_progress``.
        on_progress: called after every step; with no path, which may come back into a zone.
        rest: answers the query from where the robot is out; by ``plan`` if None, and a lower bound is proven then.

    Raises:
        ConfigurationError: the start is not valid, these zones left aside.
    """
    without = model.without(zones)
    state = without.checker.require_valid(start, "start")
    watched = None if on_progress is None else without_paths(on_progress)

    def resume(q: FloatArray, share: float, gap: float | None = None) -> PlanResult:
        part = budget.part(share * budget.seconds_left(), gap)
        return plan(model, q, goal, part, on_progress=watched) if rest is None else rest(q, part)

    last, out, ways = None, state[None], list[FloatArray]()
    later = (1.0 - WAYS_SHARE) * budget.limit
    for out in ways_out_of_zones(
        model.motion, without.motion, zones, state, lambda: budget.seconds_left() - (0.0 if ways else later)
    ):
        ways.append(out)
        last = resume(out[-1], TRY_SHARE, np.inf)
        if last.path is not None or len(ways) == WAYS or budget.is_up():
            break
    if last is not None and (last.path is None or rest is None):
        out = out if last.path is not None else ways[0]
        better = resume(out[-1], REST_SHARE)
        last = better if better.path is not None else last
    path = None
    if last is not None and last.path is not None:
        ends = np.array([state, last.path.states[-1]])
        incumbent = Incumbent(without.motion, ends[0], ends[1], budget.begin)
        incumbent.offer(np.vstack([out, vertices_of(model.motion, last.path)[1:]]))
        path = incumbent.path()
        if path is not None and not without.verification.certified(path, ends):
            path = None
    if path is None or rest is None:
        proven = plan(without, state, goal, budget.part(budget.seconds_left()), on_progress=watched)
    if path is None or last is None:
        nothing = replace(proven, path=None, first_cost=None, min_clearance=None, history=(), goal=None)
        if proven.status == "infeasible":
            return nothing
        named = ", ".join(zones)
        reason = f"no certified way out of {named} was found"
        if ways:
            reason = f"no path was found from where the certified ways out of {named} end"
        return replace(nothing, status="timeout", reason=reason)
    answer = without.verification.result(incumbent, "solved", path, model.shared.roadmap, last.time["build"] or 0.0)
    # In a zone there is no clearance.
    return replace(
        answer,
        path=model.verification.followed_by_lines(answer.path or path, leaves=True),
        goal=last.goal,
        lower_bound=incumbent.lower_bound if rest is not None else proven.lower_bound,
        world=model.checker.world,
        min_clearance=0.0,
        escape=len(path_of(model.motion, out)) - 1,
    )


def without_paths(on_progress: OnProgress) -> OnProgress:
    """Return a callback that hands on how far planning is, but no path."""

    def hand_on(progress: PlanProgress) -> None:
        on_progress(replace(progress, path=None, cost=None, nearest=None))

    return hand_on
