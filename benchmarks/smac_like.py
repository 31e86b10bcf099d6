"""A hybrid A* as nav2's Smac planner has it, for ``trailmark benchmark -p benchmarks.smac_like:plan``.

Not Smac itself, but its method, for robots that move in every direction: cells of 5 cm, 72 headings, the footprint's
outline checked on the costmap's cells at each configuration alone, expansions by grid moves and turns, a grid search
from the goal over twice as large cells as heuristic, and analytic expansions (here straight motions to the goal,
checked in steps of a cell), the more often the nearer the goal. Costs are lengths, as for all planners here.
The costmap is there before the clock starts, as in a running robot. Cars are not planned for.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.costmap import RESOLUTION, Costmap, cell_of, costmap_of, goal_distances
from trailmark.collision import StateChecker
from trailmark.compiled import njit
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.se2 import FloatArray
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

__all__ = ["SMALL", "plan", "prepare"]

HEADINGS = 72
TURN_COST = 0.5
"""Metres that a radian costs."""

MOST_NODES = 1 << 22
"""Nodes after which the search gives up, about 200 MB."""

SAME = 1e-9
"""Metres by which costs of one way may differ by rounding."""

COARSE = 2
"""Cells of the costmap to one of the heuristic's along each side."""

DIRECTIONS = np.array(
    [(a, b) for a in range(-2, 3) for b in range(-2, 3) if max(abs(a), abs(b)) == 2],
    dtype=np.int64,  # cells
)
"""Moves in cells: sixteen directions, each into another cell."""


SMALL = World("small", (0.0, 0.0, 5.0, 3.0), (Rectangle((2.5, 1.0), 0.5, 0.5),), Robot.rectangle(0.5, 0.3))
"""Where kernels are loaded."""


class Outline(NamedTuple):
    """A footprint's outline.

    Attributes:
        points: at most half a cell apart, in the robot's frame, shape (n, 2).
        reach: of the farthest, metres.
        inscribed: radius of the largest disc about the reference point within it, 0 if that lies outside; metres.
    """

    points: FloatArray
    reach: float
    inscribed: float


class Prepared(NamedTuple):
    """What a running robot has before a query comes.

    Attributes:
        costmap: of the world.
        outline: of the robot.
        table: room for the search's nodes: keys, costs, parents.
    """

    costmap: Costmap
    outline: Outline
    table: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]


def plan(
    checker: StateChecker, start: FloatArray, goal: FloatArray, time_limit: float, seed: int, *, prepared: Prepared
) -> FloatArray | None:
    """Return the states of a path, shape (n, 3), or None; nothing is random."""
    del time_limit, seed
    if checker.robot.turning_radius is not None:
        return None
    costmap, outline, table = prepared
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
    found = _search(costmap, outline, to_goal, np.array(start), np.array(goal), DIRECTIONS, table)
    return np.array(found) if len(found) else None


def prepare(checker: StateChecker) -> Prepared:
    """Return what the function ``plan`` is given, with its kernels loaded."""
    small = StateChecker(SMALL, SMALL.robot)
    ends = np.array([1.0, 1.0, 0.0]), np.array([4.0, 1.0, 1.0])
    plan(small, *ends, 1.0, 0, prepared=_prepared(small, 1 << 16))
    return _prepared(checker, 2 * MOST_NODES)


plan.prepare = prepare  # type: ignore[attr-defined]  # what the benchmark calls before its clock starts


def _prepared(checker: StateChecker, slots: int) -> Prepared:
    table = (np.full(slots, -1, np.int64), np.zeros(slots), np.zeros(slots, np.int64))
    return Prepared(costmap_of(checker), _outline(checker, RESOLUTION), table)


