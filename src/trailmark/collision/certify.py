"""Certified motions: one bisection for straight motions and for a car's curves. No collision is missed by sampling.

A track leads from one configuration to another. It has a scale, in metres, such that no point of the robot moves
farther than the place on the scale does. A configuration with clearance d therefore certifies the track for d on either
side of itself. The track is covered from its middle outwards, and certified only if it is covered completely.

On a straight motion no point moves by more than ‖Δxy‖ + R·|Δθ| (R: the largest distance of the outline from the
reference point). Over an arc of length Δs the robot turns by Δs/ρ about a centre that no point of it is farther from
than ρ + R, so that none moves by more than Δs·(1 + R/ρ).
"""

from __future__ import annotations

from math import cos, fabs, hypot, sin
from typing import Any, NamedTuple

import numpy as np

from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import (
    BLOCKED,
    FREE,
    ROUNDING,
    UNDECIDED,
    exact_clearance,
    field_clearance,
    field_hit,
    workspace,
)
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves.words import PIECES, drive
from trailmark.heading import turn
from trailmark.jit import array_callee, callee, njit
from trailmark.se2 import FloatArray
from trailmark.variants import by_type, variant_of

__all__ = [
    "BUDGET",
    "CONTACT",
    "END_ZONE",
    "EXACT",
    "CurveTrack",
    "StraightTrack",
    "certify",
    "curve_motion",
    "curve_track",
    "end_gap",
    "motion",
    "motions_certified",
    "new_queue",
    "pose",
    "straight_track",
]

CONTACT = 1e-6
"""Metres: a motion that comes closer than this to an obstacle is not certified, except near its ends."""

END_SHARE = 1e-4
"""Maximum length of an end's zone of contact as a share of the robot's inscribed radius: for tiny robots a micrometre
is much."""

WITHIN_RIM, AT_END = 0.9, 0.2
"""Of the footprint's rim: how far in an end's zone of contact what is clear of obstacles certifies that nothing else of
the robot than its rim meets any, and what is left over at an end that is valid."""

END_ZONE = 1e-3
"""Metres from either end of a motion in which it may come closer than CONTACT, as one that starts in contact does."""

BUDGET: Any = np.int64(20_000)
"""Maximum number of configurations evaluated for one motion; a motion that needs more is not certified.

Of numpy's type: for each constant of Python's own numba compiles what takes it anew."""

EXACT: Any = np.bool_(True)
"""Whether to look at more than the clearance field; of numpy's type likewise."""


class StraightTrack(NamedTuple):
    """A motion with x, y and heading all linear.

    Attributes:
        x: of the start, metres.
        y: of the start, metres.
        theta: of the start, radians.
        dx: change of x for each metre of the scale.
        dy: change of y, likewise.
        dtheta: change of the heading, radians for each metre, the shorter way round.
        bound: length of the scale, metres.
    """

    x: float
    y: float
    theta: float
    dx: float
    dy: float
    dtheta: float
    bound: float


class CurveTrack(NamedTuple):
    """A car's curve: arcs and straight pieces.

    Attributes:
        pieces: (5, 6): where a piece begins (x, y, heading), its side (1 left, 0 straight, -1 right), its length
            (metres, negative backwards), and where on the scale it begins (metres).
        used: number of pieces.
        radius: turning radius, metres.
        turning: R/ρ: metres by which the outline moves farther than the reference point, for each metre of an arc.
        bound: length of the scale, metres.
    """

    pieces: FloatArray
    used: int
    radius: float
    turning: float
    bound: float


@by_type
def pose(track: StraightTrack | CurveTrack, along: float) -> tuple[float, float, float]:
    """Return the configuration at a place on the track's scale, metres."""
    raise NotImplementedError


@variant_of(pose, StraightTrack)
@callee
def _straight_pose(track: StraightTrack, along: float) -> tuple[float, float, float]:
    return track.x + along * track.dx, track.y + along * track.dy, track.theta + along * track.dtheta


@variant_of(pose, CurveTrack)
@callee
def _curve_pose(track: CurveTrack, along: float) -> tuple[float, float, float]:
    k = track.used - 1
    while track.pieces[k, 5] > along:
        k -= 1
    x, y, theta, side, length, begin = track.pieces[k]
    part = (along - begin) / (1.0 + fabs(side) * track.turning)
    found: tuple[float, float, float] = drive(x, y, theta, side, part if length > 0.0 else -part, track.radius)
    return found


@callee
def end_gap(robot: Footprint) -> float:
    """Return how long (metres of movement) the zone at either end of a motion is in which the robot may touch."""
    return min(CONTACT, END_SHARE * float(robot.inner[0, 2]))


@njit
def new_queue() -> FloatArray:
    """Return memory for the gaps of one motion, shape (128, 2): the newest-first rule never needs more."""
    return np.empty((128, 2))


