"""Path shortening with certified motions: shortcuts, shortcuts of the heading alone, moved and dropped vertices.

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

__all__ = ["EFFORT", "GAIN", "halved", "propose", "shorten", "split", "uniform", "without_needless"]

EFFORT: Any = np.int64(500)
"""Configurations evaluated for one motion at most: one that needs more grazes something; another is sooner tried."""


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


@array_callee
def _costs(kind: MotionModel, scratch: Scratch, path: FloatArray) -> FloatArray:
    """Return the costs of a path's motions, shape (n - 1,), metres."""
    result = np.empty(len(path) - 1)
    for i in range(len(result)):
        result[i] = cost(kind, scratch, path[i], path[i + 1])
    return result


@array_callee
def _whole(kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray) -> float:
    """Return a path's cost, in metres: that of its motions, and what a car is charged beyond it."""
    return float(costs.sum() + extra_along(kind, scratch, path, 0, len(costs)))


@njit(nogil=True)
def _sweep(
    kind: MotionModel, path: FloatArray, seed: NDArray[np.uint64], scale: float, splitting: bool, deadline: Deadline
) -> tuple[FloatArray, float, float]:
    """Return the path after one round of every kind of change, the step for the next one's moves, and its cost.

    At the deadline it ends with the changes made so far.
    """
    scratch = new_scratch(kind)
    costs = _costs(kind, scratch, path)
    for _ in range(10 + 2 * len(path)):
        if over(deadline):
            return path, scale, _whole(kind, scratch, path, costs)
        path, costs = _shortcut(kind, scratch, path, costs, seed)
    # It takes what it knows of the costs by the turns alone, so that they are computed anew below.
    turn_evenly(kind, scratch, path, costs, seed)
    path = without_needless(kind, path, EFFORT)
    costs = _costs(kind, scratch, path)
    if over(deadline):
        return path, scale, _whole(kind, scratch, path, costs)
    if splitting and not obeys_triangle(kind):
        path = halved(kind, scratch, path, costs)
        costs = _costs(kind, scratch, path)
    elif splitting and len(path) > 2:
        path = split(kind, scratch, path, costs, seed, scale)
        costs = _costs(kind, scratch, path)
    moved = 0
    for _ in range(3):
        moved += _move(kind, scratch, path, costs, seed, scale, deadline)
    scale *= 1.2 if 4 * moved > len(path) else 0.6
    if over(deadline):
        return path, scale, _whole(kind, scratch, path, costs)
    path = without_needless(kind, path, EFFORT)
    return path, scale, _whole(kind, scratch, path, _costs(kind, scratch, path))


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


@callee
def _random_span(total: float, pieces: int, seed: NDArray[np.uint64]) -> tuple[float, float]:
    """Return two places along a path: at all scales alike, from the whole path down to one motion's length."""
    span = total * 2.0 ** (-uniform(seed) * log2(2.0 * pieces + 2.0))
    low = (uniform(seed) * (total + span)) - span
    return max(0.0, low), min(total, low + span)


@array_callee
def _shortcut(
    kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray, seed: NDArray[np.uint64]
) -> tuple[FloatArray, FloatArray]:
    """Join two random places of the path by a motion, or a car's by several, if that saves cost and is certified.

    What is left over of the motions that the places lie on is certified again: a part of a car's shortest curve is one
    itself, but perhaps not the only one between its ends.
    """
    n = len(path)
    low, high = _random_span(costs.sum(), n, seed)
    a, b = np.empty(3), np.empty(3)
    i, before = _locate(kind, scratch, path, costs, low, a)
    j, behind = _locate(kind, scratch, path, costs, high, b)
    extra = extra_along(kind, scratch, path, 0, n)
    # A motion is the cheapest between two places on it, but for what a car is charged beyond its length.
    if i > j or (i == j and not charged(kind)) or high - low + extra - least_cost(kind, a, b) < GAIN:
        return path, costs
    middle = _joined(kind, scratch, a, b, high - low + extra - GAIN)
    if len(middle) == 0:
        return path, costs
    keep_a, keep_b = before > 0.0, behind < costs[j]
    if keep_a and not certified(kind, scratch, path[i], a, EFFORT):
        return path, costs
    if keep_b and not certified(kind, scratch, b, path[j + 1], EFFORT):
        return path, costs
    head, tail = path[: i + 1], path[j + 1 :]
    inner = middle[int(not keep_a) : len(middle) - int(not keep_b)]
    k, m = len(head), len(inner)
    fresh = np.empty((k + m + len(tail), 3))
    fresh[:k], fresh[k : k + m], fresh[k + m :] = head, inner, tail
    after = _costs(kind, scratch, fresh)
    # Where the cost is not spread evenly along a motion, or depends on the one before, less may be saved than thought.
    may_rise = charged(kind) or not obeys_triangle(kind)
    if may_rise and _whole(kind, scratch, fresh, after) > costs.sum() + extra - GAIN:
        return path, costs
    return fresh, after


