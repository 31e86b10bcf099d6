"""Obstacles grown for one robot's errors of heading do not cover a robot that they move farther."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.grown import grown_world

from trailmark import Disc, Query, Robot, StateChecker, World
from trailmark.errors import WorldError
from trailmark.estimation import regrow
from trailmark.world import ObstacleEstimate, RiskBound

SMALL, LONG = Robot.rectangle(0.6, 0.4), Robot.rectangle(4.0, 0.5)
POSE = np.diag([1e-4, 1e-4, 0.05**2])


def grown(robot: Robot, pose: np.ndarray | None = POSE) -> World:
    estimate = ObstacleEstimate(Disc((5.0, 5.0), 1.0), np.diag([0.01, 0.01]))
    return grown_world([estimate], (0.0, 0.0, 12.0, 10.0), 0.95, robot=robot, pose_covariance=pose)


@pytest.mark.parametrize("first", [SMALL, Robot.disc(0.3)])
def test_a_robot_that_reaches_farther_is_refused(first: Robot) -> None:
    world = grown(first)
    for given in (world, world.with_robot(LONG)):
        with pytest.raises(WorldError, match=r"grown for a robot that reaches .*, got robot rectangle 4 x 0.5 m"):
            StateChecker(given, LONG)
    again = regrow(world.with_robot(LONG), 0.95)
    assert StateChecker(again).robot == LONG
    assert again.obstacles[0].area > world.obstacles[0].area


def test_one_that_reaches_no_farther_is_covered() -> None:
    world = grown(LONG)
    for robot in (LONG, SMALL, Robot.disc(3.0), Robot.rectangle(0.5, 4.0)):
        StateChecker(world, robot)


def test_without_errors_of_heading_any_robot_is_covered() -> None:
    for pose in (None, np.diag([1e-4, 1e-4, 0.0])):
        StateChecker(grown(SMALL, pose), LONG)
    assert RiskBound(0.9).covers(LONG)
    assert not RiskBound(0.9, POSE, 0.1).covers(LONG)
    StateChecker(World("plain", (0.0, 0.0, 12.0, 10.0), queries=(Query("a", (1, 1, 0), (2, 1, 0)),)), LONG)


def test_the_growth_for_the_longer_robot_keeps_the_confidence() -> None:
    """Against draws of the true obstacle and of where the robot truly is."""
    rng = np.random.default_rng(0)
    estimate = ObstacleEstimate(Disc((5.0, 5.0), 1.0), np.diag([0.01, 0.01]))
    world = regrow(grown(SMALL).with_robot(LONG), 0.95)
    checker = StateChecker(world)
    states = rng.uniform([3.0, 3.0, -np.pi], [7.0, 7.0, np.pi], (20_000, 3))
    states = states[checker.valid(states) & (checker.clearance(states) < 0.02)][:40]
    assert len(states) == 40
    hits = 0
    for q in states:
        where = rng.multivariate_normal(q, POSE, 200)
        discs = rng.multivariate_normal((5.0, 5.0), estimate.covariance, 200)
        turned = (discs - where[:, :2])[:, None] @ np.array(
            [[np.cos(where[:, 2]), -np.sin(where[:, 2])], [np.sin(where[:, 2]), np.cos(where[:, 2])]]
        ).transpose(2, 0, 1)
        outside = np.maximum(np.abs(turned[:, 0]) - (2.0, 0.25), 0.0)
        hits += int((np.hypot(*outside.T) < 1.0).sum())
    assert hits <= 0.05 * 40 * 200
