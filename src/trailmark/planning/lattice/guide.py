"""What guides a lattice search: costs to go on a grid, or the straight distance, weighted."""

from __future__ import annotations

from math import floor, hypot, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.heading import turn
from trailmark.planning.lattice.nodes import STEP_X, STEP_Y, TURNS, Nodes, move_cost, place, position
from trailmark.se2 import FloatArray

__all__ = ["Guide", "best_multi_step", "cost_of_move", "cost_to_go", "near_goal"]


class Guide(NamedTuple):
    """Costs to go, as compiled functions take them.

    Attributes:
        cost: (rows, columns), metres; empty: the straight distance counts.
        density: what a metre costs in each cell, (rows, columns); empty: its length.
        column: in ``cost``, of the lattice's first column, with what it lies beyond that cell's edge.
        row: in ``cost``, of the lattice's first row, likewise.
        step: cells of ``cost`` from one of the lattice's positions to the next.
        x: of the goal's position, metres.
        y: of the goal's position, metres.
        weight: of the cost to go.
        limit: metres; no path over a node is of interest whose cost and straight distance to the goal exceed it.
        least: what a metre costs at least.
        rotation: what a radian costs.
    """

    cost: NDArray[np.float32]
    density: NDArray[np.float32]
    column: float
    row: float
    step: float
    x: float
    y: float
    weight: float
    limit: float
    least: float
    rotation: float


@njit(cache=True)
def cost_to_go(nodes: Nodes, node: int, guide: Guide, cost: float) -> float:
    """Return the cost to go from a node's position to the goal's, infinite if ``cost`` is too much to get here."""
    _, row, column = place(node)
    if len(guide.cost) == 0 or guide.limit < np.inf:
        straight = hypot(
            guide.x - nodes.x - (column - nodes.left) * nodes.size, guide.y - nodes.y - (row - nodes.below) * nodes.size
        )
        if cost + guide.least * straight > guide.limit:
            return np.inf
        if len(guide.cost) == 0:
            return guide.least * straight
    return _guided(guide, row, column)


@njit(cache=True)
def cost_of_move(nodes: Nodes, node: int, other: int, move: int, guide: Guide) -> float:
    """Return what a move from a node to another costs: a metre what it costs on the mean at its ends."""
    if move >= TURNS:
        return guide.rotation * 2.0 * pi / nodes.headings
    if len(guide.density) == 0:
        return move_cost(nodes, move)
    return 0.5 * (_density(nodes, node, guide) + _density(nodes, other, guide)) * move_cost(nodes, move)


@njit(cache=True)
def _density(nodes: Nodes, node: int, guide: Guide) -> float:
    _, row, column = place(node)
    return _cell(guide.density, guide, row, column, guide.least)


@njit(cache=True)
def _guided(guide: Guide, row: int, column: int) -> float:
    """Return the cost to go from the cell of a position of the lattice."""
    return _cell(guide.cost, guide, row, column, np.inf)


@njit(cache=True)
def _cell(cells: NDArray[np.float32], guide: Guide, row: int, column: int, beyond: float) -> float:
    """Return what the cell under a position of the lattice holds, ``beyond`` out of all cells: they may be fewer."""
    i, j = floor(guide.row + row * guide.step), floor(guide.column + column * guide.step)
    if 0 <= i < cells.shape[0] and 0 <= j < cells.shape[1]:
        return float(cells[i, j])
    return beyond


@njit(cache=True)
def best_multi_step(nodes: Nodes, node: int, direction: int, multi_steps: int, guide: Guide) -> int:
    """Return the move of more than one step in a direction that promises most, -1 if there is none."""
    _, row, column = place(node)
    best, most = -1, np.inf
    for multi_step in range(1, multi_steps):
        move = direction + 8 * multi_step
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


@njit(cache=True)
def near_goal(nodes: Nodes, node: int, guide: Guide, q: FloatArray, goal: FloatArray) -> bool:
    """Return whether a node lies so near to the goal that a motion there may be expected."""
    x, y = position(nodes, node)
    if hypot(x - guide.x, y - guide.y) >= 1.5 * nodes.size:
        return False
    return nodes.headings == 1 or abs(turn(q[2], goal[2])) < 3.0 * pi / nodes.headings
