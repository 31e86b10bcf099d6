"""Landmarks to choose from: centres of the free space known so far, and of what sees the frontiers left over."""

# Tested by tests/exploration/test_survey.py.

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.frontiers import Frontiers
from trailmark.exploration.reachability import CERTAIN, NOWHERE
from trailmark.exploration.views import places_in_sight, sight
from trailmark.landmarks.kmeans import k_means_landmarks
from trailmark.landmarks.sensor_range import landmarks_for_area
from trailmark.se2 import FloatArray

__all__ = ["Candidates", "candidates_of", "middles_of"]

SAMPLES = 1000
"""Free places that are clustered."""

MOST = 40
"""Landmarks of the free space at most: a decision has to be quick."""

EDGES = 4
"""Of a group that no landmark sees: places are looked for that see one of them; of all, before the end is proven."""

DRAWS = 8
"""Places drawn of those that see an edge."""

STEPS = 5
"""Of Lloyd's algorithm."""


def middles_of(cells: NDArray[np.intp]) -> FloatArray:
    """Return the centres x, y of cells, shape (n, 2), rows and columns, in cells from the grid's corner."""
    return np.ascontiguousarray(cells[:, ::-1] + 0.5, dtype=np.float64)


class Candidates:
    """Places to look from.

    Attributes:
        cells: rows and columns, shape (n, 2).
        sees: which place sees which edge of the frontiers, shape (n, edges).
    """

    def __init__(self, cells: NDArray[np.intp], sees: NDArray[np.bool_]) -> None:
        self.cells, self.sees = cells, sees


def candidates_of(
    state: NDArray[np.uint8],
    passable: NDArray[np.uint8],
    costs: NDArray[np.float32],
    frontiers: Frontiers,
    farthest: FloatArray,
    sensor_range: float,
    rng: np.random.Generator,
) -> Candidates:
    """Return places from which all frontiers are seen that can be seen from where the robot can get to.

    First K-means centres of free places, as many as the sensor's range asks for; then, for each group of frontiers that
    none of them sees, the K-means centre of the cheapest places that see it.

    Args:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
        passable: NOWHERE, PERHAPS or CERTAIN.
        costs: of the way to each cell, infinite where the robot cannot get to.
        frontiers: m edges.
        farthest: from which each edge is looked at, in cells, shape (m,).
        sensor_range: in cells.
        rng: draws the places.
    """
    columns = state.shape[1]
    reached = np.flatnonzero((passable == CERTAIN) & np.isfinite(costs))
    cells = np.empty((0, 2), np.intp)
    if len(reached):
        k = min(landmarks_for_area(float(len(reached)), sensor_range), MOST)
        drawn = rng.choice(reached, min(SAMPLES, len(reached)), replace=False)
        samples = np.column_stack([drawn % columns, drawn // columns, np.zeros(len(drawn))]).astype(np.float64)
        centres = k_means_landmarks(samples, k, radius=0.0, steps=STEPS, random_state=rng)
        cells = centres[:, 1::-1].astype(np.intp)
    sees = sight(state, middles_of(cells), frontiers.edges, farthest)
    reach = np.where(np.isfinite(costs), passable, NOWHERE)
    for edges, spacing in ((EDGES, 2.0), (len(frontiers.edges), 0.5)):
        left = _some_of_each(
            np.flatnonzero(~np.isin(frontiers.group, frontiers.group[sees.any(axis=0)])), frontiers.group, edges
        )
        found = places_in_sight(state, reach, frontiers.edges[left], farthest[left], DRAWS, spacing)
        more = _middles(found, frontiers.group[left], columns)
        more_sees = sight(state, middles_of(more), frontiers.edges, farthest)
        cells, sees = np.concatenate([cells, more]), np.concatenate([sees, more_sees])
        if sees.any():
            break
    useful = sees.any(axis=1)
    return Candidates(cells[useful], sees[useful])


def _some_of_each(chosen: NDArray[np.intp], group: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return of the chosen edges at most some of each group."""
    order = chosen[np.argsort(group[chosen], kind="stable")]
    sizes = np.bincount(group[order])
    rank = np.arange(len(order)) - (np.cumsum(sizes) - sizes)[group[order]]
    every = np.maximum(-(-sizes // most), 1)[group[order]]
    return np.asarray(order[rank % every == 0])


def _middles(found: NDArray[np.int64], group: NDArray[np.intp], columns: int) -> NDArray[np.intp]:
    """Return for each group the one of its places that is nearest to their K-means centre; (n, 2), rows and columns.

    Args:
        found: row * columns + column of places, or -1, shape (edges, draws).
        group: of each edge.
        columns: of the grid.
    """
    chosen = list[NDArray[np.intp]]()
    for g in np.unique(group):
        places = found[group == g]
        cells = np.column_stack(np.divmod(places[places >= 0], columns))
        if len(cells):
            samples = np.column_stack([cells, np.zeros(len(cells))]).astype(np.float64)
            first = samples.mean(axis=0, keepdims=True)
            chosen.append(cells[np.square(samples - first).sum(axis=1).argmin()])
    return np.array(chosen, dtype=np.intp).reshape(-1, 2)
