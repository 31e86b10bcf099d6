"""What coming back to where the robot was does for its pose: loops that are closed there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.mapper import Mapper
from trailmark.exploration.travel import Travel
from trailmark.robot import Robot
from trailmark.se2 import FloatArray

__all__ = ["expected_falls", "open_loop", "places_of"]

MOST_POSES = 100
"""Where the robot was, from the first pose to the last, among which it is looked for an open loop."""

OPEN = 3.0
"""Cells that a pose has drifted by where a loop is open. Surfaces that lie less far apart shut no passage in which the
robot has room: to drive round for loops of one cell took explorations a quarter more of the way, and showed no more."""

NEAR = 0.5
"""Share of the sensor's range around a place that the robot came back to in which no loop is left to be closed."""

SHORT = 0.5
"""Share of the way along which two places are related, at most, that the way between them has where a loop is open."""


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
