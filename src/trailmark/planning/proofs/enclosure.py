"""Enclosure: a proof that no path exists, with the robot's shape and headings.

Cells of SE(2) in which every configuration collides are blocked. If a flood over the other cells that begins at one
end of a query never comes to the other, no path joins them. It is tried with ever smaller cells, from both ends by
turns: the narrower part of space is soonest filled.

Sources: cells of C-space for proofs: Lozano-Pérez, "Spatial planning: a configuration space approach", IEEE Trans.
Computers 1983; boxes that are free, blocked or mixed: Zhu & Latombe, "New heuristic algorithms for efficient
hierarchical path planning", IEEE Trans. Robotics and Automation 1991.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import ceil, log2, pi, sqrt
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.errors import ConfigurationError
from trailmark.planning.proofs.cell_core import core, discs, pivot
from trailmark.planning.proofs.cell_search import meets
from trailmark.planning.proofs.cells import LEVEL, LEVELS, Division, I, J, K
from trailmark.planning.proofs.flood import (
    ENCLOSED,
    UNDER_WAY,
    Flood,
    begin,
    go_on,
    new_flood,
)

__all__ = ["Enclosure", "Space", "enclosed", "enclosure"]

SLICE = 1_000
"""Cells taken from the queue between two looks at the clock: a few milliseconds."""

BALANCE = 2.0
"""Turning within a cell moves the robot by no more than this times half a cell's edge, from some level on."""

SHARES = (0.1, 0.3)
"""Shares of what a configuration may move within a larger cell that its centre must be clear by to count as free.

The smaller, the fewer cells, and the likelier a flood comes through where there is no way; what is proven is so anyway.
"""

DEPTH = 5
"""Levels that are tried as the finest, one after the other, for each share."""

BASE_CELLS = 1 << 14
"""Cells of level 0 at most."""


class Enclosure(NamedTuple):
    """A proof: cells of SE(2) that hold all that the robot can reach from one end of a query, and not the other end.

    Attributes:
        end: 0 if that is the start, 1 if it is the goal.
        centers: of the cells, (x, y) of the pivot and heading, shape (n, 3).
        extents: half of what the cells extend over, shape (n, 3).
        pivot: the point of the robot, in its own frame, whose place is told, shape (2,).
        rim_centers: of the blocked cells around them, in none of which the robot is free anywhere, shape (m, 3).
        rim_extents: half of what those extend over, shape (m, 3).
    """

    end: int
    centers: se2.FloatArray
    extents: se2.FloatArray
    pivot: se2.FloatArray
    rim_centers: se2.FloatArray
    rim_extents: se2.FloatArray


def enclosed(
    checker: StateChecker,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    seconds: float = np.inf,
    stop: Callable[[], bool] | None = None,
    budget: int = 2_000_000,
) -> bool:
    """Return whether it is proven that no path joins two valid configurations: arguments as :func:`enclosure`."""
    return enclosure(checker, start, goal, seconds=seconds, stop=stop, budget=budget) is not None


def enclosure(
    checker: StateChecker,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    seconds: float = np.inf,
    stop: Callable[[], bool] | None = None,
    budget: int = 2_000_000,
    space: Space | None = None,
) -> Enclosure | None:
    """Return a proof that no path, of whatever continuous motions, joins two valid configurations.

    Args:
        checker: the world and the robot; for round ones, whose triangles tell all, nothing is proven here.
        start: valid, shape (3,).
        goal: valid, shape (3,).
        seconds: time at most, kept to about 10 ms.
        stop: asked every few milliseconds whether to end early.
        budget: cells taken at most.
        space: how it is divided; by default in the way that tells most.

    Returns:
        None if there is a path, or nobody knows.

    Raises:
        ConfigurationError: other shapes, or values that are not finite.
    """
    deadline = perf_counter() + seconds
    states = [se2.configurations(q, name=name) for q, name in ((start, "start"), (goal, "goal"))]
    for state, name in zip(states, ("start", "goal"), strict=True):
        if state.ndim != 1:
            raise ConfigurationError(f"{name}: expected shape (3,), got {state.shape}")
    ends = np.array(states)
    if checker.robot.sweep_radius == 0.0:
        return None
    space = space or Space(checker)
    poses = space.poses(ends)
    orders = (poses, poses[::-1].copy())
    floods = [space.flood(), space.flood()]
    for share, finest in product(SHARES, range(space.first, min(space.first + DEPTH, LEVELS))):
        division = space.division(finest, share)
        floods = [Flood(*begin(*space.parts, division, *pair, finest)) for pair in zip(floods, orders, strict=True)]
        answer, n = UNDER_WAY, 0
        while answer == UNDER_WAY:
            if perf_counter() >= deadline or budget <= 0 or (stop is not None and stop()):
                return None
            answer, taken, flood = go_on(*space.parts, division, floods[n], orders[n][1], finest, SLICE)
            floods[n] = Flood(*flood)
            budget -= taken
            if answer == ENCLOSED:
                leads, rim, reached = meets(*space.parts, division, floods[n], finest)
                if leads:
                    return None
                centers, extents, pivot = space.boxes(floods[n], reached)
                return Enclosure(n, centers, extents, pivot, *space.boxes(floods[n], rim)[:2])
            # Where one comes to the other end, the other comes too: on to smaller cells.
            n = 1 - n
    return None


