"""What ways cost roughly, against shortest paths in a graph of the cells."""

from __future__ import annotations

import itertools
import math
from functools import partial

import networkx as nx
import numpy as np
import pytest
from tests.support.trials import trials

from trailmark.exploration.reachability import CERTAIN, NOWHERE
from trailmark.exploration.travel import TIGHT, Travel, costs_between

lengths = partial(nx.single_source_dijkstra_path_length, weight="cost")


def graph_of(fits: np.ndarray, cells: np.ndarray) -> nx.DiGraph:
    """Return the steps from cell to cell; a place is one whatever its cell is."""
    graph, places = nx.DiGraph(), {(int(r), int(c)) for r, c in cells}
    rows, columns = fits.shape
    for r, c, dr, dc in itertools.product(range(rows), range(columns), (-1, 0, 1), (-1, 0, 1)):
        there = r + dr, c + dc
        inside = 0 <= there[0] < rows and 0 <= there[1] < columns
        if inside and (dr, dc) != (0, 0) and (fits[there] != NOWHERE or there in places):
            graph.add_edge((r, c), there, cost=math.hypot(dr, dc) * (1.0 if fits[there] == CERTAIN else TIGHT))
    return graph


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(5))
def test_costs_are_those_of_shortest_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fits = rng.choice(np.array([NOWHERE, 3, CERTAIN], np.uint8), (17, 23), p=[0.35, 0.25, 0.4])
    cells = np.column_stack([rng.integers(0, 17, 8), rng.integers(0, 23, 8)])
    found = costs_between(fits, cells, len(cells), TIGHT)
    graph, reached = graph_of(fits, cells), 0
    for i, j in itertools.product(range(8), range(8)):
        ends = tuple(map(tuple, cells[[i, j]].tolist()))
        ways = [lengths(graph, a).get(b, math.inf) for a, b in (ends, ends[::-1]) if a in graph]
        expected = 0.0 if i == j else min(ways, default=math.inf)
        assert found[i, j] == pytest.approx(expected, rel=0.002)
        reached += i != j and math.isfinite(expected)
    assert reached > 10


def test_ways_past_the_nearest_places_are_joined() -> None:
    # A corridor of 60 cells with a place in every second one.
    fits = np.full((3, 60), CERTAIN, np.uint8)
    cells = np.column_stack([np.ones(30, np.intp), np.arange(0, 60, 2)])
    found = Travel(fits, 1.0).between(cells)
    assert found == pytest.approx(np.abs(cells[:, 1] - cells[:, None, 1]).astype(float))
    walled = fits.copy()
    walled[:, 31] = NOWHERE
    assert np.isinf(Travel(walled, 1.0).between(cells)[0, 16:]).all()
