"""A* over the tangents of corners: a disc's shortest path in a grid map, and lower bounds before it is found.

Each step is an arc and a tangent. A way that reaches a node is left out only where another has reached it earlier on
its circle at no higher cost. With the straight distance for guide, no path is shorter than the least key that is
waiting, at any time: the search may end whenever there is no more time, and has proven something.
"""

from __future__ import annotations

from math import atan2, hypot, inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.heap import heap_pop, heap_push
from trailmark.jit import callee, njit
from trailmark.planning.grids.sight import Corners, IntArray, fits
from trailmark.planning.grids.tangents import from_point, successors, touching, turns_at
from trailmark.se2 import FloatArray

__all__ = ["TangentSearch", "lengths_to"]

Int32Array = NDArray[np.int32]

FOUND, PAUSED, EXHAUSTED, NO_MEMORY = range(4)
"""How a part of the search ends."""

LABELS, WAITING, WAYS, EXPANDED = range(4)
"""Columns of what is counted."""

NODE, PARENT, OTHER, DEAD = range(4)
"""Columns of a label: node (-1: the goal), label before (-1: the start), next label of the same node, whether a better
one took its place."""

COST, DX, DY, LEFT, TURNED = range(5)
"""Columns of a label: length up to where the circle is reached, cells; the direction there; what is left of the turn,
radians; and the length that the way would have at the turn's end."""

AHEAD = 1e-9
"""By how much (sine of an angle) a path may seem to turn back, for rounding."""


class Task(NamedTuple):
    """What is looked for, all in cells; as :class:`TangentSearch` is given it."""

    grid: Corners
    start: FloatArray
    goal: FloatArray
    radius: float
    needed: float
    guide: NDArray[np.float32]


class Memory(NamedTuple):
    """What a search knows.

    Attributes:
        first: last label of each node, -1 before there is one.
        begin: where the ways that lead on from each node begin, -1 before they are looked for,
        end: and where they end.
        to_goal: row of ``goal_ways`` for each node from which the goal is reached at once, -1 for others.
        goal_ways: (g, 3) direction and length.
        counts: see LABELS and so on.
        ints: labels' columns NODE and so on.
        floats: labels' columns COST and so on.
        keys: heap of what waits.
        values: its labels.
        nodes: where the ways lead to.
        ways: their directions and lengths.
        found: memory for corners that are seen.
        stack: memory for looking around.
    """

    first: Int32Array
    begin: Int32Array
    end: Int32Array
    to_goal: Int32Array
    goal_ways: FloatArray
    counts: IntArray
    ints: IntArray
    floats: FloatArray
    keys: FloatArray
    values: IntArray
    nodes: IntArray
    ways: FloatArray
    found: Int32Array
    stack: FloatArray


