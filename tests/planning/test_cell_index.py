"""The final check's index of cells finds every edge that is near, as the tree of the polygons' edges does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trailmark.formats.grid import cells_of
from trailmark.path import Path
from trailmark.planning.cell_index import CellIndex
from trailmark.planning.final_check import FinalCheck
from trailmark.world import Robot, World


@pytest.mark.parametrize("seed", range(5))
def test_every_edge_of_an_occupied_cell_beside_a_free_one_is_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random((9, 11)) < 0.4
    world = World.from_grid(occupied, 0.5, (2.0, 1.0))
    cells = cells_of(world)
    assert cells is not None
    index = CellIndex(world, cells)
    low = rng.uniform((1.5, 0.5), (7.0, 5.0), (20, 2))
    high = low + rng.uniform(0.0, 2.0, (20, 2))
    groups = np.sort(rng.integers(0, 5, 20))
    first, items, runs, edges = index.near(low, high, groups, 5)
    every = index.near(np.array([[0.0, 0.0]]), np.array([[99.0, 99.0]]), np.zeros(1, np.int64), 1)[3]
    beside = occupied & ~(np.pad(occupied, 1)[1:-1, :-2] & np.pad(occupied, 1)[1:-1, 2:])
    assert len(every) >= 4 + 4 * np.count_nonzero(beside)
    for group in range(5):
        found = items[first[group] : first[group + 1]].tolist()
        assert len(set(found)) == len(found)
        near = {tuple(edges[k]) for run in found for k in range(runs[run], runs[run + 1])}
        for k in np.flatnonzero(groups == group):
            box_low = np.minimum(every[:, :2], every[:, 2:4])
            box_high = np.maximum(every[:, :2], every[:, 2:4])
            meets = ((box_low <= high[k]) & (box_high >= low[k])).all(axis=1)
            assert {tuple(edge) for edge in every[meets]} <= near


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Robot.disc(0.4), Robot.rectangle(0.9, 0.5)])
def test_verdicts_are_those_of_the_polygons(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    world = World.from_grid(rng.random((20, 20)) < 0.05, 1.0)
    mine, theirs = FinalCheck(world, robot), FinalCheck(replace(world, obstacles=tuple(world.obstacles)), robot)
    free = 0
    for _ in range(300):
        a, b = np.column_stack([rng.uniform(1.0, 19.0, (2, 2)), rng.uniform(-3.0, 3.0, 2)])
        path = Path(np.array([a, a + 0.3 * (b - a)]))
        verdicts = [check.fault(path, path.states[0], path.states[1]) for check in (mine, theirs)]
        assert (verdicts[0] is None) == (verdicts[1] is None)
        free += verdicts[0] is None
    assert 30 < free < 270
