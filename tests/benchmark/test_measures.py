"""Measures of paths: by hand, and the least clearance against a dense walk along the path."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from tests.benchmark.conftest import GOAL, START, small_world

from trailmark import se2
from trailmark.benchmark.referee import PRECISE, Referee, path_measures
from trailmark.curves import CurvePath, Steering
from trailmark.path import Path
from trailmark.shapes import Disc, Polygon
from trailmark.world import Robot, World

ROBOT = Robot.rectangle(0.8, 0.4)
EMPTY = World("empty", (-50.0, -50.0, 50.0, 50.0))
SCALE = 0.2


def test_a_straight_path_is_smooth_and_a_place_has_no_length() -> None:
    judge = Referee(EMPTY, ROBOT)
    found = path_measures(judge, [(0, 0, 0), (3, 0, 1), (10, 0, 0)], SCALE)
    assert (found.smoothness, found.max_curvature) == (0.0, 0.0)
    turned = path_measures(judge, [(0, 0, 0), (0, 0, 3)], SCALE)
    assert (turned.smoothness, turned.max_curvature) == (0.0, 0.0)


def test_a_corner() -> None:
    found = path_measures(Referee(EMPTY, ROBOT), [(0, 0, 0), (4, 0, 0), (4, 0, 1), (4, 6, 0)], SCALE)
    assert found.smoothness == pytest.approx(0.5 * math.pi / 10.0)
    assert found.max_curvature == pytest.approx(0.5 * math.pi / SCALE)
    # A circle of many short motions is measured as a circle, not as corners.
    angles = np.linspace(0.0, math.pi, 400)
    circle = np.column_stack([3.0 * np.cos(angles), 3.0 * np.sin(angles), np.zeros(400)])
    round_one = path_measures(Referee(EMPTY, ROBOT), circle, SCALE)
    assert round_one.smoothness == pytest.approx(1.0 / 3.0, rel=1e-2)
    assert round_one.max_curvature == pytest.approx(1.0 / 3.0, rel=5e-2)


@pytest.mark.parametrize("scale", [0.2, 1.5])
def test_a_car_has_the_curvature_of_its_circles(scale: float) -> None:
    car = ROBOT.steered(4.5)
    judge = Referee(EMPTY, car)
    # A parking manoeuvre: sideways, by several changes of direction.
    states = np.array([(0.0, 0.0, 0.0), (0.0, 2.0, 0.0)])
    found = path_measures(judge, states, scale)
    assert found.max_curvature == pytest.approx(1.0 / 4.5, rel=0.05)
    path = CurvePath(states, Steering(4.5))
    assert path.cusps > 0
    wanted = (path.rotation + math.pi * path.cusps) / path.length
    assert found.smoothness == pytest.approx(wanted, rel=0.05)


def least(world: World, robot: Robot, states: np.ndarray) -> float:
    """The least distance on a walk of a few millimetres, with shapes of shapely's own."""
    outline = robot.outline.vertices if not isinstance(robot.footprint, Disc) else np.zeros((1, 2))
    radius = robot.footprint.radius if isinstance(robot.footprint, Disc) else 0.0
    solid = [shape.polygon().shapely() for shape in world.obstacles if not isinstance(shape, Disc)]
    discs = [shape for shape in world.obstacles if isinstance(shape, Disc)]
    corners = se2.transform(Path(states).resample(4e-3).states, outline)
    bodies = shapely.points(corners[:, 0]) if radius else shapely.polygons(corners)
    apart = [shapely.distance(bodies, shape).min() for shape in solid]
    apart += [shapely.distance(bodies, shapely.Point(disc.center)).min() - disc.radius for disc in discs]
    apart.append(np.min([corners - world.bounds[:2], np.array(world.bounds[2:]) - corners]))
    if world.boundary is not None:
        apart.append(shapely.distance(bodies, world.boundary.shapely().exterior).min())
    return float(min(apart)) - radius


@pytest.mark.parametrize("robot", [ROBOT, Robot.disc(0.3)], ids=["rectangle", "disc"])
@pytest.mark.parametrize("bent", [False, True], ids=["bounds", "boundary"])
def test_the_least_clearance(robot: Robot, bent: bool) -> None:
    world = small_world()
    if bent:
        outline = Polygon(np.array([[0.2, 0.1], [9.9, 0.2], [9.9, 5.9], [6.0, 5.5], [0.1, 5.9]]))
        world = World("bent", world.bounds, world.obstacles, boundary=outline)
    judge = Referee(world, robot)
    rng = np.random.default_rng(3)
    accepted = 0
    while accepted < 2:
        middle = rng.uniform((1.0, 1.0, -3.0), (9.0, 5.0, 3.0), (2, 3))
        states = np.vstack([START, middle, GOAL])
        if judge.fault(states, START, GOAL) is not None:
            continue
        accepted += 1
        found, wanted = path_measures(judge, states, SCALE).min_clearance, least(world, robot, states)
        # The walk may step over the very place by two millimetres.
        assert -5e-3 <= found - wanted <= 3.0 * PRECISE


def test_a_large_disc_far_away_counts_before_a_small_one_near_by() -> None:
    # The nearest box is the small disc's, the nearest disc is the large one.
    world = World("discs", (-50.0, -50.0, 50.0, 50.0), (Disc((0.0, 3.0), 0.05), Disc((-7.0, -7.0), 5.0)))
    judge = Referee(world, Robot.disc(0.5))
    found = judge.clearance(np.array([(-2.4, -2.4, 0.0), (0.0, 0.0, 0.0), (0.0, 3.2, 0.0)]))
    away = math.hypot(4.6, 4.6) - 5.0 - 0.5
    np.testing.assert_allclose(found, [away, math.hypot(0, 3) - 0.55, 0.0], atol=2e-6)


@pytest.mark.parametrize("robot", [ROBOT, Robot.disc(0.3)], ids=["rectangle", "disc"])
def test_what_is_further_away_than_is_asked_for_stays_further_away(robot: Robot) -> None:
    judge = Referee(small_world(), robot)
    states = np.random.default_rng(5).uniform((0.0, 0.0, -3.0), (10.0, 6.0, 3.0), (500, 3))
    whole = judge.clearance(states)
    for up_to in (0.0, 0.1, 0.5):
        found, near = judge.clearance(states, up_to), whole <= up_to
        np.testing.assert_array_equal(found[near], whole[near])
        assert (found[~near] > up_to).all()
        assert near.any()
        assert not near.all()
