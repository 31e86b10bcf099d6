"""The path being followed, kept, led around and replaced; every path is judged by shapely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.oracles import judge
from tests.helpers.trials import trials
from tests.helpers.worlds import ROBOTS, random_world, star_polygon

from trailmark import ConfigurationError, Disc, KeepOutZone, LandmarkPlanner, Path, PlanResult, Rectangle, Robot, World

OPEN = World("field", (0.0, 0.0, 40.0, 20.0), (Rectangle((20.0, 4.0), 2.0, 8.0),))
START, GOAL = np.array([2.0, 3.0, 0.0]), np.array([38.0, 3.0, 0.0])


def planner_with_path(name: str = "rectangle") -> tuple[LandmarkPlanner, Path]:
    planner = LandmarkPlanner(OPEN, ROBOTS[name], seed=0)
    path = planner.plan(START, GOAL, time_limit=5.0, max_iterations=3).path
    assert path is not None
    return planner, path


def states_of(result: PlanResult) -> np.ndarray:
    return result.path.states


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle", "L"])
def test_a_path_that_no_change_touches_is_kept(name: str) -> None:
    planner, path = planner_with_path(name)
    planner.update(OPEN.edited(add=[Disc((30.0, 18.0), 1.0)]))
    here = path.at(0.3)
    result = planner.replan(here, GOAL, path)
    assert result.kept
    assert "free" in result.reason
    assert np.array_equal(result.path.states[0], here)
    assert result.path.cost == pytest.approx(0.7 * path.cost, rel=1e-6)
    assert result.min_clearance is not None
    judge(planner.world, planner.robot, here, GOAL, states_of(result))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle", "L"])
def test_a_path_that_is_blocked_is_led_around(name: str) -> None:
    planner, path = planner_with_path(name)
    there = path.at(0.7)[:2]
    planner.update(OPEN.edited(add=[Disc((float(there[0]), float(there[1])), 1.0)]))
    here = path.at(0.2)
    result = planner.replan(here, GOAL, path)
    assert (result.status, result.kept, result.reason) == ("solved", False, "the path is blocked")
    judge(planner.world, planner.robot, here, GOAL, states_of(result))
    assert result.cost < 1.2 * 0.8 * path.cost


@pytest.mark.slow
def test_a_much_better_path_takes_the_place_of_one_that_is_free() -> None:
    planner, path = planner_with_path()
    planner.update(OPEN.edited(remove=[0]))
    result = planner.replan(path.at(0.1), GOAL, path, min_gain=0.02)
    assert not result.kept
    assert "instead of" in result.reason
    assert result.cost == pytest.approx(float(planner.motion.least_cost(path.at(0.1), GOAL)))
    planner, path = planner_with_path()
    planner.update(OPEN.edited(remove=[0]))
    assert planner.replan(path.at(0.1), GOAL, path).kept


HALL = World(
    "hall",
    (0.0, 0.0, 10.0, 10.0),
    (
        *(Rectangle((5.0, 0.5 * (a + b)), 0.4, b - a) for a, b in ((2.0, 6.0), (6.0, 7.5), (7.5, 10.0))),
        *(Disc(p, 0.25) for p in ((2.0, 5.0), (3.0, 7.0), (2.5, 9.0), (7.0, 5.0), (8.0, 7.0), (7.5, 9.0), (3.5, 4.0))),
    ),
)
"""A wall with a way around its end; the second of its parts is a door."""

BODY = Robot.rectangle(0.6, 0.4)
DRIVES = {"disc": Robot.disc(0.3), "any": BODY, "differential": BODY.differential(), "car": BODY.steered(0.6)}


def followed_through(robot: Robot, worlds: list[World]) -> list[Path]:
    """Return the paths that a planner replans in worlds one after the other, five in each."""
    planner, start, goal, paths = LandmarkPlanner(worlds[0], robot, seed=0), (1.0, 8.0, 0.0), (9.0, 8.0, 0.0), []
    path = planner.plan(start, goal, time_limit=10.0, max_iterations=1).path
    for world in worlds[1:]:
        planner.update(world)
        for _ in range(5):
            assert path is not None
            path = planner.replan(start, goal, path).path
            assert path is not None
            paths.append(path)
    return paths


@pytest.mark.slow
@pytest.mark.parametrize("name", list(DRIVES))
def test_a_door_that_opens_is_taken(name: str) -> None:
    robot = DRIVES[name]
    opened, zone = HALL.edited(remove=[1]), KeepOutZone(Rectangle((5.0, 6.75), 0.4, 1.5).polygon())
    moved = HALL.edited(replace={1: Rectangle((5.0, 1.0), 0.4, 2.0)})
    best = LandmarkPlanner(opened, robot, seed=0).plan((1.0, 8.0, 0.0), (9.0, 8.0, 0.0)).cost
    assert best is not None
    # It opens, as a wall and as a zone; it opens again after it was closed; it slides to where the way led.
    for worlds in ([HALL, opened], [replace(opened, zones=(zone,)), opened], [opened, HALL, opened], [HALL, moved]):
        *_, before, last = followed_through(robot, worlds)
        assert before.cost == last.cost < 1.2 * best
        judge(worlds[-1], robot, last.states[0], last.states[-1], np.array(last.resample(0.003).states))


def test_no_path_says_so() -> None:
    planner, path = planner_with_path()
    planner.update(OPEN.edited(add=[Rectangle((25.0, 10.0), 1.0, 20.0)]))
    result = planner.replan(START, GOAL, path)
    assert (result.status, result.path, result.kept) == ("infeasible", None, False)
    assert "blocked" in result.reason


def test_ends_in_obstacles_are_said() -> None:
    planner, path = planner_with_path()
    planner.update(OPEN.edited(add={"pallet-7": Disc((2.5, 3.0), 0.5)}))
    result = planner.replan(START, GOAL, path)
    assert (result.status, result.path) == ("infeasible", None)
    assert "the robot overlaps obstacle pallet-7 (disc) by" in result.reason
    planner.update(OPEN.edited(add={"pallet-7": Disc((38.0, 3.0), 0.5)}))
    result = planner.replan(START, GOAL, path, escape=True)
    assert (result.status, result.path) == ("infeasible", None)
    assert "the goal overlaps obstacle pallet-7 (disc) by" in result.reason


@pytest.mark.parametrize(
    ("argument", "value"), [("min_gain", -0.1), ("min_gain", np.nan), ("improvement", -1.0), ("time_limit", 0.0)]
)
def test_bad_options_are_refused(argument: str, value: float) -> None:
    planner, path = planner_with_path()
    with pytest.raises(ConfigurationError, match="expected"):
        planner.replan(START, GOAL, path, **{argument: value})  # type: ignore[arg-type]  # the escape is a bool
    with pytest.raises(ConfigurationError, match="path"):
        planner.replan(START, GOAL, "path.json")  # type: ignore[arg-type]


@pytest.mark.slow
def test_many_changes_never_give_a_path_that_collides() -> None:
    rng = np.random.default_rng(3)
    for seed in trials(2, of=2):
        world, robot = random_world(seed, 60, size=50.0), ROBOTS["rectangle"]
        planner = LandmarkPlanner(world, robot, seed=0)
        free = planner.checker.valid(q := np.column_stack([rng.uniform(2, 48, (500, 2)), rng.uniform(-3, 3, 500)]))
        start, goal = q[free][np.argmin(q[free][:, :2].sum(axis=1))], q[free][np.argmax(q[free][:, :2].sum(axis=1))]
        path = planner.plan(start, goal, time_limit=20.0, max_iterations=1).path
        assert path is not None
        kept = replaced = 0
        for _ in range(20):
            near = path.at(rng.uniform(0.1, 0.9))[:2] + rng.normal(0.0, 2.0, 2)
            if rng.integers(2):
                changed = world.edited(add=[star_polygon(rng, (float(near[0]), float(near[1])), 2.0)])
            else:
                changed = world.edited(remove=[int(rng.integers(len(world.obstacles)))])
            anew = LandmarkPlanner(changed, robot, seed=0)
            if not anew.checker.valid([start, goal]).all():
                continue
            world = changed
            planner.update(world)
            result = planner.replan(start, goal, path)
            kept, replaced = kept + result.kept, replaced + (not result.kept)
            if result.path is None:
                assert anew.plan(start, goal, time_limit=2.0).status != "solved"
                break
            path = result.path
            judge(world, robot, start, goal, path.states)
        assert kept > 2
        assert replaced > 2
