"""Costs to go for a search over configurations: the inscribed disc's on a coarse grid, dearer where it is tight.

The disc's shortest path leads through gaps that the robot fits through in few headings or none; a search that follows
it floods what lies before each of them. Paths with room are nearly as short and found at once, so tight cells are
dearer here. Nothing is proven by these costs: a cell counts as open if the disc may fit somewhere in it.

A search over a lattice knows eight directions, which makes ways longer by up to 8 %: enough to lead it round the other
side of an obstacle. Within a corridor about the cheapest way by the fast marching method it cannot.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil, floor, hypot, inf, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.heading import turn
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.density import Density, densities
from trailmark.planning.fast_marching import march
from trailmark.planning.lattice.nodes import STEP_X, STEP_Y, TURNS, Nodes, move_cost, place, position
from trailmark.se2 import FloatArray

__all__ = ["TIGHTNESS", "CostToGo", "Guide", "best_multi_step", "corridor", "cost_of_move", "cost_to_go", "near_goal"]

TIGHTNESS = 6.0
"""How many times dearer a cell is in which the disc hardly fits."""

ROOMY = 0.5
"""Where between the inscribed disc's radius and the circumradius a clearance counts as room enough."""

UNIT, CLOSED, FAR = 64, 0, 2**31 - 1
"""Parts of a cell's edge that costs are counted in; the cost of a cell that is closed, and of what is not reached."""

NO_CELLS = np.empty((0, 0), np.float32)

MAX_RATIO = 1000.0
"""Between the costs of a metre in two cells: more is not told apart, since a queue of buckets needs one for each."""

_STEP_X = np.array([1, 1, 0, -1, -1, -1, 0, 1])
_STEP_Y = np.array([0, 1, 1, 1, 0, -1, -1, -1])


@dataclass(frozen=True)
class CostToGo:
    """What is left to a configuration, as far as a grid of cells knows.

    Attributes:
        cost: (rows, columns), metres; infinite where nothing leads there. Empty: the straight distance counts.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
        density: what a metre costs in each cell, (rows, columns); empty where that is its length.
        least: what it costs at least.
    """

    cost: NDArray[np.float32]
    x0: float = 0.0
    y0: float = 0.0
    size: float = 1.0
    density: NDArray[np.float32] = field(default_factory=lambda: NO_CELLS)
    least: float = 1.0

    @classmethod
    def straight(cls) -> CostToGo:
        """Return the straight distance."""
        return cls(NO_CELLS)

    @classmethod
    def of(
        cls,
        checker: StateChecker,
        goal: FloatArray,
        cells: int,
        tightness: float = TIGHTNESS,
        window: tuple[float, float, float, float] | None = None,
        density: Density | None = None,
    ) -> CostToGo:
        """Return the costs to a configuration.

        Args:
            checker: gives field and robot.
            goal: shape (3,).
            cells: about how many.
            tightness: how many times dearer a cell is in which the disc hardly fits.
            window: xmin, ymin, xmax, ymax (metres) that the cells cover; by default the bounds.
            density: what a metre costs; its length by default.
        """
        xmin, ymin, xmax, ymax = checker.world.bounds if window is None else window
        size = sqrt((xmax - xmin) * (ymax - ymin) / cells)
        columns, rows = max(1, ceil((xmax - xmin) / size)), max(1, ceil((ymax - ymin) / size))
        x, y = checker.disc_center(goal)
        weights, least = NO_CELLS, 1.0
        if density is not None:
            weights, least = densities(density, checker.field, xmin, ymin, size, rows, columns), density.least
        cost = _costs(checker.field, xmin, ymin, size, rows, columns, *_room(checker), tightness, x, y, weights, least)
        return cls(cost, xmin, ymin, size, weights, least)

    def at(self, x: float, y: float) -> float:
        """Return the cost (metres) of the cell of a place; infinite beyond the grid."""
        row, column = floor((y - self.y0) / self.size), floor((x - self.x0) / self.size)
        inside = 0 <= row < self.cost.shape[0] and 0 <= column < self.cost.shape[1]
        return float(self.cost[row, column]) if inside else inf


def _room(checker: StateChecker) -> tuple[float, float]:
    """Return the inscribed disc's radius, and the clearance (metres) that counts as room enough."""
    radius = checker.robot.inscribed_disc.radius
    return radius, radius + ROOMY * max(checker.footprint.circumradius - radius, 0.1 * radius)


