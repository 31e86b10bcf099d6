"""A tree of a car's drives: grown from sources by the cheapest first, in compiled code."""

from __future__ import annotations

from math import ceil, cos, floor, hypot, pi, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision.certify import BUDGET, curve_motion
from trailmark.collision.kernels import FREE, state, workspace
from trailmark.curves.shortest import MAX_WORDS, all_words
from trailmark.curves.words import PIECES, copy_word, unit_length, walk
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.base import MotionModel, charged, word_extra
from trailmark.motion.one_way import curve_allowed
from trailmark.se2 import FloatArray

__all__ = ["NO_TARGETS", "Guide", "Targets", "Tree", "grow"]

GREED = 1.5
"""How much a metre still to go counts against one driven already."""

EVERY = 10
"""Expanded nodes for each from which curves to the targets are tried."""

MAX_TRIED = 3
"""Curves tried from a node to a target at most, the cheapest first."""


class Targets(NamedTuple):
    """Configurations from which it is known how to go on.

    Attributes:
        configurations: (t, 3).
        costs: (t,) of going on from each, metres.
        gears: (t,) in which that begins: 1 forwards, -1 backwards, 0 for neither.
    """

    configurations: FloatArray
    costs: FloatArray
    gears: FloatArray


NO_TARGETS = Targets(np.empty((0, 3)), np.empty(0), np.empty(0))


class Guide(NamedTuple):
    """The relaxed problem's costs to go, as compiled code takes them.

    Attributes:
        cost: (rows, columns), metres.
        x0: of the grid's corner, metres.
        y0: likewise.
        size: of a cell, metres.
        center: (2,) of the inscribed disc in the robot's frame.
    """

    cost: FloatArray
    x0: float
    y0: float
    size: float
    center: FloatArray


class Tree(NamedTuple):
    """Drives that hang on sources.

    Attributes:
        q: (n, 3) nodes, sources first.
        parents: (n,), -1 of sources.
        controls: (n, 2): side, and metres driven, negative backwards.
        to_go: (n,) relaxed costs to go, metres.
        node: from which the cheapest curve leads to a target; -1 if none does.
        target: to which it leads.
        word: (2, 5), that curve.
    """

    q: FloatArray
    parents: NDArray[np.int64]
    controls: FloatArray
    to_go: FloatArray
    node: int
    target: int
    word: FloatArray


@callee
def _slot(table: NDArray[np.int64], key: int) -> int:
    """Return where a key is, or belongs, in a hash table of keys; -1 is no key."""
    mask = len(table) - 1
    at = ((key * 0x9E3779B1) >> 7) & mask
    while table[at] != -1 and table[at] != key:
        at = (at + 1) & mask
    return at


@callee
def _cost_at(guide: Guide, q: FloatArray) -> float:
    """Return the relaxed cost at the inscribed disc's centre; infinite outside of the grid."""
    c, s, (cx, cy) = cos(q[2]), sin(q[2]), guide.center
    column = floor((q[0] + c * cx - s * cy - guide.x0) / guide.size)
    row = floor((q[1] + s * cx + c * cy - guide.y0) / guide.size)
    if 0 <= row < guide.cost.shape[0] and 0 <= column < guide.cost.shape[1]:
        return float(guide.cost[row, column])
    return np.inf


@callee
def _cell_of(q: FloatArray, guide: Guide, cell: float, columns: int, headings: int, layer: int) -> int:
    """Return the number of a configuration's cell, and of the direction in which it is reached."""
    column, row = floor((q[0] - guide.x0) / cell), floor((q[1] - guide.y0) / cell)
    heading = floor((q[2] + pi) * headings / (2.0 * pi))
    return int((((row * columns + column) * headings + heading) * 2 + layer) & 0x7FFFFFFFFFFF)


@array_callee
def _free(
    kind: MotionModel,
    sign: float,
    q: FloatArray,
    word: FloatArray,
    end: FloatArray,
    placed: FloatArray,
    queue: FloatArray,
) -> bool:
    """Return whether a word from q to ``end`` is certified; ``sign`` is -1 if it is driven from there to q."""
    begin, driven = q, word
    if sign < 0.0:
        begin, driven = end, np.empty_like(word)
        copy_word(word, True, driven)
    if not curve_allowed(kind.one_way, begin, driven, kind.radius):
        return False
    return bool(curve_motion(kind.grid, kind.field, kind.robot, placed, queue, q, word, kind.radius, BUDGET) == FREE)


@array_callee
def _word_to(
    kind: MotionModel,
    sign: float,
    q: FloatArray,
    gear: float,
    target: FloatArray,
    last_gear: float,
    limit: float,
    placed: FloatArray,
    queue: FloatArray,
    words: FloatArray,
) -> tuple[float, int]:
    """Return the cost of the cheapest certified word from q to a target, and its number; infinite if none is found.

    The words are then those that lead from q. ``sign`` is -1 if they are driven from the target to q.
    """
    n, swapped = all_words(q, target, kind.radius, kind.reverse, words)
    prices = np.empty(n)
    for k in range(n):
        copy_word(words[k], swapped, words[k])
        words[k, 0] *= sign
        more, last = word_extra(words[k], kind.radius, kind.direction_change, kind.reverse_metre, gear)
        words[k, 0] *= sign
        prices[k] = (
            kind.radius * unit_length(words[k]) + more + (kind.direction_change if last * last_gear < 0 else 0.0)
        )
    for _ in range(MAX_TRIED):
        k = int(np.argmin(prices))
        if prices[k] >= limit:
            break
        if _free(kind, sign, q, words[k], target, placed, queue):
            return prices[k], k
        prices[k] = np.inf
    return np.inf, -1


