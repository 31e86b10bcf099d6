"""A hybrid A* as nav2's Smac planner has it, for ``trailmark benchmark -p benchmarks.smac_like:plan``.

Not Smac itself, but its method: cells of 5 cm, 72 headings, the footprint's outline checked on the costmap's cells at
each configuration alone, a grid search from the goal over twice as large cells as heuristic (for cars the larger of
that and the shortest curve's length), and analytic expansions to the goal, checked in steps of a cell, the more often
the nearer the goal. Each node keeps the configuration that it was reached at. What moves a robot has, and what leads it
to the goal, is in benchmarks/smac_moves.py. Costs are lengths, and half a metre a radian where the robot turns without
driving an arc, as for all planners here. The costmap is there before the clock starts, as in a running robot.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.costmap import RESOLUTION, Costmap, cell_of, costmap_of, goal_distances
from benchmarks.smac_moves import HEADINGS, Moves, Outline, ahead_of, analytic, apply, hits, moves_of, outline_of
from trailmark.clock import CLOCK_EVERY, Deadline, now
from trailmark.collision import StateChecker
from trailmark.compiled import njit
from trailmark.curves.shortest import MAX_WORDS
from trailmark.curves.words import PIECES
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

__all__ = ["SMALL", "plan", "prepare"]

MOST_NODES = 1 << 22
"""Nodes after which the search gives up, about 250 MB."""

SAME = 1e-9
"""Metres by which costs of one way may differ by rounding."""

COARSE = 2
"""Cells of the costmap to one of the heuristic's along each side."""

SMALL = World("small", (0.0, 0.0, 5.0, 3.0), (Rectangle((2.5, 1.0), 0.5, 0.5),), Robot.rectangle(0.5, 0.3))
"""Where kernels are loaded."""


class Table(NamedTuple):
    """The search's nodes, and a hash table by which they are found.

    Attributes:
        keys: of cell and heading in each slot, -1 if it is empty.
        nodes: in each slot, their number.
        states: of each node, the configuration that it was reached at, shape (n, 3).
        cost: of each node, metres from the start.
        parent: of each node, its number; -1 of the start.
        closed: whether each was expanded.
    """

    keys: NDArray[np.int64]
    nodes: NDArray[np.int32]
    states: FloatArray
    cost: FloatArray
    parent: NDArray[np.int32]
    closed: NDArray[np.bool_]


class Prepared(NamedTuple):
    """What a running robot has before a query comes.

    Attributes:
        costmap: of the world.
        outline: of the robot.
        moves: of the robot.
        table: room for the search's nodes.
    """

    costmap: Costmap
    outline: Outline
    moves: Moves
    table: Table


