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
from math import floor, hypot, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.clock import CLOCK_EVERY, Deadline, over
from trailmark.collision import StateChecker
from trailmark.collision.certify import BUDGET
from trailmark.collision.kernels import FREE, state
from trailmark.heading import turn
from trailmark.heap import WAITING, Labels, add_label, entry_of, label_of, new_labels, next_label, with_room
from trailmark.jit import array_callee, callee, njit
from trailmark.landmarks.grid_search import STEP_X, STEP_Y
from trailmark.landmarks.retraction import retract
from trailmark.motion import DifferentialMotion, Motion, WeightedMotion
from trailmark.motion.base import Scratch, certified, new_scratch
from trailmark.motion.base import cost as cost_between
from trailmark.motion.straight import Straight
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.se2 import ROTATION_WEIGHT, FloatArray, wrap

__all__ = ["Lattice"]

GOAL_EVERY = 16
"""Nodes expanded between two tries of the straight motion to the goal."""

ABOUT = 1.02
"""Times the cost to go that the motion to the goal may cost to be tried, where places differ in cost."""

REACH, MARGIN = 0.75, 0.25
"""Steps by which a node that collides may be moved and turned off the obstacles, and the clearance sought there."""

SPANS = (1, 2, 4, 8)
"""Cells that a move leads across; for each, eight directions, counter-clockwise from +x."""

TURNS, MOVES = 8 * len(SPANS), 8 * len(SPANS) + 2
"""The first of the two turns, by one heading either way, which come after all other moves; and how many there are."""

MAX_CHILDREN = 18
"""Labels that are added when a node is expanded, at most: a step or turn, and a move of more cells, in each
direction."""

FAILED, DONE = 1, 2
"""Of a label that is closed: its node is of no use, or expanded."""

BITS = 24
"""Of a node's column, and as many of its row, in its number."""


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
        weighted = self.motion if isinstance(self.motion, WeightedMotion) else None
        plain = self.motion if weighted is None else weighted.motion
        # Whether headings make a difference is known to the nodes: one kind less to compile.
        kind: Any = Straight(self.checker.grid, self.checker.field, self.checker.footprint)
        anchor, rotation = start, ROTATION_WEIGHT
        if isinstance(plain, DifferentialMotion):
            # Its steps lead along its headings, which are those of the grid: it begins with a turn.
            kind, anchor = plain.kind, plain.turned(start, self.headings)
        if weighted is not None:
            kind, rotation = weighted.kind._replace(motion=kind), weighted.density.rotation
        guide = _Guide(to_go, *self.checker.disc_center(goal), float(weight), float(limit), rotation)
        nodes, origin = _nodes_around(self.checker, anchor, self.size, self.headings)
        found, expanded = _search(
            kind,
            nodes,
            origin,
            guide,
            np.asarray(start),
            np.asarray(goal),
            budget,
            budget if patience is None else patience,
            len(SPANS) if multi_steps else 1,
            retracts,
            deadline,
        )
        return found, int(expanded)


class _Nodes(NamedTuple):
    """Positions of the inscribed disc's centre times headings; a node's number holds its heading, row and column."""

    x0: float  # of the first column, metres
    y0: float  # of the first row, metres
    size: float  # metres between neighbouring positions
    columns: int  # how many
    rows: int  # how many
    # for each heading: radians in (-pi, pi], and the offset from the centre to the reference point, metres; shape
    # (headings, 3)
    turned: FloatArray


def _nodes_around(checker: StateChecker, q: FloatArray, size: float, headings: int) -> tuple[_Nodes, int]:
    """Return the nodes within the bounds of a world, and which of them is the configuration q, shape (3,)."""
    xmin, ymin, xmax, ymax = checker.world.bounds
    x, y = checker.disc_center(q)
    left, below = floor((x - xmin) / size), floor((y - ymin) / size)
    columns, rows = left + 1 + floor((xmax - x) / size), below + 1 + floor((ymax - y) / size)
    theta = wrap(q[2] + 2.0 * pi / headings * np.arange(headings))
    c, s, (a, b) = np.cos(theta), np.sin(theta), checker.robot.inscribed_disc.center
    turned = np.column_stack([theta, s * b - c * a, -s * a - c * b])
    return _Nodes(x - left * size, y - below * size, size, columns, rows, turned), below << BITS | left


@callee
def _position(nodes: _Nodes, node: int) -> tuple[float, float]:
    """Return where a node's disc is centred, metres."""
    row, column = node >> BITS & ((1 << BITS) - 1), node & ((1 << BITS) - 1)
    return nodes.x0 + column * nodes.size, nodes.y0 + row * nodes.size


