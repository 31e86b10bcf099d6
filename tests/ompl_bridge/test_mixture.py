"""LandmarkStream: landmarks first, then shares as asked for; what must be valid is; no place is left out for ever."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import Oracle
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.ompl_bridge.landmark_source import LandmarkSource
from trailmark.ompl_bridge.mixture import ORIGINS, ROADMAP_MIXTURE, LandmarkStream, Mixture
from trailmark.world import Robot, World
from trailmark.world.library import find_world

EMPTY = StateChecker(World("empty", (0.0, 0.0, 10.0, 10.0)), Robot.disc(0.1))


@pytest.fixture(scope="module")
def narrow() -> StateChecker:
    return StateChecker(World.load(find_world("narrow")))


def taken(stream: LandmarkStream, n: int) -> np.ndarray:
    """Return n configurations; a batch without a valid one is passed over."""
    rows = (stream.take() for _ in range(20 * n))
    found = [row for _, row in zip(range(n), (row for row in rows if row is not None), strict=False)]
    assert len(found) == n
    return np.array(found)


def test_landmarks_come_first_and_in_order(narrow: StateChecker) -> None:
    given_ones = np.array([[1.6, 2.0, 0.0], [8.2, 8.6, 0.0], [15.6, 4.6, 1.0]])
    stream = LandmarkStream(LandmarkSource(narrow, given_ones), ROADMAP_MIXTURE, 0)
    assert np.array_equal(taken(stream, 3), given_ones)
    assert stream.tally[ORIGINS.index("landmark")] == 3
    taken(stream, 500)
    assert stream.tally[ORIGINS.index("landmark")] == 3
    assert sum(stream.tally) == 503


@pytest.mark.slow
@pytest.mark.parametrize("mixture", [ROADMAP_MIXTURE, Mixture(0.0, 0.0, 1.0), Mixture(6.0, 3.0, 1.0)])
def test_shares_are_those_asked_for(mixture: Mixture) -> None:
    # Nothing is in the way here, so that nothing is dropped but what lies out of bounds.
    landmarks = np.random.default_rng(0).uniform((4.0, 4.0, -3.0), (6.0, 6.0, 3.0), (40, 3))
    stream = LandmarkStream(LandmarkSource(EMPTY, landmarks), mixture, 1)
    n = 20_000
    taken(stream, 40)
    first = np.array(stream.tally[1:4])
    taken(stream, n)
    share = (np.array(stream.tally[1:4]) - first) / n
    wanted = np.array([mixture.around, mixture.between, mixture.uniform]) / sum(mixture)
    # Five standard deviations, and what the robot's radius takes off the uniform ones at the bounds.
    assert np.abs(share - wanted).max() < 5.0 * math.sqrt(0.25 / n) + 0.02


@pytest.mark.slow
@settings(max_examples=few(15))
@given(st.sampled_from(sorted(ROBOTS)), st.integers(0, 2**16))
def test_what_must_be_valid_is(robot: str, seed: int) -> None:
    world = random_world(seed % 7, 60, size=30.0, radii=(0.3, 2.0), discs=0.3, boundary=seed % 2 == 0)
    checker = StateChecker(world, ROBOTS[robot])
    stream = LandmarkStream(LandmarkSource(checker, seed=seed), ROADMAP_MIXTURE, seed)
    q = np.array([row for row in (stream.take() for _ in range(600)) if row is not None])
    if len(q):
        assert not Oracle(world, ROBOTS[robot]).collides(q).any()
        assert (np.abs(q[:, 2]) <= math.pi).all()


@pytest.mark.slow
def test_every_free_place_is_hit_in_the_end(narrow: StateChecker) -> None:
    # The only landmark is in a corner. Cells of 2 m by 2 m by a quarter of a turn that are free to 10 % are all hit.
    stream = LandmarkStream(LandmarkSource(narrow, [[1.6, 2.0, 0.0]]), ROADMAP_MIXTURE, 0)
    # The rarest are hit 8 times on average.
    q = taken(stream, 60_000)
    plain = np.random.default_rng(1).uniform((0.0, 0.0, -math.pi), (24.0, 12.0, math.pi), (20_000, 3))
    free = plain[~Oracle(narrow.world, narrow.robot).collides(plain)]
    size = np.array([2.0, 2.0, 0.5 * math.pi])
    per_cell = len(plain) / (12 * 6 * 4)
    cells, count = np.unique(np.floor(free / size), axis=0, return_counts=True)
    wanted = {tuple(cell) for cell in cells[count > 0.1 * per_cell].tolist()}
    assert len(wanted) > 150
    assert wanted <= {tuple(cell) for cell in np.floor(q / size).tolist()}


def test_none_where_nothing_is_valid() -> None:
    checker = StateChecker(World("tiny", (0.0, 0.0, 1.0, 1.0)), Robot.disc(2.0))
    stream = LandmarkStream(LandmarkSource(checker), ROADMAP_MIXTURE, 0)
    assert [stream.take() for _ in range(3)] == [None, None, None]
    assert sum(stream.tally) == 0


LATE = """
import sys
from trailmark.collision import StateChecker
from trailmark.world.library import find_world
from trailmark.motion import kind_of
from trailmark.ompl_bridge.landmark_source import LandmarkSource
from trailmark.ompl_bridge.mixture import ROADMAP_MIXTURE, LandmarkStream, warm_up_sampling
from trailmark.world import World

checker = StateChecker(World.load(find_world("lshape")))
warm_up_sampling(kind_of(checker.robot))
before = set(sys.modules)
query = checker.world.queries[0]
source = LandmarkSource(checker, query=[query.start, query.goal], seed=0)
stream = LandmarkStream(source, ROADMAP_MIXTURE, 0)
for _ in range(1000):
    stream.take()
    stream.near(tuple(query.start), 1.0)
print(len(source.landmarks) > 250, sorted(set(sys.modules) - before))
"""


@pytest.mark.slow
def test_nothing_is_imported_in_the_time_of_a_planner() -> None:
    done = subprocess.run([sys.executable, "-c", LATE], capture_output=True, text=True, check=True, timeout=120.0)
    assert done.stdout == "True []\n"
