"""Path shortening with certified motions: shortcuts, shortcuts of the heading alone, and moved vertices.

Sources: shortcuts: Kavraki, Svestka, Latombe & Overmars 1996, section 4.5, and Geraerts & Overmars, "Creating
high-quality paths for motion planning", IJRR 2007, which also brings shortcuts of single coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, log2, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, motion, state, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.heading import turn, wrapped
from trailmark.se2 import ROTATION_WEIGHT, FloatArray

__all__ = ["random_span", "shorten", "uniform"]

GAIN = 1e-7
"""Metres that a change must save at least."""

EFFORT = 500
"""Configurations evaluated for one motion at most: one that needs more grazes something; another is sooner tried."""


def shorten(
    checker: StateChecker,
    states: FloatArray,
    rng: np.random.Generator,
    *,
    sweeps: int = 40,
    tolerance: float = 1e-3,
    splitting: bool = False,
    stop: Callable[[], bool] | None = None,
) -> FloatArray:
    """Return a path no longer than the given one, with the same ends; shape (m, 3).

    A disc robot's headings are left alone and do not count.

    Args:
        checker: certifies the motions.
        states: a path of certified motions, shape (n, 3).
        rng: source of randomness.
        sweeps: rounds over the whole path at most.
        tolerance: stop when three sweeps together save less than this share of the cost.
        splitting: add vertices in each sweep; takes longer, and gets around corners on which the path hangs.
        stop: asked before each sweep whether to end early.
    """
    turning = checker.footprint.disc_radius < 0.0
    seed = np.array([rng.integers(1, 2**63)], dtype=np.uint64)
    # A copy: a Path's states are read-only, which to numba is another type and another compilation.
    path = np.array(states, dtype=np.float64, order="C")
    scale = 0.1 * _total(path, turning) / max(1, len(path))
    history = [_total(path, turning)]
    for _ in range(sweeps):
        if len(path) < 3 or (stop is not None and stop()):
            break
        path, scale = _sweep(checker.grid, checker.field, checker.footprint, path, turning, seed, scale, splitting)
        history.append(_total(path, turning))
        if len(history) > 3 and history[-4] - history[-1] < tolerance * history[-1]:
            break
    return path


@njit(cache=True)
def uniform(seed: NDArray[np.uint64]) -> float:
    """Return a number in [0, 1) and advance the seed (xorshift64*: Vigna 2016)."""
    s = seed[0]
    s ^= s >> np.uint64(12)
    s ^= s << np.uint64(25)
    s ^= s >> np.uint64(27)
    seed[0] = s
    return float((s * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@njit(cache=True)
def _cost(a: FloatArray, b: FloatArray, turning: bool) -> float:
    way = hypot(b[0] - a[0], b[1] - a[1])
    return way + ROTATION_WEIGHT * abs(turn(a[2], b[2])) if turning else way


@njit(cache=True)
def _total(path: FloatArray, turning: bool) -> float:
    total = 0.0
    for i in range(len(path) - 1):
        total += _cost(path[i], path[i + 1], turning)
    return total


@njit(cache=True)
def _between(a: FloatArray, b: FloatArray, t: float, q: FloatArray) -> None:
    """Write the configuration at fraction t of the motion from a to b into q."""
    q[0] = a[0] + t * (b[0] - a[0])
    q[1] = a[1] + t * (b[1] - a[1])
    q[2] = wrapped(a[2] + t * turn(a[2], b[2]))


@njit(cache=True, nogil=True)
def _sweep(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    path: FloatArray,
    turning: bool,
    seed: NDArray[np.uint64],
    scale: float,
    splitting: bool,
) -> tuple[FloatArray, float]:
    """Return the path after one round of every kind of change, and the step for the next one's moves."""
    placed, queue = workspace(robot), np.empty((128, 2))
    for _ in range(10 + 2 * len(path)):
        path = _shortcut(grid, field, robot, placed, queue, path, turning, seed)
    if turning:
        for _ in range(5 + len(path)):
            path = _heading_shortcut(grid, field, robot, placed, queue, path, seed)
    path = _drop(grid, field, robot, placed, queue, path, turning)
    moved = 0
    if splitting and len(path) > 2:
        path = _split(path, turning, seed, scale)
    for _ in range(3):
        moved += _move(grid, field, robot, placed, queue, path, turning, seed, scale)
    scale *= 1.2 if 4 * moved > len(path) else 0.6
    return _drop(grid, field, robot, placed, queue, path, turning), scale


@njit(cache=True)
def _locate(path: FloatArray, turning: bool, where: float, q: FloatArray) -> int:
    """Write the configuration at cost ``where`` along the path into q; return the motion it lies on."""
    for i in range(len(path) - 1):
        step = _cost(path[i], path[i + 1], turning)
        if where <= step or i == len(path) - 2:
            _between(path[i], path[i + 1], min(1.0, where / step) if step > 0.0 else 0.0, q)
            return i
        where -= step
    return 0


@njit(cache=True)
def random_span(total: float, pieces: int, seed: NDArray[np.uint64]) -> tuple[float, float]:
    """Return two places along a path: at all scales alike, from the whole path down to one motion's length."""
    span = total * 2.0 ** (-uniform(seed) * log2(2.0 * pieces + 2.0))
    low = (uniform(seed) * (total + span)) - span
    return max(0.0, low), min(total, low + span)