@njit(nogil=True)
def _costs(
    field: ClearanceField,
    x0: float,
    y0: float,
    size: float,
    rows: int,
    columns: int,
    radius: float,
    roomy: float,
    tightness: float,
    x: float,
    y: float,
    weights: NDArray[np.float32],
    least: float,
) -> NDArray[np.float32]:
    """Return the costs of all cells to the one of (x, y), shape (rows, columns)."""
    dear = _dear(field, x0, y0, size, rows, columns, radius, roomy, tightness)
    for row in range(len(weights)):
        for column in range(columns):
            dear[row + 1, column + 1] = round(dear[row + 1, column + 1] * min(weights[row, column] / least, MAX_RATIO))
    column, row = min(columns - 1, max(0, floor((x - x0) / size))), min(rows - 1, max(0, floor((y - y0) / size)))
    if dear[row + 1, column + 1] == CLOSED:
        # The goal's own cell is open in any case.
        dear[row + 1, column + 1] = round(UNIT * (1.0 + tightness))
    return _flood(dear, (row + 1) * (columns + 2) + column + 1, size * least)


@array_callee
def _dear(
    field: ClearanceField,
    x0: float,
    y0: float,
    size: float,
    rows: int,
    columns: int,
    radius: float,
    roomy: float,
    tightness: float,
) -> NDArray[np.int32]:
    """Return what crossing each cell costs, CLOSED if the disc fits nowhere in it, with a closed border all around.

    The room in a cell is the largest clearance at some places in it, looked at no closer than need be.
    """
    dear = np.full((rows + 2, columns + 2), CLOSED, np.int32)
    down, across = _under(y0 - field.y0, size, rows, field), _under(x0 - field.x0, size, columns, field)
    distance, slack = field.distance, field.slack
    for row in range(rows):
        for column in range(columns):
            dear[row + 1, column + 1] = _dear_cell(
                distance, slack, down, row, across, column, size, radius, roomy, tightness
            )
    return dear


@callee
def _dear_cell(
    distance: NDArray[np.float32],
    slack: float,
    down: NDArray[np.int64],
    row: int,
    across: NDArray[np.int64],
    column: int,
    size: float,
    radius: float,
    roomy: float,
    tightness: float,
) -> int:
    """Return what crossing one cell costs, by the field's rows and columns under all of them.

    Arrays are taken whole: to count references to a part, cut out for each cell, takes longer than the cell does.
    """
    i, j = down[row, 0], across[column, 0]
    room = distance[i, j] if 0 <= i < distance.shape[0] and 0 <= j < distance.shape[1] else 0.0
    if radius - 0.71 * size - slack <= room < roomy:
        for u in range(1, down.shape[1]):
            for v in range(1, across.shape[1]):
                i, j = down[row, u], across[column, v]
                if 0 <= i < distance.shape[0] and 0 <= j < distance.shape[1]:
                    room = max(room, distance[i, j])
    # Half of the slack: where the field cannot tell, the disc may fit.
    if room + 0.5 * slack < radius:
        return CLOSED
    lack = min(1.0, max(0.0, (roomy - room) / (roomy - radius)))
    return round(UNIT * (1.0 + tightness * lack))


@array_callee
def _under(begin: float, size: float, count: int, field: ClearanceField) -> NDArray[np.int64]:
    """Return the field's rows (or columns) under the middle of each of ``count`` cells, then under its other places."""
    places = max(1, round(size / (2.0 * field.size)))
    found = np.empty((count, places + 1), np.int64)
    for k in range(count):
        found[k, 0] = floor((begin + (k + 0.5) * size) / field.size)
        for u in range(places):
            found[k, u + 1] = floor((begin + (k + (u + 0.5) / places) * size) / field.size)
    return found


@array_callee
def _flood(dear: NDArray[np.int32], source: int, size: float) -> NDArray[np.float32]:
    """Return the costs of all cells but the border to a source, metres, by Dijkstra's algorithm.

    Costs are integers here, so that buckets take the heap's place, one for each cost that may be waiting at a time.

    Source: Dial, "Algorithm 360: shortest-path forest with topological ordering", CACM 12(11), 1969.
    """
    rows, width = dear.shape
    cells = dear.reshape(-1)
    buckets = 1
    while buckets <= 1.5 * cells.max():
        buckets *= 2
    first = np.full(buckets, -1, np.int32)
    # Entries: a cell, and the next entry of its bucket (or of those no longer in use). Few wait at a time, and what is
    # not used takes no memory, but addresses.
    entries = np.empty((8 * len(cells) + 1, 2), np.int32)
    unused, used, waiting = -1, 1, 1
    cost = np.full(len(cells), FAR, np.int32)
    steps = _STEP_Y * width + _STEP_X
    cost[source], first[0], entries[0, 0], entries[0, 1] = 0, 0, source, -1
    reached = 0
    while waiting > 0:
        entry = first[reached & (buckets - 1)]
        if entry < 0:
            reached += 1
            continue
        cell, first[reached & (buckets - 1)] = entries[entry, 0], entries[entry, 1]
        entries[entry, 1], unused = unused, entry
        waiting -= 1
        if cost[cell] != reached:
            continue
        for j in range(8):
            other = cell + steps[j]
            if cells[other] == CLOSED:
                continue
            both = cells[cell] + cells[other]
            # 181 / 256: half of the square root of 2.
            forward = reached + (both * 181 >> 8 if j % 2 else both >> 1)
            if forward < cost[other]:
                cost[other] = forward
                if unused >= 0:
                    entry, unused = unused, entries[unused, 1]
                else:
                    entry, used = used, used + 1
                bucket = forward & (buckets - 1)
                entries[entry, 0], entries[entry, 1], first[bucket] = other, first[bucket], entry
                waiting += 1
    found = np.empty((rows - 2, width - 2), np.float32)
    for row in range(rows - 2):
        for column in range(width - 2):
            value = cost[(row + 1) * width + column + 1]
            found[row, column] = inf if value == FAR else value * size / UNIT
    return found


