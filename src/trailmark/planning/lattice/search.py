"""A first path by weighted A* over a lattice of configurations: cells times headings, each checked when it is needed.

The inscribed disc's relaxed problem knows no headings; where the robot is longer than wide, its paths lead into gaps
that the robot cannot turn into. The lattice knows them: its motions are the robot's own, certified like all others, so
that a path over it is a path of certified motions. It is coarse, and nothing is proven by not finding one.

Sources: states and motions on a grid with an anchored origin: Pivtoraiko, Knepper & Kelly, "Differentially constrained
mobile robot motion planning in state lattices", JFR 2009; weighted A*: Pohl, "Heuristic search viewed as path finding
in a graph", AI 1970; checks only of what is expanded: Cohen, Phillips & Likhachev, RSS 2014.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision import StateChecker
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import FREE, state
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.jit import array_callee, callee, njit
from trailmark.landmarks.retraction import retract
from trailmark.motion import DifferentialMotion, Motion, StraightMotion
from trailmark.motion.base import MotionModel, Scratch, certified, new_scratch
from trailmark.motion.base import cost as cost_between
from trailmark.planning.lattice.cost_to_go import CostToGo, Guide, best_multi_step, cost_of_move, cost_to_go, near_goal
from trailmark.planning.lattice.nodes import (
    CHECKED,
    DONE,
    MIN_BITS,
    MULTI_STEPS,
    ORIGIN,
    RETRACTED,
    TURNS,
    VALID,
    Nodes,
    SearchTable,
    child_of,
    configuration,
    doubled,
    entry_of,
    new_table,
    parent_of,
)
from trailmark.se2 import ROTATION_WEIGHT, FloatArray

__all__ = ["Lattice"]

GOAL_EVERY = 16
"""Nodes expanded between two tries of the straight motion to the goal."""

ABOUT = 1.02
"""Times the cost to go that the motion to the goal may cost to be tried, where places differ in cost."""

MAX_CHILDREN = 18
"""Nodes that are added when one is expanded, at most."""

REACH, MARGIN = 0.75, 0.25
"""Steps by which a node that collides may be moved and turned off the obstacles, and the clearance sought there."""


@dataclass(frozen=True)
class Lattice:
    """Configurations on a grid of positions of the inscribed disc's centre, times evenly spaced headings.

    Attributes:
        checker: decides what is valid.
        size: metres between neighbouring positions.
        headings: how many; 1 for a robot to which they make no difference.
        motion: of the robot; straight motions by default.
    """

    checker: StateChecker
    size: float
    headings: int
    motion: Motion | None = None

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
        """Return a path of certified motions, shape (n, 3), (0, 3) if there is none, and the number of nodes expanded.

        The start is a node of the lattice; the goal is joined to it by a motion.

        Args:
            start: valid configuration, shape (3,).
            goal: valid configuration, shape (3,).
            to_go: guides the search.
            weight: of the cost to go; 1 seeks the cheapest path, more finds one sooner.
            budget: maximum number of nodes expanded.
            limit: metres; no path over a node is of interest whose cost and straight distance to the goal exceed it.
            patience: give up after so many nodes that come no nearer to the goal; never by default.
            multi_steps: also move several cells at a time, in the direction that promises most; paths are found sooner,
                but are dearer.
            retracts: push nodes that collide by little off the obstacles: gaps are found that no node lies in.
            seconds: that the search may take.
        """
        deadline = Deadline.after(seconds)
        motion, anchor = self.motion or StraightMotion(self.checker), start
        if isinstance(motion, DifferentialMotion):
            # Its steps lead along its headings, which are those of the grid: it begins with a turn.
            anchor = motion.turned(start, self.headings)
        nodes = Nodes.around(self.checker, anchor, self.size, self.headings)
        guide = Guide(
            to_go.cost,
            to_go.density,
            (nodes.x - nodes.left * nodes.size - to_go.x0) / to_go.size,
            (nodes.y - nodes.below * nodes.size - to_go.y0) / to_go.size,
            nodes.size / to_go.size,
            *self.checker.disc_center(goal),
            float(weight),
            float(limit),
            to_go.least,
            motion.density.rotation if motion.weighted else ROTATION_WEIGHT,
        )
        found, expanded = _search(
            motion.kind,
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
        return found, int(expanded)


@njit(nogil=True)
def _search(
    kind: MotionModel,
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
    """Return the path from start to goal, and how many nodes were expanded."""
    scratch = new_scratch(kind)
    q, before = np.empty(3), np.empty(3)
    keys, values = np.empty(256), np.empty(256, np.int64)
    waiting = heap_push(keys, values, 0, 0.0, origin)
    table, used = new_table(1 << MIN_BITS, retracts), 1
    entry = entry_of(table, origin)
    table.node[entry], table.move[entry], table.known[entry] = origin + 1, ORIGIN + 1, CHECKED | VALID
    expanded, last = 0, -1
    nearest, nearest_at = np.inf, 0
    while waiting > 0 and expanded < budget and expanded - nearest_at <= patience:
        waiting = heap_pop(keys, values, waiting)
        node = values[waiting]
        entry = entry_of(table, node)
        # It may be stale: done already, or its motion failed and no other leads here.
        if table.known[entry] & DONE or table.move[entry] == 0:
            continue
        expanded += 1
        if expanded % CLOCK_EVERY == 0 and over(deadline):
            break
        table.known[entry] |= DONE
        _configuration_of(nodes, table, node, q)
        if not table.known[entry] & CHECKED:
            table.known[entry] |= CHECKED
            if _free(kind, scratch, q):
                table.known[entry] |= VALID
            elif retracts:
                retract(
                    kind.field,
                    kind.robot,
                    q,
                    REACH * nodes.size,
                    REACH * 2.0 * pi / nodes.headings,
                    MARGIN * nodes.size,
                )
                if _free(kind, scratch, q):
                    table.known[entry] |= VALID | RETRACTED
                    table.retracted[entry] = q
        if not table.known[entry] & VALID:
            continue
        parent_move = table.move[entry] - 1
        if parent_move != ORIGIN:
            _configuration_of(nodes, table, parent_of(nodes, node, parent_move), before)
            if not certified(kind, scratch, before, q, BUDGET) and not _find_other_parent(
                kind, scratch, nodes, table, node, q, before, multi_steps, guide
            ):
                continue
        left = cost_to_go(nodes, node, guide, 0.0)
        if left < nearest:
            nearest, nearest_at = left, expanded
        if (
            (near_goal(nodes, node, guide, q, goal) or expanded % GOAL_EVERY == 0)
            # Where places differ in cost, a straight way through what is dear is no use.
            and (len(guide.density) == 0 or cost_between(kind, scratch, q, goal) <= ABOUT * left + guide.rotation * pi)
            and certified(kind, scratch, q, goal, BUDGET)
        ):
            last = node
            break
        if 2 * (used + MAX_CHILDREN) > len(table.node):
            table = doubled(table)
        if waiting + MAX_CHILDREN > len(keys):
            keys, values = heap_grow(keys, values)
        cost = table.cost[entry_of(table, node)]
        # One step, or a turn; and the multi-step that promises most.
        for direction in range(10 if nodes.headings > 1 else 8):
            step = direction if direction < 8 else TURNS + direction - 8
            for move in (step, best_multi_step(nodes, node, direction, multi_steps, guide) if direction < 8 else -1):
                other = child_of(nodes, node, move) if move >= 0 else -1
                if other < 0:
                    continue
                reached = cost + cost_of_move(nodes, node, other, move, guide)
                left = cost_to_go(nodes, other, guide, reached)
                if left < np.inf:
                    new = _relax(table, other, reached, move)
                    if new >= 0:
                        used += new
                        waiting = heap_push(keys, values, waiting, reached + guide.weight * left, other)
    if last < 0:
        return np.empty((0, 3)), expanded
    return _path_over(nodes, table, last, start, goal), expanded


@callee
def _free(kind: MotionModel, scratch: Scratch, q: FloatArray) -> bool:
    """Return whether a configuration is valid."""
    return bool(state(kind.grid, kind.field, kind.robot, scratch.placed, q[0], q[1], q[2]) == FREE)


@array_callee
def _configuration_of(nodes: Nodes, table: SearchTable, node: int, q: FloatArray) -> None:
    """Write a node's configuration into q."""
    if len(table.retracted):
        entry = entry_of(table, node)
        if table.known[entry] & RETRACTED:
            q[:] = table.retracted[entry]
            return
    configuration(nodes, node, q)


