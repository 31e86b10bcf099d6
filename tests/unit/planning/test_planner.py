"""LandmarkPlanner: its paths judged by shapely, its promises about seeds, time, progress and bad input."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import judge
from tests.helpers.trials import QUICK
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import ConfigurationError, Disc, Path, Polygon, Rectangle, Robot, StateChecker, World, WorldError
from trailmark.landmarks import free_samples
from trailmark.planning import LandmarkPlanner, PlanProgress, PlanResult

LONG = 60.0
"""Seconds: a limit that no test should reach, where rounds are limited instead."""

CAR = Robot.rectangle(1.0, 0.6)


def wall(gap: float, robot: Robot = CAR) -> World:
    """A 20 x 10 m world, a wall across it at x = 10 with one gap around y = 8."""
    low, high = 8.0 - gap / 2, 8.0 + gap / 2
    parts = (Rectangle((10.0, low / 2), 1.0, low), Rectangle((10.0, (10.0 + high) / 2), 1.0, 10.0 - high))
    return World("wall", (0, 0, 20, 10), parts, robot)


def bend(width: float, robot: Robot, size: float = 10.0) -> World:
    """A corridor with one right-angled bend, from (1, 1) east and then north."""
    inner = np.array([[0, width], [size - width, width], [size - width, size], [0, size]], dtype=float)
    return World("bend", (0, 0, size, size), (Polygon(inner),), robot)


def accepted(world: World, start: Any, goal: Any, result: PlanResult, robot: Robot | None = None) -> None:
    """Assert that a result is solved, and true in all that it says about its path."""
    assert result.status == "solved"
    robot = robot or world.robot
    assert robot is not None
    cost = judge(world, robot, start, goal, result.path.states)
    assert result.cost == pytest.approx(cost, abs=1e-9)
    # No vertex is left that a certified motion makes needless.
    q, checker = result.path.states, StateChecker(world, robot)
    assert checker.footprint.is_disc or not checker.motions_valid(q[:-2], q[2:]).any()
    turn = abs(math.atan2(math.sin(goal[2] - start[2]), math.cos(goal[2] - start[2])))
    assert result.lower_bound >= math.dist(start[:2], goal[:2]) + 0.5 * turn - 1e-6
    assert cost >= result.lower_bound - 1e-9
    costs = [entry[1] for entry in result.history]
    assert all(before > after for before, after in pairwise(costs))
    assert costs[0] == result.first_cost
    assert costs[-1] == pytest.approx(cost, abs=1e-9)
    seconds = [entry[0] for entry in result.history]
    assert seconds == sorted(seconds)
    assert result.time["first_solution"] == seconds[0]
    assert 0.0 <= seconds[-1] <= (result.time["total"] or 0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "name"), list(enumerate(ROBOTS)))
def test_paths_in_random_worlds(seed: int, name: str) -> None:
    robot = ROBOTS[name]
    world = random_world(seed, 40, size=40.0, discs=0.3, holes=0.2, boundary=seed % 2 == 1)
    planner = LandmarkPlanner(world, robot, seed=seed, settings=QUICK)
    q = free_samples(planner.checker, 4, random_state=seed)
    q[:, 2] = np.random.default_rng(seed).uniform(-3.0, 3.0, 4) if name == "disc" else q[:, 2]
    solved = 0
    for start, goal in pairwise(q):
        result = planner.plan(start, goal, LONG, max_iterations=2)
        if result.status == "solved":
            accepted(world, start, goal, result, robot)
            solved += 1
        else:
            assert result.path is None
    assert solved >= 2


def test_a_round_robot_turns_evenly_along_its_way() -> None:
    robot = Robot.disc(0.4)
    start, goal = (5.0, 2.0, 2.5), (15.0, 2.0, -2.5)
    result = LandmarkPlanner(wall(1.0), robot, seed=1).plan(start, goal, LONG, max_iterations=3)
    accepted(wall(1.0), start, goal, result, robot)
    states = result.path.states
    assert len(states) > 2
    # The shorter way round, through pi.
    assert result.path.rotation == pytest.approx(2.0 * math.pi - 5.0)
    along = np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T))
    turned = np.cumsum(np.mod(np.diff(states[:, 2]), 2.0 * math.pi))
    assert turned / turned[-1] == pytest.approx(along / along[-1], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("heading", [math.pi / 2, 0.7])
def test_start_and_goal_in_contact(heading: float) -> None:
    # A block at any angle, the robot's side flush with it, on one side at the start and on the other at the goal.
    across = np.array([-math.sin(heading), math.cos(heading)])
    block = Rectangle((10.0, 10.0), 3.0, 2.0, heading)
    world = World("block", (0, 0, 20, 20), (block,), CAR)
    start, goal = ((*(np.array([10.0, 10.0]) + side * 1.3 * across), heading) for side in (-1.0, 1.0))
    checker = StateChecker(world, CAR)
    assert checker.clearance(start) < 1e-9
    assert checker.clearance(goal) < 1e-9
    result = LandmarkPlanner(world, seed=0, settings=QUICK).plan(start, goal, LONG, max_iterations=1)
    accepted(world, start, goal, result)
    assert result.min_clearance == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.63, 0.8])
def test_a_gap_hardly_wider_than_the_robot(gap: float) -> None:
    start, goal = (4.0, 2.0, 1.0), (16.0, 2.0, -2.0)
    result = LandmarkPlanner(wall(gap), seed=0).plan(start, goal, LONG, max_iterations=12, gap=math.inf)
    accepted(wall(gap), start, goal, result)


@pytest.mark.slow
def test_a_bend_that_asks_for_turning_on_the_way() -> None:
    # A rod of length l and width w gets round a bend of width c if l + 2 w <= 2 sqrt(2) c; here with 6 % to spare.
    robot = Robot.rectangle(2.4, 0.3)
    world = bend(1.13, robot)
    start, goal = (1.5, 0.565, 0.0), (9.435, 8.5, math.pi / 2)
    result = LandmarkPlanner(world, seed=0).plan(start, goal, LONG, max_iterations=12, gap=math.inf)
    accepted(world, start, goal, result)


def test_what_is_closed_is_proven_infeasible() -> None:
    ring = np.array([[6.0, 2.0], [14.0, 2.0], [14.0, 8.0], [6.0, 8.0]])
    inside = np.array([[7.0, 3.0], [13.0, 3.0], [13.0, 7.0], [7.0, 7.0]])
    world = World("ring", (0, 0, 20, 10), (Polygon(ring, (inside,)),), CAR)
    planner = LandmarkPlanner(world, seed=0)
    for start, goal in (((2.0, 5.0, 0.0), (10.0, 5.0, 0.0)), ((10.0, 5.0, 0.0), (2.0, 5.0, 0.0))):
        result = planner.plan(start, goal, LONG)
        assert result.status == "infeasible"
        assert (result.path, result.cost, result.first_cost, result.lower_bound) == (None, None, None, None)
        assert result.min_clearance is None
        assert result.history == ()
        assert result.time["first_solution"] is None
    # A gap a little too narrow, which coarse cells cannot tell from one that is wide enough.
    narrow = LandmarkPlanner(wall(0.55), seed=0).plan((4.0, 2.0, 0.0), (16.0, 2.0, 0.0), LONG, max_iterations=12)
    assert narrow.status == "infeasible"


@pytest.mark.slow
def test_what_only_headings_close_is_proven_infeasible() -> None:
    # The inscribed disc gets round the bend; the robot does not.
    world = bend(0.8, Robot.rectangle(4.0, 0.4), 6.0)
    for start, goal in (((2.2, 0.5, 0.0), (5.5, 3.7, math.pi / 2)), ((5.5, 3.7, math.pi / 2), (2.2, 0.5, 0.0))):
        # After two rounds without a path it waits for the proof.
        result = LandmarkPlanner(world, seed=0).plan(start, goal, LONG, max_iterations=2)
        assert result.status == "infeasible"
        assert (result.path, result.lower_bound) == (None, None)


@pytest.mark.slow
def test_the_seed_decides() -> None:
    world = random_world(3, 40, size=40.0, discs=0.3)

    def paths(seed: int) -> list[Any]:
        planner = LandmarkPlanner(world, ROBOTS["L"], seed=seed, settings=QUICK)
        q = free_samples(planner.checker, 3, random_state=1)
        found = [planner.plan(a, b, LONG, max_iterations=1) for a, b in pairwise(q)]
        assert [result.seed for result in found] == [seed] * 2
        return [None if result.path is None else result.path.states.tolist() for result in found]

    assert paths(5) == paths(5)
    assert paths(5) != paths(6)
    assert LandmarkPlanner(world, ROBOTS["L"]).seed != LandmarkPlanner(world, ROBOTS["L"]).seed


@pytest.mark.slow
def test_progress_is_reported() -> None:
    seen: list[PlanProgress] = []
    result = LandmarkPlanner(wall(0.8), seed=0).plan(
        (4.0, 2.0, 1.0), (16.0, 2.0, -2.0), LONG, max_iterations=4, on_progress=seen.append
    )
    assert len(seen) >= 3
    for before, after in pairwise(seen):
        assert before.elapsed <= after.elapsed
        assert before.landmarks <= after.landmarks
        if before.cost is not None:
            assert after.cost <= before.cost + 1e-12
    assert seen[0].cost is None
    assert seen[0].phase
    assert result.cost <= seen[-1].cost + 1e-12
    assert seen[-1].elapsed <= (result.time["total"] or 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("landmarks", [1, 300])
def test_as_many_landmarks_as_asked_for(landmarks: int) -> None:
    world, start, goal = wall(2.0), (4.0, 2.0, 1.0), (16.0, 2.0, -2.0)
    planner = LandmarkPlanner(world, seed=0, landmarks=landmarks, settings=QUICK)
    roadmap = planner.build()
    assert roadmap is planner.roadmap
    assert 0.9 * landmarks <= len(roadmap) <= landmarks
    accepted(world, start, goal, planner.plan(start, goal, LONG, max_iterations=3))
    # Without build() the first query builds.
    lazy = LandmarkPlanner(world, seed=0, landmarks=landmarks, settings=QUICK)
    assert (lazy.plan(start, goal, LONG, max_iterations=3).time["build"] or 0.0) > 0.0


@pytest.mark.parametrize(
    ("start", "goal", "said"),
    [
        ((10.0, 2.0, 0.0), (2, 2, 0), r"start \(10, 2, 0\) is not valid: .* overlaps obstacle 0 \(rectangle\) by \d"),
        ((2, 2, 0), (10.0, 9.5, 0.0), r"goal \(10, 9.5, 0\) is not valid: .* overlaps obstacle 1 \(rectangle\) by \d"),
        ((2, 2, 0), (30.0, 2.0, 0.0), r"goal .* reaches 10.5 m over the right bound"),
        ((2, 2), (2, 2, 0), r"start: expected shape \(3,\) or \(n, 3\) for x, y, theta, got \(2,\)"),
        ((2, 2, math.nan), (2, 2, 0), r"start: \[2.0, 2.0, nan\] holds a value that is not a finite number"),
    ],
)
def test_ends_that_cannot_be(start: Any, goal: Any, said: str) -> None:
    planner = LandmarkPlanner(wall(2.0), seed=0)
    with pytest.raises(ConfigurationError, match=f"^{said}"):
        planner.plan(start, goal)
    assert len(planner.roadmap) == 0


def test_limits_that_cannot_be() -> None:
    world = wall(2.0)
    planner = LandmarkPlanner(world, seed=0)
    for limit in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigurationError, match=f"time limit: expected more than 0, got {limit} s"):
            planner.plan((2, 2, 0), (3, 2, 0), limit)
    with pytest.raises(ConfigurationError, match="max iterations: expected a whole number, 1 or more, got 0"):
        planner.plan((2, 2, 0), (3, 2, 0), max_iterations=0)
    with pytest.raises(ConfigurationError, match="seed: expected a whole number, 0 or more, got -1"):
        LandmarkPlanner(world, seed=-1)
    for k in (0, -5, 10**9):
        with pytest.raises(ConfigurationError, match=f"landmarks: expected a whole number, 1 to .*, got {k}"):
            LandmarkPlanner(world, landmarks=k)
        with pytest.raises(ConfigurationError, match=f"landmarks: expected a whole number, 1 to .*, got {k}"):
            planner.build(k)
    with pytest.raises(WorldError, match="names no robot"):
        LandmarkPlanner(World("bare", (0, 0, 1, 1)))
    full = World("full", (0, 0, 4, 4), (Rectangle((2, 2), 4, 4),), CAR)
    with pytest.raises(ConfigurationError, match="world 'full': no free place for the robot was found"):
        LandmarkPlanner(full, seed=0).build()


def test_planning_ends_once_the_path_is_proven_good_enough() -> None:
    # Around one disc: the shortest path is known, and so is its bound.
    world = World("disc", (0, 0, 20, 20), (Disc((10.0, 10.0), 2.0),), Robot.disc(1.0))
    start, goal = (2.0, 10.0, 0.0), (18.0, 10.0, 0.0)
    shortest = 2.0 * math.sqrt(55.0) + 3.0 * (math.pi - 2.0 * math.acos(3.0 / 8.0))
    for gap in (0.05, 0.005):
        result = LandmarkPlanner(world, seed=0).plan(start, goal, 600.0, gap=gap)
        assert result.lower_bound <= shortest <= result.cost <= (1.0 + gap) * result.lower_bound + 1e-9
        assert result.time["total"] < 600.0  # before the limit
    with pytest.raises(ConfigurationError, match="gap"):
        LandmarkPlanner(world, seed=0).plan(start, goal, gap=-0.1)


@pytest.mark.slow
def test_without_a_path_the_nearest_approach_is_told() -> None:
    # The disc inside the robot gets round the bend, the robot does not, by half a percent.
    planner = LandmarkPlanner(bend(1.055, Robot.rectangle(2.4, 0.3)), seed=0)
    start, goal = np.array((3.0, 0.5, 0.0)), np.array((9.5, 7.0, math.pi / 2))
    result = planner.plan(start, goal, 60.0, max_iterations=2)
    assert result.status == "timeout"
    states = result.nearest.states
    assert (states[0] == start).all()
    assert planner.checker.motions_valid(states[:-1], states[1:]).all()
    assert math.dist(states[-1, :2], goal[:2]) < math.dist(start[:2], goal[:2])


def test_a_solved_result() -> None:
    path = Path(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [3.0, 4.0, -1.0]]))
    times: dict[str, float | None] = {"load": 0.25, "build": 0.5, "first_solution": 1.0, "total": 2.0}
    result = PlanResult("solved", path, 7, 5.5, 9.0, 0.125, 20, 30, ((1.0, 9.0), (2.0, 6.5)), times)
    assert result.cost == 6.5
    record = result.to_dict("office", "door")
    assert record == {
        "world": "office",
        "query": "door",
        "planner": "landmark",
        "status": "solved",
        "reason": "",
        "seed": 7,
        "states": [[0.0, 0.0, 0.0], [3.0, 4.0, 1.0], [3.0, 4.0, -1.0]],
        "cost": 6.5,
        "length": 5.0,
        "rotation": 3.0,
        "min_clearance": 0.125,
        "lower_bound": 5.5,
        "first_cost": 9.0,
        "landmarks": 20,
        "edges": 30,
        "history": [[1.0, 9.0], [2.0, 6.5]],
        "time": times,
    }
    assert json.loads(json.dumps(record, allow_nan=False)) == record
    # A copy: filling in the time of loading does not change the result.
    record["time"]["load"] = 9.0
    assert result.time["load"] == 0.25
