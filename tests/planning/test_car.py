"""Car-like robots: paths of certified curves that a referee drives along, their bounds, what they say of themselves."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world

from trailmark.curves import CurvePath, Steering
from trailmark.landmarks import free_samples
from trailmark.motion import CurveMotion
from trailmark.planning import LandmarkPlanner, PlanProgress, PlanResult
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.verify import check_path
from trailmark.world import Query, Robot, World


def shipped(worlds: Path, name: str, radius: float, reverse: bool = True) -> World:
    world = World.load(worlds / f"{name}.yaml")
    assert world.robot is not None
    return world.with_robot(world.robot.steered(radius, reverse))


def planned(world: World, query: Query, seed: int = 0, **options: Any) -> tuple[LandmarkPlanner, PlanResult]:
    # By length alone: what a driver avoids besides is tested in test_car_objective.py.
    planner = LandmarkPlanner(world, seed=seed, objective="length")
    return planner, planner.plan(query.start, query.goal, **{"time_limit": 20.0, "max_iterations": 3, **options})


def referee(world: World, query: Query, result: PlanResult) -> CurvePath:
    """Assert that the result's path joins the ends and meets nothing; return it."""
    path = result.path
    assert result.status == "solved"
    assert isinstance(path, CurvePath)
    assert world.robot is not None
    assert np.array_equal(path.states[[0, -1]], [query.start, query.goal])
    states = path.resample(0.01).states
    assert not Oracle(world, world.robot).collides(states).any()
    # It drives as a car does: along its heading, on circles of the turning radius at least.
    steps = np.diff(states[:, :2], axis=0)
    turn = np.arctan2(np.sin(np.diff(states[:, 2])), np.cos(np.diff(states[:, 2])))
    heading = states[:-1, 2] + 0.5 * turn
    ahead = np.cos(heading) * steps[:, 0] + np.sin(heading) * steps[:, 1]
    assert np.abs(np.cos(heading) * steps[:, 1] - np.sin(heading) * steps[:, 0]).max() < 1e-6
    assert world.robot.turning_radius is not None
    assert (np.abs(turn) * world.robot.turning_radius <= np.hypot(*steps.T) * 1.001 + 1e-6).all()
    if not world.robot.reverse:
        assert ahead.min() > -1e-6
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", ["parallel", "bay"])
def test_parking(worlds: Path, name: str) -> None:
    world = shipped(worlds, "parking", 4.5)
    query = world.query(name)
    planner, result = planned(world, query)
    path = referee(world, query, result)
    bound = Steering(4.5).lengths(query.start, query.goal)
    assert result.lower_bound is not None
    assert bound - 1e-9 <= result.lower_bound <= path.cost < 3.0 * bound
    assert result.cost == pytest.approx(path.length)
    assert result.first_cost is not None
    assert result.first_cost >= path.cost
    assert isinstance(planner.roadmap.motion, CurveMotion)
    assert CurveMotion(planner.checker).motions_valid(path.knots[:-1], path.knots[1:]).all()


class Office(NamedTuple):
    """What was planned through a door of an office once, and what was told meanwhile."""

    world: World
    query: Query
    result: PlanResult
    seen: list[PlanProgress]


def through_the_door(worlds: Path, reverse: bool) -> Office:
    world, seen = shipped(worlds, "office", 0.6, reverse), list[PlanProgress]()
    query = world.query("door")
    return Office(world, query, planned(world, query, on_progress=seen.append)[1], seen)


@pytest.fixture(scope="module")
def office(worlds: Path) -> Office:
    return through_the_door(worlds, reverse=True)


def require_sound(planned: Office) -> CurvePath:
    path = referee(planned.world, planned.query, planned.result)
    assert planned.result.lower_bound is not None
    assert planned.result.lower_bound <= path.cost + 1e-9
    return path


@pytest.mark.slow
def test_an_office(office: Office) -> None:
    assert require_sound(office).steering == Steering(0.6)


