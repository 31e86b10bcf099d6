"""Shortening of a car's path: shortcuts by shortest curves, knots left out, knots moved; all of it certified.

As :mod:`trailmark.planning.shortening` does for straight motions. A part of a shortest curve is itself a shortest curve
between its ends, but perhaps not the only one: parts that a shortcut leaves over are therefore certified again.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.curve_motions import CurveChecker, curve_free
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, state, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.curves.shortest import MOST_WORDS, curve_length, shortest_word
from trailmark.curves.words import PIECES, walk
from trailmark.heading import wrapped
from trailmark.planning.shortening import random_span, uniform
from trailmark.se2 import FloatArray

__all__ = ["shorten_curves", "without_needless_knots"]

GAIN = 1e-6
"""Metres that a change must save at least."""


def shorten_curves(
    motions: CurveChecker,
    knots: FloatArray,
    rng: np.random.Generator,
    *,
    sweeps: int = 40,
    tolerance: float = 1e-3,
    stop: Callable[[], bool] | None = None,
) -> FloatArray:
    """Return the knots, shape (m, 3), of a path no longer than the given one, with the same ends.

    Args:
        motions: certifies the curves.
        knots: of a path of certified curves, shape (n, 3).
        rng: source of randomness.
        sweeps: rounds over the whole path at most.
        tolerance: stop when three sweeps together save less than this share of the length.
        stop: asked before each sweep whether to end early.
    """
    checker, steering = motions.checker, motions.steering
    seed = np.array([rng.integers(1, 2**63)], dtype=np.uint64)
    path = np.array(knots, dtype=np.float64, order="C")
    lengths = np.array(steering.lengths(path[:-1], path[1:]) if len(path) > 1 else [])
    scale = 0.1 * float(lengths.sum()) / max(1, len(path))
    history = [float(lengths.sum())]
    for _ in range(sweeps):
        if len(path) < 3 or (stop is not None and stop()):
            break
        path, lengths, scale = _sweep(
            checker.grid,
            checker.field,
            checker.footprint,
            steering.radius,
            steering.reverse,
            path,
            lengths,
            seed,
            scale,
        )
        history.append(float(lengths.sum()))
        if len(history) > 3 and history[-4] - history[-1] < tolerance * history[-1]:
            break
    return np.asarray(path)


def without_needless_knots(motions: CurveChecker, knots: FloatArray) -> FloatArray:
    """Return the knots, shape (m, 3), without those whose neighbours a certified curve joins that is no longer."""
    checker, steering = motions.checker, motions.steering
    path = np.array(knots, dtype=np.float64, order="C")
    while True:
        lengths = np.array(steering.lengths(path[:-1], path[1:]) if len(path) > 1 else [])
        fewer = _without(
            checker.grid, checker.field, checker.footprint, steering.radius, steering.reverse, path, lengths
        )
        if len(fewer) == len(path):
            return path
        path = np.asarray(fewer)


@njit(cache=True, nogil=True)
def _without(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    radius: float,
    reverse: bool,
    path: FloatArray,
    lengths: FloatArray,
) -> FloatArray:
    placed, queue, words = workspace(robot), np.empty((128, 2)), np.empty((MOST_WORDS, 2, PIECES))
    return _drop(grid, field, robot, placed, queue, words, radius, reverse, path, lengths)[0]


@njit(cache=True, nogil=True)
def _sweep(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    radius: float,
    reverse: bool,
    path: FloatArray,
    lengths: FloatArray,
    seed: NDArray[np.uint64],
    scale: float,
) -> tuple[FloatArray, FloatArray, float]:
    """Return the path after one round of every kind of change, its lengths, and the step for the next one's moves."""
    placed, queue, words = workspace(robot), np.empty((128, 2)), np.empty((MOST_WORDS, 2, PIECES))
    for _ in range(10 + 2 * len(path)):
        path, lengths = _shortcut(grid, field, robot, placed, queue, words, radius, reverse, path, lengths, seed)
    path, lengths = _drop(grid, field, robot, placed, queue, words, radius, reverse, path, lengths)
    moved = 0
    for _ in range(3):
        moved += _move(grid, field, robot, placed, queue, words, radius, reverse, path, lengths, seed, scale)
    return path, lengths, scale * (1.2 if 4 * moved > len(path) else 0.6)


@njit(cache=True)
def _locate(
    words: FloatArray, radius: float, reverse: bool, path: FloatArray, lengths: FloatArray, where: float, q: FloatArray
) -> tuple[int, float]:
    """Write the configuration ``where`` metres along the path into q; return its curve and how far along that it lies.

    Places within GAIN of a knot count as the knot.
    """
    i = 0
    while i < len(lengths) - 1 and where > lengths[i]:
        where -= lengths[i]
        i += 1
    if where < GAIN:
        q[:] = path[i]
        return i, 0.0
    if where > lengths[i] - GAIN:
        q[:] = path[i + 1]
        return (i + 1, 0.0) if i < len(lengths) - 1 else (i, lengths[i])
    walk(path[i], shortest_word(path[i], path[i + 1], radius, reverse, words), radius, where, q)
    return i, where


