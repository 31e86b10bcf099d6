"""Configurations of a robot in the plane, as plain arrays.

A configuration is ``(x, y, theta)``: metres, metres, radians; theta counter-clockwise in (-pi, pi]. Every
function takes arrays of shape ``(..., 3)`` and broadcasts like numpy. The distance is that of OMPL's
``SE2StateSpace`` (Euclidean plus half of the heading difference), so that costs compare directly.
"""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import number_array, warn_of_degrees
from trailmark.errors import ConfigurationError

__all__ = [
    "ROTATION_WEIGHT",
    "FloatArray",
    "between",
    "compose",
    "configurations",
    "difference",
    "distance",
    "embed",
    "ends_of_motions",
    "interpolate",
    "motion_bound",
    "transform",
    "wrap",
]

FloatArray = NDArray[np.float64]

ROTATION_WEIGHT = 0.5
"""Metres that one radian of rotation counts in a path's cost (OMPL's SE2StateSpace weight)."""


def configurations(q: ArrayLike, *, name: str = "configuration", by_hand: bool = False) -> FloatArray:
    """Return ``q`` as a float array of shape (3,) or (n, 3) with headings wrapped, or say what is wrong.

    Args:
        q: one configuration (x, y, theta) or n of them as rows; metres and radians.
        name: what the message calls it.
        by_hand: whether a heading that looks like degrees is warned of.

    Raises:
        ConfigurationError: other shapes, or values that are not finite numbers.
    """
    array = number_array(q, name, "{} is not an array of numbers x, y, theta")
    if array.ndim not in (1, 2) or array.shape[-1] != 3:
        raise ConfigurationError(f"{name}: expected shape (3,) or (n, 3) for x, y, theta, got {array.shape}")
    if not np.isfinite(array).all():
        first = array if array.ndim == 1 else array[~np.isfinite(array).all(axis=1)][0]
        raise ConfigurationError(f"{name}: {first.tolist()} holds a value that is not a finite number")
    if by_hand and array.size:
        warn_of_degrees(float(np.abs(array[..., 2]).max()), f"{name}: heading")
    array[..., 2] = wrap(array[..., 2])
    return array


def wrap(theta: ArrayLike) -> Any:
    """Return angles (radians, any shape) brought into (-pi, pi]; angles already there come back unchanged."""
    angle = np.array(theta, dtype=np.float64)
    # Mostly there is nothing to do, and one look tells so.
    if ((angle > -np.pi) & (angle <= np.pi)).all():
        return angle if angle.ndim else float(angle)
    far = ~((angle > -3.0 * np.pi) & (angle <= 3.0 * np.pi))
    if far.any():
        angle = np.where(far, angle - 2.0 * np.pi * np.floor((angle + np.pi) / (2.0 * np.pi)), angle)
    # As trailmark.heading.wrapped does it, to the last bit: whole turns are taken off exactly. A modulus is inexact.
    for _ in range(2):
        above, below = angle > np.pi, angle <= -np.pi
        if not (above.any() or below.any()):
            break
        angle = np.where(above, angle - 2.0 * np.pi, np.where(below, angle + 2.0 * np.pi, angle))
    return angle if angle.ndim else float(angle)


def difference(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return b - a, shape (..., 3), with the heading going the shorter way round (half a turn counts as +pi)."""
    delta = np.asarray(b, dtype=np.float64) - np.asarray(a, dtype=np.float64)
    delta[..., 2] = wrap(delta[..., 2])
    return delta


def distance(a: ArrayLike, b: ArrayLike) -> Any:
    """Return ‖Δxy‖ + 0.5·|Δθ| (metres), shape (...): the cost of the motion from a to b."""
    return motion_bound(a, b, ROTATION_WEIGHT)


def interpolate(a: ArrayLike, b: ArrayLike, t: ArrayLike) -> FloatArray:
    """Return the configurations at fractions t, shape (...), of the motions from a to b, shape (..., 3).

    x and y go linearly, theta along the shorter arc.
    """
    start = np.asarray(a, dtype=np.float64)
    q = start + np.asarray(t, dtype=np.float64)[..., None] * difference(a, b)
    q[..., 2] = wrap(q[..., 2])
    return q


def motion_bound(a: ArrayLike, b: ArrayLike, radius: float) -> Any:
    """Return an upper bound (metres) on how far a motion moves any point of the robot: ‖Δxy‖ + R·|Δθ|, shape (...).

    ``radius`` is R, the largest distance of the robot's outline from its reference point.
    """
    delta = difference(a, b)
    return np.hypot(delta[..., 0], delta[..., 1]) + radius * np.abs(delta[..., 2])


def compose(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return the configuration b, given in a's frame, in the frame that a is given in; shape (..., 3)."""
    first, second = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x = first[..., 0] + cos * second[..., 0] - sin * second[..., 1]
    y = first[..., 1] + sin * second[..., 0] + cos * second[..., 1]
    return np.stack([x, y, np.asarray(wrap(first[..., 2] + second[..., 2]))], axis=-1)


def between(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return b in the frame of a, which compose leads from a to b, shape (..., 3)."""
    first = np.asarray(a, dtype=np.float64)
    c, s = np.cos(first[..., 2]), np.sin(first[..., 2])
    x, y, theta = first[..., 0], first[..., 1], first[..., 2]
    return compose(np.stack([-c * x - s * y, s * x - c * y, -theta], axis=-1), b)


def transform(q: ArrayLike, points: ArrayLike) -> FloatArray:
    """Return points (m, 2) of the robot's frame in the world's, at configurations (..., 3), shape (..., m, 2)."""
    pose, body = np.asarray(q, dtype=np.float64), np.asarray(points, dtype=np.float64)
    cos, sin = np.cos(pose[..., 2, None]), np.sin(pose[..., 2, None])
    x = pose[..., 0, None] + cos * body[:, 0] - sin * body[:, 1]
    y = pose[..., 1, None] + sin * body[:, 0] + cos * body[:, 1]
    return np.stack([x, y], axis=-1)


def embed(q: ArrayLike, radius: float) -> FloatArray:
    """Return (x, y, R·cos θ, R·sin θ), shape (..., 4): configurations as points of a Euclidean space.

    The Euclidean distance e of two embedded configurations bounds the displacement of every point of a robot
    of circumradius R between them by √2·e: that displacement is at most ‖Δxy‖ + 2R·sin(|Δθ|/2), whose two
    terms are the legs of a right triangle with hypotenuse e. An R of 0 leaves the heading out.
    """
    pose = np.asarray(q, dtype=np.float64)
    return np.concatenate([pose[..., :2], radius * np.cos(pose[..., 2:]), radius * np.sin(pose[..., 2:])], axis=-1)


def ends_of_motions(a: ArrayLike, b: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends, both of shape (n, 3).

    Raises:
        ConfigurationError: other shapes, different lengths, or values that are not finite.
    """
    starts, ends = np.atleast_2d(configurations(a)), np.atleast_2d(configurations(b))
    if starts.shape != ends.shape:
        raise ConfigurationError(f"motions: expected as many ends as starts, got {len(starts)} and {len(ends)}")
    return starts, ends
