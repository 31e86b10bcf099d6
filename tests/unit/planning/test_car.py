"""Car-like robots: paths of certified curves that a referee drives along, their bounds, what they say of themselves."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import Oracle
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import CurvePath, Disc, Objective, Query, Rectangle, Robot, Steering, World, check_path
from trailmark.landmarks import free_samples
from trailmark.motion import CurveMotion
from trailmark.planning import LandmarkPlanner, PlanProgress, PlanResult


def shipped(worlds: Path, name: str, radius: float, reverse: bool = True) -> World:
    world = World.load(worlds / f"{name}.yaml")
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
    assert np.array_equal(path.states[[0, -1]], [query.start, query.goal])
    states = path.resample(0.01).states
    assert not Oracle(world, world.robot).collides(states).any()
    # It drives as a car does: along its heading, on circles of the turning radius at least.
    steps = np.diff(states[:, :2], axis=0)
    turn = np.arctan2(np.sin(np.diff(states[:, 2])), np.cos(np.diff(states[:, 2])))
    heading = states[:-1, 2] + 0.5 * turn
    ahead = np.cos(heading) * steps[:, 0] + np.sin(heading) * steps[:, 1]
    assert np.abs(np.cos(heading) * steps[:, 1] - np.sin(heading) * steps[:, 0]).max() < 1e-6
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
    assert bound - 1e-9 <= result.lower_bound <= path.cost < 3.0 * bound
    assert result.cost == pytest.approx(path.length)
    assert result.first_cost >= path.cost
    assert isinstance(planner.roadmap.motion, CurveMotion)
    assert CurveMotion(planner.checker).motions_valid(path.knots[:-1], path.knots[1:]).all()


@pytest.fixture(scope="module")
def office(worlds: Path) -> tuple[World, Query, PlanResult]:
    """What was planned through a door of an office once."""
    world = shipped(worlds, "office", 0.6)
    return world, world.query("door"), planned(world, world.query("door"))[1]


@pytest.mark.slow
def test_an_office_both_ways_and_forwards_only(worlds: Path, office: tuple[World, Query, PlanResult]) -> None:
    forwards = shipped(worlds, "office", 0.6, reverse=False)
    query = forwards.query("door")
    for world, result in ((office[0], office[2]), (forwards, planned(forwards, query)[1])):
        path = referee(world, query, result)
        assert path.steering == Steering.of(world.robot)
        assert result.lower_bound <= path.cost + 1e-9
        assert world.robot.reverse or path.cusps == 0


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
    assert result.path.cost == pytest.approx(math.pi, abs=1e-9)
    for path in (result.path, *(progress.path for progress in heard if progress.path is not None)):
        assert check_path(world, car, path.states).free
        # As many as are needed, not everywhere as many as there could be.
        assert len(path) < rows
    # So it is between the rows of its trajectory, and where there are rows between these.
    trajectory = result.path.timed(1.0, 0.5, 1.0)
    for t in (trajectory.t, np.union1d(trajectory.t, np.linspace(0.0, trajectory.duration, 500))):
        assert check_path(world, car, trajectory.at(t)).free


def test_the_record_holds_what_rebuilds_the_curves(office: tuple[World, Query, PlanResult]) -> None:
    result = office[2]
    record = json.loads(json.dumps(result.to_dict("office", "door")))
    curve = record["curve"]
    assert curve["kind"] == "reeds-shepp"
    again = CurvePath(np.array(curve["knots"]), Steering(curve["turning_radius"], curve["kind"] == "reeds-shepp"))
    assert again == result.path
    assert record["cost"] == record["length"] == again.length
    # Where lines between its states would not be free, there are more of them.
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


# A slot for parking, 1.6 m longer than the car.
SLOT_WALLS = (Rectangle((4.0, 2.0), 8.0, 2.0), Rectangle((17.6, 2.0), 8.0, 2.0), Rectangle((10.0, 0.4), 20.0, 0.8))


SLOT_WORLD = World("slot", (0.0, 0.0, 20.0, 8.0), SLOT_WALLS, Robot.rectangle(4.0, 1.8).steered(4.0))


SLOT, ROAD = np.array([10.8, 1.9, 0.0]), np.array([4.0, 5.0, 0.0])


def planned_in_slot(objective: Objective | str | None = None, start: Any = ROAD, goal: Any = SLOT) -> PlanResult:
    planner = LandmarkPlanner(SLOT_WORLD, seed=0, objective=objective)
    result = planner.plan(start, goal, time_limit=60.0, max_iterations=2)
    assert isinstance(result.path, CurvePath)
    assert np.array_equal(result.path.knots[[0, -1]], [start, goal])
    assert not Oracle(SLOT_WORLD, planner.robot).collides(result.path.resample(0.01).states).any()
    return result


@pytest.fixture(scope="module")
def paid() -> PlanResult:
    return planned_in_slot()


@pytest.mark.slow
def test_changes_of_direction_are_what_a_driver_avoids_by_default(paid: PlanResult) -> None:
    plain = planned_in_slot("length")
    assert isinstance(paid.path, CurvePath)
    assert isinstance(plain.path, CurvePath)
    assert paid.path.cusps < plain.path.cusps
    assert plain.cost == plain.path.length
    assert plain.objective is None
    assert paid.cost == pytest.approx(paid.path.length + 3.0 * paid.path.cusps + 0.5 * paid.path.reverse_length)
    assert paid.lower_bound <= paid.cost
    record = paid.to_dict("slot")
    assert record["direction_changes"] == paid.path.cusps
    assert record["reverse_length"] == paid.path.reverse_length
    assert record["objective"]["direction_change"] == 3.0
