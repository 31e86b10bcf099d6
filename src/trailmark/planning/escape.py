"""Escape: the shortest way out of an obstacle that the robot stands in, along which it is never deeper in it.

The penetration depth is the length of the shortest translation to a place where the robot is free (Dobkin,
Hershberger, Kirkpatrick & Suri, "Computing the intersection-depth of polyhedra", Algorithmica 9, 1993). Along that very
translation it falls by a metre for each metre: no place along it has a nearer way out, by the triangle inequality.
A car or a differential drive does not move sideways: of the arcs, or straight drives and turns in place, that lead out
and along which the depth never rises, it takes the shortest.
"""

# Tested by tests/planning/test_escape.py.

from __future__ import annotations

from collections.abc import Iterator
from math import cos, pi

import numpy as np
import shapely

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves.words import drive
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Shape
from trailmark.triangles import convex_pieces
from trailmark.world import Robot, World

__all__ = ["way_out"]

BEYOND = (1e-6, 1e-5, 1e-4, 1e-3)
"""Metres from all that blocks, tried in turn: rounding may leave the nearest free place itself in contact."""

ARC_STEP, LONGEST_ARC = 0.02, 1.0
"""Steps of a car's arcs, and how long they are at most, in turning radii."""

DRIVE_STEP, LONGEST_DRIVE = 0.02, 2.0
"""Likewise a differential drive's straight drives, in circumradii."""

LONGEST_TURN = 3.1
"""Radians that it turns in place at most, in as many steps: less than half a turn, which would have no direction."""

CHORDS = 128
"""Of a quarter of a circle, where a disc's region is made a polygon: it is too large by 2e-5 of the radius at most."""

DEEPER = 1e-6
"""Metres by which rounding may let the depth rise along a drive."""


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
    reach = 2.0 * checker.robot.circumradius
    while True:
        free = _free_shifts(checker, q, reach)
        for beyond in BEYOND:
            shift = _shortest(shapely.buffer(free, -beyond, quad_segs=4), reach)
            if shift is None:
                break
            out = q.copy()
            out[:2] += shift
            if checker.valid(out):
                return np.array([q, out])
        if reach > checker.world.extent:
            return None
        reach *= 2.0


def _free_shifts(checker: StateChecker, q: FloatArray, reach: float) -> shapely.Geometry:
    """Return the translations (metres) by at most ``reach`` along x and y to where the robot is free."""
    blocked = shapely.union_all(list(_blocked_shifts(checker, q, reach)))
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


def _blocked_shifts(checker: StateChecker, q: FloatArray, reach: float) -> Iterator[shapely.Geometry]:
    """Yield the translations that put the robot on what blocks it: Minkowski differences of convex pieces.

    The difference is grown by the robot's dilation: of a disc, which counts as its centre, by its radius.
    """
    robot, dilation = checker.robot, checker.footprint.dilation
    round_ = checker.footprint.is_disc
    body = [q[None, :2]] if round_ else [se2.transform(q, piece) for piece in convex_pieces(robot.outline)]
    low, high = q[:2] - robot.circumradius - reach, q[:2] + robot.circumradius + reach
    for shape in _obstacles(checker.world):
        box = shape.bounding_box()
        if box[0] > high[0] or box[1] > high[1] or box[2] < low[0] or box[3] < low[1]:
            continue
        pieces = [np.array([shape.center])] if isinstance(shape, Disc) else convex_pieces(shape.polygon())
        radius = dilation + (shape.radius if isinstance(shape, Disc) else 0.0)
        for piece in pieces:
            if (piece.min(axis=0) - radius > high).any() or (piece.max(axis=0) + radius < low).any():
                continue
            for part in body:
                found = shapely.convex_hull(shapely.MultiPoint((piece[:, None] - part).reshape(-1, 2)))
                # Chords around the circle instead of in it.
                outer = radius / cos(0.25 * pi / CHORDS)
                yield shapely.buffer(found, outer, quad_segs=CHORDS) if radius else found


def _obstacles(world: World) -> Iterator[Shape]:
    """Yield all that blocks, but for the bounds."""
    yield from world.obstacles
    if world.boundary is not None:
        xmin, ymin, xmax, ymax = world.bounds
        margin = world.extent
        frame = shapely.box(xmin - margin, ymin - margin, xmax + margin, ymax + margin)
        outside = shapely.difference(frame, world.boundary.shapely())
        for part in shapely.get_parts(outside):
            yield Polygon(
                shapely.get_coordinates(part.exterior), tuple(shapely.get_coordinates(r) for r in part.interiors)
            )


def _arcs(robot: Robot, q: FloatArray) -> FloatArray:
    """Return the states along each of a car's arcs from a configuration on, shape (k, n, 3)."""
    radius = robot.turning_radius or 0.0
    lengths = np.arange(1, round(LONGEST_ARC / ARC_STEP) + 1) * ARC_STEP * radius
    arcs = [(side, way) for way in _ways(robot) for side in (0.0, 1.0, -1.0)]
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
    for k in np.argsort(first, kind="stable"):
        if first[k] == states.shape[1]:
            return None
        rows = np.vstack([q, states[k, : first[k] + 1]])
        depths = np.array([_depth(checker, state) for state in rows])
        if (np.diff(depths) <= DEEPER).all():
            rows[1:, 2] = se2.wrap(rows[1:, 2])
            return rows
    return None


def _depth(checker: StateChecker, q: FloatArray) -> float:
    """Return the penetration depth at a configuration, metres; infinite if no way out is near."""
    reach = 4.0 * checker.robot.circumradius
    shift = _shortest(_free_shifts(checker, q, reach), reach)
    return np.inf if shift is None else float(np.hypot(*shift))
