"""Escape: the shortest way out of what the robot stands in, along which it is never deeper in it.

Out of keep-out zones it is never deeper in any of them, so that each is closed once it is left, and clear of all else;
out of obstacles it is never deeper in all that blocks taken together. The penetration depth is the length of the
shortest translation to a place where the robot is free (Dobkin, Hershberger, Kirkpatrick & Suri, "Computing the
intersection-depth of polyhedra", Algorithmica 9, 1993). Along that very translation it falls by a metre for each metre:
no place along it has a nearer way out, by the triangle inequality. A car or a differential drive does not move
sideways: of the arcs, or straight drives and turns in place, that lead out and along which the depth never rises, it
takes the shortest.

Where no such motion leads out of keep-out zones, several in a row are sought, the shortest first (A*). What leads out
of zones is not sampled: an audit (:mod:`trailmark.verify`) certifies that none is entered deeper, or again, and the
motions are certified against all else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from heapq import heappop, heappush
from math import pi

import numpy as np
import shapely
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves.words import drive
from trailmark.motion import Motion
from trailmark.penetration import Penetration, outside_of
from trailmark.se2 import FloatArray
from trailmark.shapes import Polygon
from trailmark.verify import PathAuditor
from trailmark.verify.auditor import RISE
from trailmark.world import Robot, World, keep_outs
from trailmark.zones import KeepOutZone

__all__ = ["way_out", "ways_out_of_zones"]

BEYOND = (1e-6, 1e-5, 1e-4, 1e-3)
"""Metres from all that blocks, tried in turn: rounding may leave the nearest free place itself in contact."""

ARC_STEP, LONGEST_ARC = 0.02, 1.0
"""Steps of a car's arcs, and how long they are at most, in turning radii."""

DRIVE_STEP, LONGEST_DRIVE = 0.02, 2.0
"""Likewise a differential drive's straight drives, in circumradii."""

LONGEST_TURN = 3.1
"""Radians that it turns in place at most, in as many steps: less than half a turn, which would have no direction."""

DEEPER = 1e-6
"""Metres by which rounding may let the depth rise along a drive."""

FINE, GROWTH, COARSE, PLACES = 0.02, 1.1, 0.25, 400
"""Circumradii of the first step along a motion out of zones, how much longer each next one is, the longest, and how
many there are at most."""

FEW = 8
"""States along a motion whose depths are computed at first."""

TURN_STEPS = 60
"""Of a turn in place by LONGEST_TURN."""

EAGER = 1.5
"""Times the depth, several motions in a row are expected to take: a single one that leads out comes before them."""

EXPANDED = 300
"""Places that motions out of zones are sought from, at most."""

EDGES = 8
"""Of the zones' edges, along and across which straight motions lead."""

SAME = 0.1
"""Circumradii, and radians, within which two places are one."""

Blocks = tuple[FloatArray, list[Penetration]]
"""Boxes around all that blocks, but for the bounds, shape (n, 4), and how deep the robot is in each."""