@njit(cache=True)
def _shortcut(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    path: FloatArray,
    turning: bool,
    seed: NDArray[np.uint64],
) -> FloatArray:
    """Join two random places of the path by a motion if that is shorter and certified."""
    n = len(path)
    total = _total(path, turning)
    low, high = random_span(total, n, seed)
    a, b = np.empty(3), np.empty(3)
    i, j = _locate(path, turning, low, a), _locate(path, turning, high, b)
    if i >= j or high - low - _cost(a, b, turning) < GAIN:
        return path
    if motion(grid, field, robot, placed, queue, a, b, True, EFFORT) != FREE:
        return path
    # Places at a vertex bring no new one.
    keep_a = _cost(path[i], a, turning) > GAIN
    keep_b = _cost(b, path[j + 1], turning) > GAIN
    head = i + 1
    result = np.empty((head + int(keep_a) + int(keep_b) + n - j - 1, 3))
    result[:head] = path[:head]
    k = head
    if keep_a:
        result[k] = a
        k += 1
    if keep_b:
        result[k] = b
        k += 1
    result[k:] = path[j + 1 :]
    return result


@njit(cache=True)
def _heading_shortcut(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    path: FloatArray,
    seed: NDArray[np.uint64],
) -> FloatArray:
    """Turn evenly between two vertices, leaving positions alone, if that turns less and is certified."""
    n = len(path)
    if n < 3:
        return path
    i = int(uniform(seed) * (n - 2))
    j = i + 2 + int(uniform(seed) * (n - i - 2))
    turned, way = 0.0, 0.0
    for k in range(i, j):
        turned += abs(turn(path[k, 2], path[k + 1, 2]))
        way += hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
    shorter = turn(path[i, 2], path[j, 2])
    if turned - abs(shorter) < GAIN:
        return path
    result = path.copy()
    along = 0.0
    for k in range(i, j - 1):
        along += hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        share = along / way if way > 0.0 else (k + 1 - i) / (j - i)
        result[k + 1, 2] = wrapped(path[i, 2] + share * shorter)
    for k in range(i, j):
        if motion(grid, field, robot, placed, queue, result[k], result[k + 1], True, EFFORT) != FREE:
            return path
    return result


@njit(cache=True)
def _drop(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    path: FloatArray,
    turning: bool,
) -> FloatArray:
    """Leave out vertices that the path does without."""
    kept = np.empty_like(path)
    kept[0] = path[0]
    n = 1
    for i in range(1, len(path) - 1):
        a, b = kept[n - 1], path[i + 1]
        before = _cost(a, path[i], turning) + _cost(path[i], b, turning)
        if (
            before - _cost(a, b, turning) >= -1e-12
            and motion(grid, field, robot, placed, queue, a, b, True, EFFORT) == FREE
        ):
            continue
        kept[n] = path[i]
        n += 1
    kept[n] = path[-1]
    return kept[: n + 1].copy()


@njit(cache=True)
def _split(path: FloatArray, turning: bool, seed: NDArray[np.uint64], scale: float) -> FloatArray:
    """Return the path with two more vertices, on either side of a random one: a corner may take more than one."""
    n = len(path)
    i = 1 + int(uniform(seed) * (n - 2))
    result = np.empty((n + 2, 3))
    result[:i] = path[:i]
    result[i + 1] = path[i]
    result[i + 3 :] = path[i + 1 :]
    for other, k in ((i - 1, i), (i + 1, i + 2)):
        way = _cost(path[i], path[other], turning)
        _between(path[i], path[other], min(0.45, scale * uniform(seed) / max(way, 1e-12)), result[k])
    return result


@njit(cache=True)
def _move(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    path: FloatArray,
    turning: bool,
    seed: NDArray[np.uint64],
    scale: float,
) -> int:
    """Move every inner vertex, in place, towards the line between its neighbours or at random; count what helped."""
    moved = 0
    q, straight = np.empty(3), np.empty(3)
    for i in range(1, len(path) - 1):
        a, b = path[i - 1], path[i + 1]
        before = _cost(a, path[i], turning) + _cost(path[i], b, turning)
        first, second = _cost(a, path[i], turning), _cost(path[i], b, turning)
        _between(a, b, first / max(first + second, 1e-12), straight)
        for attempt in range(4):
            if attempt == 0:
                _between(path[i], straight, 0.5, q)
            elif attempt == 1:
                _between(path[i], straight, 0.1, q)
            elif attempt == 2 and turning:
                q[:] = path[i]
                q[2] = straight[2]
            else:
                angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
                q[0] = path[i, 0] + step * cos(angle)
                q[1] = path[i, 1] + step * sin(angle)
                q[2] = path[i, 2]
                if turning:
                    q[2] = wrapped(q[2] + (uniform(seed) - 0.5) * min(2.0, 2.0 * scale))
            if before - _cost(a, q, turning) - _cost(q, b, turning) < GAIN:
                continue
            if (
                # One look at the new place is cheaper than two motions, and most fail there.
                state(grid, field, robot, placed, q[0], q[1], q[2]) == FREE
                and motion(grid, field, robot, placed, queue, a, q, True, EFFORT) == FREE
                and motion(grid, field, robot, placed, queue, q, b, True, EFFORT) == FREE
            ):
                path[i] = q
                moved += 1
                break
    return moved
