"""A first path by weighted A* over a lattice of configurations: cells times headings, each checked when it is needed.

The inscribed disc's relaxed problem knows no headings; where the robot is longer than wide, its ways lead into gaps
that the robot cannot turn into. The lattice knows them: its motions are the robot's own, certified like all others, so
that a way over it is a path. It is coarse, and nothing is proven by not finding one.

Sources: states and motions on a grid with an anchored origin: Pivtoraiko, Knepper & Kelly, "Differentially constrained
mobile robot motion planning in state lattices", JFR 2009; weighted A*: Pohl, "Heuristic search viewed as path finding
in a graph", AI 1970; checks only of what is taken from the queue: Cohen, Phillips & Likhachev, RSS 2014.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, cos, floor, hypot, isfinite, pi, sin, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, motion, state, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.planning.cost_to_go import CostToGo
from trailmark.se2 import ROTATION_WEIGHT, FloatArray

__all__ = ["MAX_NODES", "Lattice", "straightened"]

MAX_NODES = 1 << 26
"""Nodes of a lattice at most: what it does not visit takes no memory, but addresses."""

AHEAD_EVERY = 64
"""Nodes after which the straight motion to the goal is tried once more."""

TILE = 8
"""Cells along each side of a tile; cells are numbered tile by tile, so that neighbours share pages of memory."""

# What is known of a node: bits.
CHECKED, VALID, DONE = 1, 2, 4

_STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1, 0, 0])
_STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1, 0, 0])
_TURN = np.array([0, 0, 0, 0, 0, 0, 0, 0, 1, -1])
"""The moves: to the eight neighbours, counter-clockwise from +x, and a turn either way."""

ORIGIN = len(_TURN)
"""In place of a move: the node that the search began at."""


@dataclass(frozen=True)
class Lattice:
    """Configurations on a grid of positions of the inscribed disc's centre, times evenly spaced headings.

    Attributes:
        checker: decides what is valid.
        size: metres between neighbouring positions.
        headings: how many; 1 for a robot to which they make no difference.
    """

    checker: StateChecker
    size: float
    headings: int

    def way(
        self,
        start: FloatArray,
        goal: FloatArray,
        to_go: CostToGo,
        *,
        weight: float,
        budget: int,
        limit: float = np.inf,
        patience: int | None = None,
    ) -> tuple[FloatArray, int]:
        """Return a path of certified motions, shape (n, 3), or (0, 3) if none was found, and the nodes taken.

        The start is a node of the lattice; the goal is joined to it by a motion.

        Args:
            start: valid configuration, shape (3,).
            goal: valid configuration, shape (3,).
            to_go: guides the search.
            weight: of the cost to go; 1 seeks the cheapest way, more finds one sooner.
            budget: nodes taken from the queue at most.
            limit: metres; no way over a node is of interest whose cost and straight distance to the goal exceed it.
            patience: give up after so many nodes that come no nearer to the goal; never by default.
        """
        xmin, ymin, xmax, ymax = self.checker.world.bounds
        center = np.array(self.checker.robot.inscribed_disc.center)
        x, y = se2.transform(start, center[None])[0]
        left, below = floor((x - xmin) / self.size), floor((y - ymin) / self.size)
        columns, rows = left + 1 + floor((xmax - x) / self.size), below + 1 + floor((ymax - y) / self.size)
        tiles = -(-columns // TILE), -(-rows // TILE)
        nodes = tiles[0] * tiles[1] * TILE**2 * self.headings
        if nodes > MAX_NODES:
            return np.empty((0, 3)), 0
        # Zeros cost nothing before they are touched.
        found, taken = _search(
            self.checker.grid,
            self.checker.field,
            self.checker.footprint,
            center,
            np.array([x, y, start[2]]),
            np.asarray(start),
            np.asarray(goal),
            np.array([left, below, columns, rows, self.headings, tiles[0]]),
            self.size,
            to_go.cost,
            np.array([to_go.x0, to_go.y0, to_go.size]),
            weight,
            budget,
            limit,
            budget if patience is None else patience,
            np.zeros(nodes, np.uint8),
            np.zeros(nodes, np.float32),
            np.zeros(nodes, np.uint8),
        )
        return found, int(taken)


@njit(cache=True, inline="always")
def _number(column: int, row: int, extent: NDArray[np.int64]) -> int:
    """Return a cell's number."""
    tile = row // TILE * extent[5] + column // TILE
    return int(tile * TILE * TILE + row % TILE * TILE + column % TILE)


