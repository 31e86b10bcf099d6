"""Path shortening with certified motions: shortcuts, also of headings alone, moved, added and needless vertices.

Sources: shortcuts: Kavraki, Svestka, Latombe & Overmars 1996, section 4.5, and Geraerts & Overmars, "Creating
high-quality paths for motion planning", IJRR 2007, which also brings shortcuts of single coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, hypot, log2, pi, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import Deadline, over
from trailmark.collision.kernels import FREE, state
from trailmark.curves.shortest import shortest_word
from trailmark.curves.words import walk
from trailmark.heading import turn, wrapped
from trailmark.jit import array_callee, callee, njit
from trailmark.motion import Motion
from trailmark.motion.base import (
    DIFFERENTIAL,
    STRAIGHT,
    MotionModel,
    Scratch,
    certified,
    charged,
    cost,
    extra_along,
    facing,
    interpolate,
    least_cost,
    new_scratch,
    obeys_triangle,
)
from trailmark.se2 import FloatArray

__all__ = ["EFFORT", "GAIN", "shorten", "with_fewer_vertices", "without_needless"]

EFFORT: Any = np.int64(500)
"""Configurations evaluated for one motion at most: one that needs more grazes something; another is sooner tried."""

GAIN = 1e-7
"""Metres that a change must save at least."""

ATTEMPTS, MOVES = 5, 3
"""Proposals of another place for a vertex, and times in a sweep that every vertex is moved."""

SHORT = 0.02
"""Share of a path's cost up to which a motion is not halved."""

Seed = NDArray[np.uint64]


def shorten(
    motion: Motion,
    states: FloatArray,
    rng: np.random.Generator,
    *,
    sweeps: int = 40,
    tolerance: float = 1e-3,
    splitting: bool = False,
    seconds_left: Callable[[], float] | None = None,
) -> FloatArray:
    """Return a path that costs no more than the given one, with the same ends; shape (m, 3).

    Args:
        motion: what leads from one state to the next, and certifies it.
        states: a path of certified motions, shape (n, 3).
        rng: source of randomness.
        sweeps: rounds over the whole path at most.
        tolerance: stop when three sweeps together save less than this share of the cost.
        splitting: add vertices in each sweep; takes longer, and gets around corners on which the path hangs.
        seconds_left: asked before each sweep; it ends when they are over. None: there is no end to the time.
    """
    seed = np.array([rng.integers(1, 2**63)], dtype=np.uint64)
    # A copy: a Path's states are read-only, which to numba is another type and another compilation.
    path = np.array(states, dtype=np.float64, order="C")
    history = [motion.cost_of(path)]
    scale = 0.1 * history[0] / max(1, len(path))
    for _ in range(sweeps):
        seconds = np.inf if seconds_left is None else seconds_left()
        # A car may have a cheaper curve than the shortest one, and what is cheapest need not be straight.
        alone = motion.charged or (splitting and not motion.direct_is_best)
        if (len(path) < 3 and not alone) or seconds <= 0.0:
            break
        path, scale, after = _sweep(motion.kind, path, seed, scale, splitting, Deadline.after(seconds))
        history.append(after)
        if len(history) > 3 and history[-4] - history[-1] < tolerance * history[-1]:
            break
    return path


def with_fewer_vertices(motion: Motion, states: FloatArray, rise: float) -> FloatArray:
    """Return a path whose motions each take the place of several, as many as cost no more than so much less.

    Args:
        motion: certifies them.
        states: of a path of certified motions, shape (n, 3).
        rise: share by which one motion may cost more than those whose place it takes.
    """
    along = (
        np.concatenate([[0.0], np.cumsum(motion.costs(states[:-1], states[1:]))]) if len(states) > 1 else np.zeros(1)
    )
    kept, i = [0], 0
    while i < len(states) - 1:
        ends = np.arange(len(states) - 1, i, -1)
        begins = np.repeat(states[i][None], len(ends), axis=0)
        good = motion.costs(begins, states[ends]) <= (1.0 + rise) * (along[ends] - along[i]) + GAIN
        certified_ends = (k for k in ends[good] if motion.motions_between_valid(begins[:1], states[k][None])[0])
        i = int(next(certified_ends, i + 1))
        kept.append(i)
    return states[kept]


