"""Repair: what is free stays, what collides is planned anew, and what comes out is certified."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark import ConfigurationError, Disc, Path, Rectangle, Robot, StateChecker, World
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.se2 import FloatArray
from trailmark.verify import PathAuditor, repaired

WORLD = World("w", (0.0, 0.0, 20.0, 10.0), (Disc((5, 5), 1.0), Rectangle((10, 5), 1, 3), Disc((12, 5), 0.5)))
ROBOT = Robot.rectangle(1.0, 0.6)
STRAIGHT = np.array([[1.0, 5.0, 0.0], [19.0, 5.0, 0.0]])


def planned(start: FloatArray, goal: FloatArray) -> Path | None:
    return LandmarkPlanner(WORLD, ROBOT, seed=0).plan(start, goal, time_limit=0.3).path


@pytest.mark.slow
@pytest.mark.parametrize("robot", [ROBOT, Robot.disc(0.4), ROBOT.steered(0.8)], ids=["rectangle", "disc", "car"])
def test_broken_parts_are_planned_anew(robot: Robot) -> None:
    auditor = PathAuditor(StateChecker(WORLD, robot))
    planner = LandmarkPlanner(WORLD, robot, seed=0, settings=PlannerSettings(patience=1))
    asked = []

    def plan(start: FloatArray, goal: FloatArray) -> Path | None:
        asked.append((start[0], goal[0]))
        return planner.plan(start, goal, 5.0, max_iterations=1, gap=np.inf).path

    audit = auditor.audit(STRAIGHT)
    assert len(audit.collisions) == 3
    path = repaired(auditor, audit, plan)
    assert auditor.audit(path).free
    assert np.array_equal(path.states[[0, -1]], STRAIGHT)
    assert all(3.0 < a < b < 15.0 for a, b in asked)
    outside = (path.states[:, 0] < 3.0) | (path.states[:, 0] > 15.0)
    assert (path.states[outside, 1] == 5.0).all()


def test_where_there_is_no_way_there_is_no_path() -> None:
    asked = 0

    def plan(start: FloatArray, goal: FloatArray) -> None:
        nonlocal asked
        asked += 1

    auditor = PathAuditor(StateChecker(WORLD, ROBOT))
    assert repaired(auditor, auditor.audit(STRAIGHT), plan) is None
    assert asked == 5  # from farther and farther away


def test_a_plan_that_is_not_free_is_not_returned() -> None:
    auditor = PathAuditor(StateChecker(WORLD, ROBOT))
    audit = auditor.audit(STRAIGHT)
    assert repaired(auditor, audit, lambda start, goal: Path(np.array([start, goal]))) is None


@pytest.mark.parametrize(("start", "end", "name"), [((5, 5, 0), (19, 5, 0), "start"), ((1, 5, 0), (10, 5, 0), "goal")])
def test_ends_in_collision_are_told(start: tuple[float, ...], end: tuple[float, ...], name: str) -> None:
    auditor = PathAuditor(StateChecker(WORLD, ROBOT))
    with pytest.raises(ConfigurationError, match=f"{name} .* is not valid: the robot"):
        repaired(auditor, auditor.audit(np.array([start, end])), planned)
