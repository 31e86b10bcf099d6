"""Costs to go: shortest paths over cells, by scipy; room in them, by shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from tests.helpers.oracles import signed_distances
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Rectangle, Robot, StateChecker, World
from trailmark.search.cost_to_go import CostToGo

FloatArray = NDArray[np.float64]

LEAST, MOST = 70 / 71, 71 / 70
"""How far costs may be off: a cell's is rounded to 70ths, 70 of them at least, and that of a diagonal step again."""

SINGLE = 1e-6
"""Share of a cost by which single precision and sums in another order may differ."""


def cell_of(costs: CostToGo, point: complex) -> tuple[int, int]:
    """Row and column of the cell around a point of the bounds; what lies on the upper ones belongs to the last."""
    rows, columns = costs.cost.shape
    row, column = (int(v // costs.size) for v in (point.imag - costs.y0, point.real - costs.x0))
    return min(rows - 1, max(0, row)), min(columns - 1, max(0, column))


def at(costs: CostToGo, x: float, y: float) -> float:
    return float(costs.cost[cell_of(costs, complex(x, y))])


def middle(robot: Robot, q: FloatArray) -> complex:
    """Where the inscribed disc's centre is."""
    return complex(q[0], q[1]) + complex(*robot.inscribed_disc.center) * complex(math.cos(q[2]), math.sin(q[2]))


def spelled_out(costs: CostToGo, dear: FloatArray, source: tuple[int, int]) -> FloatArray:
    """Costs to the source over cells so dear (infinite: closed), by scipy."""
    at = np.arange(dear.size).reshape(dear.shape)
    pairs = [(at[:, :-1], at[:, 1:]), (at[:-1], at[1:]), (at[:-1, :-1], at[1:, 1:]), (at[:-1, 1:], at[1:, :-1])]
    a, b = (np.concatenate([side.reshape(-1) for side in sides]) for sides in zip(*pairs, strict=True))
    rows, columns = (np.unravel_index(side, dear.shape) for side in (a, b))
    step = np.hypot(rows[0] - columns[0], rows[1] - columns[1])
    weight = step * np.maximum(dear.reshape(-1)[a], dear.reshape(-1)[b])
    open_ = np.isfinite(weight)
    graph = csr_array((weight[open_], (a[open_], b[open_])), shape=(dear.size, dear.size))
    return np.asarray(dijkstra(graph, directed=False, indices=at[source])).reshape(dear.shape)


@pytest.mark.slow
@settings(max_examples=few(15))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    seed=st.integers(0, 30),
    tightness=st.sampled_from([0.0, 1.0, 6.0]),
    cells=st.sampled_from([60, 400]),
)
def test_costs_are_those_of_the_cheapest_way_over_the_cells(name: str, seed: int, tightness: float, cells: int) -> None:
    world = random_world(seed, 14, size=16.0, radii=(0.5, 2.0), discs=0.4, holes=0.2, origin=(-4.0, 2.0))
    checker = StateChecker(world, ROBOTS[name], cell=0.04)
    q = np.random.default_rng(seed).uniform((-4, 2, -math.pi), (12, 18, math.pi), (300, 3))
    q = q[checker.valid(q)]
    if len(q) == 0:
        return
    costs = CostToGo.of(checker, q[0], cells, tightness)
    rows, columns = costs.cost.shape
    # The most room at any point of each cell, to within the spacing of the points that are looked at.
    points = 8
    offsets = (np.arange(points) + 0.5) / points
    x = costs.x0 + costs.size * (np.arange(columns)[:, None] + offsets).reshape(-1)
    y = costs.y0 + costs.size * (np.arange(rows)[:, None] + offsets).reshape(-1)
    room = signed_distances(world, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))[0]
    room = room.reshape(rows, points, columns, points).max(axis=(1, 3))
    # The field is wrong by a diagonal of its cells at most, and looked at every other cell.
    spare = 3.0 * math.sqrt(2.0) * checker.field.size + 0.71 * costs.size / points
    radius = ROBOTS[name].inscribed_disc.radius
    roomy = radius + 0.5 * max(ROBOTS[name].circumradius - radius, 0.1 * radius)
    source = cell_of(costs, middle(ROBOTS[name], q[0]))
    assert costs.cost[source] == 0.0
    for best, sign, off in ((room + spare, 1.0, LEAST), (room - spare, -1.0, MOST)):
        lack = np.clip((roomy - best) / (roomy - radius), 0.0, 1.0)
        dear = np.where(best >= radius, costs.size * (1.0 + tightness * lack), np.inf)
        # The goal's own cell is open in any case.
        dear[source] = min(dear[source], costs.size * (1.0 + tightness))
        expected = off * spelled_out(costs, dear, source)
        # More room nowhere makes a way dearer.
        assert (sign * costs.cost >= sign * expected - SINGLE * np.where(np.isfinite(expected), expected, 0.0))[
            np.isfinite(costs.cost) | np.isfinite(expected)
        ].all()


def test_what_is_closed_off_is_infinitely_far() -> None:
    walls = (Rectangle((10.0, 10.0), 1.0, 20.0),)
    checker = StateChecker(World("wall", (0, 0, 20, 20), walls), Robot.rectangle(1.0, 0.6))
    costs = CostToGo.of(checker, np.array([4.0, 10.0, 0.0]), 900)
    assert np.isfinite(at(costs, 2.0, 2.0))
    assert at(costs, 16.0, 10.0) == np.inf
    assert at(costs, 10.0, 10.0) == np.inf
