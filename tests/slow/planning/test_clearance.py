"""Clearance: paths keep it by shapely's measure, in every kind of motion; and as much of it as there is, if relaxed."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracles import Oracle, motion_states
from tests.helpers.trials import QUICK

from trailmark import CurvePath, Disc, LandmarkPlanner, Path, Rectangle, Robot, StateChecker, World
from trailmark.errors import ConfigurationError, ShapeError, TrailmarkError

CAR = Robot.rectangle(0.6, 0.4)
ALLOWED = 1e-7
"""Metres by which a path may come nearer than its clearance: touching is allowed."""


def door(gap: float) -> World:
    """A 10 x 6 m world, a wall across it at x = 5 with one gap around y = 3."""
    low, high = 3.0 - gap / 2, 3.0 + gap / 2
    parts = (Rectangle((5.0, low / 2), 0.4, low), Rectangle((5.0, (6.0 + high) / 2), 0.4, 6.0 - high))
    return World("door", (0, 0, 10, 6), parts)


def least(world: World, robot: Robot, path: Path, fine: float = 0.01) -> float:
    """Return the least distance (metres) of a densely sampled path to what blocks the robot, by shapely."""
    if isinstance(path, CurvePath):
        return float(Oracle(world, robot).clearance(path.resample(fine).states).min())
    states = path.states
    moved = np.hypot(*(states[1:, :2] - states[:-1, :2]).T) + np.abs(states[1:, 2] - states[:-1, 2])
    pieces = zip(states[:-1], states[1:], moved, strict=True)
    rows = [motion_states(a[None], b[None], 2 + int(m / fine))[0] for a, b, m in pieces]
    return float(Oracle(world, robot).clearance(np.concatenate(rows)).min())


@pytest.mark.parametrize("robot", [CAR, Robot.disc(0.2)])
def test_a_gap_as_wide_as_the_robot_and_its_clearance(robot: Robot) -> None:
    start, goal = (1.0, 3.0, 0.0), (9.0, 3.0, 0.0)
    for clearance, status in ((0.1, "solved"), (0.3 - 1e-5, "solved"), (0.3 + 1e-4, "infeasible"), (2.0, "infeasible")):
        planner = LandmarkPlanner(door(1.0), robot, clearance=clearance, seed=1, settings=QUICK)
        if clearance > 0.8:
            with pytest.raises(ConfigurationError, match=r"has a clearance of 0\.[78] m there, less than the 2 m"):
                planner.plan(start, goal, 1.0)
            continue
        result = planner.plan(start, goal, 1.0)
        assert result.status == status, clearance
        if result.path is not None:
            assert least(door(1.0), robot, result.path) >= clearance - ALLOWED
            assert result.lower_bound == pytest.approx(8.0)


def test_updates_and_replanned_paths_keep_the_clearance() -> None:
    start, goal = (1.0, 3.0, 0.0), (9.0, 3.0, 0.0)
    world = World("open", (0, 0, 10, 6), (), ids=())
    planner = LandmarkPlanner(world, CAR, clearance=0.3, seed=1, settings=QUICK)
    first = planner.plan(start, goal, 1.0)
    assert first.path is not None
    for n, y in enumerate((3.0, 2.0, 4.2)):
        changed = planner.world.edited(add={f"disc {n}": Disc((3.0 + 2.0 * n, y), 0.5)})
        planner.update(changed)
        result = planner.replan(start, goal, first.path, 1.0)
        assert result.path is not None
        assert least(changed, CAR, result.path) >= 0.3 - ALLOWED
        assert result.clearance == 0.3
    near = planner.replan((3.0, 2.25, 0.0), goal, first.path, 1.0)
    assert near.status == "infeasible"
    assert "has a clearance of 0.05 m there, less than the 0.3 m that it is to keep" in near.reason
    out = planner.replan((3.0, 2.25, 0.0), goal, first.path, 1.0, escape=True)
    assert least(planner.world, CAR, Path(out.path.states[out.escape :])) >= 0.3 - ALLOWED


@pytest.mark.parametrize("robot", [CAR, Robot.disc(0.2)])
def test_relaxed_it_keeps_as_much_as_there_is(robot: Robot) -> None:
    start, goal = (1.0, 3.0, 0.0), (9.0, 3.0, 0.0)
    planner = LandmarkPlanner(door(1.0), robot, clearance=0.5, relax=True, seed=1, settings=QUICK)
    result = planner.plan(start, goal, 4.0)
    assert result.path is not None
    # 0.3 m is what there is on either side in the middle of the gap.
    assert 0.297 < result.clearance <= 0.3
    assert result.clearance <= result.clearance_bound <= 0.5
    assert least(door(1.0), robot, result.path) >= result.clearance - ALLOWED
    easy = LandmarkPlanner(door(1.0), robot, clearance=0.2, relax=True, seed=1, settings=QUICK).plan(start, goal, 1.0)
    assert easy.clearance == easy.clearance_bound == 0.2
    # An end limits it too.
    tight = planner.plan((0.45, 3.0, 0.0), goal, 4.0)
    assert tight.clearance <= (tight.clearance_bound or 0.0) <= 0.25 + 1e-9 if robot.sweep_radius == 0.0 else 0.15
    closed = LandmarkPlanner(door(0.3), robot, clearance=0.5, relax=True, seed=1, settings=QUICK).plan(start, goal, 2.0)
    assert closed.status == "infeasible"
    assert closed.clearance == closed.clearance_bound == 0.0


def test_bad_clearances() -> None:
    for bad in (-0.1, np.nan, np.inf, "0.1", 2e7):
        with pytest.raises(ShapeError, match="robot: clearance: expected a finite number of 0 or more"):
            LandmarkPlanner(door(1.0), CAR, clearance=bad)  # type: ignore[arg-type]
    with pytest.raises(TrailmarkError, match="relax: expected True or False, got 1"):
        LandmarkPlanner(door(1.0), CAR, relax=1)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match=r"clearance: expected the checker's or none, got 0\.2"):
        LandmarkPlanner(door(1.0), checker=StateChecker(door(1.0), CAR), clearance=0.2)