def plan(
    checker: StateChecker, start: FloatArray, goal: FloatArray, time_limit: float, seed: int, *, prepared: Prepared
) -> FloatArray | None:
    """Return the states of a path, shape (n, 3), or None; nothing is random."""
    del checker, seed
    deadline = Deadline.after(time_limit)
    costmap, outline, moves, table = prepared
    free = _coarse_free(costmap, outline.inscribed)
    ends = [cell_of(costmap, float(q[0]), float(q[1])) for q in (start, goal)]
    coarse = [(row // COARSE, column // COARSE) for row, column in ends]
    for row, column in coarse:
        if not (0 <= row < free.shape[0] and 0 <= column < free.shape[1]):
            return None
        free[row, column] = True
    to_goal = goal_distances(free, COARSE * costmap.size, coarse[1], coarse[0], 1.5)
    if not np.isfinite(to_goal[coarse[0]]):
        return None
    found = _search(costmap, outline, moves, to_goal, np.array(start), np.array(goal), table, deadline)
    return np.array(found) if len(found) else None


def prepare(checker: StateChecker) -> Prepared:
    """Return what the function ``plan`` is given, with its kernels loaded."""
    small = StateChecker(SMALL, SMALL.robot)
    ends = np.array([1.0, 1.0, 0.0]), np.array([4.0, 1.0, 1.0])
    plan(small, *ends, 1.0, 0, prepared=_prepared(small, 1 << 12))
    return _prepared(checker, MOST_NODES)


plan.prepare = prepare  # type: ignore[attr-defined]  # what the benchmark calls before its clock starts


def _prepared(checker: StateChecker, n: int) -> Prepared:
    keys, nodes = np.full(2 * n, -1, np.int64), np.empty(2 * n, np.int32)
    table = Table(keys, nodes, np.empty((n, 3)), np.empty(n), np.empty(n, np.int32), np.empty(n, np.bool_))
    return Prepared(costmap_of(checker), outline_of(checker, RESOLUTION), moves_of(checker.robot, RESOLUTION), table)


def _coarse_free(costmap: Costmap, inscribed: float) -> NDArray[np.bool_]:
    rows, columns = (COARSE * math.ceil(n / COARSE) for n in costmap.distance.shape)
    padded = np.zeros((rows, columns), np.float32)
    padded[: costmap.distance.shape[0], : costmap.distance.shape[1]] = costmap.distance
    widest = padded.reshape(rows // COARSE, COARSE, columns // COARSE, COARSE).max(axis=(1, 3))
    return np.asarray(widest > inscribed)


@njit(cache=True)
def _slot(keys: NDArray[np.int64], key: np.int64) -> Any:
    """Return where a key is, or belongs, in an open table."""
    mask = len(keys) - 1
    i = np.int64((np.uint64(key) * np.uint64(11400714819323198485)) >> np.uint64(38)) & mask  # Fibonacci hashing
    while keys[i] >= 0 and keys[i] != key:
        i = (i + 1) & mask
    return i


@njit(cache=True)
def _key(costmap: Costmap, state: FloatArray) -> Any:
    """Return the key of a configuration's cell and heading."""
    row, column = cell_of(costmap, state[0], state[1])
    heading = np.int64(math.floor(state[2] * (HEADINGS / (2.0 * math.pi)) + 0.5)) % HEADINGS
    return np.int64((row * costmap.distance.shape[1] + column) * HEADINGS + heading)


@njit(cache=True)
def _search(
    costmap: Costmap,
    outline: Outline,
    moves: Moves,
    to_goal: NDArray[np.float64],
    start: FloatArray,
    goal: FloatArray,
    table: Table,
    deadline: Deadline,
) -> FloatArray:
    """Return the states from start to goal, shape (n, 3); none if there is no way, no time, or too many nodes."""
    rows, columns = costmap.distance.shape
    keys, nodes, states, cost, parent, closed = table
    words = np.empty((MAX_WORDS, 2, PIECES))
    heap_keys, heap_nodes, size = np.empty(1 << 16), np.empty(1 << 16, np.int64), 0
    slot = _slot(keys, _key(costmap, start))
    keys[slot], nodes[slot] = _key(costmap, start), 0
    states[0], cost[0], parent[0], closed[0] = start, 0.0, -1, False
    count, wait, taken = 1, 0, 0
    size = heap_push(heap_keys, heap_nodes, size, 0.0, 0)
    there = np.empty(3)
    while size > 0 and count < len(states):
        taken += 1
        if taken % CLOCK_EVERY == 0 and now(deadline.kind) >= deadline.seconds:
            break
        size = heap_pop(heap_keys, heap_nodes, size)
        at = heap_nodes[size]
        here = states[at].copy()
        row, column = cell_of(costmap, here[0], here[1])
        far = to_goal[row // COARSE, column // COARSE]
        if closed[at]:
            continue
        closed[at] = True
        wait -= 1
        if wait <= 0:
            # The analytic expansion: at the next configuration if the goal is near, seldom if it is far.
            wait = int(far / (3.5 * costmap.size))
            end = analytic(costmap, outline, moves, here, goal, words)
            if len(end):
                return _states(states, parent, at, end)
        for move in range(len(moves.steps)):
            apply(moves, move, here, there)
            row, column = cell_of(costmap, there[0], there[1])
            if row < 0 or column < 0 or row >= rows or column >= columns:
                continue
            reached = cost[at] + moves.steps[move, 3]
            new = _key(costmap, there)
            slot = _slot(keys, new)
            known = keys[slot] == new
            to = nodes[slot] if known else count
            # What is expanded keeps its configuration, from which its neighbours were reached.
            if known and (closed[to] or cost[to] <= reached + SAME):
                continue
            if to == len(states) or hits(costmap, outline, there[0], there[1], there[2]):
                continue
            if not known:
                keys[slot], nodes[slot], closed[to], count = new, to, False, count + 1
            states[to], cost[to], parent[to] = there, reached, at
            if size == len(heap_keys):
                heap_keys, heap_nodes = heap_grow(heap_keys, heap_nodes)
            ahead = ahead_of(moves, to_goal[row // COARSE, column // COARSE], there, goal, words)
            size = heap_push(heap_keys, heap_nodes, size, reached + ahead, to)
    return np.empty((0, 3))


@njit(cache=True)
def _states(states: FloatArray, parent: NDArray[np.int32], last: int, end: FloatArray) -> FloatArray:
    """Return the configurations from the first node to the last, and those to the goal after it."""
    count, at = 1, last
    while parent[at] >= 0:
        count, at = count + 1, parent[at]
    path, at = np.empty((count + len(end), 3)), last
    path[count:] = end
    for i in range(count - 1, -1, -1):
        path[i] = states[at]
        at = parent[at]
    return path