def way_out(checker: StateChecker, q: FloatArray) -> FloatArray | None:
    """Return the states, shape (n, 3), from an invalid configuration to a valid one; None if none was found.

    Args:
        checker: for the world and the robot.
        q: not valid, shape (3,).
    """
    if checker.robot.turning_radius is not None:
        return _drive_out(checker, q, _arcs(checker.robot, q))
    if checker.robot.drive == "differential" and not checker.footprint.is_disc:
        # All of a drive lies on the line from its end to its beginning, all of a turn in between.
        rows = _drive_out(checker, q, _drives_and_turns(checker.robot, q))
        return None if rows is None else rows[[0, -1]]
    return _shift_out(checker, q, checker)


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
    alone = World("", (*low.tolist(), *high.tolist()), zones=tuple(KeepOutZone(region) for region in regions))
    zones = checker.edited(alone)
    auditor = PathAuditor(zones, rise=RISE)
    # What keeps a clearance is in a zone as soon as it is too near.
    depths = [Penetration(robot.footprint, region, robot.clearance) for region in regions]
    longest = float(np.hypot(*(high - low)))

    def depth(states: FloatArray) -> FloatArray:
        return np.array([each.at(states) for each in depths])

    def certified(rows: FloatArray) -> bool:
        path = motion.path(rows)
        return bool(others.motions_valid(rows[:-1], rows[1:]).all()) and auditor.audit(path).free

    # As far as the depth is, it is to go at least: what is not out yet waits for what is.
    heap = [(float(depth(q[None]).max()), 0, 0.0, q[None], False)]
    if robot.turning_radius is None and (robot.drive != "differential" or checker.footprint.is_disc):
        straight = _shift_out(zones, q, checker)
        if straight is not None:
            length = float(np.hypot(*(straight[1] - q)[:2]))
            # Nothing is shorter.
            heap = [(length, -1, length, straight, True), (length, 0, 0.0, q[None], False)]
    seen, count, expanded = set[tuple[int, ...]](), 1, 0
    while heap and seconds_left() > 0.0:
        _, _, cost, rows, out = heappop(heap)
        here = rows[-1]
        key = tuple(np.round(here / (SAME * np.array([robot.circumradius, robot.circumradius, 1.0]))).astype(int))
        if key in seen:
            continue
        if out:
            if certified(rows):
                seen.add(key)
                yield rows
            continue
        if expanded == EXPANDED:
            continue
        seen.add(key)
        expanded += 1
        at = depth(here[None])
        for states, costs in _motions_out(checker, regions, here, longest):
            last = _first(~others.checker.states_free(states))
            found = at
            # A few at first: most motions lead deeper soon.
            while (looked := found.shape[1] - 1) < last:
                found = np.hstack([found, depth(states[looked : min(last, 2 * looked + FEW)])])
                rises = (found[:, 1:] > np.minimum.accumulate(found, axis=1)[:, :-1] + DEEPER).any(axis=0)
                last = min(last, _first(rises) if rises.any() else last)
            if last == 0:
                continue
            free = checker.states_free(states[:last])
            stops = {_first(free)} if free.any() else {last - 1, last // 2, last // 4}
            if len(depths) > 1:
                # A place just out of one of several zones is one to turn off at.
                stops |= {_first(row == 0.0) for row in found[:, 1:]}
            for k in stops:
                if k < last:
                    count += 1
                    arc = robot.turning_radius is not None and states[k, 2] != here[2]
                    way = states[: k + 1] if arc else states[k : k + 1]
                    there = cost + float(costs[k])
                    to_go = EAGER * float(found[:, k + 1].max())
                    heappush(heap, (there + to_go, count, there, np.vstack([rows, way]), bool(free[k])))


def _first(flags: ArrayLike) -> int:
    """Return the index of the first that is True, of shape (n,); how many there are if none is."""
    rows = np.asarray(flags)
    return int(np.argmax(rows)) if rows.any() else len(rows)


def _motions_out(
    checker: StateChecker, regions: list[Polygon], q: FloatArray, longest: float
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the states along motions from a configuration on, shape (n, 3), and their costs, shape (n,).

    Args:
        checker: for the robot.
        regions: of the zones to leave; who moves anywhere also tries along their edges, and across.
        q: shape (3,).
        longest: metres that it may be to the end of a zone.
    """
    robot = checker.robot
    steps = robot.circumradius * np.minimum(FINE * GROWTH ** np.arange(PLACES), COARSE)
    lengths: FloatArray = np.cumsum(steps, dtype=np.float64)
    lengths = lengths[: 1 + np.searchsorted(lengths, longest)]
    if robot.turning_radius is not None:
        for states in _arcs(robot, q, (1.0, -1.0)):
            states[:, 2] = se2.wrap(states[:, 2])
            yield states, ARC_STEP * robot.turning_radius * np.arange(1.0, len(states) + 1.0)
    if robot.turning_radius is not None or (robot.drive == "differential" and not checker.footprint.is_disc):
        angles = q[2] + np.array([0.0, pi] if robot.reverse else [0.0])
    else:
        edges = [np.diff(ring[np.r_[: len(ring), 0]], axis=0) for region in regions for ring in region.rings()]
        along = np.arctan2(*np.concatenate(edges).T[::-1])
        angles = np.concatenate([along[:EDGES], np.arange(4) * 0.25 * pi])
        angles = np.unique(np.round(se2.wrap(angles[:, None] + 0.5 * pi * np.arange(4)), 9))
    for angle in angles:
        yield q + lengths[:, None] * np.array([np.cos(angle), np.sin(angle), 0.0]), lengths
    if robot.drive == "differential" and not checker.footprint.is_disc:
        turns = np.linspace(LONGEST_TURN / TURN_STEPS, LONGEST_TURN, TURN_STEPS)
        for side in (1.0, -1.0):
            states = q + side * turns[:, None] * np.array([0.0, 0.0, 1.0])
            states[:, 2] = se2.wrap(states[:, 2])
            yield states, se2.ROTATION_WEIGHT * turns


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


def _arcs(robot: Robot, q: FloatArray, sides: tuple[float, ...] = (0.0, 1.0, -1.0)) -> FloatArray:
    """Return the states along each of a car's arcs from a configuration on, shape (k, n, 3)."""
    radius = robot.turning_radius or 0.0
    lengths = np.arange(1, round(LONGEST_ARC / ARC_STEP) + 1) * ARC_STEP * radius
    arcs = [(side, way) for way in _ways(robot) for side in sides]
    return np.array([[drive(q[0], q[1], q[2], side, way * s, radius) for s in lengths] for side, way in arcs])


def _drives_and_turns(robot: Robot, q: FloatArray) -> FloatArray:
    """Return the states along a differential drive's straight drives and turns in place, shape (k, n, 3)."""
    lengths = np.arange(1, round(LONGEST_DRIVE / DRIVE_STEP) + 1) * DRIVE_STEP * robot.circumradius
    angles = LONGEST_TURN * np.arange(1, len(lengths) + 1) / len(lengths)
    ahead = np.array([np.cos(q[2]), np.sin(q[2]), 0.0])
    drives = [q + way * lengths[:, None] * ahead for way in _ways(robot)]
    return np.array([*drives, *(q + way * angles[:, None] * (0.0, 0.0, 1.0) for way in (1.0, -1.0))])


def _ways(robot: Robot) -> tuple[float, ...]:
    return (1.0, -1.0) if robot.reverse else (1.0,)


def _drive_out(checker: StateChecker, q: FloatArray, states: FloatArray) -> FloatArray | None:
    """Return the shortest drive that leads out and along which the depth never rises, shape (n, 3).

    Args:
        checker: for the world and the robot.
        q: where all begin, shape (3,).
        states: along each of the drives, shape (k, n, 3).
    """
    valid = np.array([checker.valid(rows) for rows in states])
    first = np.where(valid.any(axis=1), valid.argmax(axis=1), states.shape[1])
    blocks = _blocks(checker)
    for k in np.argsort(first, kind="stable"):
        if first[k] == states.shape[1]:
            return None
        rows = np.vstack([q, states[k, : first[k] + 1]])
        depths = np.array([_depth(checker, blocks, state) for state in rows])
        if (np.diff(depths) <= DEEPER).all():
            rows[1:, 2] = se2.wrap(rows[1:, 2])
            return rows
    return None


def _depth(checker: StateChecker, blocks: Blocks, q: FloatArray) -> float:
    """Return the penetration depth at a configuration, metres; infinite if no way out is near."""
    reach = 4.0 * checker.robot.circumradius
    shift = _shortest(_free_shifts(checker, blocks, q, reach), reach)
    return np.inf if shift is None else float(np.hypot(*shift))
