"""Robots: footprints, their discs and radii, and how they may move."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely
from tests.helpers.worlds import ROBOTS

from trailmark import Disc, Polygon, Rectangle, ShapeError
from trailmark.world.robot import TURNING_LIMIT, Robot

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


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


@pytest.mark.parametrize(
    ("text", "robot"),
    [
        ("disc:0.2", Robot.disc(0.2)),
        ("rectangle:0.6x0.4", Robot.rectangle(0.6, 0.4)),
        ("rectangle: 1 x 2", Robot.rectangle(1, 2)),
        ("polygon:0,0;1,0;0,1", Robot.polygon([(0, 0), (1, 0), (0, 1)])),
        ("robot_radius:0.22", Robot.disc(0.22)),
        ("[[0, 0], [1, 0], [0, 1]]", Robot.polygon([(0, 0), (1, 0), (0, 1)])),
        (" [ [0.0,0],[1.,0] ,[.0, 1e0], ] ", Robot.polygon([(0, 0), (1, 0), (0, 1)])),
        ("polygon:-.5,0; 1e1,0; 0,1", Robot.polygon([(-0.5, 0), (10, 0), (0, 1)])),
    ],
)
def test_robots_are_parsed(text: str, robot: Robot) -> None:
    assert Robot.parse(text) == robot


NONE = """disc disc: disc:x disc:0 disc:-1 disc:nan disc:inf disc:1e300 disc:1,2 Disc:1 sphere:1 robot_radius:0
rectangle:1 rectangle:1x2x3 rectangle:1xtwo rectangle:0x1 polygon: polygon:0,0;1,0 polygon:0,0;1,0;2,0
polygon:0,0;1;2,0 polygon:0,0;1,1;1,0;0,1 polygon:0,0,0;1,0,0;0,1,0 [] [[]] [[0,0],[1,0]] [[0,0],[1,0],[0]]
[[0,0],[1,0],[0,1,2]] [[0,0],[1,0],[0,1] [0,0],[1,0],[0,1] [[[0,0],[1,0],[0,1]]]"""


@pytest.mark.parametrize("text", [*NONE.split(), "", "[[0, 0], [1, 0], [0, x]] y"])
def test_other_robots_are_refused_in_one_line(text: str) -> None:
    with pytest.raises(ShapeError) as caught:
        Robot.parse(text)
    assert "expected" in str(caught.value) or "not simple" in str(caught.value)


def test_a_footprint_stands_on_its_reference_point() -> None:
    with pytest.raises(ShapeError, match="centred"):
        Robot(Disc((1, 0), 1))
    with pytest.raises(ShapeError, match="unrotated"):
        Robot(Rectangle((0, 0), 2, 1, 0.1))
    with pytest.raises(ShapeError, match="expected a polygon without holes, got one with 1"):
        Robot(Polygon(SQUARE * 4, (SQUARE + 1,)))


# --- Query


@pytest.mark.parametrize(
    "radius", [0.0, -1.0, math.nan, math.inf, -math.inf, 2 * TURNING_LIMIT, True, "5", [5.0]], ids=repr
)
def test_a_radius_that_is_none(radius: Any) -> None:
    with pytest.raises(ShapeError, match="turning_radius: expected a finite number above 0 and at most 10000, got"):
        Robot.rectangle(2, 1).steered(radius)