@njit(numbers=True)
def certify(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    track: StraightTrack | CurveTrack,
    exact: bool,
    budget: int,
) -> int:
    """Return FREE if a track is certified, BLOCKED if it is not, UNDECIDED if the field alone cannot tell.

    Both ends must be valid. A robot may start and stop in contact with an obstacle: within :func:`end_gap` of an end it
    may overlap one by its rim, as a valid configuration may. What does not overlap anything there certifies as much on
    either side.

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        placed: memory (:func:`trailmark.collision.kernels.workspace`).
        queue: memory (:func:`new_queue`).
        track: of the motion.
        exact: False uses the field alone.
        budget: maximum number of configurations evaluated.
    """
    bound = track.bound
    if bound == 0.0:
        return FREE
    capacity, open_end = len(queue), end_gap(robot)
    queue[0, 0], queue[0, 1] = 0.0, bound
    first, count = 0, 1
    answer = FREE
    for _ in range(budget):
        if count == 0:
            return answer
        # Widest gaps first, which finds collisions early; newest first once half of the queue is in use, so that it
        # grows by only one gap for each halving.
        count -= 1
        if 2 * count < capacity:
            low, high = queue[first, 0], queue[first, 1]
            first = (first + 1) % capacity
        else:
            last = (first + count) % capacity
            low, high = queue[last, 0], queue[last, 1]
        touching = high <= open_end or low >= bound - open_end
        if touching and (low == 0.0 or high == bound) and high - low <= AT_END * robot.rim:
            continue
        middle = 0.5 * (low + high)
        need = 0.5 * (high - low) + ROUNDING
        x, y, theta = pose(track, middle)
        c, s = cos(theta), sin(theta)
        d = field_clearance(field, robot, x, y, c, s, need)
        if d < need:
            if not exact:
                if field_hit(field, robot, x, y, c, s):
                    return BLOCKED
                if d < 0.5 * field.slack:
                    answer = UNDECIDED
                    continue
            elif d < 2.0 * field.slack:
                if d < 0.0 and field_hit(field, robot, x, y, c, s):
                    return BLOCKED
                cap = min(need + ROUNDING, max(d, 0.0) + 4.0 * field.slack)
                d = exact_clearance(grid, robot, placed, x, y, c, s, cap)
                near_end = min(middle, bound - middle) < END_ZONE
                if d < need and d < CONTACT and (d <= (0.0 if touching else ROUNDING) or not near_end):
                    return BLOCKED
        reach = d - ROUNDING
        if touching and d > 0.0:
            reach = d + WITHIN_RIM * robot.rim
            need = 0.5 * (high - low) - WITHIN_RIM * robot.rim
        if d < need:
            # Without space for both gaps the motion is not certified.
            if count + 2 > capacity:
                break
            queue[(first + count) % capacity, 0] = low
            queue[(first + count) % capacity, 1] = middle - reach
            queue[(first + count + 1) % capacity, 0] = middle + reach
            queue[(first + count + 1) % capacity, 1] = high
            count += 2
    return BLOCKED if exact else UNDECIDED


@callee
def motion(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    a: FloatArray,
    b: FloatArray,
    exact: bool,
    budget: int,
) -> int:
    """Return what :func:`certify` returns for the straight motion from a to b, each of shape (3,)."""
    return int(certify(grid, field, robot, placed, queue, straight_track(robot, a, b), exact, budget))


@callee
def straight_track(robot: Footprint, a: FloatArray, b: FloatArray) -> StraightTrack:
    """Return the straight motion from a to b, each of shape (3,), as a track."""
    dx, dy, dtheta = b[0] - a[0], b[1] - a[1], turn(a[2], b[2])
    bound = hypot(dx, dy) + robot.sweep_radius * fabs(dtheta)
    rate = 1.0 / bound if bound > 0.0 else 0.0
    return StraightTrack(a[0], a[1], a[2], rate * dx, rate * dy, rate * dtheta, bound)


@array_callee
def curve_motion(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    a: FloatArray,
    word: FloatArray,
    radius: float,
    budget: int,
) -> int:
    """Return what :func:`certify` returns for the curve of a word, shape (2, 5), from a."""
    return int(certify(grid, field, robot, placed, queue, curve_track(robot, a, word, radius), EXACT, budget))


@array_callee
def curve_track(robot: Footprint, a: FloatArray, word: FloatArray, radius: float) -> CurveTrack:
    """Return the curve of a word, shape (2, 5), from a, shape (3,), as a track; the radius in metres."""
    pieces = np.empty((PIECES, 6))
    used, bound, turning = 0, 0.0, robot.sweep_radius / radius
    x, y, theta = a[0], a[1], a[2]
    for k in range(PIECES):
        side, length = word[1, k], word[0, k] * radius
        if length == 0.0:
            continue
        pieces[used, 0], pieces[used, 1], pieces[used, 2] = x, y, theta
        pieces[used, 3], pieces[used, 4], pieces[used, 5] = side, length, bound
        bound += fabs(length) * (1.0 + fabs(side) * turning)
        x, y, theta = drive(x, y, theta, side, length, radius)
        used += 1
    return CurveTrack(pieces, used, radius, turning, bound)


@njit(nogil=True)
def motions_certified(
    grid: ObstacleGrid, field: ClearanceField, robot: Footprint, a: FloatArray, b: FloatArray, exact: bool
) -> np.ndarray:
    """Return FREE, BLOCKED or (only if not ``exact``) UNDECIDED for straight motions from a to b.

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        a: starts, shape (n, 3), valid.
        b: ends, shape (n, 3), valid.
        exact: False uses the field alone.

    Returns:
        uint8, shape (n,).
    """
    placed, queue = workspace(robot), new_queue()
    result = np.empty(len(a), np.uint8)
    for i in range(len(a)):
        result[i] = motion(grid, field, robot, placed, queue, a[i], b[i], exact, BUDGET)
    return result
