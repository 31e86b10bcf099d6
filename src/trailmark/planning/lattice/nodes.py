"""The nodes of a lattice: how they are numbered, where they lie, which moves lead from one to another.

Arrays over all nodes would be simpler, but each page of memory that is touched for the first time costs as much as
expanding a node.

Source: linear probing with multiplicative hashing: Knuth, "The Art of Computer Programming" vol. 3, section 6.4.
"""

from __future__ import annotations

from math import floor, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.jit import array_callee, callee
from trailmark.se2 import ROTATION_WEIGHT, FloatArray, wrap

__all__ = [
    "CHECKED",
    "DONE",
    "MIN_BITS",
    "MULTI_STEPS",
    "ORIGIN",
    "RETRACTED",
    "TURNS",
    "VALID",
    "Nodes",
    "SearchTable",
    "child_of",
    "configuration",
    "doubled",
    "entry_of",
    "move_cost",
    "new_table",
    "parent_of",
    "position",
]

BITS = 24
"""Of a node's column, and as many of its row, in its number."""

MULTI_STEPS = (1, 2, 4, 8)
"""Cells that a move leads across."""

_X, _Y = np.array([1, 1, 0, -1, -1, -1, 0, 1]), np.array([0, 1, 1, 1, 0, -1, -1, -1])
STEP_X = np.concatenate([*(length * _X for length in MULTI_STEPS), [0, 0]])
STEP_Y = np.concatenate([*(length * _Y for length in MULTI_STEPS), [0, 0]])
_TURN = np.concatenate([np.zeros(8 * len(MULTI_STEPS), np.int64), [1, -1]])
"""The moves: for each length eight directions, counter-clockwise from +x; then a turn either way."""

TURNS = 8 * len(MULTI_STEPS)
"""The first of the two turns."""

ORIGIN = len(_TURN)
"""In place of a move: the node that the search began at."""


class Nodes(NamedTuple):
    """Positions of the inscribed disc's centre, ``size`` apart, times evenly spaced headings.

    Attributes:
        x: of the start's position, metres.
        y: of the start's position, metres.
        size: metres between neighbouring positions.
        left: columns to the left of the start.
        below: rows below the start.
        columns: of all positions.
        rows: of all positions.
        headings: how many.
        turned: for each heading: radians in (-pi, pi], and the offset from the centre to the reference point, metres;
            shape (headings, 3).
    """

    x: float
    y: float
    size: float
    left: int
    below: int
    columns: int
    rows: int
    headings: int
    turned: FloatArray

    @classmethod
    def around(cls, checker: StateChecker, start: FloatArray, size: float, headings: int) -> Nodes:
        """Return the nodes within the bounds of a world, one of them a configuration of shape (3,)."""
        xmin, ymin, xmax, ymax = checker.world.bounds
        x, y = checker.disc_center(start)
        left, below = floor((x - xmin) / size), floor((y - ymin) / size)
        columns, rows = left + 1 + floor((xmax - x) / size), below + 1 + floor((ymax - y) / size)
        turned = np.empty((headings, 3))
        turned[:, 0] = wrap(start[2] + 2.0 * pi / headings * np.arange(headings))
        c, s = np.cos(turned[:, 0]), np.sin(turned[:, 0])
        a, b = checker.robot.inscribed_disc.center
        turned[:, 1], turned[:, 2] = s * b - c * a, -s * a - c * b
        return cls(x, y, size, left, below, columns, rows, headings, turned)

    @property
    def origin(self) -> int:
        """The start's number."""
        return self.below << BITS | self.left


@callee
def place(node: int) -> tuple[int, int, int]:
    """Return a node's heading, row and column."""
    return node >> 2 * BITS, node >> BITS & ((1 << BITS) - 1), node & ((1 << BITS) - 1)


@callee
def position(nodes: Nodes, node: int) -> tuple[float, float]:
    """Return where a node's disc is centred, metres."""
    _, row, column = place(node)
    return nodes.x + (column - nodes.left) * nodes.size, nodes.y + (row - nodes.below) * nodes.size


