"""Certified motions along a car's curves: nothing is sampled, so nothing is missed.

Over an arc of length Δs the robot turns by Δs/ρ about a centre that no point of it is farther from than ρ + R (R: the
largest distance of its outline from the reference point), so that no point moves by more than Δs·(1 + R/ρ); on a
straight piece none moves by more than Δs. A configuration with clearance d therefore certifies the curve for as far, in
either direction, as these bounds add up to d. As a straight motion (:func:`trailmark.collision.kernels.motion`), a
curve is covered from its middle outwards and accepted only once it is covered whole.
"""

from __future__ import annotations

from math import cos, fabs, sin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision.checker import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import (
    BLOCKED,
    BUDGET,
    CONTACT,
    END_ZONE,
    FREE,
    ROUNDING,
    end_gap,
    exact_clearance,
    field_clearance,
    field_hit,
    workspace,
)
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.curves import Steering
from trailmark.curves.shortest import MOST_WORDS, shortest_word
from trailmark.curves.words import PIECES, drive
from trailmark.errors import ConfigurationError
from trailmark.se2 import FloatArray

__all__ = ["CurveChecker", "curve_free", "curve_motion"]


class CurveChecker:
    """Certified motions along a car's shortest curves.

    A curve is certified if no configuration along it collides; as with straight motions, one that comes within 1e-6 m
    of an obstacle more than 1 mm from its ends is not, nor is one that needs more than 20,000 distances.

    Args:
        checker: decides which configurations are valid, and knows the distances.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.

    Raises:
        ConfigurationError: neither ``steering`` nor a turning radius of the robot is given.
    """

    def __init__(self, checker: StateChecker, steering: Steering | None = None) -> None:
        chosen = steering or Steering.of(checker.robot)
        if chosen is None:
            raise ConfigurationError(
                f"robot ({checker.robot.describe()}) without turning radius given, allowed: a steering, or one with it"
            )
        self.checker = checker
        self.steering: Steering = chosen

    def motions_valid(self, a: ArrayLike, b: ArrayLike) -> NDArray[np.bool_]:
        """Return which shortest curves are certified free of collision, ends included.

        Args:
            a: starts, shape (n, 3).
            b: ends, shape (n, 3).

        Returns:
            Shape (n,), True only if no configuration along the curve collides.

        Raises:
            ConfigurationError: other shapes, different lengths, or values that are not finite.
        """
        starts, ends = np.atleast_2d(se2.configurations(a)), np.atleast_2d(se2.configurations(b))
        if starts.shape != ends.shape:
            raise ConfigurationError(f"motions: {len(starts)} starts and {len(ends)} ends given, allowed: as many")
        free = np.asarray(self.checker.valid(starts) & self.checker.valid(ends))
        free[free] = self.motions_between_valid(starts[free], ends[free])
        return free

    def motion_valid(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return whether the shortest curve from a to b, each of shape (3,), is certified free of collision."""
        ends = se2.configurations(a, name="motion: start"), se2.configurations(b, name="motion: end")
        if ends[0].ndim != 1 or ends[1].ndim != 1:
            raise ConfigurationError(f"motion: shapes {ends[0].shape} and {ends[1].shape} given, allowed: (3,)")
        return bool(self.motions_valid(*ends)[0])

    def motions_between_valid(self, a: se2.FloatArray, b: se2.FloatArray) -> NDArray[np.bool_]:
        """Return which curves between configurations known to be valid are certified; shapes (n, 3), unchecked."""
        checker, steering = self.checker, self.steering
        return np.asarray(
            _curves_free(checker.grid, checker.field, checker.footprint, a, b, steering.radius, steering.reverse)
            == FREE
        )


@njit(cache=True)
def curve_motion(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    a: FloatArray,
    word: FloatArray,
    radius: float,
) -> int:
    """Return FREE if driving a word, shape (2, 5), from a is certified, BLOCKED if it is not.

    Both ends must be valid; in contact with an obstacle they may be, as in :func:`trailmark.collision.kernels.motion`.
    """
    # Of each piece: where it begins, its side, its way, and where on the scale of the bound it begins.
    track = np.empty((PIECES, 6))
    pieces, bound = 0, 0.0
    x, y, theta = a[0], a[1], a[2]
    for k in range(PIECES):
        side, way = word[1, k], word[0, k] * radius
        if way == 0.0:
            continue
        track[pieces, 0], track[pieces, 1], track[pieces, 2] = x, y, theta
        track[pieces, 3], track[pieces, 4], track[pieces, 5] = side, way, bound
        bound += fabs(way) * (1.0 + fabs(side) * robot.sweep_radius / radius)
        x, y, theta = drive(x, y, theta, side, way, radius)
        pieces += 1
    if bound == 0.0:
        return FREE
    capacity, open_end = len(queue), end_gap(robot)
    queue[0, 0], queue[0, 1] = 0.0, bound
    first, count = 0, 1
    for _ in range(BUDGET):
        if count == 0:
            return FREE
        if count + 1 > capacity:
            break
        # Widest gaps first, then, once half of the queue is in use, newest first.
        count -= 1
        if 2 * count < capacity:
            low, high = queue[first, 0], queue[first, 1]
            first = (first + 1) % capacity
        else:
            last = (first + count) % capacity
            low, high = queue[last, 0], queue[last, 1]
        if (low == 0.0 or high == bound) and high - low <= open_end:
            continue
        middle = 0.5 * (low + high)
        need = 0.5 * (high - low) + ROUNDING
        k = pieces - 1
        while track[k, 5] > middle:
            k -= 1
        side = track[k, 3]
        part = (middle - track[k, 5]) / (1.0 + fabs(side) * robot.sweep_radius / radius)
        x, y, theta = drive(track[k, 0], track[k, 1], track[k, 2], side, part if track[k, 4] > 0.0 else -part, radius)
        c, s = cos(theta), sin(theta)
        d = field_clearance(field, robot, x, y, c, s, need)
        if d < need and d < 2.0 * field.slack:
            if d < 0.0 and field_hit(field, robot, x, y, c, s):
                return BLOCKED
            cap = min(need + ROUNDING, max(d, 0.0) + 4.0 * field.slack)
            d = exact_clearance(grid, robot, placed, x, y, c, s, cap)
            if d < need and d < CONTACT and (d <= ROUNDING or min(middle, bound - middle) >= END_ZONE):
                return BLOCKED
        if d < need:
            reach = d - ROUNDING
            queue[(first + count) % capacity, 0] = low
            queue[(first + count) % capacity, 1] = middle - reach
            queue[(first + count + 1) % capacity, 0] = middle + reach
            queue[(first + count + 1) % capacity, 1] = high
            count += 2
    return BLOCKED


@njit(cache=True)
def curve_free(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    words: FloatArray,
    a: FloatArray,
    b: FloatArray,
    radius: float,
    reverse: bool,
) -> int:
    """Return FREE if the shortest curve from a to b, both valid, is certified, BLOCKED if it is not."""
    return curve_motion(grid, field, robot, placed, queue, a, shortest_word(a, b, radius, reverse, words), radius)


@njit(cache=True, nogil=True)
def _curves_free(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    a: FloatArray,
    b: FloatArray,
    radius: float,
    reverse: bool,
) -> np.ndarray:
    """Return FREE or BLOCKED (uint8, shape (n,)) for the shortest curves between valid a and b, shapes (n, 3)."""
    placed, queue, words = workspace(robot), np.empty((128, 2)), np.empty((MOST_WORDS, 2, PIECES))
    result = np.empty(len(a), np.uint8)
    for i in range(len(a)):
        result[i] = curve_free(grid, field, robot, placed, queue, words, a[i], b[i], radius, reverse)
    return result