@njit(cache=True)
def _shortcut(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    words: FloatArray,
    radius: float,
    reverse: bool,
    path: FloatArray,
    lengths: FloatArray,
    seed: NDArray[np.uint64],
) -> tuple[FloatArray, FloatArray]:
    """Join two random places of the path by the shortest curve if that saves length and is certified."""
    n = len(path)
    low, high = random_span(lengths.sum(), n, seed)
    a, b = np.empty(3), np.empty(3)
    i, before = _locate(words, radius, reverse, path, lengths, low, a)
    j, behind = _locate(words, radius, reverse, path, lengths, high, b)
    if i >= j:
        return path, lengths
    between = curve_length(a, b, radius, reverse, words)
    saved = lengths[i] - before + behind - between
    for k in range(i + 1, j):
        saved += lengths[k]
    if saved < GAIN or curve_free(grid, field, robot, placed, queue, words, a, b, radius, reverse) != FREE:
        return path, lengths
    keep_a, keep_b = before > 0.0, behind < lengths[j]
    if keep_a and curve_free(grid, field, robot, placed, queue, words, path[i], a, radius, reverse) != FREE:
        return path, lengths
    if keep_b and curve_free(grid, field, robot, placed, queue, words, b, path[j + 1], radius, reverse) != FREE:
        return path, lengths
    head, tail = path[: i + 1], path[j + 1 :]
    fresh = np.empty((len(head) + int(keep_a) + int(keep_b) + len(tail), 3))
    fresh[: len(head)] = head
    k = len(head)
    if keep_a:
        fresh[k] = a
        k += 1
    if keep_b:
        fresh[k] = b
        k += 1
    fresh[k:] = tail
    return fresh, _lengths(fresh, radius, reverse, words)


@njit(cache=True)
def _lengths(path: FloatArray, radius: float, reverse: bool, words: FloatArray) -> FloatArray:
    result = np.empty(len(path) - 1)
    for i in range(len(result)):
        result[i] = curve_length(path[i], path[i + 1], radius, reverse, words)
    return result


@njit(cache=True)
def _drop(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    words: FloatArray,
    radius: float,
    reverse: bool,
    path: FloatArray,
    lengths: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Leave out knots that the path does without."""
    kept = np.empty_like(path)
    kept[0] = path[0]
    n = 1
    for i in range(1, len(path) - 1):
        a, b = kept[n - 1], path[i + 1]
        around = curve_length(a, path[i], radius, reverse, words) + lengths[i]
        if (
            around - curve_length(a, b, radius, reverse, words) >= -1e-9
            and curve_free(grid, field, robot, placed, queue, words, a, b, radius, reverse) == FREE
        ):
            continue
        kept[n] = path[i]
        n += 1
    kept[n] = path[-1]
    short = kept[: n + 1].copy()
    return short, _lengths(short, radius, reverse, words)


@njit(cache=True)
def _move(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    words: FloatArray,
    radius: float,
    reverse: bool,
    path: FloatArray,
    lengths: FloatArray,
    seed: NDArray[np.uint64],
    scale: float,
) -> int:
    """Move every inner knot, in place, towards the curve between its neighbours or at random; count what helped."""
    moved = 0
    q = np.empty(3)
    for i in range(1, len(path) - 1):
        a, b = path[i - 1], path[i + 1]
        before = lengths[i - 1] + lengths[i]
        for attempt in range(5):
            if attempt == 0:
                straight = curve_length(a, b, radius, reverse, words)
                share = lengths[i - 1] / max(before, 1e-12)
                walk(a, shortest_word(a, b, radius, reverse, words), radius, share * straight, q)
            else:
                angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
                if attempt == 1:
                    # Along its heading, the way that it can go.
                    angle = path[i, 2] if uniform(seed) < 0.5 else path[i, 2] + pi
                q[0], q[1], q[2] = path[i, 0] + step * cos(angle), path[i, 1] + step * sin(angle), path[i, 2]
                if attempt == 2:
                    q[0], q[1] = path[i, 0], path[i, 1]
                if attempt > 1:
                    q[2] = wrapped(q[2] + (2.0 * uniform(seed) - 1.0) * min(1.0, scale / radius))
            first = curve_length(a, q, radius, reverse, words)
            if before - first < GAIN:
                continue
            second = curve_length(q, b, radius, reverse, words)
            if before - first - second < GAIN:
                continue
            if (
                state(grid, field, robot, placed, q[0], q[1], q[2]) == FREE
                and curve_free(grid, field, robot, placed, queue, words, a, q, radius, reverse) == FREE
                and curve_free(grid, field, robot, placed, queue, words, q, b, radius, reverse) == FREE
            ):
                path[i] = q
                lengths[i - 1], lengths[i] = first, second
                moved += 1
                break
    return moved
