"""The relaxed problem: what it closes is proven closed, and its costs are those of Dijkstra's algorithm.

Distances come from shapely, shortest paths from scipy; only the rules of the grid's graph are written down again.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from tests.helpers.oracles import signed_distances
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Rectangle, Robot, StateChecker, World
from trailmark.landmarks import Relaxation, free_samples
from trailmark.landmarks.relaxation import CORNER_FACTOR, UNSURE_FACTOR

FloatArray = NDArray[np.float64]

EXACT = 1e-4
"""Relative error of costs: those of steps are whole numbers, and in single precision."""
CASES = [(name, seed) for seed, name in enumerate(ROBOTS)]


def cluttered(seed: int, obstacles: int = 50, size: float = 40.0) -> World:
    return random_world(seed, obstacles, size=size, discs=0.3, holes=0.2, boundary=seed % 2 == 0)


def centres(relaxation: Relaxation) -> FloatArray:
    """Centres of all cells, row by row."""
    x = relaxation.x0 + (np.arange(relaxation.columns) + 0.5) * relaxation.size
    y = relaxation.y0 + (np.arange(relaxation.rows) + 0.5) * relaxation.size
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def scipy_graph(relaxation: Relaxation) -> sparse.csr_matrix:
    """The rules again: steps to eight neighbours, dearer where it is too tight for the disc."""
    rows, columns, size, r = relaxation.rows, relaxation.columns, relaxation.size, relaxation.radius
    index = np.arange(rows * columns).reshape(rows, columns)
    room = relaxation.clearance(index.ravel()).reshape(rows, columns)
    starts, ends, costs = [], [], []
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if dx == dy == 0:
                continue
            here = (slice(max(0, -dy), rows - max(0, dy)), slice(max(0, -dx), columns - max(0, dx)))
            there = (slice(max(0, dy), rows - max(0, -dy)), slice(max(0, dx), columns - max(0, -dx)))
            side, other = (here[0], there[1]), (there[0], here[1])
            cost = size * math.hypot(dx, dy) * np.where((room[here] < r) | (room[there] < r), UNSURE_FACTOR, 1.0)
            if dx and dy:
                cost *= np.where((room[side] < r) | (room[other] < r), CORNER_FACTOR, 1.0)
            may = relaxation.open[there]
            starts.append(index[here][may])
            ends.append(index[there][may])
            costs.append(cost[may])
    triple = np.concatenate(costs), (np.concatenate(starts), np.concatenate(ends))
    return sparse.csr_matrix(triple, shape=(rows * columns, rows * columns))


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), CASES)
def test_clearance_is_right_where_it_matters(name: str, seed: int) -> None:
    world = cluttered(seed)
    checker = StateChecker(world, ROBOTS[name])
    relaxation = Relaxation(checker)
    where = centres(relaxation)
    cells = np.arange(len(where))
    if len(cells) > 2_000:
        cells = np.random.default_rng(0).choice(cells, 2_000, replace=False)
    assert np.array_equal(relaxation.cells(where), np.arange(len(where)))
    assert relaxation.cell_centers(cells) == pytest.approx(where[cells], abs=1e-9)
    exact = signed_distances(world, where[cells])[0]
    found = relaxation.clearance(cells)
    # In obstacles it is minus the depth, no farther than a cell.
    assert np.abs(np.maximum(found, 0.0) - exact).max() <= checker.field.slack
    assert (exact[found < 0.0] == 0.0).all()
    assert found.min() >= -relaxation.size
    # Does the disc fit with its centre at the cell's, or anywhere in the cell?
    for least in (relaxation.radius, relaxation.radius - relaxation.size * math.sqrt(0.5)):
        if least < 0.0:
            continue  # The oracle knows no depths: what is closed then is looked at below.
        clear_cut = np.abs(exact - least) > 1e-5
        assert np.array_equal((found >= least)[clear_cut], (exact >= least)[clear_cut])
    # Where a cell is closed, no point of it has room for the disc.
    rng = np.random.default_rng(1)
    closed = where[cells][~relaxation.open.ravel()[cells]]
    inside = closed + rng.uniform(-0.5, 0.5, closed.shape) * relaxation.size
    assert (signed_distances(world, inside)[0] < relaxation.radius).all()


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_costs_are_dijkstras(name: str, seed: int) -> None:
    world = cluttered(seed, 20, 25.0)
    checker = StateChecker(world, ROBOTS[name], cell=0.2)
    relaxation = Relaxation(checker)
    if relaxation.rows * relaxation.columns > 40_000:
        # The thin robot's grid has a million cells; a stouter one does for the algorithm.
        relaxation = Relaxation(StateChecker(world, Robot.rectangle(4.0, 0.6), cell=0.2))
    checker = relaxation.checker
    source, target = free_samples(checker, 2, random_state=seed)
    start, end = (int(relaxation.cells(relaxation.disc_centers(q))) for q in (source, target))
    graph = scipy_graph(relaxation)
    forth = csgraph.dijkstra(graph, indices=np.array([start]))[0]

    whole = relaxation.costs_from(source)
    assert whole.limit == np.inf
    np.testing.assert_allclose(whole.cost.ravel(), forth, rtol=EXACT)
    assert np.array_equal(np.isfinite(whole.cost).ravel(), relaxation.component(source))
    # Parents: one step back along a shortest path each.
    columns = relaxation.columns
    cells = np.flatnonzero(whole.parent.ravel() >= 0)
    angle = whole.parent.ravel()[cells] * (np.pi / 4.0)
    before = cells + np.rint(np.sin(angle)).astype(int) * columns + np.rint(np.cos(angle)).astype(int)
    np.testing.assert_allclose(np.asarray(graph[before, cells]).ravel() + forth[before], forth[cells], rtol=EXACT)
    assert len(cells) == np.isfinite(forth).sum() - 1
    if not np.isfinite(forth[end]):
        pytest.skip("no path joins the two")
    way = relaxation.shortest_path(whole, target)
    assert (way[0], way[-1]) == (end, start)
    assert np.asarray(graph[way[1:], way[:-1]]).sum() == pytest.approx(forth[end], rel=EXACT)

    near = relaxation.costs_from(source, target=target, widening=0.2)
    assert forth[end] * 1.2 <= near.limit < forth[end] * 1.2001 + 10.0 * relaxation.size


@pytest.mark.slow
@settings(max_examples=few(10))
@given(seed=st.integers(0, 10_000), name=st.sampled_from(sorted(set(ROBOTS) - {"thin"})), fineness=st.integers(0, 2))
def test_no_certified_path_crosses_from_one_component_to_another(seed: int, name: str, fineness: int) -> None:
    world = random_world(seed, 60, size=25.0, radii=(0.3, 2.0), discs=0.2)
    checker = StateChecker(world, ROBOTS[name], cell=0.1)
    q = free_samples(checker, 150, random_state=seed)
    if len(q) < 2:
        return
    pairs = np.array(np.triu_indices(len(q), 1)).T
    pairs = pairs[np.hypot(*(q[pairs[:, 0], :2] - q[pairs[:, 1], :2]).T) < 6.0]
    joined = pairs[checker.motions_valid(q[pairs[:, 0]], q[pairs[:, 1]])]
    graph = sparse.coo_matrix((np.ones(len(joined)), joined.T), shape=(len(q), len(q)))
    labels = csgraph.connected_components(graph, directed=False)[1]
    relaxation = Relaxation(checker, fineness)
    cells = relaxation.cells(relaxation.disc_centers(q))
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        assert relaxation.component(q[members[0]])[cells[members]].all()


@pytest.mark.slow
@settings(max_examples=few(20))
@given(
    slack=st.sampled_from([0.0, 1e-6, 1e-3]),
    heading=st.floats(-math.pi, math.pi),
    x=st.floats(0.0, 1.0),
    y=st.floats(0.0, 1.0),
    fineness=st.integers(0, 2),
)
def test_the_tightest_corridor_stays_open(slack: float, heading: float, x: float, y: float, fineness: int) -> None:
    # Two walls at any angle, no or hardly farther apart than the robot is wide: touching is allowed.
    across = np.array([-math.sin(heading), math.cos(heading)])
    middle = np.array([10.0 + x, 10.0 + y])
    offset = 0.3 + slack + 0.5
    walls = tuple(
        Rectangle((float(c[0]), float(c[1])), 6.0, 1.0, heading)
        for c in (middle + offset * across, middle - offset * across)
    )
    checker = StateChecker(World("corridor", (0, 0, 21, 21), walls), Robot.rectangle(1.0, 0.6))
    along = np.array([math.cos(heading), math.sin(heading)])
    way = np.linspace(-3.5, 3.5, 200)
    q = np.column_stack([middle + way[:, None] * along, np.full(200, heading)])
    assert checker.valid(q).all()
    relaxation = Relaxation(checker, fineness)
    cells = relaxation.cells(relaxation.disc_centers(q))
    assert relaxation.open.ravel()[cells].all()
    assert relaxation.component(q[0])[cells].all()
