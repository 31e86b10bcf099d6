"""Hybrid A*: where a car gets to from given configurations by short drives to the left, straight on and to the right.

In a tight place a car gets on by many short drives to and fro, each of which depends on the one before: independent
samples hardly ever join there. So a tree of drives grows, every one of them certified, those first that promise to be
on the shortest path; a cell of configurations is entered once. After hybrid A* (Dolgov, Thrun, Montemerlo & Diebel,
"Practical search techniques in path planning for autonomous driving", 2008), with several sources, and with the relaxed
problem's costs as its guide.
"""

from __future__ import annotations

from math import ceil, cos, floor, pi, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.clock import CLOCK_EVERY, Deadline, now
from trailmark.collision.certify import curve_motion
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, state, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.curves.words import PIECES, walk
from trailmark.heap import heap_grow, heap_pop, heap_push
from trailmark.landmarks.kmeans import lloyd
from trailmark.landmarks.relaxation import CostMap, Relaxation
from trailmark.motion import Motion

__all__ = ["Reached", "hybrid_astar"]

GREED = 1.5
"""How much a metre still to go counts against one driven already."""

FINEST = 0.005
"""Turning radii: drives that no shorter ones follow."""

LONGEST_ARC = 0.5 * pi
"""Radians: drives on one side are put together up to this arc, which is the shortest curve between its ends."""


class Reached(NamedTuple):
    """Configurations that hang on sources, or on one another, by drives.

    Attributes:
        configurations: (n, 3), valid.
        parents: (n,): index of a source, or, from the number of sources on, of one of ``configurations``.
    """

    configurations: se2.FloatArray
    parents: NDArray[np.int64]


def hybrid_astar(
    motions: Motion,
    relaxation: Relaxation,
    costs: CostMap,
    sources: se2.FloatArray,
    *,
    reverse: bool,
    step: float,
    most: int,
    landmarks: int,
    rng: np.random.Generator,
    seconds: float = np.inf,
) -> Reached:
    """Return landmarks among what drives from the sources reach, and what leads there.

    The landmarks are the configurations nearest to K-means centres of all that was reached, and the one with the
    least cost to go.

    Args:
        motions: certifies the drives.
        relaxation: the relaxed problem's grid.
        costs: its costs to where the drives should lead.
        sources: valid configurations, shape (m, 3).
        reverse: whether the drives are to lead to the sources, not away from them.
        step: longest drive, metres; cells are half as large. Both are halved until so many configurations are reached.
        most: configurations reached at most.
        landmarks: about so many of them are kept.
        rng: source of randomness.
        seconds: that the drives may take.
    """
    deadline = Deadline.after(seconds)
    checker, radius = motions.checker, motions.radius
    directions = np.array([-1.0 if reverse else 1.0] if not motions.checker.robot.reverse else [1.0, -1.0])
    m = len(sources)
    while True:
        q, parents, controls, to_go = _grow(
            checker.grid,
            checker.field,
            checker.footprint,
            radius,
            directions,
            np.array(sources, order="C"),
            step,
            costs.cost,
            relaxation.x0,
            relaxation.y0,
            relaxation.size,
            relaxation.center,
            most,
            deadline,
        )
        if len(q) >= m + most or step <= FINEST * radius or now(deadline.kind) >= deadline.seconds:
            break
        # All cells that these drives lead to are entered: smaller ones may lead farther.
        step *= 0.5
    if len(q) == m:
        return Reached(np.empty((0, 3)), np.empty(0, np.int64))
    from scipy.spatial import cKDTree

    points = se2.embed(q[m:], radius)
    first = points[rng.choice(len(points), min(landmarks, len(points)), replace=False)]
    chosen = m + np.unique(np.asarray(cKDTree(points).query(lloyd(points, first, 2))[1]))
    chosen = np.unique(np.append(chosen, m + np.argmin(to_go[m:])))
    return _joined(q, parents, controls, chosen, m, radius)


def _joined(
    q: se2.FloatArray,
    parents: NDArray[np.int64],
    controls: se2.FloatArray,
    chosen: NDArray[np.int64],
    m: int,
    radius: float,
) -> Reached:
    """Return the chosen nodes and those that lead to them, with drives under one control put together."""
    above: dict[int, int] = {}
    for node in chosen.tolist():
        at = node
        while at >= m and at not in above:
            side, way = controls[at]
            up, arc = int(parents[at]), abs(way)
            while up >= m and up not in above and controls[up, 0] == side and controls[up, 1] * way > 0.0:
                arc += abs(controls[up, 1])
                if side != 0.0 and arc > LONGEST_ARC * radius:
                    break
                up = int(parents[up])
            above[at] = up
            at = up
    kept = sorted(above)
    number = {node: m + i for i, node in enumerate(kept)}
    return Reached(q[kept], np.array([number.get(above[node], above[node]) for node in kept], dtype=np.int64))


