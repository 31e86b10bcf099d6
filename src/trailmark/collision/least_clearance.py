"""The least clearance along a track: branch and bound with the same rule that certifies motions."""

# Tested by tests/motion/test_least_clearance.py.

from __future__ import annotations

from math import cos, sin

from trailmark.collision.certify import CurveTrack, StraightTrack, pose
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import exact_clearance, field_cap, field_clearance
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.se2 import FloatArray

__all__ = ["least_along"]


@njit(cache=True)
def least_along(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    track: StraightTrack | CurveTrack,
    best: float,
    tolerance: float,
    budget: int,
) -> tuple[float, float]:
    """Return the least clearance (metres) found along a track, and where on its scale; -1 if none is below ``best``.

    A configuration with clearance d leaves nothing below b within d − b of itself on the scale. What is left between
    the places looked at is looked at in its middle, until all that is left is less than the tolerance below the best.

    Args:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        placed: memory (:func:`trailmark.collision.kernels.workspace`).
        queue: memory (:func:`trailmark.collision.certify.new_queue`).
        track: of the motion.
        best: metres; only what is less is of interest.
        tolerance: metres, above 0, by which the true least clearance may be less than what is returned.
        budget: maximum number of configurations whose clearance is computed.
    """
    bound, where = track.bound, -1.0
    queue[0, 0], queue[0, 1] = 0.0, bound
    count = 1
    for step in range(budget + 2):
        # Both ends first: a path touches obstacles at its states.
        low, high = 0.0, 0.0
        if step == 1:
            low = high = bound
        elif step > 1:
            if count == 0 or best <= tolerance:
                break
            count -= 1
            low, high = queue[count, 0], queue[count, 1]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        x, y, theta = pose(track, middle)
        c, s = cos(theta), sin(theta)
        d = field_clearance(field, robot, x, y, c, s, best - tolerance + half)
        if d < best - tolerance + half:
            cap = field_cap(field, robot, x, y, c, s, best + half)
            d = exact_clearance(grid, robot, placed, x, y, c, s, cap)
            if d < best:
                best, where = d, middle
        if step < 2:
            continue
        reach = max(d - best, 0.0) + tolerance
        if reach < half:
            if count + 2 > len(queue):
                break
            queue[count, 0], queue[count, 1] = low, middle - reach
            queue[count + 1, 0], queue[count + 1, 1] = middle + reach, high
            count += 2
    return best, where
