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
from math import hypot, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import CLOCK_EVERY, Deadline, now
from trailmark.collision import StateChecker
from trailmark.collision.certify import motion
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, state, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.heading import turn
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.landmarks.retraction import retract
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.lattice.nodes import (
    MULTI_STEPS,
    ORIGIN,
    STEP_X,
    STEP_Y,
    TURNS,
    Nodes,
    came_from,
    configuration,
    leads_to,
    move_cost,
    place,
    position,
)
from trailmark.planning.lattice.table import CHECKED, DONE, FEWEST, SEATED, VALID, Tree, entry_of, grown, new_tree
from trailmark.se2 import FloatArray

__all__ = ["Lattice"]

AHEAD_EVERY = 16
"""Nodes after which the straight motion to the goal is tried once more."""

MOST = 18
"""Nodes that are taken down on the way from one, at most."""

REACH, MARGIN = 0.75, 0.25
"""Steps by which a node that collides may be moved and turned off the obstacles, and the clearance sought there."""


class Guide(NamedTuple):
    """Costs to go, as compiled functions take them.

    Attributes:
        cost: (rows, columns), metres; empty: the straight distance counts.
        column: in ``cost``, of the lattice's first column, with what it lies beyond that cell's edge.
        row: in ``cost``, of the lattice's first row, likewise.
        step: cells of ``cost`` from one of the lattice's positions to the next.
        x: of the goal's position, metres.
        y: of the goal's position, metres.
        weight: of the cost to go.
        limit: metres; no way over a node is of interest whose cost and straight distance to the goal exceed it.
    """

    cost: NDArray[np.float32]
    column: float
    row: float
    step: float
    x: float
    y: float
    weight: float
    limit: float


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

    def find_path(
        self,
        start: FloatArray,
        goal: FloatArray,
        to_go: CostToGo,
        *,
        weight: float,
        budget: int,
        limit: float = np.inf,
        patience: int | None = None,
        multi_steps: bool = False,
        retracts: bool = False,
        seconds: float = np.inf,
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
            multi_steps: also move several cells at a time, in the direction that promises most; ways are found sooner,
                but are dearer.
            retracts: push nodes that collide by little off the obstacles: gaps are found that no node lies in.
            seconds: that the search may take.
        """
        deadline = Deadline.after(seconds)
        nodes = Nodes.around(self.checker, start, self.size, self.headings)
        guide = Guide(
            to_go.cost,
            (nodes.x - nodes.left * nodes.size - to_go.x0) / to_go.size,
            (nodes.y - nodes.below * nodes.size - to_go.y0) / to_go.size,
            nodes.size / to_go.size,
            *self.checker.disc_center(goal),
            float(weight),
            float(limit),
        )
        found, taken = _search(
            self.checker.grid,
            self.checker.field,
            self.checker.footprint,
            nodes,
            nodes.origin,
            guide,
            np.asarray(start),
            np.asarray(goal),
            budget,
            budget if patience is None else patience,
            len(MULTI_STEPS) if multi_steps else 1,
            retracts,
            deadline,
        )
        return found, int(taken)


@njit(cache=True, nogil=True)
def _search(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    nodes: Nodes,
    origin: int,
    guide: Guide,
    start: FloatArray,
    goal: FloatArray,
    budget: int,
    patience: int,
    multi_steps: int,
    retracts: bool,
    deadline: Deadline,
) -> tuple[FloatArray, int]:
    """Return the way from start to goal, and how many nodes were taken from the queue."""
    placed, queue = workspace(robot), np.empty((128, 2))
    q, before = np.empty(3), np.empty(3)
    keys, values = np.empty(256), np.empty(256, np.int64)
    waiting = heap_push(keys, values, 0, 0.0, origin)
    tree, used = new_tree(1 << FEWEST, retracts), 1
    entry = entry_of(tree, origin)
    tree.node[entry], tree.move[entry], tree.known[entry] = origin + 1, ORIGIN + 1, CHECKED | VALID
    taken, last = 0, -1
    nearest, when = np.inf, 0
    while waiting > 0 and taken < budget and taken - when <= patience:
        waiting = heap_pop(keys, values, waiting)
        node = values[waiting]
        entry = entry_of(tree, node)
        # It may be stale: done already, or its motion failed and no other leads here.
        if tree.known[entry] & DONE or tree.move[entry] == 0:
            continue
        taken += 1
        if taken % CLOCK_EVERY == 0 and now(deadline.kind) >= deadline.seconds:
            break
        tree.known[entry] |= DONE
        _at(nodes, tree, node, q)
        if not tree.known[entry] & CHECKED:
            tree.known[entry] |= CHECKED
            if state(grid, field, robot, placed, q[0], q[1], q[2]) == FREE:
                tree.known[entry] |= VALID
            elif retracts:
                retract(field, robot, q, REACH * nodes.size, REACH * 2.0 * pi / nodes.headings, MARGIN * nodes.size)
                if state(grid, field, robot, placed, q[0], q[1], q[2]) == FREE:
                    tree.known[entry] |= VALID | SEATED
                    tree.retract[entry] = q
        if not tree.known[entry] & VALID:
            continue
        arrived = tree.move[entry] - 1
        if arrived != ORIGIN:
            _at(nodes, tree, came_from(nodes, node, arrived), before)
            if motion(grid, field, robot, placed, queue, before, q, True) != FREE and not _joined_otherwise(
                grid, field, robot, placed, queue, nodes, tree, node, q, before, multi_steps
            ):
                continue
        left = _left(nodes, node, guide, 0.0)
        if left < nearest:
            nearest, when = left, taken
        if (taken % AHEAD_EVERY == 0 or _near(nodes, node, guide, q, goal)) and (
            motion(grid, field, robot, placed, queue, q, goal, True) == FREE
        ):
            last = node
            break
        if 2 * (used + MOST) > len(tree.node):
            tree = grown(tree)
        if waiting + MOST > len(keys):
            keys, values = heap_grow(keys, values)
        cost = tree.cost[entry_of(tree, node)]
        # One step, or a turn; and the stride that promises most.
        for way in range(10 if nodes.headings > 1 else 8):
            step = way if way < 8 else TURNS + way - 8
            for move in (step, _best_stride(nodes, node, way, multi_steps, guide) if way < 8 else -1):
                other = leads_to(nodes, node, move) if move >= 0 else -1
                if other < 0:
                    continue
                reached = cost + move_cost(nodes, move)
                left = _left(nodes, other, guide, reached)
                if left < np.inf:
                    new = _take_down(tree, other, reached, move)
                    if new >= 0:
                        used += new
                        waiting = heap_push(keys, values, waiting, reached + guide.weight * left, other)
    if last < 0:
        return np.empty((0, 3)), taken
    return _way_to(nodes, tree, last, start, goal), taken


@njit(cache=True, inline="always")
def _at(nodes: Nodes, tree: Tree, node: int, q: FloatArray) -> None:
    """Write a node's configuration into q."""
    if len(tree.retract):
        entry = entry_of(tree, node)
        if tree.known[entry] & SEATED:
            q[:] = tree.retract[entry]
            return
    configuration(nodes, node, q)


@njit(cache=True, inline="always")
def _left(nodes: Nodes, node: int, guide: Guide, cost: float) -> float:
    """Return what is left from a node's position to the goal's, infinite if ``cost`` is too much to get here."""
    _, row, column = place(node)
    if len(guide.cost) == 0 or guide.limit < np.inf:
        straight = hypot(
            guide.x - nodes.x - (column - nodes.left) * nodes.size, guide.y - nodes.y - (row - nodes.below) * nodes.size
        )
        if cost + straight > guide.limit:
            return np.inf
        if len(guide.cost) == 0:
            return straight
    return _guided(guide, row, column)


@njit(cache=True, inline="always")
def _guided(guide: Guide, row: int, column: int) -> float:
    """Return the cost to go from the cell of a position of the lattice."""
    i, j = int(guide.row + row * guide.step), int(guide.column + column * guide.step)
    if i < guide.cost.shape[0] and j < guide.cost.shape[1]:
        return float(guide.cost[i, j])
    return np.inf


@njit(cache=True, inline="always")
def _best_stride(nodes: Nodes, node: int, way: int, multi_steps: int, guide: Guide) -> int:
    """Return the move of more than one step in a direction that promises most, -1 if there is none."""
    _, row, column = place(node)
    best, most = -1, np.inf
    for stride in range(1, multi_steps):
        move = way + 8 * stride
        i, j = row + STEP_Y[move], column + STEP_X[move]
        if not (0 <= i < nodes.rows and 0 <= j < nodes.columns):
            break
        if len(guide.cost):
            left = _guided(guide, i, j)
        else:
            left = hypot(
                guide.x - nodes.x - (j - nodes.left) * nodes.size, guide.y - nodes.y - (i - nodes.below) * nodes.size
            )
        key = move_cost(nodes, move) + guide.weight * left
        if key < most:
            best, most = move, key
    return best


@njit(cache=True, inline="always")
def _near(nodes: Nodes, node: int, guide: Guide, q: FloatArray, goal: FloatArray) -> bool:
    """Return whether a node lies so near to the goal that a motion there may be expected."""
    x, y = position(nodes, node)
    if hypot(x - guide.x, y - guide.y) >= 1.5 * nodes.size:
        return False
    return nodes.headings == 1 or abs(turn(q[2], goal[2])) < 3.0 * pi / nodes.headings


@njit(cache=True, inline="always")
def _take_down(tree: Tree, node: int, cost: float, move: int) -> int:
    """Take down that a move leads to a node at some cost; return the entries that takes, -1 if it is of no use."""
    entry = entry_of(tree, node)
    if tree.known[entry] & DONE or tree.known[entry] & (CHECKED | VALID) == CHECKED:
        return -1
    if tree.move[entry] != 0 and cost >= tree.cost[entry]:
        return -1
    new = tree.node[entry] == 0
    tree.node[entry], tree.cost[entry], tree.move[entry] = node + 1, cost, move + 1
    return int(new)


@njit(cache=True)
def _joined_otherwise(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    queue: FloatArray,
    nodes: Nodes,
    tree: Tree,
    node: int,
    q: FloatArray,
    before: FloatArray,
    multi_steps: int,
) -> bool:
    """Join a node, whose motion failed, to what is done already by another; else wait for one that is found later."""
    entry = entry_of(tree, node)
    arrived, cheapest = tree.move[entry] - 1, np.inf
    tree.known[entry] &= ~np.uint8(VALID)
    for move in range(ORIGIN if nodes.headings > 1 else TURNS):
        other = came_from(nodes, node, move)
        if move == arrived or other < 0 or 8 * multi_steps <= move < TURNS:
            continue
        there = entry_of(tree, other)
        if tree.known[there] & (DONE | VALID) != DONE | VALID:
            continue
        cost = tree.cost[there] + move_cost(nodes, move)
        if cost < cheapest:
            _at(nodes, tree, other, before)
            if motion(grid, field, robot, placed, queue, before, q, True) == FREE:
                cheapest, tree.move[entry] = cost, move + 1
    tree.known[entry] |= VALID
    if cheapest < np.inf:
        tree.cost[entry] = cheapest
        return True
    tree.known[entry] &= ~np.uint8(DONE)
    tree.move[entry] = 0
    return False


@njit(cache=True)
def _way_to(nodes: Nodes, tree: Tree, last: int, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Return the configurations from start to goal over a node."""
    length, node = 1, last
    move = tree.move[entry_of(tree, node)] - 1
    while move != ORIGIN:
        node = came_from(nodes, node, move)
        move = tree.move[entry_of(tree, node)] - 1
        length += 1
    way = np.empty((length + 1, 3))
    way[0], way[length], node = start, goal, last
    for i in range(length - 1, 0, -1):
        _at(nodes, tree, node, way[i])
        node = came_from(nodes, node, tree.move[entry_of(tree, node)] - 1)
    return way