@callee
def _relax(table: SearchTable, node: int, cost: float, move: int) -> int:
    """Record that a move leads to a node at some cost; return the entries that takes, -1 if that is no better."""
    entry = entry_of(table, node)
    if table.known[entry] & DONE or table.known[entry] & (CHECKED | VALID) == CHECKED:
        return -1
    if table.move[entry] != 0 and cost >= table.cost[entry]:
        return -1
    new = table.node[entry] == 0
    table.node[entry], table.cost[entry], table.move[entry] = node + 1, cost, move + 1
    return int(new)


@callee
def _find_other_parent(
    kind: MotionModel,
    scratch: Scratch,
    nodes: Nodes,
    table: SearchTable,
    node: int,
    q: FloatArray,
    before: FloatArray,
    multi_steps: int,
    guide: Guide,
) -> bool:
    """Join a node, whose motion failed, to another expanded one; without success it waits for a parent found later."""
    entry = entry_of(table, node)
    parent_move, cheapest = table.move[entry] - 1, np.inf
    table.known[entry] &= ~np.uint8(VALID)
    for move in range(ORIGIN if nodes.headings > 1 else TURNS):
        other = parent_of(nodes, node, move)
        if move == parent_move or other < 0 or 8 * multi_steps <= move < TURNS:
            continue
        there = entry_of(table, other)
        if table.known[there] & (DONE | VALID) != DONE | VALID:
            continue
        cost = table.cost[there] + cost_of_move(nodes, other, node, move, guide)
        if cost < cheapest:
            _configuration_of(nodes, table, other, before)
            if certified(kind, scratch, before, q, BUDGET):
                cheapest, table.move[entry] = cost, move + 1
    table.known[entry] |= VALID
    if cheapest < np.inf:
        table.cost[entry] = cheapest
        return True
    table.known[entry] &= ~np.uint8(DONE)
    table.move[entry] = 0
    return False


@array_callee
def _path_over(nodes: Nodes, table: SearchTable, last: int, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Return the configurations from start to goal over a node."""
    length, node = 1, last
    move = table.move[entry_of(table, node)] - 1
    while move != ORIGIN:
        node = parent_of(nodes, node, move)
        move = table.move[entry_of(table, node)] - 1
        length += 1
    path = np.empty((length + 1, 3))
    path[0], path[length], node = start, goal, last
    for i in range(length - 1, 0, -1):
        _configuration_of(nodes, table, node, path[i])
        node = parent_of(nodes, node, table.move[entry_of(table, node)] - 1)
    return path