@callee
def configuration(nodes: Nodes, node: int, q: FloatArray) -> None:
    """Write a node's configuration into q."""
    x, y = position(nodes, node)
    theta, dx, dy = nodes.turned[node >> 2 * BITS]
    q[0], q[1], q[2] = x + dx, y + dy, theta


@callee
def child_of(nodes: Nodes, node: int, move: int) -> int:
    """Return the node that a move leads to, -1 out of the lattice."""
    k, row, column = place(node)
    column, row = column + STEP_X[move], row + STEP_Y[move]
    if not (0 <= column < nodes.columns and 0 <= row < nodes.rows):
        return -1
    k += _TURN[move]
    if k < 0:
        k += nodes.headings
    elif k >= nodes.headings:
        k -= nodes.headings
    return int((k << BITS | row) << BITS | column)


@callee
def parent_of(nodes: Nodes, node: int, move: int) -> int:
    """Return the node from which a move leads to ``node``, -1 out of the lattice."""
    if move >= TURNS:
        return int(child_of(nodes, node, 2 * TURNS + 1 - move))
    return int(child_of(nodes, node, (move & ~7) + ((move + 4) & 7)))


@callee
def move_cost(nodes: Nodes, move: int) -> float:
    """Return a move's cost, metres."""
    if move >= TURNS:
        return ROTATION_WEIGHT * 2.0 * pi / nodes.headings
    length = nodes.size * (1 << (move >> 3))
    return length * sqrt(2.0) if move & 1 else length


# --- What a lattice search knows of the nodes that it has come to, in a hash table: memory grows with these alone.

CHECKED, VALID, DONE, RETRACTED = 1, 2, 4, 8
"""What is known of a node: bits."""

MIN_BITS = 9
"""Binary logarithm of the entries of a new table."""

_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)


class SearchTable(NamedTuple):
    """A table of nodes; at most half of its entries are to be used.

    Attributes:
        node: numbers plus 1; 0 where an entry is not used.
        known: CHECKED, VALID, DONE, and RETRACTED where the configuration is not the lattice's own.
        cost: from the start, metres.
        move: that led there, plus 1; 0 if none did.
        retracted: configurations of the nodes that are RETRACTED, (entries, 3); empty if none ever is.
    """

    node: NDArray[np.int64]
    known: NDArray[np.uint8]
    cost: NDArray[np.float32]
    move: NDArray[np.uint8]
    retracted: NDArray[np.float64]


@array_callee
def new_table(entries: int = 1 << MIN_BITS, retracts: bool = False) -> SearchTable:
    """Return an empty table with room for a power of two of entries, and if ``retracts`` for their configurations."""
    return SearchTable(
        np.zeros(entries, np.int64),
        np.zeros(entries, np.uint8),
        np.zeros(entries, np.float32),
        np.zeros(entries, np.uint8),
        np.zeros((entries if retracts else 0, 3)),
    )


@callee
def entry_of(table: SearchTable, node: int) -> int:
    """Return a node's entry; one that is not used, where the node belongs, if it is not there."""
    mask = len(table.node) - 1
    # The upper half of the product is well mixed, once what tells headings apart is low enough to get there.
    entry = np.int64((np.uint64(node ^ (node >> 32)) * _MULTIPLIER) >> np.uint64(32)) & mask
    while table.node[entry] != 0 and table.node[entry] != node + 1:
        entry = (entry + 1) & mask
    return int(entry)


@array_callee
def doubled(table: SearchTable) -> SearchTable:
    """Return a table of twice the size with the same nodes."""
    larger = new_table(2 * len(table.node), len(table.retracted) > 0)
    for old in range(len(table.node)):
        if table.node[old] != 0:
            new = entry_of(larger, table.node[old] - 1)
            larger.node[new], larger.known[new] = table.node[old], table.known[old]
            larger.cost[new], larger.move[new] = table.cost[old], table.move[old]
            if len(table.retracted):
                larger.retracted[new] = table.retracted[old]
    return larger
