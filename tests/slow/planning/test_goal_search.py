"""Paths to goals: the best of several, exact at their ends, bounded over all of them."""

from __future__ import annotations

import itertools
from functools import cache
from math import pi

import numpy as np
import pytest
from tests.helpers.trials import trials

from trailmark import Disc, Goal, LandmarkPlanner, PlannerSettings, PlanResult, Rectangle, Robot, World
from trailmark.benchmark.referee import Referee
from trailmark.errors import ConfigurationError
from trailmark.planning.incumbent import GAP
from trailmark.se2 import FloatArray

START = np.array([1.0, 1.0, 0.3])
QUICK = PlannerSettings(patience=1)
"""Paths settle at the first round that gains nothing."""
ROBOTS = {
    "rectangle": Robot.rectangle(0.6, 0.4),
    "disc": Robot.disc(0.25),
    "offset": Robot.polygon(np.array([[-0.1, -0.2], [0.7, -0.2], [0.7, 0.2], [-0.1, 0.2]])),
    "car": Robot.rectangle(0.6, 0.4).steered(0.5),
}
WALLS = (
    Rectangle((5.0, 4.0), 0.2, 6.0),
    Rectangle((8.0, 7.0), 0.2, 6.0),
    Rectangle((3.0, 8.0), 2.0, 0.3, 0.4),
    Rectangle((7.0, 2.0), 1.0, 1.0, 0.7),
)


def room(robot: str = "rectangle", *more: Rectangle) -> World:
    return World("room", (0.0, 0.0, 10.0, 10.0), (*WALLS, *more), ROBOTS[robot])


def box(x: float, y: float, half: float) -> list[tuple[float, float]]:
    return [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]


def closed(x: float, y: float, half: float) -> list[Rectangle]:
    """Return four walls around a place."""
    side = 2.0 * half + 0.2
    return [
        Rectangle((x, y - half), side, 0.1),
        Rectangle((x, y + half), side, 0.1),
        Rectangle((x - half, y), 0.1, side),
        Rectangle((x + half, y), 0.1, side),
    ]


def plan(
    world: World,
    *goals: Goal,
    seconds: float = 1.0,
    start: FloatArray = START,
    rounds: int | None = None,
    gap: float = GAP,
) -> PlanResult:
    """Return an answer whose claims were looked at by code that planning does not use."""
    planner = LandmarkPlanner(world, seed=3, settings=QUICK, objective="length")
    result = planner.plan(start, goals, seconds, max_iterations=rounds, gap=gap)
    if result.path is None:
        return result
    goal, states = goals[result.goal.index], result.path.states
    assert goal.contains(states[-1])
    assert result.goal.pose == tuple(states[-1])
    assert result.goal.cost == goal.cost
    assert result.cost == pytest.approx(result.path.cost + goal.cost, abs=1e-12)
    assert result.lower_bound <= result.cost * (1 + 1e-9)
    assert [cost for _, cost in result.history] == sorted({cost for _, cost in result.history}, reverse=True)
    assert result.history[-1][1] >= result.cost - 1e-9
    if len(states) > 1 and world.robot.turning_radius is None:
        assert Referee(world, world.robot).fault(states, states[0], states[-1]) is None
    assert np.array_equal(states[0], start)
    return result


GOALS = {
    "tolerance": Goal((8.5, 2.0, 1.0), position_tolerance=0.4, heading_tolerance=0.5),
    "position": Goal((8.5, 2.0, 1.0), position_tolerance=0.4),
    "across half a turn": Goal((8.5, 2.0, 3.0), heading_tolerance=0.5),
    "half a turn": Goal((8.5, 2.0, 3.0), heading_tolerance=pi),
    "free heading": Goal((8.5, 2.0)),
    "region": Goal(region=box(8.5, 3.0, 0.7)),
    "region with heading": Goal(region=box(8.5, 3.0, 0.7), heading=1.5, heading_tolerance=0.2),
    "mostly blocked": Goal(region=box(5.0, 4.0, 0.45)),
    "partly outside": Goal(region=[(9.0, 1.0), (14.0, 1.0), (14.0, 3.0), (9.0, 3.0)]),
}


@cache
def cost_to(robot: str, *pose: float) -> float:
    """Return what planning to one pose finds."""
    other = LandmarkPlanner(room(robot), seed=3, settings=QUICK).plan(START, pose, 20.0, max_iterations=1)
    assert other.cost is not None
    return other.cost


# Two robots for each kind of goal, all pairs of robots equally often.
PAIRS = list(zip(GOALS, itertools.cycle(itertools.combinations(ROBOTS, 2)), strict=False))
CASES = [(name, robot) for name, pair in PAIRS for robot in pair]


