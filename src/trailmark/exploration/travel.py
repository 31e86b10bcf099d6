"""What ways cost, roughly and at once, over the cells of the known map; how sure places along them would be."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.mapper import Mapper
from trailmark.exploration.reachability import CERTAIN, NOWHERE
from trailmark.jit import njit
from trailmark.se2 import FloatArray
from trailmark.world.robot import Robot

__all__ = ["Travel", "costs_between", "expected_falls", "open_loop", "places_of"]

TIGHT = 2
"""Times as much that a metre is taken to cost where it is not certain that the robot fits."""

SPARE = 0.6
"""Of the robot's inner radius: the coarser cells are no larger, so that no wall lies within one of them."""

COARSEST = 16
"""Cells, along either side of one of the coarser ones, at most."""

NEAREST = 10
"""Places up to which ways from a place are followed; to the others they lead by way of those."""


STRAIGHT: Final = 12
DIAGONAL: Final = 17
"""Steps, in twelfths of a cell's side: 17/12 is 0.2 % more than the root of two."""


MOST_POSES = 100
"""Where the robot was, from the first pose to the last, among which it is looked for an open loop."""

OPEN = 3.0
"""Cells that a pose has drifted by where a loop is open. Surfaces that lie less far apart shut no passage in which the
robot has room: to drive round for loops of one cell took explorations a quarter more of the way, and showed no more."""

NEAR = 0.5
"""Share of the sensor's range around a place that the robot came back to in which no loop is left to be closed."""

SHORT = 0.5
"""Share of the way along which two places are related, at most, that the way between them has where a loop is open."""


