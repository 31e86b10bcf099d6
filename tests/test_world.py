"""World, Robot and Query: what they derive from their footprint, and what they refuse."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from benchmarks.random_worlds import ROBOTS, star_polygon
from hypothesis import given
from hypothesis import strategies as st

from trailmark.errors import ConfigurationError, ShapeError, WorldError
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import BOUNDS_LIMIT, Query, Robot, World

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])

# --- Robot


@pytest.mark.parametrize("name", ROBOTS)
def test_radii_bound_the_footprint(name: str) -> None:
    robot = ROBOTS[name]
    region = robot.outline.shapely()
    rim = shapely.get_coordinates(shapely.segmentize(region.exterior, 0.01))
    disc = isinstance(robot.footprint, Disc)
    reach = np.hypot(*rim.T)
    assert robot.circumradius == pytest.approx(reach.max(), rel=1.1e-3 if disc else 1e-12)
    assert robot.sweep_radius == (0.0 if disc else robot.circumradius)
    inside = region.contains(shapely.Point(0, 0))
    assert robot.reference_radius == pytest.approx(reach.min() if inside else 0.0, abs=1e-4)
    inscribed = robot.inscribed_disc
    center = shapely.Point(inscribed.center)
    assert region.contains(center)
    assert inscribed.radius <= region.exterior.distance(center) * (1 + 1e-12)


@given(st.integers(0, 2**32 - 1))
def test_the_inscribed_disc_is_inside_and_nearly_the_largest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = Robot(star_polygon(rng, (float(rng.uniform(-3, 3)), 0.0), 1.0))
    region = robot.outline.shapely()
    disc = robot.inscribed_disc
    assert region.contains(shapely.Point(disc.center))
    assert disc.radius <= region.exterior.distance(shapely.Point(disc.center)) * (1 + 1e-12)
    # No point of the region is farther from its outline, searched everywhere and around the best one found.
    low, high = np.array(region.bounds[:2]), np.array(region.bounds[2:])
    for _ in range(6):
        points = shapely.points(rng.uniform(low, high, (400, 2)))
        depths = np.where(shapely.contains(region, points), shapely.distance(region.exterior, points), 0.0)
        assert depths.max() <= disc.radius * (1 + 1e-5)
        best, half = shapely.get_coordinates(points[depths.argmax()])[0], (high - low) / 8
        low, high = best - half, best + half


def test_a_disc_turns_in_place_and_its_outline_contains_it() -> None:
    robot = Robot.disc(0.2)
    assert robot.sweep_radius == 0.0
    assert robot.circumradius == robot.reference_radius == robot.inscribed_disc.radius == 0.2
    assert 0.2 <= np.hypot(*robot.outline.vertices.T).min() <= 0.2002


@pytest.mark.parametrize(
    ("text", "robot"),
    [
        ("disc:0.2", Robot.disc(0.2)),
        ("rectangle:0.6x0.4", Robot.rectangle(0.6, 0.4)),
        ("rectangle: 1 x 2", Robot.rectangle(1, 2)),
        ("polygon:0,0;1,0;0,1", Robot.polygon([(0, 0), (1, 0), (0, 1)])),
        ("polygon:-.5,0; 1e1,0; 0,1", Robot.polygon([(-0.5, 0), (10, 0), (0, 1)])),
    ],
)
def test_robots_are_parsed(text: str, robot: Robot) -> None:
    assert Robot.parse(text) == robot


@pytest.mark.parametrize(
    "text",
    [
        "",
        "disc",
        "disc:",
        "disc:x",
        "disc:0",
        "disc:-1",
        "disc:nan",
        "disc:inf",
        "disc:1e300",
        "disc:1,2",
        "rectangle:1",
        "rectangle:1x2x3",
        "rectangle:1xtwo",
        "rectangle:0x1",
        "polygon:",
        "polygon:0,0;1,0",
        "polygon:0,0;1,0;2,0",
        "polygon:0,0;1;2,0",
        "polygon:0,0;1,1;1,0;0,1",
        "polygon:0,0,0;1,0,0;0,1,0",
        "sphere:1",
        "Disc:1",
    ],
)
def test_other_robots_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ShapeError) as caught:
        Robot.parse(text)
    assert "\n" not in str(caught.value)
    assert "allowed" in str(caught.value) or "not simple" in str(caught.value)


def test_a_footprint_stands_on_its_reference_point() -> None:
    with pytest.raises(ShapeError, match="centred"):
        Robot(Disc((1, 0), 1))
    with pytest.raises(ShapeError, match="unrotated"):
        Robot(Rectangle((0, 0), 2, 1, 0.1))
    with pytest.raises(ShapeError, match="1 holes given, allowed: without"):
        Robot(Polygon(SQUARE * 4, (SQUARE + 1,)))


def test_robots_describe_themselves() -> None:
    assert Robot.disc(0.25).describe() == "disc 0.25 m"
    assert Robot.rectangle(0.6, 0.4).describe() == "rectangle 0.6 x 0.4 m"
    assert ROBOTS["L"].describe() == "polygon of 6 vertices"


# --- Query


def test_a_querys_ends_are_wrapped_tuples() -> None:
    query = Query("q", (0, 0, 4.0), [1, 2, -math.pi])  # type: ignore[arg-type]  # a list, as a file gives it
    assert query.start == pytest.approx((0, 0, 4.0 - 2 * math.pi))
    assert query.goal == (1.0, 2.0, math.pi)
    assert isinstance(query.goal, tuple)


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
        (0, 0, 1),
        (0, 0, 1, 1, 1),
        (0, 0, math.inf, 1),
        (0, math.nan, 1, 1),
        (0, 0, 2 * BOUNDS_LIMIT, 1),
        (0, 0, 10**400, 1),
        (1, 0, 1, 1),
        (0, 2, 1, 1),
        ("a", 0, 1, 1),
        None,
        7,
    ],
)
def test_bad_bounds_are_refused_in_one_line(bounds: Any) -> None:
    with pytest.raises(WorldError, match=r"bounds: .* given, allowed: ") as caught:
        World("w", bounds)
    assert "\n" not in str(caught.value)


def test_a_boundary_has_no_holes() -> None:
    with pytest.raises(WorldError, match=r"boundary: .*make the holes obstacles"):
        World("w", (0, 0, 9, 9), boundary=Polygon(SQUARE * 9, (SQUARE + 1,)))


def test_queries_are_found_by_name() -> None:
    queries = (Query("door", (0, 0, 0), (1, 1, 0)), Query("desk", (0, 0, 0), (2, 2, 0)))
    world = World("office", (0, 0, 9, 9), queries=queries)
    assert world.query().name == "door"
    assert world.query("desk") is queries[1]
    with pytest.raises(WorldError, match=r"query 'dor' is not in world 'office'; did you mean 'door'\?"):
        world.query("dor")
    with pytest.raises(WorldError, match="holds no query"):
        World("empty", (0, 0, 1, 1)).query()
    with pytest.raises(WorldError, match="'door' is given more than once"):
        World("twice", (0, 0, 9, 9), queries=(*queries, queries[0]))


def test_a_world_is_a_value() -> None:
    world = World("w", (0, 0, 3, 4), [Disc((1, 1), 0.5)])  # type: ignore[arg-type]  # a list, as a reader builds it
    assert isinstance(world.obstacles, tuple)
    assert world.bounds == (0.0, 0.0, 3.0, 4.0)
    assert world.extent == 5.0
    other = world.with_robot(Robot.disc(0.1))
    assert other.robot == Robot.disc(0.1)
    assert world.robot is None
    assert other.obstacles is world.obstacles
    assert hash(other) == hash(world.with_robot(Robot.disc(0.1)))