@callee
def _moved(nodes: _Nodes, node: int, move: int) -> int:
    """Return the node that a move leads to, -1 out of the lattice."""
    heading, row, column = node >> 2 * BITS, node >> BITS & ((1 << BITS) - 1), node & ((1 << BITS) - 1)
    if move >= TURNS:
        heading = (heading + (1 if move == TURNS else len(nodes.turned) - 1)) % len(nodes.turned)
    else:
        span = 1 << (move >> 3)
        column, row = column + span * STEP_X[move & 7], row + span * STEP_Y[move & 7]
        if not (0 <= column < nodes.columns and 0 <= row < nodes.rows):
            return -1
    return int((heading << BITS | row) << BITS | column)


@callee
def _length(nodes: _Nodes, move: int) -> float:
    """Return the length of a move that is no turn, metres."""
    length = nodes.size * (1 << (move >> 3))
    return length * sqrt(2.0) if move & 1 else length


class _Guide(NamedTuple):
    """Costs to go, and how they are used."""

    to_go: CostToGo  # on a grid
    x: float  # of the goal's position, metres
    y: float  # of the goal's position, metres
    weight: float  # of the cost to go
    limit: float  # metres; no path over a node is of interest whose cost and straight distance to the goal exceed it
    rotation: float  # what a radian costs


@callee
def _cost_to_go(nodes: _Nodes, node: int, guide: _Guide, cost: float) -> float:
    """Return the cost to go from a node's position to the goal's, infinite if ``cost`` is too much to get here."""
    (x, y), to_go = _position(nodes, node), guide.to_go
    if len(to_go.cost) == 0 or guide.limit < np.inf:
        straight = to_go.least * hypot(guide.x - x, guide.y - y)
        if cost + straight > guide.limit:
            return np.inf
        if len(to_go.cost) == 0:
            return straight
    return _in_cell(to_go, to_go.cost, x, y, np.inf)


@callee
def _in_cell(to_go: CostToGo, cells: NDArray[np.float32], x: float, y: float, beyond: float) -> float:
    """Return what the cell of a place holds, ``beyond`` out of all cells: they may cover less than the lattice."""
    i, j = floor((y - to_go.y0) / to_go.size), floor((x - to_go.x0) / to_go.size)
    return float(cells[i, j]) if 0 <= i < cells.shape[0] and 0 <= j < cells.shape[1] else beyond


@callee
def _cost_of_move(nodes: _Nodes, node: int, other: int, move: int, guide: _Guide) -> float:
    """Return what a move from a node to another costs: a metre what it costs on the mean at its ends."""
    if move >= TURNS:
        return guide.rotation * 2.0 * pi / len(nodes.turned)
    if len(guide.to_go.density) == 0:
        return _length(nodes, move)
    return 0.5 * (_density(nodes, node, guide.to_go) + _density(nodes, other, guide.to_go)) * _length(nodes, move)


@callee
def _density(nodes: _Nodes, node: int, to_go: CostToGo) -> float:
    x, y = _position(nodes, node)
    return _in_cell(to_go, to_go.density, x, y, to_go.least)


@callee
def _best_span(nodes: _Nodes, node: int, direction: int, spans: int, guide: _Guide) -> int:
    """Return the move of more than one cell in a direction that promises most, -1 if there is none."""
    best, least = -1, np.inf
    for k in range(1, spans):
        other = _moved(nodes, node, direction + 8 * k)
        if other < 0:
            break
        key = _length(nodes, direction + 8 * k) + guide.weight * _cost_to_go(nodes, other, guide, 0.0)
        if key < least:
            best, least = direction + 8 * k, key
    return best


