"""LandmarkSource: landmarks given, made for a query, or spread; which are refused; what a seed fixes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.helpers.oracles import Oracle

from trailmark.collision import StateChecker
from trailmark.ompl_bridge.landmark_source import LandmarkSource
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Query, Robot, World
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


def test_given_landmarks_are_the_only_round(narrow: StateChecker) -> None:
    given = [[1.6, 2.0, 0.0], [8.2, 8.6, 7.0]]
    source = LandmarkSource(narrow, given)
    (q,) = rounds(source, 1)
    assert q[:, :2].tolist() == [[1.6, 2.0], [8.2, 8.6]]
    assert q[1, 2] == pytest.approx(7.0 - 2.0 * math.pi)
    assert source.round(1) is None
    assert source.made == 1
    assert np.array_equal(source.landmarks, q)


@pytest.mark.parametrize("name", ["narrow", "lshape", "discs"])
def test_landmarks_made_for_a_query_are_valid_and_ever_more(name: str) -> None:
    world = World.load(find_world(name))
    assert world.robot is not None
    checker, query = StateChecker(world), world.queries[0]
    source = LandmarkSource(checker, query=ends(query), seed=3)
    made = rounds(source, 4)
    assert not Oracle(world, world.robot).collides(source.landmarks).any()
    assert all(20 <= len(q) <= 600 for q in made)
    # Centres, guides, more centres, still more.
    assert len(made[3]) > len(made[2]) > len(made[0])
    # Near both ends, to begin with.
    for end in ends(query):
        assert np.hypot(*(made[0][:, :2] - end[:2]).T).min() < 1.5


def test_the_same_seed_makes_the_same_landmarks(narrow: StateChecker) -> None:
    query = ends(narrow.world.query("second"))
    first, again, other = (LandmarkSource(narrow, query=query, seed=seed) for seed in (5, 5, 6))
    for a, b, c in zip(rounds(first, 3), rounds(again, 3), rounds(other, 3), strict=True):
        assert np.array_equal(a, b)
        assert not np.array_equal(a, c)


def test_without_a_query_landmarks_lie_all_over(narrow: StateChecker) -> None:
    source = LandmarkSource(narrow, seed=1)
    (q,) = rounds(source, 1)
    oracle = Oracle(narrow.world, narrow.robot)
    assert not oracle.collides(q).any()
    # Whatever is free has a landmark within a few metres: 24 by 12 m, 120 of them.
    rng = np.random.default_rng(0)
    free = rng.uniform((0.0, 0.0, -math.pi), (24.0, 12.0, math.pi), (2000, 3))
    free = free[~oracle.collides(free)]
    gaps = np.hypot(*(free[:, None, :2] - q[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    assert gaps.max() < 3.0


def test_no_landmarks_where_no_way_exists() -> None:
    wall = Rectangle((5.0, 3.0), 0.5, 6.0)
    world = World("split", (0.0, 0.0, 10.0, 6.0), (wall,), robot=Robot.rectangle(0.6, 0.4))
    source = LandmarkSource(StateChecker(world), query=[[1.0, 1.0, 0.0], [9.0, 5.0, 0.0]])
    assert source.round(0) is None
    assert source.infeasible
    assert len(source.landmarks) == 0


def test_landmarks_keep_to_the_bounds(narrow: StateChecker) -> None:
    source = LandmarkSource(narrow, query=ends(narrow.world.query("second")), bounds=(7.0, 1.0, 17.0, 9.0), seed=0)
    rounds(source, 3)
    x, y, _ = source.landmarks.T
    assert len(x) > 100
    assert x.min() >= 7.0
    assert x.max() <= 17.0
    assert y.min() >= 1.0
    assert y.max() <= 9.0


def test_a_disc_robot_turns_evenly_on_its_way() -> None:
    world = World("yard", (0.0, 0.0, 20.0, 6.0), (Disc((10.0, 2.0), 1.0),), robot=Robot.disc(0.4))
    source = LandmarkSource(StateChecker(world), query=[[1.0, 2.0, 0.0], [19.0, 2.0, 2.0]], seed=0)
    (q,) = rounds(source, 1)
    assert q[:, 2].min() >= 0.0
    assert q[:, 2].max() <= 2.0
    # The farther on, the farther round.
    assert np.corrcoef(q[:, 0], q[:, 2])[0, 1] > 0.98
