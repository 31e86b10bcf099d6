"""What a robot sweeps: against its outline, placed at many configurations."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from tests.helpers.random_worlds import ROBOTS

from trailmark.estimation.risk import swept_region


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangle", "L", "disc"])
def test_the_swept_region_is_what_the_robot_covers(name: str) -> None:
    robot = ROBOTS[name]
    states = np.array([[0, 0, 0], [3, 0, 2.5], [3, 2, -2.5], [3, 2, -2.5]])
    region = swept_region(robot, states)
    shapely.prepare(region)
    bodies = []
    for a, b in itertools.pairwise(states):
        turn = (b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
        for t in np.linspace(0, 1, 150):
            x, y, theta = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * turn
            rotation = np.array([[math.cos(theta), math.sin(theta)], [-math.sin(theta), math.cos(theta)]])
            outline = robot.outline.vertices @ rotation + [x, y]
            bodies.append(shapely.Point(x, y).buffer(0.6) if name == "disc" else shapely.Polygon(outline))
    assert shapely.covers(shapely.buffer(region, 1e-9), bodies).all()
    # No point moves farther than 5 cm from one body to the next.
    assert shapely.covers(shapely.buffer(shapely.union_all(bodies), 0.03), region)
    assert shapely.covers(swept_region(robot, states[0]), robot.outline.shapely())


@pytest.mark.slow
def test_far_from_the_origin_it_is_the_same_region() -> None:
    states = np.array([[0, 0, 0], [3, 0, 2.5], [3, 2, -2.5]])
    near = swept_region(ROBOTS["L"], states)
    for offset in (1e4, 1e6):
        far = swept_region(ROBOTS["L"], states + np.array([offset, -offset, 0.0]))
        back = shapely.transform(far, lambda points, o=offset: points - [o, -o])
        assert shapely.hausdorff_distance(near, back) <= 4.0 * np.spacing(offset)
