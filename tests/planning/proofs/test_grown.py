"""Grown polygons reach nowhere farther than the radius, and lack no more than their chords."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.random_worlds import star_polygon
from tests.support.trials import few

from trailmark import LandmarkPlanner, Robot, World
from trailmark.planning.proofs.bound import LowerBound
from trailmark.planning.proofs.grown import grown
from trailmark.shapes import Polygon

CHORDS = 0.015
"""Share of the radius that a chord may lie inside of its circle: 0.5 %, and more where GEOS leaves out an end."""


def uneven_wall(rng: np.random.Generator, most: float) -> shapely.Polygon:
    """A frame whose upper inner edge is uneven by up to ``most`` metres."""
    x = np.sort(rng.uniform(-4.5, 4.5, int(rng.integers(1, 15))))
    y = 2.0 + rng.uniform(0.0, most, len(x))
    hole = [(-5.0, -5.0), (5.0, -5.0), (5.0, 2.0), *zip(x[::-1], y[::-1], strict=True), (-5.0, 2.0)]
    return shapely.Polygon([(-6, -6), (6, -6), (6, 3), (-6, 3)], [hole])


def judge(polygon: shapely.Polygon, regions: list[shapely.Geometry], r: float) -> None:
    union = shapely.union_all(regions)
    # Distances from a polygon are not convex between its pieces: so the places in between are measured, too, and what
    # the region has over, wherever that is.
    places = shapely.get_coordinates(shapely.segmentize(shapely.boundary(union), 0.02 * r))
    assert shapely.distance(shapely.points(places), polygon).max() <= r * (1.0 + 1e-9)
    low, high = np.array(union.bounds).reshape(2, 2)
    points = shapely.points(np.random.default_rng(0).uniform(low, high, (2000, 2)))
    distance = shapely.distance(points, polygon)
    inside = shapely.intersects(union, points)
    assert not inside[distance > r * (1.0 + 1e-9)].any()
    assert inside[distance < r * (1.0 - CHORDS)].all()


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.005, 0.02, 0.05]), st.sampled_from([0.3, 1.0, 2.5]))
@settings(max_examples=few(25), deadline=None)
def test_shallow_places_are_not_filled(seed: int, most: float, r: float) -> None:
    wall = uneven_wall(np.random.default_rng(seed), most)
    judge(wall, grown(np.array([wall], dtype=object), r), r)


def star_with_a_hole(seed: int) -> Polygon:
    """A star-shaped polygon and, in half of them, a hole of half its size."""
    rng = np.random.default_rng(seed)
    star = star_polygon(rng, (0.0, 0.0), 2.0)
    hole = (0.5 * star.vertices,) if len(star.vertices) > 3 and rng.random() < 0.5 else ()
    return Polygon(star.vertices, hole)


def widest_place(hole: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a place in a hole that is farthest from its outline, and how far that is."""
    radius = shapely.maximum_inscribed_circle(shapely.Polygon(hole))
    return shapely.get_coordinates(radius)[0], radius.length


def test_of_a_hole_that_geos_fills_nothing_is_claimed() -> None:
    star, robot = star_with_a_hole(93830), Robot.disc(0.5)
    place, reach = widest_place(star.holes[0])
    (region,) = grown(np.array([star.shapely()], dtype=object), 0.5)
    assert reach > 0.51
    assert shapely.contains_xy(region, *place)  # it is free in truth
    world = World("hole", (-5.0, -5.0, 5.0, 5.0), (star,))
    start, inside, outside = (np.array([x, y, 0.0]) for x, y in (place, place + np.array([0.002, 0.0]), (4.0, 4.0)))
    assert LowerBound(world, robot).of(start, inside).cost == pytest.approx(0.002)
    assert LandmarkPlanner(world, robot, seed=0).plan(start, inside, 5.0).status == "solved"
    # From outside there is no path, whatever becomes of the hole.
    assert LowerBound(world, robot).of(start, outside).cost == np.inf


def test_what_geos_fills_is_told_by_the_judge() -> None:
    # The judge must see the fault that it is there for: this world had a way with 5 mm of play, and was called shut.
    hole = [(-5, -5), (5, -5), (5, 2), (3.3135, 2.0005), (2.1258, 2.0023), (2.1252, 2.0098), (-1.034, 2.0035)]
    hole += [(-1.8091, 2.0023), (-2.2011, 2.0086), (-2.6773, 2.0089), (-5, 2)]
    wall = shapely.Polygon([(-6, -6), (6, -6), (6, 3), (-6, 3)], [hole])
    judge(wall, grown(np.array([wall], dtype=object), 1.0), 1.0)
    with pytest.raises(AssertionError):
        judge(wall, [shapely.buffer(wall, 1.0, quad_segs=8)], 1.0)
