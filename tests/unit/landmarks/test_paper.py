"""Algorithms 1 and 2 as published, enclosed regions. The oracles are numpy's sums, scipy's distances and shapely."""

from __future__ import annotations

import math
import warnings
from unittest import mock

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from tests.helpers.trials import few, trials

from trailmark import ConfigurationError, StateChecker, World
from trailmark.estimation import RangeBearing, sense_obstacles
from trailmark.landmarks import algorithm_1, algorithm_2, enclosed_cells, free_samples, paper
from trailmark.landmarks.paper import INITIALISATIONS, Initialisation, initial_centres
from trailmark.world.library import shipped_worlds

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

initialisations = st.sampled_from(INITIALISATIONS)


@st.composite
def data(draw: st.DrawFn) -> tuple[FloatArray, int]:
    """Samples in clumps, on a coarse grid (equal ones, ties) or uniform, near the origin or far; and a k for them."""
    n, d, seed = draw(st.integers(1, 80)), draw(st.integers(1, 4)), draw(st.integers(0, 10_000))
    rng = np.random.default_rng(seed)
    kind = draw(st.sampled_from(["uniform", "clumps", "grid"]))
    x = rng.uniform(-5.0, 5.0, (n, d))
    if kind == "clumps":
        x = 0.05 * x + rng.integers(-2, 3, (n, 1)) * np.ones(d)
    elif kind == "grid":
        x = np.round(x / 2.5) * 2.5
    x = x + draw(st.sampled_from([0.0, 1e5]))
    return x, draw(st.integers(1, len(np.unique(x, axis=0))))


def inertia_of(x: FloatArray, centres: FloatArray) -> float:
    return float((cdist(x, centres).min(axis=1) ** 2).sum())


@pytest.mark.slow
@settings(max_examples=few(60))
@given(data(), initialisations, st.integers(0, 99))
def test_inertia_falls_to_a_fixed_point(given_data: tuple[FloatArray, int], init: Initialisation, seed: int) -> None:
    x, k = given_data
    found = algorithm_1(x, k, init, seed)
    scale = 1.0 + np.abs(x).max()
    assert found.centres.shape == (k, x.shape[1])
    # No cluster is empty, each centre is its members' mean, each member's nearest centre is its own.
    assert set(found.labels) == set(range(k))
    means = np.array([x[found.labels == j].mean(axis=0) for j in range(k)])
    assert np.abs(found.centres - means).max() <= 1e-9 * scale
    gaps = cdist(x, found.centres)
    assert (gaps[np.arange(len(x)), found.labels] <= gaps.min(axis=1) + 1e-6 * math.sqrt(scale)).all()
    assert found.inertia == pytest.approx(inertia_of(x, found.centres), rel=1e-6, abs=1e-6)
    assert found.iterations >= 1
    last = inertia_of(x, initial_centres(x, k, init, seed))
    for steps in range(1, found.iterations + 1):
        with mock.patch.object(paper, "MAX_ITERATIONS", steps), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # on the way, though never at the end, a cluster may be empty
            now = algorithm_1(x, k, init, seed)
        assert now.inertia <= last * (1.0 + 1e-9) + 1e-6
        last = now.inertia
    assert last == pytest.approx(found.inertia, rel=1e-9, abs=1e-9)


def lloyd(x: FloatArray, centres: FloatArray) -> NDArray[np.int64]:
    """Algorithm 1 as the paper has it: until no point changes cluster (here none may lose all its points)."""
    labels = np.full(len(x), -1)
    while True:
        nearest: NDArray[np.int64] = np.argmin(cdist(x, centres), axis=1)
        if (nearest == labels).all():
            return nearest
        labels = nearest
        centres = np.array([x[labels == j].mean(axis=0) for j in range(len(centres))])


@pytest.mark.parametrize("init", INITIALISATIONS)
@pytest.mark.parametrize("seed", range(5))
def test_the_same_clusters_as_a_plain_loop_finds_and_the_seeds_own(init: Initialisation, seed: int) -> None:
    x = np.random.default_rng(seed).uniform(0.0, 10.0, (500, 2))
    k = 3 if init == "random-partition" else 8  # of more centroids, close together, some get no point at first
    found = algorithm_1(x, k, init, seed)
    assert np.array_equal(found.labels, lloyd(x, initial_centres(x, k, init, seed)))
    assert np.array_equal(found.centres, algorithm_1(x, k, init, np.random.default_rng(seed)).centres)
    assert not np.array_equal(found.centres, algorithm_1(x, k, init, seed + 1).centres)


