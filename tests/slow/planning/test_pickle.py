"""Planners, checkers and roadmaps that are pickled and copied: the copy answers as the original does."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import pytest
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Disc, LandmarkPlanner, Moving, PlannerSettings, PlanResult, Robot
from trailmark.landmarks import free_samples

WORLD = random_world(3, 40, size=40.0, discs=0.3)
LIMIT = 600.0
"""Seconds: never reached, so that the seed alone decides."""


def used(robot: Robot) -> LandmarkPlanner:
    """Return a planner with a life behind it: queries one by one and many at once, changes, moving obstacles."""
    # A roadmap for many queries that is made soon.
    settings = PlannerSettings(patience=1, probes=40, max_spread_landmarks=200)
    planner = LandmarkPlanner(WORLD, robot, seed=0, warm=False, settings=settings)
    ends = free_samples(planner.checker, 4, random_state=1)
    path = planner.plan(ends[0], ends[1], LIMIT, max_iterations=1).path
    assert path is not None
    planner.plan_many(ends[:2], ends[2:], LIMIT, max_iterations=1)
    world = WORLD.edited(remove=[3], move={5: (0.3, 0.0)})
    planner.update(world)
    planner.replan(ends[0], ends[1], path, LIMIT)
    planner.update(world.edited(add={"cart": Moving(Disc((1.0, 1.0), 0.3), (0.1, 0.0), 2.0)}))
    planner.replan(ends[0], ends[1], path, LIMIT, speed=1.0)
    return planner


def answers(planner: LandmarkPlanner) -> list[PlanResult]:
    """Return answers that depend on all that a planner knows: its roadmap, its randomness, its world."""
    ends = free_samples(planner.checker, 4, random_state=2)
    found = [planner.plan(ends[0], ends[1], LIMIT, max_iterations=1), *planner.plan_many(ends[:2], ends[2:], LIMIT)]
    planner.update(planner.world.edited(remove=["cart", 2], move={7: (0.0, 0.4)}))
    return [*found, planner.plan(ends[2], ends[3], LIMIT, max_iterations=1)]


def same(a: PlanResult, b: PlanResult) -> bool:
    return (a.status, a.path, a.lower_bound, a.landmarks, a.edges) == (
        b.status,
        b.path,
        b.lower_bound,
        b.landmarks,
        b.edges,
    )


class Lived(NamedTuple):
    """A planner with a life behind it as it was copied, and what it answered itself afterwards."""

    pickle: bytes
    deepcopy: LandmarkPlanner
    expected: list[PlanResult]


@pytest.fixture(scope="module")
def lived() -> Callable[[str], Lived]:
    @cache
    def of(name: str) -> Lived:
        planner = used(ROBOTS[name])
        return Lived(pickle.dumps(planner), copy.deepcopy(planner), answers(planner))

    return of


@pytest.mark.parametrize("name", ["rectangle", "disc"])
def test_a_copy_answers_as_the_planner_does(name: str, lived: Callable[[str], Lived]) -> None:
    expected = lived(name).expected
    assert any(result.path for result in expected)
    unpickled = pickle.loads(lived(name).pickle)  # noqa: S301  # made by the test
    for other in (unpickled, lived(name).deepcopy):
        assert all(same(a, b) for a, b in zip(answers(other), expected, strict=True))