@pytest.mark.slow
def test_an_office_forwards_only(worlds: Path) -> None:
    path = require_sound(through_the_door(worlds, reverse=False))
    assert path.steering == Steering(0.6, reverse=False)
    assert path.cusps == 0


def test_a_free_way_is_the_shortest_curve_itself() -> None:
    world = World("free", (-20.0, -20.0, 20.0, 20.0), robot=Robot.rectangle(2.0, 1.0).steered(3.0))
    query = Query("q", (0.0, 0.0, 0.0), (1.0, 6.0, math.pi))
    _, result = planned(world, query)
    path = referee(world, query, result)
    assert len(path.knots) == 2
    assert (
        path.cost == pytest.approx(result.lower_bound) == pytest.approx(Steering(3.0).lengths(query.start, query.goal))
    )


@pytest.mark.parametrize(("pillar", "room", "rows"), [(0.2, 2e-6, 100), (1.7, 5e-4, 100), (1.6, 0.1, 50)])
def test_straight_lines_from_state_to_state_are_free_as_well(pillar: float, room: float, rows: int) -> None:
    # A pillar within the arc that the car drives along: a chord of 1 mm of sagitta would meet it.
    car = Robot.disc(0.3).steered(2.0)
    beside = 2.0 - 0.3 - room - pillar
    centre = (beside * math.sin(0.8), 2.0 - beside * math.cos(0.8))
    world = World("pillar", (-3.0, -3.0, 5.0, 5.0), (Disc(centre, pillar),), car)
    heard: list[PlanProgress] = []
    _, result = planned(world, Query("around", (0.0, 0.0, 0.0), (2.0, 2.0, 0.5 * math.pi)), on_progress=heard.append)
    assert result.path is not None
    assert result.path.cost == pytest.approx(math.pi, abs=1e-9)
    for path in (result.path, *(progress.path for progress in heard if progress.path is not None)):
        assert check_path(world, car, path.states).free
        # As many as are needed, not everywhere as many as there could be.
        assert len(path) < rows
    # So it is between the rows of its trajectory, and where there are rows between these.
    trajectory = result.path.timed(1.0, 0.5, 1.0)
    for t in (trajectory.t, np.union1d(trajectory.t, np.linspace(0.0, trajectory.duration, 500))):
        assert check_path(world, car, trajectory.at(t)).free


def test_a_three_point_turn_in_an_aisle() -> None:
    walls = (Rectangle((10.0, 7.6), 20.0, 0.8), Rectangle((10.0, 2.4), 20.0, 0.8))
    world = World("aisle", (0.0, 0.0, 20.0, 10.0), walls, Robot.rectangle(2.4, 1.2).steered(2.5))
    query = Query("turn", (10.0, 5.0, 0.0), (10.0, 5.0, math.pi))
    _, result = planned(world, query)
    path = referee(world, query, result)
    assert path.cusps >= 2


@pytest.mark.slow
def test_a_round_car_has_a_heading() -> None:
    wall = Polygon(np.array([(9.5, 0.0), (10.5, 0.0), (10.5, 7.0), (9.5, 7.0)]))
    world = World("wall", (0.0, 0.0, 20.0, 10.0), (wall,), Robot.disc(0.6).steered(1.5, reverse=False))
    query = Query("over", (3.0, 2.0, 0.0), (17.0, 2.0, 0.0))
    _, result = planned(world, query)
    path = referee(world, query, result)
    # The bound knows of the wall too.
    assert result.lower_bound is not None
    assert 1.2 * Steering(1.5, reverse=False).lengths(query.start, query.goal) < result.lower_bound <= path.cost


def test_no_way_for_the_robot_at_all_is_proven() -> None:
    wall = Rectangle((10.0, 5.0), 1.0, 10.0)
    world = World("split", (0.0, 0.0, 20.0, 10.0), (wall,), Robot.rectangle(2.0, 1.0).steered(3.0))
    _, result = planned(world, Query("q", (3.0, 5.0, 0.0), (17.0, 5.0, 0.0)))
    assert result.status == "infeasible"
    assert result.lower_bound is None
    assert result.path is None