class TangentSearch:
    """A search for a disc's shortest path from one point to another.

    Args:
        grid: cells and corners.
        start: column and row coordinates, cells, shape (2,).
        goal: likewise.
        radius: of the circles, cells.
        needed: distance to cells that is kept for certain, cells; less than the radius by rounding.
        guide: (rows, columns) of estimated lengths to the goal, cells, instead of the straight distance, which
            alone proves anything; (0, 0) for none.

    Attributes:
        limit: cells: ways that are no shorter are left out from now on.
        length: of the path that was found, cells; infinite before.
        bound: no path is shorter, cells, without a guide; no less than the limit once all is exhausted.
    """

    def __init__(
        self,
        grid: Corners,
        start: FloatArray,
        goal: FloatArray,
        radius: float,
        needed: float,
        guide: NDArray[np.float32],
    ) -> None:
        self.task, self.limit = Task(grid, start, goal, radius, needed, guide), inf
        self.length, self.bound = inf, float(np.hypot(*(goal - start)))
        self._end, self._begun = -1, False
        nodes = 2 * (int(grid.number.max(initial=-1)) + 1)
        first, begin, end, to_goal = (np.full(nodes, -1, np.int32) for _ in range(4))
        self._memory = Memory(
            first,
            begin,
            end,
            to_goal,
            np.empty((0, 3)),
            np.zeros(4, np.int64),
            np.empty((1 << 12, 4), np.int64),
            np.empty((1 << 12, 5)),
            np.empty(1 << 12),
            np.empty(1 << 12, np.int64),
            np.empty(1 << 13, np.int64),
            np.empty((1 << 13, 3)),
            np.empty((1 << 12, 2), np.int32),
            np.empty((1 << 10, 3)),
        )

    @property
    def expanded(self) -> int:
        """How many labels have been expanded."""
        return int(self._memory.counts[EXPANDED])

    def run(self, labels: int) -> bool:
        """Go on until that many more labels have been expanded; return whether the search has ended."""
        if not self._begun:
            self._begin()
        upto = self.expanded + labels
        while True:
            state, end, key = _search(self.task, self._memory, self.limit, upto)
            if state != NO_MEMORY:
                break
            self._grow()
        if state == FOUND:
            self.length, self._end = float(key), int(end)
        if not self.task.guide.size:
            self.bound = max(self.bound, min(float(key), self.limit))
        return bool(state != PAUSED)

    def corners(self) -> IntArray:
        """Return the corners of the path that was found: columns column, row, whether on its right; shape (n, 3)."""
        return np.asarray(_corners(self._memory.ints, self._end, self.task.grid.side.shape[1]))

    def _begin(self) -> None:
        """Find the ways from the start and those to the goal."""
        self._begun = True
        start, goal = self.task.start, self.task.goal
        if fits(self.task.grid, start[0], start[1], goal[0], goal[1], self.task.needed):
            self.limit = self.length = self.bound
        for forward in (False, True):
            while (count := _from_end(self.task, self._memory, forward, self.limit)) < 0:
                self._grow()
            if not forward:
                nodes, ways = self._memory.nodes[:count], self._memory.ways[:count].copy()
                self._memory = self._memory._replace(goal_ways=ways)
                number = self.task.grid.number.ravel()[nodes >> 1]
                self._memory.to_goal[2 * number + (nodes & 1)] = np.arange(count)

    def _grow(self) -> None:
        """Double all memory but that of nodes."""
        fields = ("ints", "floats", "keys", "values", "nodes", "ways", "found", "stack")
        known = {name: getattr(self._memory, name) for name in fields}
        self._memory = self._memory._replace(
            **{name: np.concatenate([array, np.empty_like(array)]) for name, array in known.items()}
        )


@njit
def _corners(ints: IntArray, end: int, width: int) -> IntArray:
    """Return what :meth:`TangentSearch.corners` does, by the goal's label, or -1."""
    count, label = -1, end
    while label >= 0:
        count, label = count + 1, ints[label, PARENT]
    rows = np.empty((max(0, count), 3), np.int64)
    label = ints[end, PARENT] if end >= 0 else -1
    for k in range(count - 1, -1, -1):
        node = ints[label, NODE]
        rows[k, 0], rows[k, 1], rows[k, 2] = (node >> 1) % width, (node >> 1) // width, node & 1
        label = ints[label, PARENT]
    return rows