class Travel:
    """Estimates of what ways cost, over cells some times as large as the map's.

    Args:
        fits: from NOWHERE to CERTAIN for each cell of the map, shape (rows, columns).
        inner: radius of the robot's disc about its reference point, in cells of the map.
    """

    def __init__(self, fits: NDArray[np.uint8], inner: float) -> None:
        self.factor = max(1, min(COARSEST, int(SPARE * inner)))
        f = self.factor
        rows, columns = -(-fits.shape[0] // f), -(-fits.shape[1] // f)
        padded = np.zeros((rows * f, columns * f), np.uint8)
        padded[: fits.shape[0], : fits.shape[1]] = fits
        # One axis after the other: along both at once takes ten times as long.
        self.fits = padded.reshape(rows, f, -1).max(axis=1).reshape(rows, columns, f).max(axis=2)

    def between(self, cells: NDArray[np.intp]) -> FloatArray:
        """Return the costs of the ways between cells of the map, in cells, infinite where none leads, shape (n, n).

        Args:
            cells: rows and columns, shape (n, 2).
        """
        costs = costs_between(self.fits, np.ascontiguousarray(cells, dtype=np.int64) // self.factor, NEAREST, TIGHT)
        for k in range(len(costs)):  # Floyd 1962
            costs = np.minimum(costs, costs[:, k, None] + costs[None, k])
        return np.asarray(costs * self.factor)


@njit(nogil=True)
def costs_between(fits: NDArray[np.uint8], cells: NDArray[np.int64], nearest: int, tight: int) -> FloatArray:
    """Return the costs of the ways between some cells, in cells, shape (n, n), infinite where none was found.

    Ways lead to the eight cells around, and from each of the cells to the nearest ones. They are followed in the order
    of their costs, which are whole numbers (Dial, "Algorithm 360: shortest-path forest with topological ordering",
    Communications of the ACM 1969).

    Args:
        fits: NOWHERE, up to CERTAIN, shape (rows, columns).
        cells: rows and columns, shape (n, 2), whatever they are.
        nearest: to how many others.
        tight: times as much that a step into a cell that is not CERTAIN costs.
    """
    rows, columns = fits.shape
    n, width = len(cells), columns + 2
    between = np.full((n, n), np.inf)
    # With a cell more on each side, which no way leads to.
    dearer, here = np.zeros((rows + 2) * width, np.int32), np.zeros((rows + 2) * width, np.int32)
    for r in range(rows):
        for c in range(columns):
            if fits[r, c] != NOWHERE:
                dearer[(r + 1) * width + c + 1] = 1 if fits[r, c] == CERTAIN else tight
    at = (cells[:, 0] + 1) * width + cells[:, 1] + 1
    for k in range(n):
        here[at[k]] += 1
        dearer[at[k]] = max(dearer[at[k]], np.int32(1 if fits[cells[k, 0], cells[k, 1]] == CERTAIN else tight))
    around = np.array([-width - 1, -width, -width + 1, -1, 1, width - 1, width, width + 1])
    steps = np.array([DIAGONAL, STRAIGHT, DIAGONAL, STRAIGHT, STRAIGHT, DIAGONAL, STRAIGHT, DIAGONAL], np.int32)
    far = np.iinfo(np.int32).max
    costs = np.empty(len(here), np.int32)
    # No step costs as much as there are buckets: a bucket holds places of one cost, in a list that begins with first.
    first = np.empty(tight * DIAGONAL + 1, np.int64)
    place, after = np.empty(1024, np.int64), np.empty(1024, np.int64)
    for k in range(n):
        costs[:], first[:] = far, -1
        costs[at[k]], place[0], after[0], first[0] = 0, at[k], -1, 0
        used, waiting, cost, found = 1, 1, 0, 0
        # The first is the first of the list, which needs the ways to all others.
        wanted = n if k == 0 else nearest + 1
        while waiting > 0 and found < wanted:
            entry = first[cost % len(first)]
            if entry < 0:
                cost += 1
                continue
            first[cost % len(first)] = after[entry]
            waiting -= 1
            if cost > costs[place[entry]]:
                continue
            found += here[place[entry]]
            for d in range(8):
                there = place[entry] + around[d]
                way = cost + steps[d] * dearer[there]
                if dearer[there] > 0 and way < costs[there]:
                    costs[there] = way
                    if used == len(place):
                        place, after = np.append(place, place), np.append(after, after)
                    bucket = way % len(first)
                    place[used], after[used], first[bucket] = there, first[bucket], used
                    used, waiting = used + 1, waiting + 1
        for other in range(n):
            if costs[at[other]] < far:
                length = costs[at[other]] / STRAIGHT
                between[k, other] = min(between[k, other], length)
                between[other, k] = min(between[other, k], length)
    return between


def expected_falls(places: FloatArray, visited: FloatArray, sigmas: FloatArray, within: float) -> FloatArray:
    """Return by how much the standard deviation of the robot's place is expected to fall at places, metres, shape (n,).

    Where it sees again what it saw before, its place is as sure as it was then, for readings are matched to each other.
    Elsewhere nothing falls.

    Source: active loop closing: Stachniss, Hähnel & Burgard, "Exploration with active loop-closing for FastSLAM",
    IROS 2004.

    Args:
        places: x, y, shape (n, 2).
        visited: where it was, x, y, in the order of time, the last where it is, shape (m, 2).
        sigmas: standard deviations of these, in the world, metres, shape (m,).
        within: metres up to which the same things are seen.
    """
    if len(visited) == 0:
        return np.zeros(len(places))
    apart = np.hypot(places[:, None, 0] - visited[None, :, 0], places[:, None, 1] - visited[None, :, 1])
    surest = np.where(apart <= within, sigmas[None, :], np.inf).min(axis=1)
    return np.asarray(np.maximum(sigmas[-1] - surest, 0.0))


def open_loop(
    mapper: Mapper,
    levels: NDArray[np.uint8],
    robot: Robot,
    here: FloatArray,
    done: list[FloatArray],
    sensor_range: float,
) -> FloatArray | None:
    """Return the nearest of the robot's poses, shape (3,), at which it would close a loop; None if there is none.

    A loop is open where the robot can come soon to where it was, and the map knows of the two only by a long way round,
    along which its pose has drifted by more than :data:`OPEN` cells: what was seen from both has two surfaces then.

    Args:
        mapper: knows where the robot was.
        levels: where it gets to, see :meth:`trailmark.exploration.survey.Memory.find_levels`.
        robot: with the clearance that it keeps.
        here: where it is, shape (3,).
        done: places that it has come back to already, shape (3,) each.
        sensor_range: metres.
    """
    poses, drifts, known = mapper.trajectory[:, 1:], mapper.drifts, mapper.known
    some = np.unique(np.linspace(0, len(poses) - 1, MOST_POSES).astype(np.intp))
    some = some[drifts[some, 1] > OPEN * known.cell]
    for place in done:
        some = some[np.hypot(*(poses[some] - place)[:, :2].T) > NEAR * sensor_range]
    if not len(some):
        return None
    cells = np.column_stack(known.cells_of(np.vstack([here, poses[some]])[:, :2]))
    ways = Travel(levels, robot.reference_radius / known.cell).between(cells)[0, 1:] * known.cell
    ways[ways > SHORT * drifts[some, 0]] = np.inf
    nearest = int(ways.argmin())
    return np.asarray(poses[some[nearest]]) if np.isfinite(ways[nearest]) else None


def places_of(trajectory: FloatArray, covariances: FloatArray) -> FloatArray:
    """Return where the robot was and how sure that is: x, y and the largest standard deviation, metres, shape (n, 3).

    Args:
        trajectory: rows t, x, y, theta, shape (n, 4).
        covariances: of its poses, shape (n, 3, 3).
    """
    largest = np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1]
    return np.column_stack([trajectory[:, 1:3], np.sqrt(np.maximum(largest, 0.0))])
