"""Goal: what it holds, what is nearest in it, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np
import pytest
import shapely

from trailmark import Goal, OneWayZone, Polygon, Query, Rectangle
from trailmark.errors import ConfigurationError, InputWarning

L_SHAPE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)])
TILTED = np.array([(5000.1, 3000.3), (5003.7, 3001.9), (5002.2, 3004.4)])
GOALS = (
    Goal((1.0, 2.0, 0.5)),
    Goal((1.0, 2.0)),
    Goal((1.0, 2.0, 3.1), position_tolerance=0.3, heading_tolerance=0.2),
    Goal((1e5, -1e5 / 3.0, -pi), position_tolerance=0.1, heading_tolerance=1e-3),
    Goal((1.0, 2.0, 0.5), heading_tolerance=pi),
    Goal((0.1, 0.7, 1.0), heading_tolerance=3.1415),
    Goal(region=L_SHAPE),
    Goal(region=TILTED, heading=-3.0, heading_tolerance=0.4, cost=2.0),
    Goal(region=Polygon(L_SHAPE), heading=1.0),
)


@pytest.mark.parametrize("goal", GOALS)
def test_what_is_nearest_or_drawn_lies_inside_exactly(goal: Goal) -> None:
    rng = np.random.default_rng(5)
    center, radius = goal.disc
    q = np.column_stack([center + rng.normal(0.0, 1.0 + 2.0 * radius, (400, 2)), rng.uniform(-9.0, 9.0, 400)])
    for found in (goal.nearest(q), goal.draw(rng, 400)):
        assert goal.contains(found).all()
        assert (np.hypot(*(found[:, :2] - center).T) <= radius * (1 + 1e-9)).all()
        assert ((found[:, 2] > -pi) & (found[:, 2] <= pi)).all()
    # What is inside stays as it is.
    inside = goal.draw(rng, 50)
    assert np.array_equal(goal.nearest(inside), inside)
    assert goal.contains(q[0]).shape == ()


def test_a_region_is_the_polygons_with_its_outline() -> None:
    goal, region = Goal(region=L_SHAPE), shapely.Polygon(L_SHAPE)
    xy = np.random.default_rng(1).uniform(-1.0, 5.0, (2000, 2))
    q = np.column_stack([xy, np.zeros(2000)])
    assert np.array_equal(goal.contains(q), shapely.intersects_xy(region, *xy.T))
    assert goal.contains([[4.0, 0.5, 2.0], [1.0, 1.0, 0.0]]).all()
    away = np.hypot(*(goal.nearest(q) - q)[:, :2].T)
    assert away == pytest.approx(shapely.distance(region, shapely.points(xy)), abs=1e-9)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected a pose or a region, got neither"),
        ({"pose": (0, 0), "region": L_SHAPE}, "expected a pose or a region, got both"),
        ({"pose": (0, 0, 0, 0)}, r"expected \[x, y, theta\] or \[x, y\], got shape \(4,\)"),
        ({"pose": (0, np.nan)}, "not a finite number"),
        ({"pose": (0, 0, 0), "position_tolerance": -0.1}, "position_tolerance: expected a finite number of 0 or more"),
        ({"pose": (0, 0), "heading": 0.1}, "heading: expected the heading of a pose in the pose"),
        ({"pose": (0, 0, 0), "cost": -1}, "cost: expected 0 or more, got -1 .only differences count"),
        ({"region": [(0, 0), (1, 1), (2, 2)]}, "region: polygon: .*"),
        ({"region": L_SHAPE, "position_tolerance": 0.1}, "position_tolerance: expected a pose, got a region"),
    ],
)
def test_what_is_no_goal_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Goal(**options)  # type: ignore[arg-type]  # that is the point


@pytest.mark.parametrize(
    "make",
    [
        lambda: Goal((6.5, 1.0, 90.0)),
        lambda: Query("a", (0, 0, 0), (1, 1, 45)),
        lambda: Rectangle((0.0, 0.0), 1.0, 2.0, 30.0),
        lambda: OneWayZone(Polygon(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)])), 90.0, 0.5),
    ],
)
def test_angles_that_look_like_degrees_are_warned_of(make: Callable[[], object]) -> None:
    with pytest.warns(InputWarning, match="is taken as radians; are they degrees"):
        make()
