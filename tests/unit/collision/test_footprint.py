"""The footprint's discs: the cover leaves nothing out, the inner discs do not stick out, erosion is bounded."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.worlds import ROBOTS, star_polygon

from trailmark import Robot, StateChecker, World
from trailmark.collision.footprint import build_footprint
from trailmark.shapes import Disc, signed_area
from trailmark.touching import TOUCHING_TOLERANCE, eroded, overlap_core

SHAPES = {
    **ROBOTS,
    "needle": Robot.rectangle(4.0, 1e-6),
    "frame": Robot.polygon([(-2, -2), (2, -2), (2, 2), (1.9, 2), (1.9, -1.9), (-1.9, -1.9), (-1.9, 2), (-2, 2)]),
    "far reference": Robot.polygon([(100, 100), (101, 100), (100.5, 101)]),
    "speck": Robot.rectangle(1e-3, 5e-4),
    "giant": Robot.rectangle(500.0, 300.0),
    "comb": Robot.polygon(
        [(0, 0), (9, 0), *[p for i in range(8, 0, -2) for p in ((i + 0.5, 5), (i, 0.1), (i - 0.5, 5))]]
    ),
}


def assert_bounded_by_discs(robot: Robot) -> None:
    footprint = build_footprint(robot)
    region = robot.outline.shapely()
    size = robot.circumradius
    rng = np.random.default_rng(0)
    # The triangles' corners and random points of each: all of the footprint, its rim above all.
    corners = shapely.get_coordinates(shapely.constrained_delaunay_triangles(region)).reshape(-1, 4, 2)[:, :3]
    weights = np.concatenate([np.eye(3), rng.dirichlet([0.4] * 3, 200)])
    points = (weights @ corners).reshape(-1, 2)
    gaps = np.hypot(*(points[:, None] - footprint.cover[:, :2]).transpose(2, 0, 1)) - footprint.cover[:, 2]
    assert gaps.min(axis=1).max() <= 1e-12 * size
    assert len(footprint.inner) > 0
    assert (footprint.inner[:, 2] > 0.0).all()
    centers = shapely.points(footprint.inner[:, :2])
    assert shapely.contains(region, centers).all()
    assert (footprint.inner[:, 2] <= shapely.distance(region.exterior, centers)).all()
    assert footprint.inner[0, 2] == footprint.inner[:, 2].max()
    assert footprint.circumradius == pytest.approx(np.hypot(*robot.outline.vertices.T).max())
    assert signed_area(footprint.outline) > 0.0


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
def test_discs_bound_random_footprints(seed: int) -> None:
    rng = np.random.default_rng(seed)
    center = (float(rng.uniform(-2, 2)), float(rng.uniform(-2, 2)))
    assert_bounded_by_discs(Robot(star_polygon(rng, center, float(rng.uniform(0.1, 5.0)))))


@pytest.mark.parametrize("name", ["rectangle", "L", "star", "comb", "frame"])
@pytest.mark.parametrize("depth", [1e-7, 3e-7, 1e-3])
def test_erosion_takes_off_what_it_says(name: str, depth: float) -> None:
    region = SHAPES[name].outline.shapely()
    left = eroded(region, depth)
    assert region.contains(left)
    # No deeper than said, and everywhere at least 0.9 of it (at reflex corners an arc is a polyline).
    rim = shapely.points(shapely.get_coordinates(left))
    distance = shapely.distance(region.exterior, rim)
    assert distance.min() >= 0.9 * depth
    rng = np.random.default_rng(1)
    points = shapely.points(rng.uniform(region.bounds[:2], region.bounds[2:], (2000, 2)))
    kept = shapely.contains(left, points)
    deep = shapely.contains(region, points) & (shapely.distance(region.exterior, points) > depth * (1 + 1e-6))
    assert kept[deep].all()


TIPS = {
    "needle": [[0.0, 0.0], [1.0, -1e-3], [1.0, 1e-3]],
    "0.01 degrees": [[0.0, 0.0], [2.0, -2.0 * np.tan(np.deg2rad(0.01))], [2.0, 2.0 * np.tan(np.deg2rad(0.01))]],
    "blunt": [[0.0, -1e-9], [1.0, -1e-4], [1.0, 1e-4], [0.0, 1e-9]],
    "antenna": [
        [0.0, 0.0],
        [1.0, 0.0],
        [1.0, 0.5],
        [2.0, 0.5],
        [2.0, 0.5 + 1e-8],
        [1.0, 0.5 + 1e-8],
        [1.0, 1.0],
        [0.0, 1.0],
    ],
    "waist": [[0.0, 0.0], [1.0, 0.49999999], [2.0, 0.0], [2.0, 1.0], [1.0, 0.5], [0.0, 1.0]],
}
"""Outlines whose tips an erosion by a tenth of the tolerance draws back by far more than the tolerance."""


@pytest.mark.parametrize("name", [*TIPS, *(name for name in SHAPES if name != "disc")])
def test_no_point_of_a_footprint_is_far_from_what_may_not_overlap(name: str) -> None:
    outline = Robot.polygon(TIPS[name]).outline if name in TIPS else SHAPES[name].outline
    ring = outline.rings()[0]
    left = shapely.union_all(overlap_core(ring))
    region = shapely.Polygon(ring)
    rim = shapely.points(shapely.get_coordinates(shapely.segmentize(region.exterior, region.length / 5000)))
    assert shapely.distance(rim, left).max() <= TOUCHING_TOLERANCE
    # All of it lies inside, so that what touches does not count; by rounding or more.
    assert shapely.distance(shapely.points(shapely.get_coordinates(left)), region).max() == 0.0
    kept = shapely.points(shapely.get_coordinates(left))
    assert shapely.distance(region.exterior, kept).min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_the_gap_to_the_core_is_a_bound(name: str) -> None:
    footprint = build_footprint(SHAPES[name])
    if name == "disc":
        assert footprint.core_gap == np.inf
        return
    rim = shapely.get_coordinates(shapely.segmentize(SHAPES[name].outline.shapely().exterior, 0.05))
    assert shapely.distance(shapely.points(rim), shapely.Polygon(footprint.core)).max() <= footprint.core_gap
    assert footprint.core_gap < 1e-4


def test_a_core_that_lost_a_part_is_far_from_it() -> None:
    # A footprint thinner than the erosion has none, and must not fail for it.
    assert len(build_footprint(Robot.rectangle(4.0, 1e-7)).core) == 0
    dumbbell = [(0, 0), (1, 0), (1, 0.5), (2, 0.5), (2, 0), (3, 0), (3, 1), (2, 1)]
    dumbbell += [(2, 0.5 + 1e-7), (1, 0.5 + 1e-7), (1, 1), (0, 1)]
    robot = Robot.polygon(dumbbell)
    assert build_footprint(robot).core_gap >= 2.0
    world = World("w", (0, 0, 10, 10), (Disc((2.5, 2.5), 0.1), Disc((7.5, 7.5), 0.1)))
    checker = StateChecker(world, robot)
    # Each half on a disc in turn, and none; the neck on one, though it is as thin as the overlap that is allowed.
    q = [(2, 2, 0), (0, 2, 0), (5, 7, 0), (6, 3, 0), (1, 2, 0)]
    assert checker.valid(q).tolist() == [False, False, False, True, False]