@array_callee
def _joined(kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray, limit: float) -> FloatArray:
    """Return the ends of a certified motion from a to b that costs less than ``limit``, shape (2, 3), or none."""
    states = np.empty((2, 3))
    states[0], states[1] = a, b
    total = extra_along(kind, scratch, states, 0, 2) + cost(kind, scratch, a, b)
    if total > limit or not certified(kind, scratch, a, b, EFFORT):
        return states[:0]
    return states


@array_callee
def turn_evenly(
    kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray, seed: NDArray[np.uint64]
) -> None:
    """Turn evenly between random vertices, in place, positions left alone, where that turns less and is certified.

    A disc has no heading, a car's follow from its curves, and those of a differential drive from where it drives.
    """
    n = len(path)
    if n < 3 or kind.drive != STRAIGHT:
        return
    for _ in range(5 + n):
        i = int(uniform(seed) * (n - 2))
        j = i + 2 + int(uniform(seed) * (n - i - 2))
        turned, length = 0.0, 0.0
        for k in range(i, j):
            turned += abs(turn(path[k, 2], path[k + 1, 2]))
            length += hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
        shorter = turn(path[i, 2], path[j, 2])
        if turned - abs(shorter) < GAIN:
            continue
        changed = path[i : j + 1].copy()
        along = 0.0
        for k in range(i, j - 1):
            along += hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
            share = along / length if length > 0.0 else (k + 1 - i) / (j - i)
            changed[k + 1 - i, 2] = wrapped(path[i, 2] + share * shorter)
        free = True
        for k in range(j - i):
            if not certified(kind, scratch, changed[k], changed[k + 1], EFFORT):
                free = False
                break
        if free:
            path[i : j + 1] = changed
            for k in range(i, j):
                costs[k] = cost(kind, scratch, path[k], path[k + 1])


@array_callee
def _move(
    kind: MotionModel,
    scratch: Scratch,
    path: FloatArray,
    costs: FloatArray,
    seed: NDArray[np.uint64],
    scale: float,
    deadline: Deadline,
) -> int:
    """Move every inner vertex, in place, towards the motion between its neighbours or at random; count what helped."""
    moved, q = 0, np.empty(3)
    for i in range(1, len(path) - 1):
        if over(deadline):
            break
        a, b = path[i - 1], path[i + 1]
        before, extra = costs[i - 1] + costs[i], extra_along(kind, scratch, path, i - 2, i + 2)
        for attempt in range(5):
            if not propose(kind, scratch, path, i, costs[i - 1] / max(before, 1e-12), attempt, seed, scale, q):
                break
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
            if saved < GAIN:
                continue
            if (
                # One look at the new place is cheaper than two motions, and most fail there.
                state(kind.grid, kind.field, kind.robot, scratch.placed, q[0], q[1], q[2]) == FREE
                and certified(kind, scratch, a, q, EFFORT)
                and certified(kind, scratch, q, b, EFFORT)
            ):
                path[i] = q
                costs[i - 1], costs[i] = first, second
                moved += 1
                break
    return moved


# --- Needless vertices of a path: those whose neighbours a certified motion joins at no higher cost.

GAIN = 1e-7
"""Metres that a change must save at least."""


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