def _outline(checker: StateChecker, size: float) -> Outline:
    ring = checker.robot.outline.rings()[0]
    step = 0.5 * size
    points = []
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        n = max(1, math.ceil(float(np.hypot(*(b - a))) / step))
        points.append(a + (b - a) * (np.arange(n) / n)[:, None])
    x, y = (ring - np.roll(ring, -1, axis=0)).T
    along = np.clip(-((np.roll(ring, -1, axis=0) * np.column_stack([x, y])).sum(axis=1)) / (x**2 + y**2), 0.0, 1.0)
    foot = np.roll(ring, -1, axis=0) + along[:, None] * np.column_stack([x, y])
    disc = checker.robot.inscribed_disc
    holds = math.hypot(*disc.center) < disc.radius
    inscribed = float(np.hypot(*foot.T).min()) if holds else 0.0
    return Outline(np.concatenate(points), float(checker.robot.circumradius), inscribed)


def _coarse_free(costmap: Costmap, inscribed: float) -> NDArray[np.bool_]:
    rows, columns = (COARSE * math.ceil(n / COARSE) for n in costmap.distance.shape)
    padded = np.zeros((rows, columns), np.float32)
    padded[: costmap.distance.shape[0], : costmap.distance.shape[1]] = costmap.distance
    widest = padded.reshape(rows // COARSE, COARSE, columns // COARSE, COARSE).max(axis=(1, 3))
    return np.asarray(widest > inscribed)


@njit(cache=True)
def _hits(costmap: Costmap, outline: Outline, x: float, y: float, theta: float) -> bool:
    """Return whether an occupied cell holds a point of the outline, or the disc about the reference point says so."""
    rows, columns = costmap.distance.shape
    row, column = cell_of(costmap, x, y)
    if row < 0 or column < 0 or row >= rows or column >= columns:
        return True
    d = costmap.distance[row, column]
    if d <= outline.inscribed:
        return True
    if d > outline.reach + 1.5 * costmap.size:
        return False
    cos, sin = math.cos(theta), math.sin(theta)
    for i in range(len(outline.points)):
        px, py = outline.points[i]
        row, column = cell_of(costmap, x + cos * px - sin * py, y + sin * px + cos * py)
        if row < 0 or column < 0 or row >= rows or column >= columns or costmap.distance[row, column] <= 0.0:
            return True
    return False


@njit(cache=True)
def _turn(a: float, b: float) -> float:
    """Return the shorter turn from heading a to b."""
    return (b - a + math.pi) % (2.0 * math.pi) - math.pi


@njit(cache=True)
def _straight_free(costmap: Costmap, outline: Outline, a: FloatArray, b: FloatArray) -> bool:
    """Return whether no configuration hits on the straight motion from a to b, in steps of a cell."""
    turn = _turn(a[2], b[2])
    steps = int((math.hypot(b[0] - a[0], b[1] - a[1]) + outline.reach * abs(turn)) / costmap.size) + 1
    for i in range(1, steps + 1):
        t = i / steps
        if _hits(costmap, outline, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * turn):
            return False
    return True


@njit(cache=True)
def _slot(keys: NDArray[np.int64], key: np.int64) -> Any:
    """Return where a key is, or belongs, in an open table."""
    mask = len(keys) - 1
    i = np.int64((np.uint64(key) * np.uint64(11400714819323198485)) >> np.uint64(38)) & mask  # Fibonacci hashing
    while keys[i] >= 0 and keys[i] != key:
        i = (i + 1) & mask
    return i


@njit(cache=True)
def _search(
    costmap: Costmap,
    outline: Outline,
    to_goal: NDArray[np.float64],
    start: FloatArray,
    goal: FloatArray,
    directions: NDArray[np.int64],
    table: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]],
) -> FloatArray:
    """Return the states from start to goal, shape (n, 3); none if there is no way, or too many nodes."""
    rows, columns = costmap.distance.shape
    bin_size = 2.0 * math.pi / HEADINGS
    keys, cost, parent = table
    heap_keys, heap_slots, size = np.empty(1 << 16), np.empty(1 << 16, np.int64), 0
    row, column = cell_of(costmap, start[0], start[1])
    heading = round(start[2] / bin_size) % HEADINGS
    first = np.int64((row * columns + column) * HEADINGS + heading)
    slot = _slot(keys, first)
    keys[slot], cost[slot], parent[slot], nodes, wait = first, 0.0, -1, 1, 0
    size = heap_push(heap_keys, heap_slots, size, 0.0, slot)
    here, there = np.empty(3), np.empty(3)
    while size > 0 and 2 * nodes < len(keys):
        size = heap_pop(heap_keys, heap_slots, size)
        at, key = heap_slots[size], heap_keys[size]
        node = keys[at]
        heading, cell = node % HEADINGS, node // HEADINGS
        row, column = cell // columns, cell % columns
        _place(costmap, row, column, heading * bin_size, start, at == slot, here)
        ahead = to_goal[row // COARSE, column // COARSE] + TURN_COST * abs(_turn(here[2], goal[2]))
        if cost[at] + ahead + SAME < key:
            continue  # it was reached by a shorter way since
        wait -= 1
        if wait <= 0:
            # The analytic expansion: at the next configuration if the goal is near, seldom if it is far.
            wait = int(to_goal[row // COARSE, column // COARSE] / (3.5 * costmap.size))
            if _straight_free(costmap, outline, here, goal):
                return _states(costmap, keys, parent, at, slot, start, goal)
        for move in range(len(directions) + 2):
            i, j, k = row, column, heading
            if move < len(directions):
                i, j = row + directions[move, 0], column + directions[move, 1]
            else:
                k = (heading + 2 * (move - len(directions)) - 1) % HEADINGS
            if i < 0 or j < 0 or i >= rows or j >= columns:
                continue
            _place(costmap, i, j, k * bin_size, start, False, there)
            reached = cost[at] + math.hypot(there[0] - here[0], there[1] - here[1])
            reached += TURN_COST * abs(_turn(here[2], there[2]))
            new = np.int64((i * columns + j) * HEADINGS + k)
            to = _slot(keys, new)
            if keys[to] == new and cost[to] <= reached + SAME:
                continue
            if keys[to] != new:
                hit = _hits(costmap, outline, there[0], there[1], there[2])
                keys[to], nodes = new, nodes + 1
                cost[to] = -1.0 if hit else reached  # none is below: never looked at again
                if hit:
                    continue
            cost[to], parent[to] = reached, at
            if size == len(heap_keys):
                heap_keys, heap_slots = heap_grow(heap_keys, heap_slots)
            ahead = to_goal[i // COARSE, j // COARSE] + TURN_COST * abs(_turn(there[2], goal[2]))
            size = heap_push(heap_keys, heap_slots, size, reached + ahead, to)
    return np.empty((0, 3))


@njit(cache=True)
def _place(
    costmap: Costmap, row: int, column: int, theta: float, start: FloatArray, first: bool, state: FloatArray
) -> None:
    """Write a node's configuration into ``state``: the middle of its cell, or the start itself."""
    if first:
        state[:] = start
    else:
        state[0] = costmap.x0 + (column + 0.5) * costmap.size
        state[1] = costmap.y0 + (row + 0.5) * costmap.size
        state[2] = theta


@njit(cache=True)
def _states(
    costmap: Costmap,
    keys: NDArray[np.int64],
    parent: NDArray[np.int64],
    last: int,
    first: int,
    start: FloatArray,
    goal: FloatArray,
) -> FloatArray:
    """Return the configurations from the first node to the last, and the goal."""
    columns = costmap.distance.shape[1]
    count, at = 1, last
    while at >= 0:
        count, at = count + 1, parent[at]
    states, at = np.empty((count, 3)), last
    states[count - 1] = goal
    for i in range(count - 2, -1, -1):
        node = keys[at]
        cell = node // HEADINGS
        theta = (node % HEADINGS) * 2.0 * math.pi / HEADINGS
        _place(costmap, cell // columns, cell % columns, theta, start, at == first, states[i])
        at = parent[at]
    return states