@njit(nogil=True)
def _search(
    kind: Any,
    nodes: _Nodes,
    origin: int,
    guide: _Guide,
    start: FloatArray,
    goal: FloatArray,
    budget: int,
    patience: int,
    spans: int,
    retracts: bool,
    deadline: Deadline,
) -> tuple[FloatArray, int]:
    """Return the path from start to goal, and how many nodes were expanded."""
    scratch, labels, headings = new_scratch(kind), new_labels(256, 0), len(nodes.turned)
    add_label(labels, entry_of(labels, origin), origin, -1, 0.0, 0.0)
    expanded, nearest, nearest_at = 0, np.inf, 0
    while labels.counts[WAITING] > 0 and expanded < budget and expanded - nearest_at <= patience:
        labels = with_room(labels, MAX_CHILDREN)
        label = next_label(labels)
        if label < 0:
            continue
        expanded += 1
        if expanded % CLOCK_EVERY == 0 and over(deadline):
            break
        node, q = labels.node[label], labels.q[label]
        labels.closed[label] = FAILED
        if not _place(kind, scratch, nodes, node, retracts, q):
            continue
        parent = labels.parent[label]
        if parent >= 0 and not certified(kind, scratch, labels.q[parent], q, BUDGET):
            _find_other_parent(kind, scratch, nodes, labels, label, spans, guide)
            if labels.parent[label] < 0:
                # Its node waits for a parent that is found later.
                labels.closed[label], labels.cost[label] = 0, np.inf
                continue
        labels.closed[label] = DONE
        left = _cost_to_go(nodes, node, guide, 0.0)
        if left < nearest:
            nearest, nearest_at = left, expanded
        if (
            (expanded % GOAL_EVERY == 0 or _near_goal(nodes, node, guide, q, goal))
            # Where places differ in cost, a straight way through what is dear is no use.
            and (
                len(guide.to_go.density) == 0
                or cost_between(kind, scratch, q, goal) <= ABOUT * left + guide.rotation * pi
            )
            and certified(kind, scratch, q, goal, BUDGET)
        ):
            return _path_over(labels, label, start, goal), expanded
        # One step, and the move across more cells that promises most; or a turn.
        for direction in range(10 if headings > 1 else 8):
            first = direction if direction < 8 else TURNS + direction - 8
            for move in (first, _best_span(nodes, node, direction, spans, guide) if direction < 8 else -1):
                other = _moved(nodes, node, move) if move >= 0 else -1
                if other < 0:
                    continue
                cost = labels.cost[label] + _cost_of_move(nodes, node, other, move, guide)
                left = _cost_to_go(nodes, other, guide, cost)
                if left == np.inf:
                    continue
                entry = entry_of(labels, other)
                known = labels.table[entry]
                if known >= 0:
                    if labels.closed[known] or cost >= labels.cost[known]:
                        continue
                    labels.closed[known] = FAILED
                add_label(labels, entry, other, label, cost, cost + guide.weight * left)
    return np.empty((0, 3)), expanded


@callee
def _place(kind: Any, scratch: Scratch, nodes: _Nodes, node: int, retracts: bool, q: FloatArray) -> bool:
    """Write a node's configuration into q, pushed off the obstacles if need be; return whether it is valid."""
    x, y = _position(nodes, node)
    theta, dx, dy = nodes.turned[node >> 2 * BITS]
    q[0], q[1], q[2] = x + dx, y + dy, theta
    if state(kind.grid, kind.field, kind.robot, scratch.placed, q[0], q[1], q[2]) == FREE:
        return True
    if not retracts:
        return False
    turning = REACH * 2.0 * pi / len(nodes.turned)
    retract(kind.field, kind.robot, q, REACH * nodes.size, turning, MARGIN * nodes.size)
    return bool(state(kind.grid, kind.field, kind.robot, scratch.placed, q[0], q[1], q[2]) == FREE)


@callee
def _near_goal(nodes: _Nodes, node: int, guide: _Guide, q: FloatArray, goal: FloatArray) -> bool:
    """Return whether a node lies so near to the goal that a motion there may be expected."""
    x, y = _position(nodes, node)
    if hypot(x - guide.x, y - guide.y) >= 1.5 * nodes.size:
        return False
    return len(nodes.turned) == 1 or abs(turn(q[2], goal[2])) < 3.0 * pi / len(nodes.turned)


@callee
def _find_other_parent(
    kind: Any, scratch: Scratch, nodes: _Nodes, labels: Labels, label: int, spans: int, guide: _Guide
) -> None:
    """Join a node, whose motion failed, to another expanded one, or to none."""
    node, failed, cheapest = labels.node[label], labels.parent[label], np.inf
    labels.parent[label] = -1
    for move in range(MOVES if len(nodes.turned) > 1 else TURNS):
        # Moves come in pairs, there and back.
        other = _moved(nodes, node, move) if move < 8 * spans or move >= TURNS else -1
        before = label_of(labels, other) if other >= 0 else -1
        if before < 0 or before == failed or labels.closed[before] != DONE:
            continue
        cost = labels.cost[before] + _cost_of_move(nodes, other, node, move, guide)
        if cost < cheapest and certified(kind, scratch, labels.q[before], labels.q[label], BUDGET):
            cheapest, labels.cost[label], labels.parent[label] = cost, cost, before


@array_callee
def _path_over(labels: Labels, label: int, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Return the configurations from start to goal over a label's node."""
    length, at = 2, labels.parent[label]
    while at >= 0:
        length, at = length + 1, labels.parent[at]
    path = np.empty((length, 3))
    path[length - 1], at = goal, label
    for i in range(length - 2, -1, -1):
        path[i], at = labels.q[at], labels.parent[at]
    path[0] = start
    return path
