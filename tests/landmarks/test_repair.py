"""Centres that the robot cannot use: which they are, by shapely, and what stands in for them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import repair_centres
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]

WORLD = World(
    "room",
    (0.0, 0.0, 20.0, 12.0),
    (
        Disc((5.0, 5.0), 2.0),
        Rectangle((12.0, 3.0), 4.0, 1.0, 0.4),
        Polygon(np.array([[14, 6], [18, 6], [18, 11], [17, 11], [17, 7], [14, 7]])),
        Rectangle((10.0, 9.0), 6.0, 0.5),
        Rectangle((10.0, 10.2), 6.0, 0.5),  # a gap of 0.7 m between the two, which only some headings fit
    ),
    boundary=Polygon(np.array([[0, 0], [20, 0], [20, 12], [4, 12], [0, 8]])),
)
SOLID = shapely.union_all([shape.polygon(1e-5).shapely() for shape in WORLD.obstacles])
assert WORLD.boundary is not None
FREE = WORLD.boundary.shapely().difference(SOLID)
LOOSE, TIGHT = FREE.buffer(1e-3), FREE.buffer(-1e-4)
shapely.prepare(LOOSE)
shapely.prepare(TIGHT)

ROBOTS = [Robot.disc(0.4), Robot.rectangle(1.6, 0.6), Robot.polygon([[-0.3, -0.2], [1.2, -0.2], [1.2, 0.3]])]


def uniform(n: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).uniform((0.0, 0.0), (20.0, 12.0), (n, 2))


def body(robot: Robot, q: FloatArray) -> shapely.Geometry:
    if isinstance(robot.footprint, Disc):
        return shapely.Point(q[:2]).buffer(robot.footprint.radius, quad_segs=64)
    placed = shapely.affinity.rotate(robot.outline.shapely(), q[2], (0, 0), use_radians=True)
    return shapely.affinity.translate(placed, q[0], q[1])


def fits(robot: Robot, place: FloatArray) -> bool:
    """Is there a heading, of those that are tried, at which the robot fits with room to spare?"""
    headings = [0.0] if isinstance(robot.footprint, Disc) else np.linspace(-math.pi, math.pi, 72, endpoint=False)
    return any(TIGHT.contains(body(robot, np.array([*place, heading]))) for heading in headings)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS, ids=Robot.describe)
def test_all_configurations_are_valid_and_the_flags_are_right(robot: Robot) -> None:
    centres, samples = uniform(40, 0), uniform(200, 1)
    found = repair_centres(StateChecker(WORLD, robot), centres, samples)
    assert found.configurations.shape == (40, 3)
    assert all(LOOSE.contains(body(robot, q)) for q in found.configurations)
    points = shapely.points(centres)
    sure = shapely.distance(points, FREE.boundary) > 1e-4
    assert np.array_equal(found.in_obstacle[sure], ~shapely.contains(FREE, points)[sure])
    assert 3 < found.in_obstacle.sum() < 30
    for q, centre, invalid in zip(found.configurations, centres, found.invalid, strict=True):
        if not invalid:
            assert np.array_equal(q[:2], centre)
            continue
        assert not fits(robot, centre)
        assert np.hypot(*(samples - q[:2]).T).min() == 0.0
        nearer = samples[np.hypot(*(samples - centre).T) < np.hypot(*(q[:2] - centre)) - 1e-9]
        assert not any(fits(robot, place) for place in nearer)


def test_a_gap_that_only_some_headings_fit() -> None:
    checker = StateChecker(WORLD, ROBOTS[1])
    found = repair_centres(checker, [[10.0, 9.6]], uniform(10, 0))
    assert not found.invalid[0]
    assert abs(math.sin(found.configurations[0, 2])) < 0.1


def test_a_centre_far_from_all_good_samples() -> None:
    samples = np.vstack([np.random.default_rng(0).uniform(4.5, 5.5, (400, 2)), [[19.0, 1.0]]])
    found = repair_centres(StateChecker(WORLD, ROBOTS[0]), [[5.0, 5.0]], samples)
    assert found.configurations.tolist() == [[19.0, 1.0, 0.0]]


def test_no_place_to_stand() -> None:
    checker = StateChecker(WORLD, ROBOTS[0])
    with pytest.raises(ConfigurationError, match=r"samples: expected one at which the robot \(disc 0.4 m\) can stand"):
        repair_centres(checker, [[5.0, 5.0]], [[5.0, 5.1]])
    with pytest.raises(ConfigurationError, match=r"centres: expected shape \(n, 2\), .* got \(1, 3\)"):
        repair_centres(checker, [[5.0, 5.0, 0.0]], [[5.0, 5.1]])
    with pytest.raises(ConfigurationError, match=r"got \(0, 2\)"):
        repair_centres(checker, [[5.0, 5.0]], np.empty((0, 2)))