@njit(nogil=True)
def _sweep(
    kind: MotionModel, path: FloatArray, seed: Seed, scale: float, splitting: bool, deadline: Deadline
) -> tuple[FloatArray, float, float]:
    """Return the path after one round of every kind of change, the step for the next one's moves, and its cost.

    At the deadline it ends with the changes made so far.
    """
    scratch = new_scratch(kind)
    costs = _costs(kind, scratch, path)
    for _ in range(10 + 2 * len(path)):
        if not over(deadline):
            path, costs = _shortcut(kind, scratch, path, costs, seed)
    if not over(deadline):
        turn_evenly(kind, scratch, path, seed)
        path = without_needless(kind, path, EFFORT)
        costs = _costs(kind, scratch, path)
        if splitting and not obeys_triangle(kind):
            path = _halved(kind, scratch, path, costs)
        elif splitting and len(path) > 2:
            path = _split(kind, scratch, path, costs, seed, scale)
        costs = _costs(kind, scratch, path)
        moved = 0
        for _ in range(MOVES):
            moved += _move(kind, scratch, path, costs, seed, scale, deadline)
        scale *= 1.2 if 4 * moved > len(path) else 0.6
    if not over(deadline):
        path = without_needless(kind, path, EFFORT)
        costs = _costs(kind, scratch, path)
    return path, scale, float(costs.sum() + extra_along(kind, scratch, path, 0, len(costs)))


@array_callee
def _costs(kind: MotionModel, scratch: Scratch, path: FloatArray) -> FloatArray:
    """Return the costs of a path's motions, shape (n - 1,), metres."""
    result = np.empty(len(path) - 1)
    for i in range(len(result)):
        result[i] = cost(kind, scratch, path[i], path[i + 1])
    return result


