"""Returned paths have no vertex that a certified motion makes needless, and no motion of length 0."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.random_pairs import random_pairs
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.quick import QUICK

from trailmark import LandmarkPlanner, PlanResult, se2
from trailmark.collision import StateChecker
from trailmark.collision.certify import BUDGET
from trailmark.curves import CurvePath
from trailmark.motion import CurveMotion, motion_of
from trailmark.planning.shortening import without_needless
from trailmark.planning.warmup import warm_up

FloatArray = NDArray[np.float64]
Judge = Callable[..., float]

WORLD = random_world(3, 120, size=50.0, radii=(0.5, 3.0), discs=0.3)


def fewer(checker: StateChecker, path: FloatArray) -> FloatArray:
    return np.asarray(without_needless(motion_of(checker).kind, path, BUDGET))


def assert_none_needless(motions: Any, result: PlanResult) -> int:
    """Assert that each inner vertex is needed; return how many there are."""
    assert result.path is not None
    q = result.path.states
    assert (q[1:] != q[:-1]).any(axis=1).all() or len(q) == 2
    free = motions.motions_valid(q[:-2], q[2:])
    assert not free.any()
    return len(q) - 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "L"])
def test_planned_paths(name: str, judge: Judge) -> None:
    planner = LandmarkPlanner(WORLD, ROBOTS[name], seed=4, settings=QUICK)
    pairs = random_pairs(planner, 3, 3)
    vertices = 0
    for _ in range(2):
        for start, goal in pairs:
            result = planner.plan(start, goal, 30.0, max_iterations=2)
            vertices += assert_none_needless(planner.checker, result)
            assert result.path is not None
            judge(WORLD, planner.robot, start, goal, result.path.states)
            assert result.history[-1][1] == pytest.approx(result.path.cost, abs=1e-9)
    assert vertices > 10


@pytest.mark.slow
def test_a_cars_paths() -> None:
    warm_up("curve")
    planner = LandmarkPlanner(WORLD, ROBOTS["rectangle"].steered(1.5), seed=4)
    motions = CurveMotion(planner.checker)
    assert isinstance(planner.motion, CurveMotion)
    lengths = planner.motion.steering.lengths
    knots = 0
    for start, goal in random_pairs(planner, 3, 3):
        result = planner.plan(start, goal, 60.0, max_iterations=1)
        if result.path is None:
            continue
        assert isinstance(result.path, CurvePath)
        q = result.path.knots
        longer = lengths(q[:-2], q[2:]) > lengths(q[:-2], q[1:-1]) + lengths(q[1:-1], q[2:]) + 1e-9
        assert (~motions.motions_valid(q[:-2], q[2:]) | longer).all()
        knots += len(q) - 2
    assert knots > 2


@pytest.mark.slow
def test_what_is_needed_stays_and_costs_do_not_rise() -> None:
    checker = StateChecker(WORLD, ROBOTS["L"])
    planner = LandmarkPlanner(WORLD, ROBOTS["L"], seed=4, checker=checker, settings=QUICK)
    rng = np.random.default_rng(1)
    dropped = 0
    for start, goal in random_pairs(planner, 4, 8):
        path = planner.plan(start, goal, 30.0, max_iterations=1).path
        assert path is not None
        # With needless vertices at random places along it, some of them twice.
        places = np.sort(np.append(rng.uniform(0.0, len(path.states) - 1, 30), np.arange(len(path.states))))
        along = np.minimum(places.astype(int), len(path.states) - 2)
        q = se2.interpolate(path.states[along], path.states[along + 1], places - along)
        q = np.repeat(q, rng.integers(1, 3, len(q)), axis=0)
        if not checker.motions_valid(q[:-1], q[1:]).all():
            continue
        left = fewer(checker, q)
        assert checker.motions_valid(left[:-1], left[1:]).all()
        assert not checker.motions_valid(left[:-2], left[2:]).any()
        assert np.array_equal(left[[0, -1]], q[[0, -1]])
        cost = float(np.sum(se2.distance(q[:-1], q[1:])))
        assert float(np.sum(se2.distance(left[:-1], left[1:]))) <= cost + 1e-9
        dropped += len(q) - len(left)
    assert dropped > 40
