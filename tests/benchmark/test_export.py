"""Problems as the native program reads them: nothing of the world is lost."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark.benchmark.native import problem_text
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Query, Robot, World

QUERY = Query("q", (1.0, 2.0, 0.5), (3.0, 4.0, np.pi))

FRAME = Polygon(
    np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 5.0], [1.0, 5.0]]),
    (np.array([[2.0, 2.0], [4.0, 2.0], [4.0, 4.0], [2.0, 4.0]]),),
)


def exported(world: World, robot: Robot) -> dict[str, Any]:
    problem: dict[str, Any] = json.loads(problem_text(world, robot, QUERY))
    return problem


def region(rows: list[list[float]]) -> shapely.Geometry:
    return shapely.union_all(shapely.polygons(np.array(rows).reshape(-1, 3, 2)))


def test_triangles_fill_the_polygons_and_discs_stay_discs() -> None:
    obstacles = (FRAME, Rectangle((8.0, 3.0), 2.0, 1.0, 0.4), Disc((7.0, 8.0), 0.5))
    problem = exported(World("w", (0.0, 0.0, 10.0, 10.0), obstacles), Robot.disc(0.3))
    whole = shapely.union_all([FRAME.shapely(), obstacles[1].polygon().shapely()])
    assert region(problem["triangles"]).symmetric_difference(whole).area < 1e-12
    assert problem["discs"] == [[7.0, 8.0, 0.5]]
    assert problem["bounds"] == [0.0, 0.0, 10.0, 10.0]
    assert (problem["start"], problem["goal"]) == (list(QUERY.start), list(QUERY.goal))


def test_outside_the_boundary_is_an_obstacle_to_beyond_the_bounds() -> None:
    boundary = Polygon(np.array([[0.0, 0.0], [9.0, 1.0], [6.0, 8.0]]))
    problem = exported(World("w", (0.0, 0.0, 9.0, 9.0), (), None, boundary), Robot.disc(0.3))
    outside = shapely.box(-1.0, -1.0, 10.0, 10.0).difference(boundary.shapely())
    assert region(problem["triangles"]).symmetric_difference(outside).area < 1e-12


def test_an_empty_world_has_no_triangles() -> None:
    problem = exported(World("w", (0.0, 0.0, 9.0, 9.0)), Robot.disc(0.3))
    assert problem["triangles"] == problem["discs"] == []


@pytest.mark.parametrize(
    "robot",
    [
        Robot.rectangle(0.6, 0.4),
        Robot.polygon([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.5, 2.0], [1.5, 0.5], [0.0, 0.5]]),
    ],
)
def test_the_robot_is_smaller_by_less_than_touching(robot: Robot) -> None:
    entry = exported(World("w", (0.0, 0.0, 9.0, 9.0)), robot)["robot"]
    filled, outline = region(entry["triangles"]), robot.outline.shapely()
    assert outline.contains(filled)
    assert shapely.hausdorff_distance(outline, filled) < 1.01e-7
    assert shapely.Polygon(entry["hull"]).equals(outline.convex_hull)
    x, y, radius = entry["inscribed"]
    assert filled.buffer(1e-9).contains(shapely.Point(x, y).buffer(radius))
    assert entry["circumradius"] == pytest.approx(np.hypot(*robot.outline.vertices.T).max())


def test_a_round_robot_is_a_radius_of_which_something_is_left() -> None:
    world = World("w", (0.0, 0.0, 9.0, 9.0))
    assert exported(world, Robot.disc(0.3))["robot"]["radius"] == pytest.approx(0.3 - 1e-7, abs=1e-12)
    assert exported(world, Robot.disc(1e-7))["robot"]["radius"] == pytest.approx(5e-8)
    assert exported(world, Robot.disc(0.3))["robot"]["circumradius"] == 0.3