# --- Proposals: where a vertex of a path might better be, for each kind of motion, and where to add some.

SHORT = 0.02
"""Share of a path's cost up to which a motion is not halved."""


@callee
def uniform(seed: NDArray[np.uint64]) -> float:
    """Return a number in [0, 1) and advance the seed (xorshift64*: Vigna 2016)."""
    s = seed[0]
    s ^= s >> np.uint64(12)
    s ^= s << np.uint64(25)
    s ^= s >> np.uint64(27)
    seed[0] = s
    return float((s * np.uint64(2685821657736338717)) >> np.uint64(11)) * (1.0 / 9007199254740992.0)


@callee
def propose(
    kind: MotionModel,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> bool:
    """Write where vertex i might better be into q; return False if there is no other proposal.

    Args:
        kind: of motion.
        scratch: memory to work in.
        path: (n, 3).
        i: an inner vertex.
        share: of the cost from the vertex before to the one after, at which this one lies.
        attempt: number of the proposal, from 0 on.
        seed: of random numbers.
        scale: metres that random proposals lie away at most.
        q: where to.
    """
    a, here, b = path[i - 1], path[i], path[i + 1]
    if len(kind.weighted):
        # At all scales: what is cheapest is curved, here more and there less.
        near = min(hypot(a[0] - here[0], a[1] - here[1]), hypot(b[0] - here[0], b[1] - here[1]))
        scale = max(0.5 * near * 2.0 ** (-6.0 * uniform(seed)), 1e-6)
        last, attempt = attempt == 4, (0, 2, 3, 3, 3)[attempt]
    else:
        last = attempt == (2, 4, 3, 5)[kind.drive]
    if last:
        return False
    if len(kind.car):
        _propose_curve(kind, scratch, path, i, share, attempt, seed, scale, q)
        return True
    heading = wrapped(a[2] + share * turn(a[2], b[2]))
    if attempt < 2:
        t = 0.5 if attempt == 0 else 0.1
        q[0] = here[0] + t * (a[0] + share * (b[0] - a[0]) - here[0])
        q[1] = here[1] + t * (a[1] + share * (b[1] - a[1]) - here[1])
        q[2] = wrapped(here[2] + t * turn(here[2], heading))
    elif attempt == 2 and kind.drive == STRAIGHT:
        q[0], q[1], q[2] = here[0], here[1], heading
    else:
        angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
        q[0], q[1], q[2] = here[0] + step * cos(angle), here[1] + step * sin(angle), here[2]
        if kind.drive == STRAIGHT:
            q[2] = wrapped(here[2] + (uniform(seed) - 0.5) * min(2.0, 2.0 * scale))
    if kind.drive == DIFFERENTIAL:
        # It arrives without a turn.
        q[2] = here[2]
        q[2] = facing(kind, a, q)
    return True


@callee
def _propose_curve(
    kind: MotionModel,
    scratch: Scratch,
    path: FloatArray,
    i: int,
    share: float,
    attempt: int,
    seed: NDArray[np.uint64],
    scale: float,
    q: FloatArray,
) -> None:
    """Write where vertex i of a car's path might better be into q."""
    a, here, b = path[i - 1], path[i], path[i + 1]
    if attempt == 0:
        length = shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
        walk(a, scratch.words[0], kind.radius, share * length, q)
        return
    angle, step = 2.0 * pi * uniform(seed), scale * sqrt(uniform(seed))
    if attempt == 1:
        # Along its heading, where it can go.
        angle = here[2] if uniform(seed) < 0.5 else here[2] + pi
    q[0], q[1], q[2] = here[0] + step * cos(angle), here[1] + step * sin(angle), here[2]
    if attempt == 2:
        q[0], q[1] = here[0], here[1]
    if attempt > 1:
        q[2] = wrapped(q[2] + (2.0 * uniform(seed) - 1.0) * min(1.0, scale / kind.radius))


@array_callee
def split(
    kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray, seed: NDArray[np.uint64], scale: float
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
def halved(kind: MotionModel, scratch: Scratch, path: FloatArray, costs: FloatArray) -> FloatArray:
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
