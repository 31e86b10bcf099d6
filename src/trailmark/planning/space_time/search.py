"""A search over short straight motions for the beginning of a path that passes moving obstacles in time."""

from __future__ import annotations

from math import atan2, cos, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import FREE, state
from trailmark.heap import heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.base import Scratch, certified, cost, new_scratch
from trailmark.planning.space_time.obstacles import MovingObstacles, motion_clear
from trailmark.se2 import FloatArray

__all__ = ["search"]

WEIGHT = 1.2
"""Of the cost to go: a path may cost so many times the cheapest, and is found among far fewer nodes."""

CELLS = 2.0
"""Cells per step within which one node stands for all that come there at the same time."""

NEIGHBOURS = 3
"""Bends of the path before and behind its parent's that a node is joined to."""


@njit(nogil=True)
def search(
    kind: Any,
    moving: MovingObstacles,
    start: FloatArray,
    path: FloatArray,
    to_go: FloatArray,
    speed: float,
    step: float,
    directions: int,
    max_nodes: int,
    deadline: Deadline,
) -> tuple[bool, FloatArray]:
    """Return whether a way to the goal was found, and its states, shape (n, 3).

    From the start the robot takes steps of equal length and duration in any of a number of directions, turning in none.
    From each place it is tried whether it can go on along the path to the end without meeting an obstacle as long as
    that is foreseen. Without success the states are those of the steps that stay clear for the longest time, nearest to
    the goal among them.

    Args:
        kind: of motion, of a robot that moves anywhere, among what stands.
        moving: obstacles that move, and the robot.
        start: valid, shape (3,), and clear of them.
        path: to the goal among what stands, shape (m, 3), m >= 2, its first state left aside.
        to_go: (m,) cost from each of its states to the goal, metres.
        speed: metres of cost per second.
        step: metres.
        directions: number of them.
        max_nodes: nodes expanded at most.
        deadline: when to end without success.
    """
    scratch, last = new_scratch(kind), len(path) - 1
    capacity = (max_nodes + 1) * (directions + 1) + 1
    q, parents, bends = np.empty((capacity, 3)), np.empty(capacity, np.int64), np.empty(capacity, np.int64)
    layers = np.empty(capacity, np.int64)
    keys, heap = np.empty(capacity), np.empty(capacity, np.int64)
    size_of_table = 1
    while size_of_table < 2 * capacity:
        size_of_table *= 2
    table = np.full(size_of_table, -1, np.int64)
    seconds, horizon = step / speed, moving.until.max()
    q[0], parents[0], layers[0], bends[0] = start, -1, 0, last
    count, size, best, best_rank = 1, heap_push(keys, heap, 0, 0.0, 0), 0, -np.inf
    for expanded in range(max_nodes):
        if size == 0 or (expanded % CLOCK_EVERY == CLOCK_EVERY - 1 and over(deadline)):
            break
        size = heap_pop(keys, heap, size)
        node = heap[size]
        here, time = q[node], layers[node] * seconds
        bend = _bend(kind, scratch, here, path, bends[node], node == 0)
        if bend >= 0:
            bends[node] = bend
            if _goes_on(kind, scratch, moving, here, time, path, bend, speed):
                return True, _states(q, parents, node, path[bend:])
        target = path[bends[node]]
        left = cost(kind, scratch, here, target) + to_go[bends[node]]
        # Who stays clear as long as anything is foreseen may go on; before that, the longer the better.
        rank = min(time, horizon) - 1e-6 * left
        if rank > best_rank:
            best, best_rank = node, rank
        ahead = atan2(target[1] - here[1], target[0] - here[0])
        for k in range(directions):
            angle = ahead + 2.0 * pi * k / directions
            child = q[count]
            child[0], child[1], child[2] = here[0] + step * cos(angle), here[1] + step * sin(angle), here[2]
            key = _key(layers[node] + 1, child, step / CELLS)
            place = _place(table, key)
            if table[place] == key:
                continue
            if not motion_clear(moving, here, time, child, time + seconds):
                continue
            if state(kind.grid, kind.field, kind.robot, scratch.placed, child[0], child[1], child[2]) != FREE:
                continue
            if not certified(kind, scratch, here, child, BUDGET):
                continue
            table[place] = key
            parents[count], layers[count], bends[count] = node, layers[node] + 1, bends[node]
            left = cost(kind, scratch, child, target) + to_go[bends[node]]
            size = heap_push(keys, heap, size, step * layers[count] + WEIGHT * left, count)
            count += 1
    return False, _states(q, parents, best, path[:0])


@callee
def _bend(kind: Any, scratch: Scratch, here: FloatArray, path: FloatArray, near: int, anywhere: bool) -> int:
    """Return the last state of the path, about ``near`` or anywhere, that a certified motion leads to; -1 if none."""
    last = len(path) - 1
    high, low = (last, 1) if anywhere else (min(last, near + NEIGHBOURS), max(1, near - NEIGHBOURS))
    for k in range(high, low - 1, -1):
        if certified(kind, scratch, here, path[k], BUDGET):
            return k
    return -1


@array_callee
def _goes_on(
    kind: Any,
    scratch: Scratch,
    moving: MovingObstacles,
    here: FloatArray,
    time: float,
    path: FloatArray,
    bend: int,
    speed: float,
) -> bool:
    """Return whether the robot may go to a state of the path and along it to its end without meeting an obstacle."""
    horizon = moving.until.max()
    for k in range(bend, len(path)):
        if time >= horizon:
            return True
        end = time + cost(kind, scratch, here, path[k]) / speed
        if not motion_clear(moving, here, time, path[k], end):
            return False
        here, time = path[k], end
    return True


@callee
def _key(layer: int, q: FloatArray, cell: float) -> int:
    """Return a number of its own for each layer of time and cell, up to a million cells to either side."""
    x, y = np.int64(np.floor(q[0] / cell)) & 0x1FFFFF, np.int64(np.floor(q[1] / cell)) & 0x1FFFFF
    return int((np.int64(layer) << 42) | (x << 21) | y)


@callee
def _place(table: NDArray[np.int64], key: int) -> int:
    """Return where a key stands in a hash table whose length is a power of 2, or where it would; -1 is no key."""
    mask = len(table) - 1
    place = (key ^ (key >> 13) ^ (key >> 29)) & mask
    while table[place] != -1 and table[place] != key:
        place = (place + 1) & mask
    return place


@array_callee
def _states(q: FloatArray, parents: NDArray[np.int64], node: int, rest: FloatArray) -> FloatArray:
    """Return the states on the way to a node, and the rest."""
    steps, k = 0, node
    while k >= 0:
        steps, k = steps + 1, parents[k]
    states = np.empty((steps + len(rest), 3))
    states[steps:] = rest
    k = node
    for i in range(steps - 1, -1, -1):
        states[i], k = q[k], parents[k]
    return states