class Space:
    """How a world's SE(2) is divided for a robot.

    Attributes:
        parts: grid, field and footprint about the pivot, as the kernels take them.
        pivot: the point of the robot (its frame, shape (2,)) whose place stands for it.
        first: the first level worth trying as the finest; none is if it is LEVELS.

    Args:
        checker: the world and the robot.
        point: another pivot, shape (2,); by default the one about which cells tell most.
    """

    def __init__(self, checker: StateChecker, point: se2.FloatArray | None = None) -> None:
        footprint, robot = checker.footprint, checker.robot
        self.pivot = pivot(robot) if point is None else point
        outline = footprint.outline - self.pivot
        sweep = float(np.hypot(*outline.T).max()) * (1.0 + 1e-12)
        radius = sweep + footprint.dilation
        shift = np.array([*self.pivot, 0.0])
        about = footprint._replace(
            outline=outline,
            core=footprint.core - self.pivot,
            cover=footprint.cover - shift,
            inner=discs(outline) + np.array([0.0, 0.0, footprint.dilation]),
            circumradius=radius,
            sweep_radius=sweep,
        )
        self.parts: tuple[ObstacleGrid, ClearanceField, Footprint] = (checker.grid, checker.field, about)
        # Wider than where the pivot of a valid configuration can be: it lies in the footprint's smallest circle.
        xmin, ymin, xmax, ymax = checker.world.bounds
        width, height = xmax - xmin + 4.0 * radius, ymax - ymin + 4.0 * radius
        edge = max(4.0 * radius, sqrt(width * height / BASE_CELLS))
        self._origin = xmin - 2.0 * radius, ymin - 2.0 * radius
        self._columns, self._rows = ceil(width / edge), ceil(height / edge)
        self._half: se2.FloatArray = 0.5 * edge * 0.5 ** np.arange(LEVELS, dtype=np.float64)
        wanted = [ceil(log2(sweep * pi / (BALANCE * half))) for half in self._half]
        self._turns = np.array([min(level, max(0, turns)) for level, turns in enumerate(wanted)], np.int64)
        self._shift, self._turn = sqrt(2.0) * self._half, pi / np.exp2(self._turns)
        self._spread = self._shift + 2.0 * sweep * np.sin(0.5 * self._turn)
        self._cores: list[list[se2.FloatArray]] = []
        self.first = int(np.count_nonzero(self._half > 0.5 * robot.inscribed_disc.radius))

    def division(self, finest: int, share: float) -> Division:
        """Return the division, with the cores of all levels up to ``finest``."""
        for level in range(len(self._cores), finest + 1):
            self._cores.append(core(self.parts[2].outline, float(self._shift[level]), float(self._turn[level])))
        rings = [ring for level in self._cores for ring in level]
        cores = np.zeros(LEVELS + 1, np.int64)
        known = len(self._cores) + 1
        cores[1:known] = np.cumsum([len(level) for level in self._cores])
        cores[known:] = cores[known - 1]
        return Division(
            *self._origin,
            self._columns,
            self._rows,
            self._half,
            self._turns,
            share * np.maximum(0.0, self._spread - self._spread[finest]),
            np.concatenate([np.empty((0, 2)), *rings]),
            np.concatenate([[0], np.cumsum([len(ring) for ring in rings])]).astype(np.int64),
            cores,
        )

    def boxes(self, flood: Flood, cells: NDArray[np.int64]) -> tuple[se2.FloatArray, se2.FloatArray, se2.FloatArray]:
        """Return the middle (n, 3) and half the extent (n, 3) of cells, of the pivot's place, and the pivot, (2,)."""
        rows = flood.cells[cells]
        half, turn = self._half[rows[:, LEVEL]], self._turn[rows[:, LEVEL]]
        x, y = (o + (2 * rows[:, c] + 1) * half for o, c in zip(self._origin, (I, J), strict=True))
        return (
            np.column_stack([x, y, (2 * rows[:, K] + 1) * turn - pi]),
            np.column_stack([half, half, turn]),
            self.pivot,
        )

    def poses(self, ends: se2.FloatArray) -> se2.FloatArray:
        """Return the ends with the pivot's position in place of the reference point's, shape (2, 3)."""
        return np.column_stack([se2.transform(ends, self.pivot[None])[:, 0], ends[:, 2]])

    def headings(self, level: int) -> int:
        """Return into how many parts cells of a level divide a turn."""
        return 1 << int(self._turns[level])

    def flood(self) -> Flood:
        """Return a flood that has not begun."""
        return new_flood(self._columns, self._rows)