@njit(cache=True)
def _entered(table: NDArray[np.int64], key: int) -> bool:
    """Return whether a key is in a hash table already; put it there."""
    mask = len(table) - 1
    at = ((key * 0x9E3779B1) >> 7) & mask
    while table[at] != -1:
        if table[at] == key:
            return True
        at = (at + 1) & mask
    table[at] = key
    return False


@njit(cache=True)
def _cost_at(
    cost: se2.FloatArray, x0: float, y0: float, size: float, center: se2.FloatArray, q: se2.FloatArray
) -> float:
    """Return the relaxed cost at the inscribed disc's centre; infinite outside of the grid."""
    c, s = cos(q[2]), sin(q[2])
    column = floor((q[0] + c * center[0] - s * center[1] - x0) / size)
    row = floor((q[1] + s * center[0] + c * center[1] - y0) / size)
    if 0 <= row < cost.shape[0] and 0 <= column < cost.shape[1]:
        return float(cost[row, column])
    return np.inf


@njit(cache=True, nogil=True)
def _grow(
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    radius: float,
    directions: se2.FloatArray,
    sources: se2.FloatArray,
    step: float,
    cost: se2.FloatArray,
    x0: float,
    y0: float,
    size: float,
    center: se2.FloatArray,
    most: int,
    deadline: Deadline,
) -> tuple[se2.FloatArray, NDArray[np.int64], se2.FloatArray, se2.FloatArray]:
    """Return the tree: nodes (sources first), parents, controls (side, way in metres), and relaxed costs to go."""
    m = len(sources)
    capacity = m + most
    q, to_go = np.empty((capacity, 3)), np.full(capacity, np.inf)
    parents, controls = np.full(capacity, -1, np.int64), np.zeros((capacity, 2))
    driven = np.zeros(capacity)
    placed, queue = workspace(robot), np.empty((128, 2))
    word, end = np.zeros((2, PIECES)), np.empty(3)
    cell = 0.5 * step
    headings = max(8, min(720, ceil(2.0 * pi * radius / cell)))
    columns = ceil(cost.shape[1] * size / cell) + 2
    slots = 64
    while slots < 4 * capacity:
        slots *= 2
    table = np.full(slots, -1, np.int64)
    keys, values = np.empty(1024), np.empty(1024, np.int64)
    waiting = 0
    for i in range(m):
        q[i] = sources[i]
        to_go[i] = _cost_at(cost, x0, y0, size, center, q[i])
        _entered(table, _cell_of(q[i], x0, y0, cell, columns, headings))
        if to_go[i] < np.inf:
            if waiting == len(keys):
                keys, values = heap_grow(keys, values)
            waiting = heap_push(keys, values, waiting, GREED * to_go[i], i)
    n = m
    expanded = 0
    while waiting > 0 and n < capacity:
        expanded += 1
        if expanded % CLOCK_EVERY == 0 and now(deadline.kind) >= deadline.seconds:
            break
        waiting = heap_pop(keys, values, waiting)
        at = values[waiting]
        for side in (0.0, 1.0, -1.0):
            for direction in directions:
                way = step
                for _ in range(4):
                    word[0, 0], word[1, 0] = direction * way / radius, side
                    walk(q[at], word, radius, way, end)
                    ahead = _cost_at(cost, x0, y0, size, center, end)
                    if (
                        ahead < np.inf
                        and state(grid, field, robot, placed, end[0], end[1], end[2]) == FREE
                        and curve_motion(grid, field, robot, placed, queue, q[at], word, radius) == FREE
                    ):
                        if n < capacity and not _entered(table, _cell_of(end, x0, y0, cell, columns, headings)):
                            q[n] = end
                            parents[n], to_go[n] = at, ahead
                            controls[n, 0], controls[n, 1] = side, direction * way
                            driven[n] = driven[at] + way
                            if waiting == len(keys):
                                keys, values = heap_grow(keys, values)
                            waiting = heap_push(keys, values, waiting, driven[n] + GREED * ahead, n)
                            n += 1
                        break
                    way *= 0.5
    return q[:n], parents[:n], controls[:n], to_go[:n]


@njit(cache=True)
def _cell_of(q: se2.FloatArray, x0: float, y0: float, cell: float, columns: int, headings: int) -> int:
    """Return the number of a configuration's cell."""
    column, row = floor((q[0] - x0) / cell), floor((q[1] - y0) / cell)
    heading = floor((q[2] + pi) * headings / (2.0 * pi))
    return int(((row * columns + column) * headings + heading) & 0x7FFFFFFFFFFF)