@njit(nogil=True)
def grow(
    kind: MotionModel,
    guide: Guide,
    sources: FloatArray,
    reverse: bool,
    step: float,
    cell: float,
    targets: Targets,
    limit: float,
    most: int,
    deadline: Deadline,
) -> tuple[Any, ...]:
    """Return the fields of the :class:`Tree` of drives; the arguments are those of :func:`drive_to`."""
    m, radius, sign = len(sources), kind.radius, -1.0 if reverse else 1.0
    capacity = m + most
    q, to_go = np.empty((capacity, 3)), np.full(capacity, np.inf)
    parents, controls = np.full(capacity, -1, np.int64), np.zeros((capacity, 2))
    driven, slots = np.zeros(capacity), np.zeros(capacity, np.int64)
    placed, queue = workspace(kind.robot), np.empty((128, 2))
    word, end, words = np.zeros((2, PIECES)), np.empty(3), np.empty((MAX_WORDS, 2, PIECES))
    charging = charged(kind)
    headings = max(8, min(1440, ceil(2.0 * pi * radius / cell)))
    columns = ceil(guide.cost.shape[1] * guide.size / cell) + 2
    room = 64
    while room < 4 * capacity:
        room *= 2
    table, owner = np.full(room, -1, np.int64), np.full(room, -1, np.int64)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    waiting = 0
    for i in range(m):
        q[i] = sources[i]
        to_go[i] = _cost_at(guide, q[i])
        # A source may be left in either direction.
        for layer in range(2):
            slots[i] = _slot(table, _cell_of(q[i], guide, cell, columns, headings, layer))
            table[slots[i]], owner[slots[i]] = _cell_of(q[i], guide, cell, columns, headings, layer), i
        if to_go[i] < np.inf:
            if waiting == len(keys):
                keys, values = heap_grow(keys, values)
            waiting = heap_push(keys, values, waiting, GREED * to_go[i], i)
    n, expanded = m, 0
    best, best_node, best_target, best_word = limit, -1, -1, np.zeros((2, PIECES))
    while waiting > 0 and n < capacity:
        waiting = heap_pop(keys, values, waiting)
        at = values[waiting]
        if keys[waiting] >= best:
            break
        if at >= m and owner[slots[at]] != at:
            continue
        gear = sign * controls[at, 1]
        if expanded % EVERY == 0:
            for t in range(len(targets.costs)):
                target, beyond = targets.configurations[t], driven[at] + targets.costs[t]
                if beyond + hypot(target[0] - q[at, 0], target[1] - q[at, 1]) < best:
                    price, k = _word_to(
                        kind, sign, q[at], gear, target, targets.gears[t], best - beyond, placed, queue, words
                    )
                    if k >= 0:
                        best, best_node, best_target = beyond + price, at, t
                        best_word[:] = words[k]
        expanded += 1
        if expanded % CLOCK_EVERY == 0 and over(deadline):
            break
        for side in (0.0, 1.0, -1.0):
            for direction in (1.0, -1.0):
                if sign * direction < 0.0 and not kind.reverse:
                    continue
                way, metre = step, 1.0 + (kind.reverse_metre if sign * direction < 0.0 else 0.0)
                change = kind.direction_change if gear * sign * direction < 0.0 else 0.0
                for _ in range(4):
                    word[0, 0], word[1, 0] = direction * way / radius, side
                    walk(q[at], word, radius, way, end)
                    ahead, cost = _cost_at(guide, end), driven[at] + change + way * metre
                    key = _cell_of(end, guide, cell, columns, headings, int(charging and direction > 0.0))
                    slot = _slot(table, key)
                    if table[slot] == key and driven[owner[slot]] <= cost:
                        break
                    if (
                        cost + ahead < best
                        and state(kind.grid, kind.field, kind.robot, placed, end[0], end[1], end[2]) == FREE
                        and _free(kind, sign, q[at], word, end, placed, queue)
                    ):
                        if n < capacity:
                            table[slot], owner[slot] = key, n
                            q[n], parents[n], to_go[n], driven[n], slots[n] = end, at, ahead, cost, slot
                            controls[n, 0], controls[n, 1] = side, direction * way
                            if waiting == len(keys):
                                keys, values = heap_grow(keys, values)
                            waiting = heap_push(keys, values, waiting, cost + GREED * ahead, n)
                            n += 1
                        break
                    way *= 0.5
    return (q[:n], parents[:n], controls[:n], to_go[:n], best_node, best_target, best_word)
