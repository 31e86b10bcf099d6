"""Numbers of landmarks: the closed form against geometry by shapely, the promise against scikit-learn's centres."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from sklearn.cluster import KMeans
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_states, random_world
from threadpoolctl import threadpool_limits

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks.sensor_range import (
    distances_to_landmarks,
    landmarks_for_area,
    landmarks_for_range,
)
from trailmark.library import shipped_worlds
from trailmark.shapes import Polygon, Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def open_world(width: float = 40.0, height: float = 40.0, radius: float = 0.5) -> StateChecker:
    """A world without obstacles whose free area is width x height for the disc's centre."""
    bounds = (-radius, -radius, width + radius, height + radius)
    return StateChecker(World("open", bounds), Robot.disc(radius))


OPEN = open_world()


def hexagon(area: float) -> shapely.Polygon:
    side = math.sqrt(area / (1.5 * math.sqrt(3.0)))
    angles = np.arange(6) * (math.pi / 3.0)
    return shapely.Polygon(side * np.column_stack([np.cos(angles), np.sin(angles)]))


# --- the closed form


@pytest.mark.parametrize("probability", [0.01, 0.3, 0.85, 0.9, 0.95, 0.99, 0.9999])
def test_a_hexagon_has_that_share_within_range(probability: float) -> None:
    area, reach = 1e6, 3.0
    k = landmarks_for_area(area, reach, probability)
    cell = hexagon(area / k)
    covered = cell.intersection(shapely.Point(0, 0).buffer(reach, quad_segs=2000)).area / cell.area
    # One landmark less would not do, and k is large: the share is met to a rounding.
    assert covered == pytest.approx(probability, abs=1e-4)


def test_a_triangular_lattice_meets_the_probability() -> None:
    side, reach, probability = 100.0, 5.0, 0.95
    spacing = math.sqrt(2.0 / math.sqrt(3.0) * side**2 / landmarks_for_area(side**2, reach, probability))
    rows = np.arange(-2, 18)
    x = spacing * (np.arange(-2, 15)[None, :] + 0.5 * (rows[:, None] % 2))
    y = np.broadcast_to(spacing * math.sqrt(0.75) * rows[:, None], x.shape)
    places = np.random.default_rng(1).uniform(0, side, (3000, 2))
    share = (cdist(places, np.column_stack([x.ravel(), y.ravel()])).min(axis=1) <= reach).mean()
    assert share == pytest.approx(probability, abs=4 * math.sqrt(0.95 * 0.05 / 3000))


areas, ranges, shares = st.floats(1e-3, 1e6), st.floats(1e-2, 1e4), st.floats(1e-6, 1.0 - 1e-6)


# --- the promise, with centres and places that share nothing with the function


SAMPLES = 500
"""How many are clustered, half as many as by default: it takes half of the time."""


def shares_in_range(places: FloatArray, k: int, reach: float, times: int = 4) -> FloatArray:
    """The shares of the places within range of scikit-learn's centres of SAMPLES others, some times."""
    shares = []
    for seed in range(times):
        mixed = np.random.default_rng(seed).permutation(places)
        some, others = mixed[:SAMPLES], mixed[SAMPLES:]
        with threadpool_limits(1):  # more threads than free cores would wait for one another
            centres = KMeans(k, init="random", n_init=1, random_state=seed).fit(some).cluster_centers_
        shares.append((cdist(others, centres).min(axis=1) <= reach).mean())
    return np.array(shares)