@callee
def uniform(seed: Seed) -> float:
    """Return a number in [0, 1) and advance the seed (xorshift64*: Vigna 2016)."""
    s = seed[0]
    s ^= s >> np.uint64(12)
    s ^= s << np.uint64(25)
    s ^= s >> np.uint64(27)
    seed[0] = s
    return float((s * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@array_callee
def _locate(
    kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray, place: float, q: FloatArray
) -> tuple[int, float]:
    """Write the configuration at cost ``place`` along the path into q; return its motion and what lies before on it.

    Places within GAIN of a vertex count as the vertex.
    """
    i = 0
    while i < len(costs) - 1 and place > costs[i]:
        place -= costs[i]
        i += 1
    if place < GAIN:
        q[:] = path[i]
        return i, 0.0
    if place > costs[i] - GAIN:
        q[:] = path[i + 1]
        return (i + 1, 0.0) if i < len(costs) - 1 else (i, costs[i])
    interpolate(kind, scratch, path[i], path[i + 1], place, q)
    return i, place


@array_callee
def _shortcut(
    kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray, seed: Seed
) -> tuple[FloatArray, FloatArray]:
    """Join two random places of the path by a motion, if that saves cost and is certified.

    What is left over of the motions that the places lie on is certified again: a part of a car's shortest curve is one
    itself, but perhaps not the only one between its ends.
    """
    n, total = len(path), costs.sum()
    # At all scales alike, from the whole path down to one motion's length.
    span = total * 2.0 ** (-uniform(seed) * log2(2.0 * n + 2.0))
    low = uniform(seed) * (total + span) - span
    low, high = max(0.0, low), min(total, low + span)
    ends = np.empty((2, 3))
    a, b = ends[0], ends[1]
    i, before = _locate(kind, scratch, path, costs, low, a)
    j, behind = _locate(kind, scratch, path, costs, high, b)
    extra = extra_along(kind, scratch, path, 0, n)
    limit = high - low + extra - GAIN
    # A motion is the cheapest between two places on it, but for what a car is charged beyond its length.
    if i > j or (i == j and not charged(kind)) or least_cost(kind, a, b) > limit:
        return path, costs
    keep_a, keep_b = before > 0.0, behind < costs[j]
    if (
        cost(kind, scratch, a, b) + extra_along(kind, scratch, ends, 0, 2) > limit
        or not certified(kind, scratch, a, b, EFFORT)
        or (keep_a and not certified(kind, scratch, path[i], a, EFFORT))
        or (keep_b and not certified(kind, scratch, b, path[j + 1], EFFORT))
    ):
        return path, costs
    k = i + 1
    fresh = np.empty((k + keep_a + keep_b + n - j - 1, 3))
    fresh[:k] = path[:k]
    if keep_a:
        fresh[k] = a
        k += 1
    if keep_b:
        fresh[k] = b
        k += 1
    fresh[k:] = path[j + 1 :]
    after = _costs(kind, scratch, fresh)
    # Where the cost is not spread evenly along a motion, or depends on the one before, less may be saved than thought.
    may_rise = charged(kind) or not obeys_triangle(kind)
    if may_rise and after.sum() + extra_along(kind, scratch, fresh, 0, len(after)) > total + extra - GAIN:
        return path, costs
    return fresh, after


@array_callee
def turn_evenly(kind: MotionModel, scratch: Scratch, path: FloatArray, seed: Seed) -> None:
    """Turn evenly between random vertices, in place, positions left alone, where that turns less and is certified.

    A disc has no heading, a car's follow from its curves, and those of a differential drive from where it drives.
    """
    n = len(path)
    for _ in range(5 + n if n > 2 and kind.drive == STRAIGHT else 0):
        i = int(uniform(seed) * (n - 2))
        j = i + 2 + int(uniform(seed) * (n - i - 2))
        turned, length = 0.0, 0.0
        for k in range(i, j):
            turned += abs(turn(path[k, 2], path[k + 1, 2]))
            length += hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        shorter = turn(path[i, 2], path[j, 2])
        free, along, changed = turned - abs(shorter) >= GAIN, 0.0, path[i : j + 1].copy()
        for k in range(j - i if free else 0):
            along += hypot(changed[k + 1, 0] - changed[k, 0], changed[k + 1, 1] - changed[k, 1])
            if k < j - i - 1:
                share = along / length if length > 0.0 else (k + 1) / (j - i)
                changed[k + 1, 2] = wrapped(path[i, 2] + share * shorter)
            free = free and certified(kind, scratch, changed[k], changed[k + 1], EFFORT)
        if free:
            path[i : j + 1] = changed


@array_callee
def _move(
    kind: MotionModel,
    scratch: Scratch,
    path: FloatArray,
    costs: FloatArray,
    seed: Seed,
    scale: float,
    deadline: Deadline,
) -> int:
    """Move every inner vertex, in place, towards the motion between its neighbours or at random; count what helped."""
    moved = 0
    for i in range(1, len(path) - 1):
        if over(deadline):
            break
        a, b = path[i - 1], path[i + 1]
        before, extra = costs[i - 1] + costs[i], extra_along(kind, scratch, path, i - 2, i + 2)
        share = costs[i - 1] / max(before, 1e-12)
        for attempt in range(ATTEMPTS):
            q = propose(kind, scratch, path[i - 1 : i + 2], share, attempt, scale, seed)
            first = cost(kind, scratch, a, q)
            if before + extra - first < GAIN:
                continue
            second = cost(kind, scratch, q, b)
            saved = before - first - second
            if charged(kind):
                here = path[i].copy()
                path[i] = q
                saved += extra - extra_along(kind, scratch, path, i - 2, i + 2)
                path[i] = here
            if (
                saved >= GAIN
                # One look at the new place is cheaper than two motions, and most fail there.
                and state(kind.grid, kind.field, kind.robot, scratch.placed, q[0], q[1], q[2]) == FREE
                and certified(kind, scratch, a, q, EFFORT)
                and certified(kind, scratch, q, b, EFFORT)
            ):
                path[i] = q
                costs[i - 1], costs[i] = first, second
                moved += 1
                break
    return moved


@array_callee
def _split(
    kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray, seed: Seed, scale: float
) -> FloatArray:
    """Return the path with two more vertices, on either side of a random one: a corner may take more than one."""
    n = len(path)
    i = 1 + int(uniform(seed) * (n - 2))
    result = np.empty((n + 2, 3))
    result[:i] = path[:i]
    result[i + 1] = path[i]
    result[i + 3 :] = path[i + 1 :]
    before = min(0.45 * costs[i - 1], scale * uniform(seed))
    interpolate(kind, scratch, path[i - 1], path[i], costs[i - 1] - before, result[i])
    interpolate(kind, scratch, path[i], path[i + 1], min(0.45 * costs[i], scale * uniform(seed)), result[i + 2])
    return result


@array_callee
def _halved(kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray) -> FloatArray:
    """Return the path with a vertex in the middle of every longer motion: what is cheapest need not be straight."""
    longer = costs > SHORT * costs.sum()
    result, k = np.empty((len(path) + longer.sum(), 3)), 0
    for i in range(len(costs)):
        result[k] = path[i]
        k += 1
        if longer[i]:
            interpolate(kind, scratch, path[i], path[i + 1], 0.5 * costs[i], result[k])
            k += 1
    result[k] = path[-1]
    return result


@njit(nogil=True)
def without_needless(kind: MotionModel, path: FloatArray, effort: int) -> FloatArray:
    """Return a path of certified motions without vertices whose neighbours a certified motion joins; shape (m, 3).

    None of what is left is needless: what lies beside a vertex left out is looked at again. The cost rises by no more
    than rounding, mostly by the triangle inequality.

    Args:
        kind: of motion.
        path: shape (n, 3).
        effort: configurations evaluated for one motion at most.
    """
    scratch = new_scratch(kind)
    n = len(path)
    before, after = np.arange(n) - 1, np.arange(n) + 1
    kept, waits = np.ones(n, np.bool_), np.ones(n, np.bool_)
    waiting = np.arange(n)[::-1].copy()
    size = n
    while size > 0:
        size -= 1
        i = waiting[size]
        waits[i] = False
        if i == 0 or i == n - 1 or not kept[i]:
            continue
        a, b = before[i], after[i]
        rows = (max(before[a], 0), a, i, b, min(after[b], n - 1))
        if (charged(kind) or not obeys_triangle(kind)) and _rise(kind, scratch, path, rows) > GAIN:
            continue
        if certified(kind, scratch, path[a], path[b], effort):
            kept[i] = False
            after[a], before[b] = b, a
            for j in (b, a):
                if not waits[j]:
                    waits[j] = True
                    waiting[size] = j
                    size += 1
    return path[kept]


@array_callee
def _rise(kind: MotionModel, scratch: Scratch, path: FloatArray, rows: tuple[int, int, int, int, int]) -> float:
    """Return what a path costs more, in metres, without the third of five vertices that follow one another."""
    window = np.empty((5, 3))
    for k in range(5):
        window[k] = path[rows[k]]
    rise = -extra_along(kind, scratch, window, 0, 4)
    rise -= cost(kind, scratch, window[1], window[2]) + cost(kind, scratch, window[2], window[3])
    window[2:4] = window[3:]
    return rise + cost(kind, scratch, window[1], window[2]) + extra_along(kind, scratch, window, 0, 3)


# --- Proposals: where a vertex of a path might better be.


@array_callee
def propose(
    kind: MotionModel, scratch: Scratch, near: FloatArray, share: float, attempt: int, scale: float, seed: Seed
) -> FloatArray:
    """Return where the second of three vertices, shape (3, 3), might better be, shape (3,); where it is for no other.

    These are half, and a tenth, of the way to the straight motion between its neighbours, its heading alone, and a
    random place. A differential drive is to get there without a turn at the end.

    Args:
        kind: of motion.
        scratch: memory to work in.
        near: the vertex between its neighbours.
        share: of the cost from the one before to the one after, at which it lies.
        attempt: number of the proposal, from 0 to ATTEMPTS - 1.
        scale: metres that random proposals lie away at most.
        seed: of random numbers.
    """
    q: FloatArray = near[1].copy()
    if len(kind.weighted):
        # At all scales: the cheapest path is curved, here more, there less.
        before, after = near[0] - near[1], near[2] - near[1]
        close = min(hypot(before[0], before[1]), hypot(after[0], after[1]))
        scale, attempt = max(0.5 * close * 2.0 ** (-6.0 * uniform(seed)), 1e-6), (0, 2, 3, 3, 3)[attempt]
    if len(kind.car):
        _propose_for_car(kind, scratch, near, share, attempt, scale, seed, q)
        return q
    heading = wrapped(near[0, 2] + share * turn(near[0, 2], near[2, 2]))
    if attempt < 2:
        t = (0.5, 0.1)[attempt]
        q[:2] += t * (near[0, :2] + share * (near[2, :2] - near[0, :2]) - q[:2])
        if kind.drive == STRAIGHT:
            q[2] = wrapped(q[2] + t * turn(q[2], heading))
    elif attempt == 2 and kind.drive == STRAIGHT:
        q[2] = heading
    elif attempt == (2 if kind.drive == DIFFERENTIAL else 3):
        _shift(q, 2.0 * pi * uniform(seed), scale, seed)
        if kind.drive == STRAIGHT:
            q[2] = wrapped(q[2] + (uniform(seed) - 0.5) * min(2.0, 2.0 * scale))
    if kind.drive == DIFFERENTIAL:
        q[2] = facing(kind, near[0], q)
    return q


@callee
def _shift(q: FloatArray, angle: float, scale: float, seed: Seed) -> None:
    """Move a place in one direction, by a random step up to ``scale``."""
    step = scale * sqrt(uniform(seed))
    q[0] += step * cos(angle)
    q[1] += step * sin(angle)


@callee
def _propose_for_car(
    kind: MotionModel,
    scratch: Scratch,
    near: FloatArray,
    share: float,
    attempt: int,
    scale: float,
    seed: Seed,
    q: FloatArray,
) -> None:
    """Write a place on the curve between the neighbours, one along the heading, another heading, or a random one."""
    if attempt == 0:
        length = shortest_word(near[0], near[2], kind.radius, kind.reverse, scratch.words)
        walk(near[0], scratch.words[0], kind.radius, share * length, q)
    elif attempt == 1:
        _shift(q, q[2] if uniform(seed) < 0.5 else q[2] + pi, scale, seed)
    else:
        if attempt > 2:
            _shift(q, 2.0 * pi * uniform(seed), scale, seed)
        q[2] = wrapped(q[2] + (2.0 * uniform(seed) - 1.0) * min(1.0, scale / kind.radius))