@pytest.mark.parametrize(
    ("samples", "k", "init", "problem"),
    [
        (np.zeros((5, 2)), 2, "forgy", "k: expected 1 to 1, the number of different samples, got 2"),
        (np.eye(3), 4, "forgy", "k: expected 1 to 3, the number of samples, got 4"),
        (np.empty((0, 2)), 1, "forgy", "k: expected 1 to 0, the number of samples, got 1"),
        (np.eye(3), 2, "frogy", "got 'frogy' \\(did you mean 'forgy'\\?\\)"),
        (np.array([1.0, 2.0]), 1, "forgy", r"got \(2,\)"),
        (np.array([[1.0, np.nan]]), 1, "forgy", "samples: hold a value that is not a finite number"),
    ],
)
def test_bad_input_to_algorithm_1(samples: FloatArray, k: int, init: Initialisation, problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        algorithm_1(samples, k, init, 0)


RECTANGLE = (0.0, 0.0, 10.0, 6.0)


def readings(m: int, seed: int) -> list[FloatArray]:
    """Refined readings of m obstacles, some of them reaching out of the rectangle; one was never seen."""
    rng = np.random.default_rng(seed)
    obstacles = [rng.uniform(0.0, 10.0, 2) + rng.normal(0.0, 0.4, (rng.integers(1, 20), 2)) for _ in range(m)]
    return [*obstacles, np.empty((0, 2))]


@pytest.mark.slow
@given(st.integers(0, 12), st.integers(0, 999))
def test_forbidden_points_are_those_in_boxes_or_cut_off_by_them(m: int, seed: int) -> None:
    obstacles, robot = readings(m, seed), np.array([9.9, 5.9])
    found = algorithm_2(obstacles, RECTANGLE, 400, 1, random_state=seed, robot=robot)
    region = shapely.box(*RECTANGLE)
    solid = shapely.union_all([shapely.box(*box) for box in found.boxes])
    points = shapely.points(found.samples)
    assert shapely.intersects(region, points).all()
    inside = shapely.intersects(solid, points)
    assert np.array_equal(found.forbidden & ~found.enclosed, inside)
    rooms = shapely.get_parts(region.difference(solid))
    home = shapely.intersects(rooms, shapely.Point(robot))
    if home.any():
        assert np.array_equal(found.enclosed, ~inside & ~shapely.intersects(rooms[home][0], points))


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"n": 0}, "n: expected 1 or more, got 0"),
        ({"k": 0}, "k: expected 1 or more, got 0"),
        ({"k": 101}, "k: expected 1 to 100, got 101: 100 of 100 points drawn are valid"),
        ({"readings": [[(-1, -1), (11, 7)]]}, "k: empty free space: 0 of 100 points drawn are valid"),
        ({"rectangle": (0.0, 0.0, 0.0, 6.0)}, "rectangle: expected xmin, ymin, xmax, ymax .* got 0, 0, 0, 6"),
        ({"rectangle": (0.0, 0.0, math.inf, 6.0)}, "got 0, 0, inf, 6"),
        ({"readings": [[(1, 1, 1)]]}, r"got \(1, 3\)"),
        ({"readings": [[(1, math.nan)]]}, r"readings\[0\]: expected shape \(r, 2\), finite numbers, got \(1, 2\)"),
        ({"init": "partition"}, "got 'partition' \\(did you mean 'random-partition'\\?\\)"),
        ({"robot": (math.nan, 0.0)}, "robot: hold a value"),
        ({"margin": -1.0}, "margin: expected a finite number of 0 or more, got -1"),
    ],
)
def test_bad_input_to_algorithm_2(arguments: dict[str, object], problem: str) -> None:
    usual: dict[str, object] = {"readings": [], "rectangle": RECTANGLE, "n": 100, "k": 3, "random_state": 0}
    with pytest.raises(ConfigurationError, match=problem):
        algorithm_2(**(usual | arguments))  # type: ignore[arg-type]  # that is what is tested


@pytest.mark.slow
def test_environment_1_has_the_published_share_of_forbidden_points() -> None:
    world = World.load(shipped_worlds()["environment1"])
    assert world.bounds == (5.5001, 10.5481, 46.6007, 117.5)
    assert world.boundary is not None
    home = np.array(world.queries[0].start)
    poses = free_samples(StateChecker(world), 220, reachable_from=home, random_state=0)
    counts = []
    for sensed in range(10):
        refined = sense_obstacles(world, poses, RangeBearing(0.05, 0.01), max_range=12.0, random_state=sensed)
        for drawn in trials(20, of=2):
            # What is forbidden does not depend on the number of clusters, and one is found soonest.
            k = 1 if drawn else 12
            found = algorithm_2(refined, world.bounds, 1000, k, random_state=1000 * sensed + drawn, robot=home[:2])
            counts.append(int(found.forbidden.sum()))
            assert len(found.centres) == k
    assert 165.0 <= np.mean(counts) <= 171.0
    # Deviations of a binomial: within four standard errors of its own.
    binomial = math.sqrt(1000 * 0.168 * 0.832)
    assert np.std(counts, ddof=1) == pytest.approx(binomial, rel=4.0 / math.sqrt(2 * (len(counts) - 1)))


def flood(occupied: BoolArray, seeds: list[tuple[int, int]]) -> BoolArray:
    """The free cells that can be reached from the seeds over the cells' sides."""
    rows, columns = occupied.shape
    reached = np.zeros_like(occupied)
    stack = [cell for cell in seeds if not occupied[cell]]
    while stack:
        i, j = stack.pop()
        if reached[i, j]:
            continue
        reached[i, j] = True
        near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
        stack += [(a, b) for a, b in near if 0 <= a < rows and 0 <= b < columns and not occupied[a, b]]
    return reached


@pytest.mark.slow
@given(arrays.arrays(np.bool_, st.tuples(st.integers(1, 9), st.integers(1, 9))), st.data())
def test_cells_that_are_enclosed(occupied: BoolArray, data: st.DataObject) -> None:
    rows, columns = occupied.shape
    edge = [(i, j) for i in range(rows) for j in range(columns) if i in (0, rows - 1) or j in (0, columns - 1)]
    robot = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, columns - 1))
    # Without a robot, or with one in a wall, the edge is open; with one it is closed.
    assert np.array_equal(enclosed_cells(occupied), ~occupied & ~flood(occupied, edge))
    seeds = edge if occupied[robot] else [robot]
    assert np.array_equal(enclosed_cells(occupied, robot), ~occupied & ~flood(occupied, seeds))