CASES = {
    "open, small share": (OPEN, 3.5, 0.5),
    "office": (StateChecker(World.load(shipped_worlds()["office"])), 3.0, 0.95),
    "corridor": (StateChecker(World.load(shipped_worlds()["corridor"])), 3.0, 0.95),
    "random": (StateChecker(random_world(2, 250, discs=0.4, boundary=True), ROBOTS["rectangle"]), 14.0, 0.99),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_share_in_range_is_as_promised(name: str) -> None:
    checker, reach, probability = CASES[name]
    k = landmarks_for_range(checker, reach, probability, samples=SAMPLES, random_state=1)
    # As many samples as the promise is made for, and three times as many other places or more.
    rng, oracle, places = np.random.default_rng(2), Oracle(checker.world, checker.robot), np.empty((0, 2))
    while len(places) < 2000:
        q = random_states(checker.world, 2500, rng)
        places = np.vstack([places, q[~oracle.collides(q)][:, :2]])
    shares = shares_in_range(places, k, reach)
    error = max(shares.std(ddof=1) / 2.0, math.sqrt(probability * (1.0 - probability) / len(places)))
    assert shares.mean() >= probability - 3.0 * error
    # Nor is it far too many, although these centres may lie in obstacles: two thirds would not do.
    assert shares_in_range(places, 2 * k // 3, reach, times=1).mean() < probability


@pytest.mark.slow
def test_along_a_corridor_landmarks_stand_in_a_row() -> None:
    checker = open_world(100.0, 0.05, radius=0.25)
    reach, probability = 6.0, 0.9
    k = landmarks_for_range(checker, reach, probability, random_state=2)
    # Each landmark has 2 r of the length at best; areas know nothing of that.
    assert probability * 100.0 / (2.0 * reach) <= k <= 1.35 * 100.0 / (2.0 * reach)
    assert landmarks_for_area(5.0, reach, probability) == 1


@pytest.mark.slow
def test_what_is_enclosed_needs_no_landmarks() -> None:
    outer = np.array([[10.0, 10.0], [39.0, 10.0], [39.0, 39.0], [10.0, 39.0]])
    ring = Polygon(outer, (np.array([[11.0, 11.0], [38.0, 11.0], [38.0, 38.0], [11.0, 38.0]]),))
    checker = StateChecker(World("ring", (0, 0, 40, 40), (ring,)), Robot.disc(0.5))
    everywhere = landmarks_for_range(checker, 6.0, samples=300, random_state=6)
    inside = np.array([5.0, 5.0, 0.0])
    assert landmarks_for_range(checker, 6.0, samples=300, reachable_from=inside, random_state=6) < everywhere


# --- line of sight


def test_distances_along_lines_of_sight() -> None:
    world = random_world(5, 60, size=60.0, discs=0.4, holes=0.3, boundary=True)
    checker = StateChecker(world, Robot.disc(0.3))
    q = random_states(world, 900, np.random.default_rng(6))
    q = q[checker.valid(q)]
    landmarks, places = q[:30], q[30:]
    blocked = shapely.union_all([shape.polygon(1e-6).shapely() for shape in world.obstacles])
    assert world.boundary is not None
    outside = shapely.box(*world.bounds).difference(world.boundary.shapely())
    gaps = cdist(places[:, :2], landmarks[:, :2])
    assert distances_to_landmarks(checker, places, landmarks) == pytest.approx(gaps.min(axis=1))

    nearest = np.argsort(gaps, axis=1)[:, :8]
    ends = np.stack([np.repeat(places[:, None, :2], 8, axis=1), landmarks[nearest, :2]], axis=2)
    lines = shapely.linestrings(ends)
    shapely.prepare([blocked, outside])
    seen = ~(shapely.intersects(blocked, lines) | shapely.intersects(outside, lines))
    expected = np.where(seen, np.take_along_axis(gaps, nearest, axis=1), np.inf).min(axis=1)
    found = distances_to_landmarks(checker, places[:, :2], landmarks[:, :2], line_of_sight=True)
    assert np.isinf(expected).any()
    assert (expected > gaps.min(axis=1) + 1e-9).mean() > 0.1
    assert found == pytest.approx(expected)


# --- bad input


@pytest.mark.parametrize(
    "call",
    [
        *(lambda reach=reach: landmarks_for_area(1.0, reach) for reach in (0.0, -1.0, math.nan, math.inf, 1e-200)),
        *(lambda reach=reach: landmarks_for_range(OPEN, reach) for reach in (0.0, math.nan, 0.01)),
        *(lambda p=p: landmarks_for_range(OPEN, 1.0, p) for p in (0.0, 1.0, 0.99999, math.nan)),
        lambda: landmarks_for_area(1.0, 1.0, 1.0),
        lambda: landmarks_for_area(0, 1.0),
        lambda: landmarks_for_range(OPEN, 1.0, samples=0),
        lambda: distances_to_landmarks(OPEN, np.zeros((3, 2)), np.empty((0, 3))),
    ],
)
def test_bad_arguments_are_told_in_one_line(call: Callable[[], object]) -> None:
    with pytest.raises(ConfigurationError, match=r"^[^\n]*expected [^\n]*got [^\n]*$"):
        call()


@pytest.mark.slow
def test_no_free_space() -> None:
    full = StateChecker(World("full", (0, 0, 4, 4), (Rectangle((2, 2), 4, 4),)), Robot.disc(0.5))
    with pytest.raises(ConfigurationError, match=r"^world 'full': no free place for the robot was found$"):
        landmarks_for_range(full, 1.0, random_state=1)
    tight = StateChecker(World("tight", (0, 0, 10, 10), (Rectangle((5.505, 5), 8.99, 10),)), Robot.disc(0.5))
    with pytest.raises(
        ConfigurationError, match=r"'tight': expected more free places for a probability of 0.999, found \d+$"
    ):
        landmarks_for_range(tight, 1.0, 0.999, random_state=1)
