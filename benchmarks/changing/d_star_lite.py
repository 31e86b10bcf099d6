"""D* Lite on a grid of cells, the usual baseline for replanning: for a disc, the one inscribed in the robot.

Source: Koenig & Likhachev, "D* Lite", AAAI 2002, figure 4 (the optimized version), for a robot that moves.
"""

from __future__ import annotations

from heapq import heappop, heappush
from math import hypot, inf, sqrt
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = ["DStarLite"]

Cell: TypeAlias = tuple[int, int]
Key: TypeAlias = tuple[float, float]

ROUNDING = 1e-9
"""Cells."""

STEPS = [(1, 0, 1.0), (-1, 0, 1.0), (0, 1, 1.0), (0, -1, 1.0)]
STEPS += [(1, 1, sqrt(2.0)), (1, -1, sqrt(2.0)), (-1, 1, sqrt(2.0)), (-1, -1, sqrt(2.0))]


class DStarLite:
    """Shortest paths to a goal over the open cells of a grid, mended when cells open or close.

    Args:
        open_: which cells are open, shape (rows, columns); kept, and changed by :meth:`change`.
        start: row, column.
        goal: row, column.
    """

    def __init__(self, open_: NDArray[np.bool_], start: Cell, goal: Cell) -> None:
        self.open, self.start, self.goal = open_.copy(), start, goal
        self._last, self._km = start, 0.0
        self._g: dict[Cell, float] = {}
        self._rhs: dict[Cell, float] = {goal: 0.0}
        self._queue: list[tuple[Key, Cell]] = []
        self._queued: dict[Cell, Key] = {}
        self._insert(goal)

    def change(self, open_: NDArray[np.bool_], start: Cell) -> None:
        """Take over which cells are open now, and where the robot is."""
        self.start = start
        self._km += hypot(self._last[0] - start[0], self._last[1] - start[1])
        self._last = start
        changed = np.argwhere(open_ != self.open)
        self.open = open_.copy()
        for row, column in changed.tolist():
            self._update((row, column))
            for other, _ in self._neighbours((row, column)):
                self._update(other)

    def path(self) -> list[Cell]:
        """Return the cells from the robot to the goal; none if there is no way."""
        self._compute()
        if self._g.get(self.start, inf) == inf:
            return []
        cells = [self.start]
        while cells[-1] != self.goal:
            here = cells[-1]
            to_go = [(self._cost(here, s, d) + self._g.get(s, inf), s) for s, d in self._neighbours(here)]
            cells.append(min(to_go)[1])
            if len(cells) > self.open.size:
                return []
        return cells

    def _neighbours(self, cell: Cell) -> list[tuple[Cell, float]]:
        rows, columns = self.open.shape
        found = []
        for dy, dx, length in STEPS:
            row, column = cell[0] + dy, cell[1] + dx
            if 0 <= row < rows and 0 <= column < columns:
                found.append(((row, column), length))
        return found

    def _cost(self, a: Cell, b: Cell, length: float) -> float:
        return length if self.open[a] and self.open[b] else inf

    def _key(self, cell: Cell) -> Key:
        least = min(self._g.get(cell, inf), self._rhs.get(cell, inf))
        return least + hypot(cell[0] - self.start[0], cell[1] - self.start[1]) + self._km, least

    def _insert(self, cell: Cell) -> None:
        self._queued[cell] = self._key(cell)
        heappush(self._queue, (self._queued[cell], cell))

    def _update(self, cell: Cell) -> None:
        if cell != self.goal:
            self._rhs[cell] = min(
                (self._cost(cell, other, length) + self._g.get(other, inf) for other, length in self._neighbours(cell)),
                default=inf,
            )
        self._queued.pop(cell, None)
        if self._g.get(cell, inf) != self._rhs.get(cell, inf):
            self._insert(cell)

    def _compute(self) -> None:
        while self._queue:
            key, cell = self._queue[0]
            if self._queued.get(cell) != key:
                heappop(self._queue)
                continue
            done = self._rhs.get(self.start, inf) == self._g.get(self.start, inf)
            # Cells of the shortest path have the start's key, but for rounding.
            if done and key[0] > self._key(self.start)[0] + ROUNDING:
                return
            heappop(self._queue)
            del self._queued[cell]
            if key < self._key(cell):
                self._insert(cell)
                continue
            if self._g.get(cell, inf) > self._rhs.get(cell, inf):
                self._g[cell] = self._rhs[cell]
            else:
                self._g[cell] = inf
                self._update(cell)
            for other, _ in self._neighbours(cell):
                self._update(other)
