"""Problem and Job."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.runs import small_world

from trailmark import CurvePath, FormatError, Goal, Path, Query, Robot, Steering, World, WorldError
from trailmark.benchmark.problems import Problem, problems_of, read_problem
from trailmark.formats.grid import cells_of


def test_a_world_poses_one_problem_a_query() -> None:
    world = small_world()
    assert [p.query.name for p in problems_of(world)] == ["ahead", "around"]
    assert [p.query.name for p in problems_of(world, queries=["around"])] == ["around"]
    assert [p.robot for p in problems_of(world, Robot.disc(0.2))] == [Robot.disc(0.2)] * 2
    assert next(problems_of(world)).name == "room-ahead"


def test_what_is_missing_is_reported() -> None:
    world = small_world()
    with pytest.raises(WorldError, match="names no robot"):
        next(problems_of(replace(world, robot=None)))
    with pytest.raises(WorldError, match="holds no query"):
        next(problems_of(replace(world, queries=())))
    with pytest.raises(WorldError, match="did you mean 'ahead'"):
        next(problems_of(world, queries=["ahed"]))
    region = Query("b", (1.0, 1.0, 0.0), Goal(region=[(2.0, 2.0), (3.0, 2.0), (3.0, 3.0)]))
    with pytest.raises(WorldError, match="query 'b': expected a goal that is one configuration"):
        next(problems_of(replace(world, queries=(region,))))


def test_a_problem_travels_as_text(ahead: Problem) -> None:
    there = read_problem(ahead.text)
    assert there.world == ahead.world
    assert there.key == ahead.key
    with pytest.raises(FormatError):
        read_problem("- no\n- world\n")


def test_a_clearance_is_part_of_the_problem_and_travels_with_it(ahead: Problem) -> None:
    wide = next(problems_of(small_world(), Robot.rectangle(0.8, 0.4).keeping(0.15)))
    assert wide.key != ahead.key
    there = read_problem(wide.text)
    assert (there.robot, there.key) == (wide.robot, wide.key)
    assert there.robot.clearance == 0.15


def test_a_grid_map_travels_as_cells() -> None:
    occupied = np.random.default_rng(2).random((12, 20)) < 0.2
    occupied[:2, :2] = occupied[-2:, -2:] = False
    world = World.from_grid(occupied, 0.5, (1.0, -2.0), name="map")
    posed = replace(world, robot=Robot.disc(0.2), queries=(Query("q", (1.5, -1.5, 0.0), (10.5, 3.5, 0.0)),))
    problem = Problem(posed)
    there = read_problem(problem.text)
    cells = cells_of(there.world.obstacles)
    assert (cells.occupied == occupied).all()
    assert there.world == posed
    assert there.key == problem.key
    assert "polygon" not in problem.text


def test_only_the_same_problem_has_the_same_key(ahead: Problem, around: Problem) -> None:
    assert next(problems_of(small_world())).key == ahead.key
    assert around.key != ahead.key
    assert Problem(ahead.world.with_robot(Robot.disc(0.3))).key != ahead.key


def test_a_car_poses_a_problem_of_curves(ahead: Problem) -> None:
    car = next(problems_of(small_world(), Robot.rectangle(0.8, 0.4).steered(1.5, reverse=False)))
    assert car.steering == Steering(1.5, reverse=False)
    assert car.objective == "length of the dubins curves, metres"
    path = car.path([car.query.start, car.query.goal])
    assert isinstance(path, CurvePath)
    assert read_problem(car.text).steering == car.steering
    assert car.key != ahead.key
    assert ahead.steering is None
    assert type(ahead.path([ahead.query.start, ahead.query.goal])) is Path