# --- What guides a lattice search: costs to go on a grid, or the straight distance, weighted.


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


@callee
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


@callee
def cost_of_move(nodes: Nodes, node: int, other: int, move: int, guide: Guide) -> float:
    """Return what a move from a node to another costs: a metre what it costs on the mean at its ends."""
    if move >= TURNS:
        return guide.rotation * 2.0 * pi / nodes.headings
    if len(guide.density) == 0:
        return move_cost(nodes, move)
    return 0.5 * (_density(nodes, node, guide) + _density(nodes, other, guide)) * move_cost(nodes, move)


@callee
def _density(nodes: Nodes, node: int, guide: Guide) -> float:
    _, row, column = place(node)
    return _cell(guide.density, guide, row, column, guide.least)


@callee
def _guided(guide: Guide, row: int, column: int) -> float:
    """Return the cost to go from the cell of a position of the lattice."""
    return _cell(guide.cost, guide, row, column, np.inf)


@callee
def _cell(cells: NDArray[np.float32], guide: Guide, row: int, column: int, beyond: float) -> float:
    """Return what the cell under a position of the lattice holds, ``beyond`` out of all cells: they may be fewer."""
    i, j = floor(guide.row + row * guide.step), floor(guide.column + column * guide.step)
    if 0 <= i < cells.shape[0] and 0 <= j < cells.shape[1]:
        return float(cells[i, j])
    return beyond


@callee
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


@callee
def near_goal(nodes: Nodes, node: int, guide: Guide, q: FloatArray, goal: FloatArray) -> bool:
    """Return whether a node lies so near to the goal that a motion there may be expected."""
    x, y = position(nodes, node)
    if hypot(x - guide.x, y - guide.y) >= 1.5 * nodes.size:
        return False
    return nodes.headings == 1 or abs(turn(q[2], goal[2])) < 3.0 * pi / nodes.headings


# --- Corridor: costs to go of the cells on nearly the cheapest way alone, where places differ in cost.


def corridor(checker: StateChecker, density: Density, ends: FloatArray, cells: int, widening: float) -> CostToGo:
    """Return the costs to the goal, infinite outside of the corridor.

    Args:
        checker: gives field and robot.
        density: what a metre costs.
        ends: start and goal, shape (2, 3).
        cells: of the grid, about.
        widening: how much dearer than the cheapest a way through a cell may be, as a share.
    """
    plain = CostToGo.of(checker, ends[1], cells, 0.0, density=density)
    # Where the disc fits somewhere in the cell, by costs that are not shy of tight places.
    open_ = np.isfinite(plain.cost)
    metre = np.where(open_, plain.density, np.inf).astype(np.float64)
    rows, columns = metre.shape
    sums = np.zeros((rows, columns))
    to_goal = sums
    for q in ends:
        x, y = checker.disc_center(q)
        column = min(columns - 1, max(0, int((x - plain.x0) / plain.size)))
        row = min(rows - 1, max(0, int((y - plain.y0) / plain.size)))
        metre[row, column] = min(metre[row, column], plain.density[row, column])
        vertices = march(metre, plain.size, row, column)
        to_goal = 0.25 * (vertices[1:, 1:] + vertices[1:, :-1] + vertices[:-1, 1:] + vertices[:-1, :-1])
        sums = sums + to_goal
    cheapest = float(np.min(sums, initial=np.inf, where=np.isfinite(metre)))
    near = np.isfinite(metre) & (sums <= (1.0 + widening) * cheapest)
    cost = np.where(near, to_goal, np.inf).astype(np.float32)
    return CostToGo(cost, plain.x0, plain.y0, plain.size, plain.density, plain.least)