@njit(cache=True, inline="always")
def _place(cell: int, extent: NDArray[np.int64]) -> tuple[int, int]:
    """Return a cell's column and row."""
    tile, within = cell // (TILE * TILE), cell % (TILE * TILE)
    return tile % extent[5] * TILE + within % TILE, tile // extent[5] * TILE + within // TILE


@njit(cache=True)
def _configuration(
    node: int, origin: FloatArray, extent: NDArray[np.int64], size: float, center: FloatArray, q: FloatArray
) -> None:
    """Write a node's configuration into q."""
    cell, k = node // extent[4], node % extent[4]
    theta = origin[2] + 2.0 * pi * k / extent[4]
    # Into (-pi, pi]: half a turn is +pi.
    theta -= 2.0 * pi * ceil((theta - pi) / (2.0 * pi))
    c, s = cos(theta), sin(theta)
    column, row = _place(cell, extent)
    q[0] = origin[0] + (column - extent[0]) * size - (c * center[0] - s * center[1])
    q[1] = origin[1] + (row - extent[1]) * size - (s * center[0] + c * center[1])
    q[2] = theta


@njit(cache=True)
def _left(
    node: int,
    origin: FloatArray,
    extent: NDArray[np.int64],
    size: float,
    target: FloatArray,
    to_go: FloatArray,
    frame: FloatArray,
) -> tuple[float, float]:
    """Return what is left from a node's position to the goal's, and the straight distance, metres."""
    column, row = _place(node // extent[4], extent)
    x = origin[0] + (column - extent[0]) * size
    y = origin[1] + (row - extent[1]) * size
    straight = hypot(target[0] - x, target[1] - y)
    if to_go.shape[0] == 0:
        return straight, straight
    i, j = floor((y - frame[1]) / frame[2]), floor((x - frame[0]) / frame[2])
    if 0 <= i < to_go.shape[0] and 0 <= j < to_go.shape[1]:
        return float(to_go[i, j]), straight
    return np.inf, straight


@njit(cache=True)
def _neighbour(node: int, move: int, extent: NDArray[np.int64]) -> int:
    """Return the node that a move leads to, -1 out of the lattice."""
    cell, k = node // extent[4], node % extent[4]
    column, row = _place(cell, extent)
    column, row = column + _STEP_X[move], row + _STEP_Y[move]
    if not (0 <= column < extent[2] and 0 <= row < extent[3]):
        return -1
    return int(_number(column, row, extent) * extent[4] + (k + _TURN[move] + extent[4]) % extent[4])


@njit(cache=True)
def _back(node: int, move: int, extent: NDArray[np.int64]) -> int:
    """Return the node that a move to ``node`` came from."""
    return _neighbour(node, (move + 4) % 8 if move < 8 else 17 - move, extent)


@njit(cache=True, nogil=True)
def _search(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    center: FloatArray,
    origin: FloatArray,
    start: FloatArray,
    goal: FloatArray,
    extent: NDArray[np.int64],
    size: float,
    to_go: FloatArray,
    frame: FloatArray,
    weight: float,
    budget: int,
    limit: float,
    patience: int,
    known: NDArray[np.uint8],
    costs: NDArray[np.float32],
    moves: NDArray[np.uint8],
) -> tuple[FloatArray, int]:
    """Return the way from start to goal, and how many nodes were taken from the queue.

    ``extent`` holds the columns left of and the rows below the start, columns, rows, headings, and tiles across;
    ``known``, ``costs`` and ``moves`` are zeros, one for each node.
    """
    placed, queue = workspace(robot), np.empty((128, 2))
    turning = extent[4] > 1
    count = 10 if turning else 8
    turn = 2.0 * pi / extent[4]
    c, s = cos(goal[2]), sin(goal[2])
    target = np.array([goal[0] + c * center[0] - s * center[1], goal[1] + s * center[0] + c * center[1]])
    q, before = np.empty(3), np.empty(3)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    first = _number(extent[0], extent[1], extent) * extent[4]
    size_of_heap = heap_push(keys, values, 0, 0.0, first)
    moves[first], known[first] = ORIGIN + 1, CHECKED | VALID
    taken, last = 0, -1
    nearest, when = np.inf, 0
    while size_of_heap > 0 and taken < budget and taken - when <= patience:
        size_of_heap = heap_pop(keys, values, size_of_heap)
        node = values[size_of_heap]
        # An entry may be stale: done already, or its motion failed and no other leads here.
        if known[node] & DONE or moves[node] == 0:
            continue
        taken += 1
        known[node] |= DONE
        _configuration(node, origin, extent, size, center, q)
        if not known[node] & CHECKED:
            known[node] |= CHECKED
            if state(grid, field, robot, placed, q[0], q[1], q[2]) == FREE:
                known[node] |= VALID
        if not known[node] & VALID:
            continue
        arrived = moves[node] - 1
        if arrived != ORIGIN:
            _configuration(_back(node, arrived, extent), origin, extent, size, center, before)
            if motion(grid, field, robot, placed, queue, before, q, True) != FREE:
                # By another way, if one leads here.
                known[node] &= ~np.uint8(VALID)
                cheapest = np.inf
                for move in range(count):
                    other = _back(node, move, extent)
                    if move == arrived or other < 0 or known[other] & (DONE | VALID) != DONE | VALID:
                        continue
                    cost = costs[other] + _length(move, size, turn)
                    if cost < cheapest:
                        _configuration(other, origin, extent, size, center, before)
                        if motion(grid, field, robot, placed, queue, before, q, True) == FREE:
                            cheapest, moves[node] = cost, move + 1
                            known[node] |= VALID
                if not known[node] & VALID:
                    # Not valid by this way, but perhaps by one that is found later.
                    known[node] = (known[node] | VALID) & ~np.uint8(DONE)
                    moves[node] = 0
                    continue
                costs[node] = cheapest
        x = q[0] + cos(q[2]) * center[0] - sin(q[2]) * center[1] - target[0]
        y = q[1] + sin(q[2]) * center[0] + cos(q[2]) * center[1] - target[1]
        away = abs(q[2] - goal[2])
        left, _ = _left(node, origin, extent, size, target, to_go, frame)
        if left < nearest:
            nearest, when = left, taken
        near = hypot(x, y) < 1.5 * size and (not turning or min(away, 2.0 * pi - away) < 1.5 * turn)
        if (near or taken % AHEAD_EVERY == 0) and motion(grid, field, robot, placed, queue, q, goal, True) == FREE:
            last = node
            break
        for move in range(count):
            other = _neighbour(node, move, extent)
            if other < 0 or known[other] & DONE or (known[other] & CHECKED and not known[other] & VALID):
                continue
            cost = costs[node] + _length(move, size, turn)
            if moves[other] == 0 or cost < costs[other]:
                left, straight = _left(other, origin, extent, size, target, to_go, frame)
                if not isfinite(left) or cost + straight > limit:
                    continue
                costs[other], moves[other] = cost, move + 1
                if size_of_heap == len(keys):
                    keys, values = heap_grow(keys, values)
                size_of_heap = heap_push(keys, values, size_of_heap, cost + weight * left, other)
    if last < 0:
        return np.empty((0, 3)), taken
    length, node = 2, last
    while moves[node] - 1 != ORIGIN:
        node = _back(node, moves[node] - 1, extent)
        length += 1
    way = np.empty((length, 3))
    way[0], way[length - 1] = start, goal
    node = last
    for i in range(length - 2, 0, -1):
        _configuration(node, origin, extent, size, center, way[i])
        node = _back(node, moves[node] - 1, extent)
    return way, taken


@njit(cache=True, inline="always")
def _length(move: int, size: float, turn: float) -> float:
    if move >= 8:
        return ROTATION_WEIGHT * turn
    return size * sqrt(2.0) if move % 2 else size


@njit(cache=True, nogil=True)
def straightened(grid: ObstacleGrid, field: ClearanceField, robot: Footprint, path: FloatArray) -> FloatArray:
    """Return a path of certified motions with the vertices left out that it does without; shape (m, 3).

    From each vertex as far ahead as a certified motion leads, sought by doubling and halving.
    """
    placed, queue = workspace(robot), np.empty((128, 2))
    kept = np.empty_like(path)
    kept[0], m, i, n = path[0], 1, 0, len(path)
    while i < n - 1:
        good, step = i + 1, 2
        bad = n
        while good < n - 1:
            ahead = min(i + step, n - 1)
            if ahead >= bad:
                break
            if motion(grid, field, robot, placed, queue, path[i], path[ahead], True) != FREE:
                bad = ahead
                break
            good, step = ahead, 2 * step
        while bad - good > 1:
            middle = (good + bad) // 2
            if middle >= n:
                break
            if motion(grid, field, robot, placed, queue, path[i], path[middle], True) == FREE:
                good = middle
            else:
                bad = middle
        i = good
        kept[m] = path[i]
        m += 1
    return kept[:m].copy()