@pytest.mark.slow
def test_what_is_too_tight_for_a_car_ends_in_time_with_how_far_it_got() -> None:
    # Out of a dead end that is entered forwards only: a car that does not reverse never comes out again.
    walls = (Rectangle((5.0, 3.9), 10.0, 0.4), Rectangle((5.0, 6.1), 10.0, 0.4), Rectangle((10.2, 5.0), 0.4, 2.6))
    world = World("dead end", (-8.0, -4.0, 20.0, 14.0), walls, Robot.rectangle(2.0, 1.0).steered(3.0, reverse=False))
    query = Query("out", (7.0, 5.0, 0.0), (15.0, 5.0, 0.0))
    _, result = planned(world, query, time_limit=0.4, max_iterations=None)
    assert result.status == "timeout"
    assert result.time["total"] is not None
    assert result.time["total"] < 30.0  # without a limit on its rounds it would not end
    free = world.with_robot(Robot.rectangle(2.0, 1.0).steered(3.0))
    referee(free, query, planned(free, query)[1])


@pytest.mark.slow
def test_the_same_seed_gives_the_same_path_and_queries_share_the_roadmap(worlds: Path) -> None:
    world = shipped(worlds, "office", 0.6)
    query = world.query("coffee")
    planner, first = planned(world, query, seed=4, time_limit=60.0)
    _, second = planned(world, query, seed=4, time_limit=60.0)
    assert first.path == second.path
    assert first.path is not None
    # The way back is there already.
    back = planner.plan(query.goal, query.start, time_limit=60.0, max_iterations=1)
    assert back.path is not None
    assert back.path.cost < 1.05 * first.path.cost


def test_the_record_holds_what_rebuilds_the_curves(office: Office) -> None:
    result = office.result
    record = json.loads(json.dumps(result.to_dict("office", "door")))
    curve = record["curve"]
    assert curve["kind"] == "reeds-shepp"
    again = CurvePath(np.array(curve["knots"]), Steering(curve["turning_radius"], curve["kind"] == "reeds-shepp"))
    assert again == result.path
    assert record["cost"] == record["length"] == again.length
    # Where lines between its states would not be free, there are more of them.
    assert result.path is not None
    assert record["states"] == result.path.states.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False], ids=["reversing", "forwards"])
def test_many_queries_are_answered_on_one_roadmap(reverse: bool) -> None:
    world = random_world(11, 25, size=30.0, radii=(0.5, 2.5))
    planner = LandmarkPlanner(world, ROBOTS["rectangle"].steered(1.5, reverse), seed=0, landmarks=400)
    ends = free_samples(planner.checker, 16, random_state=2).reshape(-1, 2, 3)
    answered = planner.plan_many(ends[:, 0], ends[:, 1], 2.0, max_iterations=1)
    solved = [i for i, result in enumerate(answered) if result.path is not None]
    assert len(solved) >= 6
    judge = Oracle(world, planner.robot, 1e-6)
    for i in solved:
        path = answered[i].path
        assert isinstance(path, CurvePath)
        assert np.array_equal(path.knots[[0, -1]], ends[i])
        assert (path.curves.signed_lengths >= 0.0).all() or reverse
        assert not judge.collides(path.resample(0.02).states).any()
        assert (answered[i].lower_bound or 0.0) <= (answered[i].cost or 0.0) + 1e-9
    # Once more, by threads: what the roadmap answers changes nothing in it, and is answered alike.
    nodes = len(planner.roadmap)
    snapshot = planner._model.shared.snapshot(lambda: planner.relaxation)
    known = ends[[i for i in solved if snapshot.find_path(ends[i, 0].copy(), ends[i, 1].copy()) is not None]]
    assert len(known) >= 4
    alone, beside = (planner.plan_many(known[:, 0], known[:, 1], 2.0, max_iterations=1, workers=n) for n in (1, 2))
    assert len(planner.roadmap) == nodes
    assert [result.cost for result in alone] == [result.cost for result in beside]
