"""Penetration depth: known cases, and that a translation of that length separates and no shorter one does."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from tests.helpers.trials import trials

from trailmark import Robot, ShapeError, se2
from trailmark.penetration import Penetration, bounds_depth
from trailmark.shapes import Disc, Polygon, Rectangle, Shape, triangulate

U_SHAPE = Polygon(np.array([[0, 0], [4, 0], [4, 4], [3, 4], [3, 1], [1, 1], [1, 4], [0, 4.0]]))
RING = Polygon(np.array([[-3, -3], [3, -3], [3, 3], [-3, 3.0]]), (np.array([[-2, -2], [2, -2], [2, 2], [-2, 2.0]]),))
L_ROBOT = Robot.polygon([[0, 0], [1, 0], [1, 0.4], [0.4, 0.4], [0.4, 1], [0, 1]])


@pytest.mark.parametrize(
    ("robot", "shape", "state", "depth"),
    [
        (Robot.disc(0.5), Disc((0, 0), 1.0), (1.2, 0, 0), 0.3),
        (Robot.disc(0.5), Disc((0, 0), 1.0), (1.6, 0, 0), 0.0),
        (Robot.disc(0.5), Rectangle((0, 0), 2, 4), (1.2, 0, 0), 0.3),
        (Robot.disc(0.5), Rectangle((0, 0), 2, 4), (0.2, 0, 0), 1.3),
        (Robot.rectangle(1, 1), Disc((0, 0), 1.0), (1.2, 0, 0), 0.3),
        (Robot.rectangle(1, 1), Rectangle((0, 0), 2, 2), (1.2, 0, 0), 0.3),
        (Robot.rectangle(1, 1), Rectangle((0, 0), 0.02, 10), (0.0, 0, 0), 0.51),
        (Robot.rectangle(1, 1), U_SHAPE, (2, 1.3, 0), 0.2),  # up, out of the bottom of the U
        (Robot.rectangle(1.8, 1), U_SHAPE, (2, 1.3, 0), 0.2),
        (Robot.rectangle(2.2, 1), U_SHAPE, (2, 3.8, 0), 0.7),  # too wide for it: above it
        (Robot.disc(0.5), RING, (1.7, 0, 0), 0.2),
        (Robot.disc(0.5), RING, (0, 0, 0), 0.0),
        (Robot.rectangle(1, 1), RING, (0, -1.7, 0), 0.2),
        (Robot.rectangle(1, 1), RING, (0, -2.5, 0), 1.0),
    ],
)
def test_known_depths(robot: Robot, shape: Shape, state: tuple[float, float, float], depth: float) -> None:
    assert Penetration(robot.footprint, shape).at(np.array([state], dtype=float)) == pytest.approx([depth], abs=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [L_ROBOT, Robot.disc(0.4), Robot.rectangle(1.5, 0.3)])
@pytest.mark.parametrize("shape", [U_SHAPE, RING, Rectangle((1, 1), 3, 1, 0.4), Disc((1, 1), 1.2)])
def test_the_depth_is_the_shortest_way_out(robot: Robot, shape: Shape) -> None:
    rng = np.random.default_rng(0)
    region = (
        shapely.Point(shape.center).buffer(shape.radius, 128) if isinstance(shape, Disc) else shape.polygon().shapely()
    )
    angles = np.linspace(0, 2 * math.pi, 180, endpoint=False)
    for _ in trials(10):
        state = np.array([*rng.uniform(-3.5, 4.5, 2), rng.uniform(-3, 3)])
        depth = float(Penetration(robot.footprint, shape).at(state[None])[0])
        if isinstance(robot.footprint, Disc):
            body = shapely.Point(state[:2]).buffer(robot.footprint.radius, 128)
        else:
            body = shapely.Polygon(se2.transform(state, robot.outline.vertices))
        if depth == 0.0:
            assert shapely.intersection(body, region).area < 1e-3
            continue
        assert shapely.intersects(body, region)
        ways = np.column_stack([np.cos(angles), np.sin(angles)])
        overlap = [
            shapely.intersection(shapely.affinity.translate(body, *(0.98 * depth * w)), region).area for w in ways
        ]
        assert min(overlap) > 0.0
        overlap = [
            shapely.intersection(shapely.affinity.translate(body, *(1.01 * depth * w)), region).area for w in ways
        ]
        assert min(overlap) < 2e-3


@pytest.mark.slow
def test_depths_of_polygons_are_those_of_their_minkowski_difference() -> None:
    rng = np.random.default_rng(1)
    for k in trials(24):
        cells = [shapely.box(i, j, i + 1, j + 1) for i in range(-3, 3) for j in range(-3, 3) if rng.random() < 0.6]
        largest = max(shapely.get_parts(shapely.union_all(cells)), key=lambda part: part.area)
        try:
            shape = Polygon(
                np.array(largest.exterior.coords), tuple(np.array(ring.coords) for ring in largest.interiors)
            )
        except ShapeError:
            continue  # cells that touch by a corner
        robot = (L_ROBOT, Robot.rectangle(1.5, 0.3))[k % 2]
        states = np.column_stack([rng.uniform(-3, 3, (8, 2)), rng.uniform(-3, 3, 8)])
        if k % 3 == 0:  # edges that coincide, but no gap of just the robot's width, into which it would fit
            robot = Robot.rectangle(1.5, 0.5)
            states = np.column_stack([np.round(4 * states[:, :2]) / 4, np.round(states[:, 2]) * math.pi / 2])
        for state, depth in zip(states, Penetration(robot.footprint, shape).at(states), strict=True):
            body = [se2.transform(state, piece) for piece in triangulate(robot.outline)]
            sums = [(a[:, None] - b).reshape(-1, 2) for a in triangulate(shape) for b in body]
            blocked = shapely.union_all([shapely.MultiPoint(points).convex_hull for points in sums])
            origin = shapely.Point(0.0, 0.0)
            expected = blocked.boundary.distance(origin) if blocked.contains(origin) else 0.0
            assert depth == pytest.approx(expected, abs=1e-9)


def test_the_way_back_inside_the_bounds() -> None:
    bounds = (0.0, 0.0, 10.0, 10.0)
    states = np.array([[5, 5, 1], [0.3, 5, 0], [9.9, 9.8, 0], [0.5, 0.5, math.pi / 2]])
    assert bounds_depth(Robot.rectangle(1, 1).footprint, bounds, states) == pytest.approx([0, 0.2, 0.5, 0], abs=1e-12)
    assert bounds_depth(Robot.disc(0.5).footprint, bounds, states) == pytest.approx([0, 0.2, 0.5, 0], abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [L_ROBOT, Robot.disc(0.4)])
def test_a_shape_of_many_vertices_is_as_deep_as_one_of_few(robot: Robot) -> None:
    ring = np.concatenate([np.linspace(a, b, 100, endpoint=False) for a, b in zip(*_sides(U_SHAPE), strict=True)])
    rng = np.random.default_rng(2)
    states = np.column_stack([rng.uniform(-1, 5, (60, 2)), rng.uniform(-3, 3, 60)])
    expected = Penetration(robot.footprint, U_SHAPE).at(states)
    assert np.count_nonzero(expected) > 20
    assert Penetration(robot.footprint, Polygon(ring)).at(states) == pytest.approx(expected, abs=1e-4)


def _sides(polygon: Polygon) -> tuple[np.ndarray, np.ndarray]:
    return polygon.vertices, np.roll(polygon.vertices, -1, axis=0)
