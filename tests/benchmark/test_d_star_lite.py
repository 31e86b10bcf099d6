"""The baseline D* Lite finds what networkx finds, before and after changes."""

from __future__ import annotations

import networkx
import numpy as np
import pytest
from benchmarks.changing.d_star_lite import STEPS, Cell, DStarLite
from tests.support.trials import few, trials


def length_by_networkx(open_: np.ndarray, start: Cell, goal: Cell) -> float:
    graph = networkx.Graph()
    for row, column in np.argwhere(open_).tolist():
        for dy, dx, length in STEPS:
            other = (row + dy, column + dx)
            if 0 <= other[0] < open_.shape[0] and 0 <= other[1] < open_.shape[1] and open_[other]:
                graph.add_edge((row, column), other, weight=length)
    try:
        return float(networkx.shortest_path_length(graph, start, goal, weight="weight"))
    except (networkx.NetworkXNoPath, networkx.NodeNotFound):
        return np.inf


def length_of(path: list[Cell]) -> float:
    return float(np.hypot(*np.diff(np.array(path), axis=0).T).sum()) if path else np.inf


@pytest.mark.slow
def test_it_is_as_short_as_dijkstras_after_every_change() -> None:
    rng, mended = np.random.default_rng(0), 0
    for _ in trials(6):
        open_ = rng.random((20, 30)) > 0.25
        start, goal = (0, 0), (19, 29)
        open_[start] = open_[goal] = True
        planner = DStarLite(open_, start, goal)
        for _ in range(12):
            path = planner.path()
            assert length_of(path) == pytest.approx(length_by_networkx(open_, start, goal))
            mended += bool(path)
            if len(path) > 3:
                start = path[1]
            open_ = open_.copy()
            flip = rng.integers(0, (20, 30), (6, 2))
            open_[flip[:, 0], flip[:, 1]] ^= True
            open_[start] = open_[goal] = True
            planner.change(open_, start)
    assert mended > few(30)
