"""Landmarks given, made for a query, or spread; what streams draw is valid, and no place is left out for ever."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import Oracle
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Disc, Query, Rectangle, Robot, StateChecker, World
from trailmark.ompl_bridge.landmark_stream import LandmarkSource, LandmarkStream
from trailmark.world.library import find_world


@pytest.fixture(scope="module")
def narrow() -> StateChecker:
    return StateChecker(World.load(find_world("narrow")))


def ends(query: Query) -> np.ndarray:
    return np.array([query.start, query.goal])


def rounds(source: LandmarkSource, count: int) -> list[np.ndarray]:
    made = [source.round(i) for i in range(count)]
    assert all(q is not None for q in made)
    return [q for q in made if q is not None]


def taken(stream: LandmarkStream, n: int) -> np.ndarray:
    """Return n configurations; a batch without a valid one is passed over."""
    rows = (stream.take() for _ in range(20 * n))
    found = [row for _, row in zip(range(n), (row for row in rows if row is not None), strict=False)]
    assert len(found) == n
    return np.array(found)


def test_given_landmarks_are_the_only_round_and_come_first(narrow: StateChecker) -> None:
    source = LandmarkSource(narrow, [[1.6, 2.0, 0.0], [8.2, 8.6, 7.0]])
    (q,) = rounds(source, 1)
    assert q[:, :2].tolist() == [[1.6, 2.0], [8.2, 8.6]]
    assert q[1, 2] == pytest.approx(7.0 - 2.0 * math.pi)
    assert source.round(1) is None
    stream = LandmarkStream(source, 0)
    assert np.array_equal(taken(stream, 2), q)
    assert np.array_equal(source.landmarks, q)
    taken(stream, 500)
    assert stream.drawn == 502


@pytest.mark.parametrize("name", ["narrow", "lshape", "discs"])
def test_landmarks_made_for_a_query_are_valid_and_ever_more(name: str) -> None:
    world = World.load(find_world(name))
    assert world.robot is not None
    checker, query = StateChecker(world), world.queries[0]
    made, again, other = (rounds(LandmarkSource(checker, query=ends(query), seed=seed), 4) for seed in (3, 3, 4))
    assert not Oracle(world, world.robot).collides(np.vstack(made)).any()
    assert all(20 <= len(q) <= 600 for q in made)
    # Centres, guides, more centres, still more.
    assert len(made[3]) > len(made[2]) > len(made[0])
    # Near both ends, to begin with.
    for end in ends(query):
        assert np.hypot(*(made[0][:, :2] - end[:2]).T).min() < 1.5
    assert all(np.array_equal(a, b) for a, b in zip(made, again, strict=True))
    assert not any(np.array_equal(a, b) for a, b in zip(made, other, strict=True))


def test_without_a_query_landmarks_lie_all_over(narrow: StateChecker) -> None:
    (q,) = rounds(LandmarkSource(narrow, seed=1), 1)
    oracle = Oracle(narrow.world, narrow.robot)
    assert not oracle.collides(q).any()
    # Whatever is free has a landmark within a few metres: 24 by 12 m, 120 of them.
    rng = np.random.default_rng(0)
    free = rng.uniform((0.0, 0.0, -math.pi), (24.0, 12.0, math.pi), (2000, 3))
    free = free[~oracle.collides(free)]
    gaps = np.hypot(*(free[:, None, :2] - q[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    assert gaps.max() < 3.0


def test_no_landmarks_where_no_way_exists_or_nothing_is_valid() -> None:
    wall = Rectangle((5.0, 3.0), 0.5, 6.0)
    world = World("split", (0.0, 0.0, 10.0, 6.0), (wall,), robot=Robot.rectangle(0.6, 0.4))
    source = LandmarkSource(StateChecker(world), query=[[1.0, 1.0, 0.0], [9.0, 5.0, 0.0]])
    assert source.round(0) is None
    assert source.infeasible
    assert len(source.landmarks) == 0
    tiny = LandmarkStream(LandmarkSource(StateChecker(World("tiny", (0.0, 0.0, 1.0, 1.0)), Robot.disc(2.0))), 0)
    assert [tiny.take() for _ in range(3)] == [None, None, None]
    assert tiny.drawn == 0


def test_landmarks_keep_to_the_bounds(narrow: StateChecker) -> None:
    source = LandmarkSource(narrow, query=ends(narrow.world.query("second")), bounds=(7.0, 1.0, 17.0, 9.0), seed=0)
    rounds(source, 3)
    x, y, _ = source.landmarks.T
    assert len(x) > 100
    assert (x.min() >= 7.0, x.max() <= 17.0, y.min() >= 1.0, y.max() <= 9.0) == (True,) * 4


def test_a_disc_robot_turns_evenly_on_its_way() -> None:
    world = World("yard", (0.0, 0.0, 20.0, 6.0), (Disc((10.0, 2.0), 1.0),), robot=Robot.disc(0.4))
    source = LandmarkSource(StateChecker(world), query=[[1.0, 2.0, 0.0], [19.0, 2.0, 2.0]], seed=0)
    (q,) = rounds(source, 1)
    assert 0.0 <= q[:, 2].min() <= q[:, 2].max() <= 2.0
    # The farther on, the farther round.
    assert np.corrcoef(q[:, 0], q[:, 2])[0, 1] > 0.98


@pytest.mark.slow
@settings(max_examples=few(15))
@given(st.sampled_from(sorted(ROBOTS)), st.integers(0, 2**16))
def test_what_must_be_valid_is(robot: str, seed: int) -> None:
    world = random_world(seed % 7, 60, size=30.0, radii=(0.3, 2.0), discs=0.3, boundary=seed % 2 == 0)
    stream = LandmarkStream(LandmarkSource(StateChecker(world, ROBOTS[robot]), seed=seed), seed)
    q = np.array([row for row in (stream.take() for _ in range(600)) if row is not None])
    if len(q):
        assert not Oracle(world, ROBOTS[robot]).collides(q).any()
        assert (np.abs(q[:, 2]) <= math.pi).all()


@pytest.mark.slow
def test_every_free_place_is_hit_in_the_end(narrow: StateChecker) -> None:
    # The only landmark is in a corner. Cells of 2 m by 2 m by a quarter of a turn that are free to 10 % are all hit.
    stream = LandmarkStream(LandmarkSource(narrow, [[1.6, 2.0, 0.0]]), 0)
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