@callee
def _place(grid: Corners, node: int) -> int:
    """Return where the arrays that have an element for each node keep that of a node."""
    width = grid.side.shape[1]
    return int(2 * grid.number[(node >> 1) // width, (node >> 1) % width] + (node & 1))


@callee
def _left(task: Task, px: float, py: float) -> float:
    """Return what is left from a point: at least, or as the guide has it."""
    straight = hypot(task.goal[0] - px, task.goal[1] - py)
    if task.guide.size == 0:
        return straight
    value = float(task.guide[int(py), int(px)])
    return max(straight, value) if value < inf else 2.0 * straight


@callee
def _reach(task: Task, memory: Memory, node: int, parent: int, cost: float, dx: float, dy: float, limit: float) -> None:
    """Take a way to a node down, unless one that is known is no worse; there must be memory for one more label."""
    counts, ints, floats = memory.counts, memory.ints, memory.floats
    width = task.grid.side.shape[1]
    right, row, column = node & 1, (node >> 1) // width, (node >> 1) % width
    px, py = touching(float(column), float(row), right, dx, dy, task.radius)
    if cost + hypot(task.goal[0] - px, task.goal[1] - py) >= limit:
        return
    ex, ey = turns_at(task.grid, column, row, right)
    left = atan2(abs(dx * ey - dy * ex), dx * ex + dy * ey)
    turned = cost + task.radius * left
    place = _place(task.grid, node)
    other = memory.first[place]
    while other >= 0:
        if floats[other, TURNED] <= turned and floats[other, LEFT] >= left:
            return
        if floats[other, TURNED] >= turned and floats[other, LEFT] <= left:
            ints[other, DEAD] = 1
        other = ints[other, OTHER]
    label = counts[LABELS]
    ints[label, NODE], ints[label, PARENT], ints[label, OTHER], ints[label, DEAD] = node, parent, memory.first[place], 0
    floats[label, COST], floats[label, DX], floats[label, DY] = cost, dx, dy
    floats[label, LEFT], floats[label, TURNED] = left, turned
    memory.first[place] = label
    counts[LABELS] += 1
    key = cost + _left(task, px, py)
    counts[WAITING] = heap_push(memory.keys, memory.values, counts[WAITING], key, label)


@njit
def _from_end(task: Task, memory: Memory, forward: bool, limit: float) -> int:
    """Write the ways to the goal to memory, or take those from the start down; return their number, -1 if too many."""
    point, nodes, ways = task.start if forward else task.goal, memory.nodes, memory.ways
    count = from_point(
        task.grid, point[0], point[1], forward, task.radius, task.needed, memory.found, memory.stack, nodes, ways
    )
    if count > len(memory.ints):
        return -1
    for k in range(count if forward else 0):
        _reach(task, memory, nodes[k], -1, ways[k, 2], ways[k, 0], ways[k, 1], limit)
    return count


@njit(nogil=True)
def _search(task: Task, memory: Memory, limit: float, upto: int) -> tuple[int, int, float]:
    """Return how the search ends, the goal's label if it is found, and the least key that is waiting, or was last."""
    counts, ints, floats, ways = memory.counts, memory.ints, memory.floats, memory.ways
    while counts[EXPANDED] < upto:
        if counts[WAITING] == 0:
            return EXHAUSTED, -1, inf
        key, label = memory.keys[0], memory.values[0]
        node = ints[label, NODE]
        if node < 0:
            return FOUND, label, key
        if ints[label, DEAD]:
            counts[WAITING] = heap_pop(memory.keys, memory.values, counts[WAITING])
            continue
        place = _place(task.grid, node)
        if memory.begin[place] < 0:
            # Where this node leads to is looked for once.
            count = successors(
                task.grid, node, task.radius, task.needed, memory.found, memory.stack, memory.nodes, ways, counts[WAYS]
            )
            if count < 0:
                return NO_MEMORY, -1, key
            memory.begin[place], memory.end[place], counts[WAYS] = counts[WAYS], count, count
        if counts[LABELS] + memory.end[place] - memory.begin[place] + 1 > len(ints):
            return NO_MEMORY, -1, key
        counts[WAITING] = heap_pop(memory.keys, memory.values, counts[WAITING])
        counts[EXPANDED] += 1
        turn = -1.0 if node & 1 else 1.0
        cost, dx, dy = floats[label, COST], floats[label, DX], floats[label, DY]
        for k in range(memory.begin[place], memory.end[place]):
            across, along = turn * (dx * ways[k, 1] - dy * ways[k, 0]), dx * ways[k, 0] + dy * ways[k, 1]
            if across >= -AHEAD:
                further = cost + task.radius * max(0.0, atan2(across, along)) + ways[k, 2]
                _reach(task, memory, memory.nodes[k], label, further, ways[k, 0], ways[k, 1], limit)
        if memory.to_goal[place] >= 0:
            way = memory.goal_ways[memory.to_goal[place]]
            across, along = turn * (dx * way[1] - dy * way[0]), dx * way[0] + dy * way[1]
            further = cost + task.radius * max(0.0, atan2(across, along)) + way[2]
            if across >= -AHEAD and further < limit:
                new = counts[LABELS]
                ints[new, NODE], ints[new, PARENT], ints[new, DEAD], ints[new, OTHER] = -1, label, 0, -1
                counts[LABELS] += 1
                counts[WAITING] = heap_push(memory.keys, memory.values, counts[WAITING], further, new)
    return PAUSED, -1, memory.keys[0] if counts[WAITING] else inf


# --- Estimated lengths to the goal over the free cells of a grid map, which guide a search and prove nothing;
# compiled.

STRAIGHT, DIAGONAL, BUCKETS = 70, 99, 128
"""Costs of steps, whole numbers: their ratio is the square root of 2 within 5e-5; a power of two above all of them."""

FURTHER = 32
"""Cells farther than the start's that are still gone through: a way may lead off before it comes nearer."""

_STEP_X = np.array([1, 0, -1, 0, 1, -1, -1, 1])
_STEP_Y = np.array([0, 1, 0, -1, 1, 1, -1, -1])


@njit(nogil=True)
def lengths_to(open_: NDArray[np.bool_], goal: int, start: int) -> NDArray[np.float32]:
    """Return the lengths (cells) from cells to the goal's by steps to eight neighbours, none past a closed cell.

    Source: Dial, "Algorithm 360: shortest-path forest with topological ordering", CACM 12(11), 1969.

    Args:
        open_: shape (rows, columns), the outermost cells closed.
        goal: row * columns + column.
        start: likewise; cells much farther than it is are left out.

    Returns:
        Shape (rows, columns); infinite where nothing leads there.
    """
    rows, columns = open_.shape
    cells = open_.reshape(-1)
    cost = np.full(len(cells), np.int32(2**31 - 1))
    first = np.full(BUCKETS, -1, np.int32)
    # A cell may wait in several buckets; what is not used takes no memory, but addresses.
    entries = np.empty((8 * len(cells) + 1, 2), np.int32)
    unused, used, waiting, reached, last = -1, 1, 1, 0, 2**30
    cost[goal], first[0], entries[0, 0], entries[0, 1] = 0, 0, goal, -1
    steps = _STEP_Y * columns + _STEP_X
    while waiting > 0 and reached <= last:
        entry = first[reached & (BUCKETS - 1)]
        if entry < 0:
            reached += 1
            continue
        cell, first[reached & (BUCKETS - 1)] = entries[entry, 0], entries[entry, 1]
        entries[entry, 1], unused = unused, entry
        waiting -= 1
        if cost[cell] != reached:
            continue
        if cell == start:
            last = reached + FURTHER * STRAIGHT
        for k in range(8):
            other = cell + steps[k]
            if not cells[other] or (k > 3 and not (cells[cell + _STEP_X[k]] and cells[other - _STEP_X[k]])):
                continue
            length = reached + (STRAIGHT if k < 4 else DIAGONAL)
            if length >= cost[other]:
                continue
            cost[other] = length
            if unused >= 0:
                entry, unused = unused, entries[unused, 1]
            else:
                entry, used = used, used + 1
            bucket = length & (BUCKETS - 1)
            entries[entry, 0], entries[entry, 1], first[bucket] = other, first[bucket], entry
            waiting += 1
    found = np.empty((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            value = cost[row * columns + column]
            found[row, column] = inf if value == 2**31 - 1 else value / STRAIGHT
    return found
