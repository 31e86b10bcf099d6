"""Zones: what they refuse, and how worlds carry them."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from trailmark import CostZone, Disc, KeepOutZone, Objective, OneWayZone, Polygon, SpeedZone, StateChecker, check_path
from trailmark.errors import ConfigurationError, TrailmarkError, WorldError
from trailmark.world import BOUNDS_LIMIT, Query, Robot, World, with_keep_outs
from trailmark.world.moving import Moving

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
HOLE = [[0.5, 0.5], [1.0, 0.5], [1.0, 1.0]]
ZONES = (
    CostZone(SQUARE, 3),  # type: ignore[arg-type]  # a list, as people write it
    KeepOutZone(Polygon(np.array(SQUARE), (np.array(HOLE),))),
    OneWayZone(Polygon(np.array(SQUARE)), math.pi / 2, 0.8),
    SpeedZone(Polygon(np.array(SQUARE)), 0.3),
)


def test_a_zone_takes_vertices_or_a_polygon_and_is_a_value() -> None:
    assert ZONES[0].region == Polygon(np.array(SQUARE))
    assert ZONES[0] == CostZone(Polygon(np.array(SQUARE)), 3.0)
    assert ZONES[0] != CostZone(Polygon(np.array(SQUARE)), 4.0)
    assert len({*ZONES, *copy.deepcopy(ZONES)}) == len(ZONES)


@pytest.mark.parametrize(
    ("make", "values", "message"),
    [
        (CostZone, (0.0,), "zone: factor: expected a finite number of 0.1 or more and at most 1e"),
        (OneWayZone, (math.nan, 1.0), "zone: heading: expected a finite number, got nan"),
        (OneWayZone, (0.0, -0.1), "zone: tolerance: expected a finite number of 0 or more and at most 3.14159, got"),
        (SpeedZone, (0.0,), "zone: limit: expected a finite number above 0, got 0.0"),
    ],
)
def test_values_out_of_range_are_refused(make: Any, values: tuple[Any, ...], message: str) -> None:
    with pytest.raises(WorldError) as caught:
        make(SQUARE, *values)
    assert message in str(caught.value)


def test_a_world_carries_zones_through_its_edits() -> None:
    world = World("w", (0, 0, 9, 9), (Disc((5, 5), 1),), zones=list(ZONES))  # type: ignore[arg-type]
    assert world.zones == ZONES
    assert world.edited(remove=[0]).zones == ZONES
    assert "4 zones" in repr(world)
    assert copy.deepcopy(world) == world
    with pytest.raises(WorldError, match="difference: zones: expected the same in both worlds"):
        world.difference(replace(world, zones=ZONES[:2]))


def test_keep_out_zones_are_obstacles_of_the_world_that_is_checked() -> None:
    world = World("w", (0, 0, 9, 9), (Disc((5, 5), 1),), zones=ZONES)
    occupied = with_keep_outs(world)
    assert occupied.obstacles == (Disc((5, 5), 1), ZONES[1].region)
    assert occupied.ids == (None, "keep-out zone 1")
    assert with_keep_outs(occupied) is occupied
    assert occupied.zones == ZONES
    assert with_keep_outs(occupied.edited(remove=[0])).ids == ("keep-out zone 1",)
    assert with_keep_outs(occupied.edited(remove=["keep-out zone 1"])).obstacles == occupied.obstacles
    without = replace(world, zones=(ZONES[0],))
    assert with_keep_outs(without) is without
    with pytest.raises(WorldError, match="'keep-out zone 1' is the name of a zone"):
        with_keep_outs(world.edited(add={"keep-out zone 1": Disc((2, 2), 1)}))


def test_a_checker_keeps_the_whole_robot_out() -> None:
    robot = Robot.rectangle(1.0, 0.4)
    world = World("w", (0, 0, 9, 9), (Disc((5, 5), 1),), robot, zones=ZONES)
    checker = StateChecker(world)
    inside, touching, beyond = (1.0, 1.8, 0.0), (2.5, 1.0, 0.0), (2.49, 1.0, 0.0)
    assert checker.valid([inside, touching, beyond]).tolist() == [False, True, False]
    assert not checker.motion_valid((1.0, 3.0, 0.0), (3.0, 1.0, 0.0))
    with pytest.raises(ConfigurationError, match=r"goal .* is not valid: .* overlaps keep-out zone 1 by 0\.01 m"):
        checker.require_valid(beyond, "goal")
    checker.require_for(world)
    moved = checker.edited(world.edited(move={0: (1.0, 0.0)}))
    assert moved.valid([beyond, (3.7, 5.0, 0.0)]).tolist() == [False, True]
    without = moved.edited(replace(world, zones=()))
    assert without.valid(inside)
    audit = check_path(world, None, [[3.0, 3.0, 0.0], [3.0, 1.0, 0.0], [2.0, 1.0, 0.0], [3.0, 1.0, 0.0]])
    assert [(c.obstacle, round(c.depth, 3)) for c in audit.collisions] == [("keep-out zone 1", 0.5)]


def test_names_and_weighted_sums() -> None:
    assert Objective.of(None) == Objective.of("length") == Objective()
    objective = Objective.of("time", max_speed=0.5, max_turn_rate=2.0)
    assert (objective.length, objective.time, objective.max_speed) == (0.0, 1.0, 0.5)
    assert objective.rotation == 0.5
    assert Objective.of("length=1, clearance=2.5") == Objective(length=1.0, clearance=2.5)
    assert Objective.of("time=2") == Objective(length=0.0, time=2.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("lenght", "expected clearance, length, time, got 'lenght'"),
        ("length=far", "length: expected a number, got 'far'"),
        ("clearance=2", "a weight of length or of time above 0"),
        ("length=1, length=2", "expected each weight once, got 'length=1, length=2'"),
        ("length=1,reverse=0.5", "reverse: expected a finite number of 1 or more"),
    ],
)
def test_what_is_no_objective_is_refused_in_one_line(given: object, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Objective.of(given)  # type: ignore[arg-type]  # on purpose


@pytest.mark.parametrize(
    "bounds",
    [
        *((0, 0, 1), (0, 0, 1, 1, 1), (1, 0, 1, 1), (0, 2, 1, 1), ("a", 0, 1, 1), None, 7),
        *((0, 0, math.inf, 1), (0, math.nan, 1, 1), (0, 0, 2 * BOUNDS_LIMIT, 1), (0, 0, 10**400, 1)),
    ],
)
def test_bad_bounds_are_refused_in_one_line(bounds: Any) -> None:
    with pytest.raises(WorldError, match="bounds: expected"):
        World("w", bounds)


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