@pytest.mark.parametrize(("name", "robot"), CASES)
def test_a_path_ends_within_its_goal(name: str, robot: str) -> None:
    goal, world = GOALS[name], room(robot)
    # Rounds end it, not the time, which a busy machine would not do with.
    result = plan(world, goal, seconds=20.0, rounds=1, gap=0.01)
    assert result.status == "solved"
    # It costs no more than planning to where one would guess.
    if goal.pose is not None:
        guess = np.array([*goal.pose, START[2]])[:3]
        assert result.cost <= 1.02 * cost_to(robot, *guess.tolist())


def test_the_best_goal_is_chosen_as_by_planning_to_each() -> None:
    rng = np.random.default_rng(11)
    world = room()
    planner = LandmarkPlanner(world, seed=1, settings=QUICK)
    wrong = 0
    for _ in trials(4, of=2):
        poses = rng.uniform([0.5, 0.5, -pi], [9.5, 9.5, pi], (40, 3))
        poses = poses[planner.checker.valid(poses)][:6]
        goals = [Goal(tuple(q), cost=float(rng.choice([0.0, 2.0]))) for q in poses]
        result = plan(world, *goals, seconds=1.0)
        each = [planner.plan(START, q, 0.3) for q in poses]
        costs = [np.inf if r.cost is None else r.cost + g.cost for r, g in zip(each, goals, strict=True)]
        bounds = [(r.lower_bound or np.inf) + g.cost for r, g in zip(each, goals, strict=True)]
        assert result.lower_bound <= min(costs) * (1 + 1e-9)
        assert result.cost >= min(bounds) * (1 - 1e-9)
        wrong += result.cost > 1.02 * min(costs)
    assert wrong == 0


def test_it_is_infeasible_only_if_each_goal_is() -> None:
    world = room("rectangle", *closed(2.5, 4.0, 1.2))
    blocked = [Goal((2.5, 4.0, 0.0)), Goal((2.3, 4.1, 1.0)), Goal((5.0, 4.0, 0.0))]
    result = plan(world, *blocked)
    assert result.status == "infeasible"
    assert result.lower_bound is None
    assert plan(world, *blocked, Goal((9.0, 9.0, 0.0))).status == "solved"


def test_goals_that_are_not_valid_are_left_out_or_refused() -> None:
    world, wall, free = room(), (5.0, 4.0, 0.0), (8.5, 2.0, 1.0)
    result = plan(world, Goal(wall), Goal((20.0, 2.0, 0.0)), Goal(free), seconds=0.5)
    assert result.goal.index == 2
    planner = LandmarkPlanner(world, seed=0)
    with pytest.raises(ConfigurationError, match=r"^goal \(5, 4, 0\) is not valid"):
        planner.plan(START, Goal(wall))
    with pytest.raises(ConfigurationError, match=r"^goal\[0\] \(5, 4, 0\) is not"):
        planner.plan(START, [Goal(wall), Goal((20.0, 2.0, 0.0))])
    with pytest.raises(ConfigurationError, match=r"^start \(5, 4, 0\) is not valid"):
        planner.plan(wall, Goal(free))
    with pytest.raises(ConfigurationError, match=r"goal\[1\]: expected Goal, got"):
        planner.plan(START, [Goal(free), free])  # type: ignore[arg-type]  # that is the point


@pytest.mark.parametrize("robot", ["disc", "rectangle"])
def test_a_point_that_nothing_leads_to_is_proven_so_whatever_the_heading(robot: str) -> None:
    world = room(robot, *closed(7.0, 8.0, 1.2))
    assert plan(world, Goal(pose=(7.3, 8.2)), seconds=2.0).status == "infeasible"
    several = plan(world, Goal(pose=(7.3, 8.2)), Goal(pose=(2.0, 6.0)))
    assert several.status == "solved"
    assert several.goal.index == 1


NEAR, FAR = Goal((5.0, 1.0), position_tolerance=0.3), Goal((8.5, 8.5, 1.0))


def room_planner() -> LandmarkPlanner:
    wall = Rectangle((5.0, 5.0), 4.0, 0.3)
    return LandmarkPlanner(World("room", (0, 0, 10, 10), (wall,), Robot.rectangle(0.6, 0.4)), seed=1)


def test_it_leads_to_another_goal_where_its_own_is_blocked() -> None:
    plans = room_planner()
    path = plans.plan(START, [NEAR, FAR], 0.3).path
    assert path is not None
    plans.update(plans.world.edited(add=[Disc((5.0, 1.0), 0.8)]))
    result = plans.replan(START, [NEAR, FAR], path, improvement=0.1)
    assert result.goal.index == 1
    assert FAR.contains(result.path.states[-1])
    assert "blocked" in result.reason
    # A goal given up is no longer led to.
    other = plans.replan(START, FAR, path)
    assert other.goal is not None
    assert other.reason == "the path leads to another goal"
    with pytest.raises(ConfigurationError, match="is not valid"):
        plans.replan(START, Goal((5.0, 5.0, 0.0)), path)
