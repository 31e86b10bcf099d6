"""World and Query: what they derive, and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark.errors import ConfigurationError, TrailmarkError, WorldError
from trailmark.shapes import Disc, Polygon
from trailmark.world import BOUNDS_LIMIT, Query, Robot, World
from trailmark.world.moving import Moving
from trailmark.world.zones import CostZone

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize(
    ("end", "error"),
    [((0, 0), ConfigurationError), ((0, 0, math.nan), ConfigurationError), ([[0, 0, 0]], WorldError)],
)
def test_a_query_with_a_bad_end_is_refused(end: Any, error: type[Exception]) -> None:
    with pytest.raises(error, match="query 'door': goal"):
        Query("door", (0, 0, 0), end)
    with pytest.raises(error, match="query 'door': start"):
        Query("door", end, (0, 0, 0))


# --- World


@pytest.mark.parametrize(
    "bounds",
    [
        *((0, 0, 1), (0, 0, 1, 1, 1), (1, 0, 1, 1), (0, 2, 1, 1), ("a", 0, 1, 1), None, 7),
        *((0, 0, math.inf, 1), (0, math.nan, 1, 1), (0, 0, 2 * BOUNDS_LIMIT, 1), (0, 0, 10**400, 1)),
    ],
)
def test_bad_bounds_are_refused_in_one_line(bounds: Any) -> None:
    with pytest.raises(WorldError, match="bounds: expected") as caught:
        World("w", bounds)
    assert "\n" not in str(caught.value)


def test_geometries_of_shapely_become_polygons() -> None:
    holed = shapely.box(0, 0, 3, 3) - shapely.box(1, 1, 2, 2)
    square = Polygon(SQUARE[[1, 2, 3, 0]])  # in shapely's order
    world = World("w", (0, 0, 9, 9), (holed, Disc((5, 5), 1)), boundary=shapely.box(0, 0, 9, 9))
    assert isinstance(world.obstacles[0], Polygon)
    assert world.obstacles[0].area == holed.area
    assert world.boundary == Polygon(square.vertices * 9)
    assert Robot(shapely.box(-1, -1, 1, 1)) == Robot.polygon(square.vertices * 2 - 1)
    assert CostZone(shapely.box(0, 0, 1, 1), 2.0) == CostZone(square, 2.0)
    pair = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 2, 3, 3)])
    assert World("w", (0, 0, 9, 9), (pair, holed)).obstacles[0] == square
    assert len(World("w", (0, 0, 9, 9), (pair, holed)).obstacles) == 3
    with pytest.raises(WorldError, match="ids: expected one for each of 2 obstacles, or none, got 1"):
        World("w", (0, 0, 9, 9), (pair,), ids=("pair",))


@pytest.mark.parametrize(
    ("geometries", "problem"),
    [
        ([], "expected bounds or a geometry that is not empty, got neither"),
        ([shapely.box(0, 0, 1, 1), shapely.Point(1, 1)], r"obstacles\[1\]: expected a Polygon or .*, got a Point"),
        (shapely.LineString([(0, 0), (1, 1)]), "got a LineString"),
        ([shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])], r"obstacles\[0\]: polygon: not simple"),
        ([None], r"obstacles\[0\]: expected Disc or Rectangle or Polygon or Moving, got None"),
        ("office", "obstacles: expected a sequence, got 'office'"),
        (7, "obstacles: expected a sequence, got 7"),
    ],
)
def test_other_geometries_are_refused_in_one_line(geometries: Any, problem: str) -> None:
    with pytest.raises(TrailmarkError, match=problem) as caught:
        World.from_shapely(geometries)
    assert "\n" not in str(caught.value)


def test_obstacles_are_added() -> None:
    world = World("w", (0, 0, 9, 9), (Disc((1, 1), 0.5),), Robot.disc(0.1), ids=("bin",))
    pair = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(2, 2, 3, 3)])
    more = world.add(Disc((5, 5), 1), pair, Moving(Disc((3, 3), 0.2), (1, 0), 2))
    assert len(more.obstacles) == 5
    assert more.obstacles[:2] == (world.obstacles[0], Disc((5, 5), 1))
    assert more.ids == ("bin", None, None, None, None)
    assert more.moving[4] is not None
    assert more.robot == world.robot
    assert len(world.obstacles) == 1
    assert world.difference(more).items[0].after == Disc((5, 5), 1)
    assert world.edited(add={"box": shapely.box(0, 0, 1, 1)}).ids == ("bin", "box")
    assert world.add() == world
    for wrong in (7, "disc", None, shapely.Point(1, 1), [Disc((1, 1), 1)]):
        with pytest.raises(TrailmarkError, match="add"):
            world.add(wrong)


def test_queries_are_found_by_name() -> None:
    queries = (Query("door", (0, 0, 0), (1, 1, 0)), Query("desk", (0, 0, 0), (2, 2, 0)))
    world = World("office", (0, 0, 9, 9), queries=queries)
    assert world.query().name == "door"
    assert world.query("desk") is queries[1]
    with pytest.raises(WorldError, match=r"query: expected desk, door, got 'dor' \(did you mean 'door'\?\)"):
        world.query("dor")
    with pytest.raises(WorldError, match="holds no query"):
        World("empty", (0, 0, 1, 1)).query()
    with pytest.raises(WorldError, match="holds no query 'door', give a start and a goal"):
        World("empty", (0, 0, 1, 1)).query("door")
    with pytest.raises(WorldError, match="expected each name once, got 'door' more than once"):
        World("twice", (0, 0, 9, 9), queries=(*queries, queries[0]))
