"""Lower bounds hold for every path, are tight for discs, and prove that there is none only where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from benchmarks.soundness.carving import carved_world
from benchmarks.soundness.scenes import SCALES
from benchmarks.soundness.walls import ceiling_world
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import Oracle, sampled_cost
from tests.helpers.trials import few, trials
from tests.helpers.worlds import random_world

from trailmark import CostZone, Disc, Objective, Path, Polygon, Rectangle, Robot, SpeedZone, StateChecker, World, se2
from trailmark.motion import Motion, motion_of
from trailmark.proofs import LowerBound
from trailmark.proofs.bound import LARGE
from trailmark.proofs.eikonal import Eikonal
from trailmark.proofs.region import ellipse, free_region, grown
from trailmark.world.library import find_world


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.3, 0.8]), st.booleans())
@settings(max_examples=few(25))
def test_the_region_holds_every_free_place_of_the_disc(seed: int, radius: float, boundary: bool) -> None:
    world = random_world(seed, 12, size=10.0, radii=(0.2, 1.5), discs=0.4, holes=0.3, boundary=boundary)
    region = free_region(world, radius)
    centres = np.random.default_rng(seed).uniform(0.0, 10.0, (400, 2))
    q = np.column_stack([centres, np.zeros(len(centres))])
    free = ~Oracle(world, Robot.disc(radius)).collides(q)
    inside = shapely.intersects_xy(region, centres)
    assert inside[free].all()
    # And hardly any other: chords lie half a per cent of a radius inside of circles, the obstacles' own among them.
    gaps = StateChecker(world, Robot.disc(0.98 * radius - 0.005 * 1.5)).valid(q)
    assert (gaps | ~inside).all()


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.1, 0.4, 0.9]))
@settings(max_examples=25)
def test_the_formula_holds_for_discs_off_the_reference_point(seed: int, offset: float) -> None:
    # A square robot seen from a point off its middle, in the open: any sequence of configurations is a path.
    square = [(offset - 0.2, -0.2), (offset + 0.2, -0.2), (offset + 0.2, 0.2), (offset - 0.2, 0.2)]
    robot = Robot.polygon(square)
    world = World("open", (-50.0, -50.0, 50.0, 50.0))
    rng = np.random.default_rng(seed)
    q = rng.normal(0.0, 1.0, (int(rng.integers(2, 6)), 3)) * (1.0, 1.0, 2.0)
    q[:, 2] = se2.wrap(q[:, 2])
    assert LowerBound(world, robot).of(q[0], q[-1]).cost <= Path(q).cost + 1e-6


def test_the_bound_of_a_disc_is_the_shortest_path() -> None:
    # Around a disc: two tangents and an arc.
    world = World("disc", (0.0, 0.0, 20.0, 20.0), (Disc((10.0, 10.0), 2.0),))
    found = LowerBound(world, Robot.disc(1.0)).of(np.array([2.0, 10.0, 0.0]), np.array([18.0, 10.0, 0.0]))
    tangent, angle = np.sqrt(8.0**2 - 3.0**2), np.pi - 2.0 * np.arccos(3.0 / 8.0)
    assert found.cost == pytest.approx(2.0 * tangent + 3.0 * angle, rel=2e-3)
    assert found.cost <= 2.0 * tangent + 3.0 * angle


def test_what_the_disc_cannot_reach_is_proven() -> None:
    world = World.load(find_world("enclosed"))
    assert world.robot is not None
    query = world.queries[0]
    bound = LowerBound(world, world.robot).of(np.array(query.start), np.array(query.goal))
    assert bound.cost == np.inf
    # A gap that the robot fits exactly is no proof.
    walls = (Rectangle((10.0, 2.25), 1.0, 4.5), Rectangle((10.0, 7.75), 1.0, 4.5))
    slit = World("slit", (0.0, 0.0, 20.0, 10.0), walls)
    ends = np.array([2.0, 5.0, 0.0]), np.array([18.0, 5.0, 0.0])
    assert LowerBound(slit, Robot.disc(0.5)).of(*ends).cost == pytest.approx(16.0, abs=1e-4)
    assert LowerBound(slit, Robot.disc(0.5 + 1e-5)).of(*ends).cost == np.inf


def test_what_is_told_to_stop_leaves_obstacles_aside() -> None:
    world = World("wall", (0.0, 0.0, 10.0, 10.0), (Rectangle((5.0, 4.0), 1.0, 8.0),))
    bound, ends = LowerBound(world, Robot.disc(0.2)), (np.array([1.0, 1.0, 0.0]), np.array([9.0, 1.0, 0.0]))
    assert bound.of(*ends, stop=lambda: True).cost == pytest.approx(8.0)
    assert bound.of(*ends).cost > 15.0


@pytest.mark.slow
@pytest.mark.parametrize("scale", list(SCALES))
def test_no_path_that_a_world_was_carved_around_is_bounded_away(scale: str) -> None:
    """Shallow walls, slivers and abutting pieces around a known path, with hardly any room: discs and other shapes."""
    for seed in trials(6):
        rng = np.random.default_rng(seed)
        for known in (ceiling_world(rng, scale), carved_world(rng, False, scale)):
            if known is None or known.world.robot is None:
                continue
            # Of a large world no more is looked at than paths need that cost so much.
            for large, cost in ((LARGE, np.inf), (0, 1.05 * known.cost), (0, known.cost)):
                found = LowerBound(known.world, known.world.robot, large=large).of(known.way[0], known.way[-1], cost)
                assert found.cost <= known.cost * (1.0 + 1e-12) + 1e-9


# --- Grown polygons reach nowhere farther than the radius, and lack no more than their chords.

CHORDS = 0.015
"""Share of the radius that a chord may lie inside of its circle: 0.5 %, and more where GEOS leaves out an end."""


def uneven_wall(rng: np.random.Generator, most: float) -> shapely.Polygon:
    """A frame whose upper inner edge is uneven by up to ``most`` metres."""
    x = np.sort(rng.uniform(-4.5, 4.5, int(rng.integers(1, 15))))
    y = 2.0 + rng.uniform(0.0, most, len(x))
    hole = [(-5.0, -5.0), (5.0, -5.0), (5.0, 2.0), *zip(x[::-1], y[::-1], strict=True), (-5.0, 2.0)]
    return shapely.Polygon([(-6, -6), (6, -6), (6, 3), (-6, 3)], [hole])


def judge_grown(polygon: shapely.Polygon, regions: list[shapely.Geometry], r: float) -> None:
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
    judge_grown(wall, grown(np.array([wall], dtype=object), r), r)


def test_what_geos_fills_is_told_by_the_judge_grown() -> None:
    # The judge must see the fault that it is there for: this world had a way with 5 mm of play, and was called shut.
    hole = [(-5, -5), (5, -5), (5, 2), (3.3135, 2.0005), (2.1258, 2.0023), (2.1252, 2.0098), (-1.034, 2.0035)]
    hole += [(-1.8091, 2.0023), (-2.2011, 2.0086), (-2.6773, 2.0089), (-5, 2)]
    wall = shapely.Polygon([(-6, -6), (6, -6), (6, 3), (-6, 3)], [hole])
    judge_grown(wall, grown(np.array([wall], dtype=object), 1.0), 1.0)
    with pytest.raises(AssertionError):
        judge_grown(wall, [shapely.buffer(wall, 1.0, quad_segs=8)], 1.0)


def weighted(world: World, objective: Objective | None = None, robot: Robot | None = None) -> Motion:
    motion = motion_of(StateChecker(world, robot or Robot.disc(0.2)), objective=objective)
    assert motion.weighted
    return motion


@pytest.mark.slow
def test_no_weighted_path_costs_less() -> None:
    rng, tight = np.random.default_rng(3), 0
    for _ in range(few(16, of=6)):
        zones: list[CostZone | SpeedZone] = []
        for _ in range(rng.integers(1, 5)):
            corner, sides = rng.uniform(0.0, 8.0, 2), rng.uniform(0.05, 6.0, 2)
            x, y, u, v = *corner, *(corner + sides)
            square = [(x, y), (u, y), (u, v), (x, v)]
            zones.append(CostZone(Polygon(np.array(square, dtype=float)), float(rng.uniform(0.1, 5.0))))
            zones.append(SpeedZone(Polygon(np.array(square[:3], dtype=float)), float(rng.uniform(0.1, 2.0))))
        obstacles = tuple(Disc(tuple(rng.uniform(0.0, 10.0, 2)), float(rng.uniform(0.1, 1.0))) for _ in range(4))
        world = World("w", (0.0, 0.0, 10.0, 10.0), obstacles, zones=tuple(zones))
        length, hasty = (float(v) for v in rng.uniform(0.1, 2.0, 2))
        objective = Objective(length, hasty, clearance=float(rng.choice([0.0, 3.0])))
        eikonal = Eikonal(weighted(world, objective))
        checker = eikonal.motion.checker
        q = np.column_stack([rng.uniform(0.2, 9.8, (24, 2)), rng.uniform(-3.0, 3.0, 24)])
        q = q[checker.valid(q)]
        for a, b in zip(q[:-1:2], q[1::2], strict=False):
            if checker.motion_valid(a, b):
                direct = sampled_cost(world, objective, np.array([a, b]), 5e-3)
                bound = eikonal.of(a, b)
                assert bound <= direct * 1.002 + 0.02
                tight += bound > 0.5 * direct
    assert tight > few(20, of=6)


def test_obstacles_stop_it() -> None:
    """Through a wall that the disc cannot pass nothing leads; the bound goes round it, or claims nothing."""
    wall = Rectangle((5.0, 4.0), 8.0, 1.0, np.pi / 2)
    world = World(
        "wall",
        (0.0, 0.0, 10.0, 10.0),
        (wall,),
        zones=(CostZone(Polygon(np.array([(0, 0), (10, 0), (10, 10), (0, 10)], dtype=float)), 2.0),),
    )
    start, goal = np.array([2.0, 2.0, 0.0]), np.array([8.0, 2.0, 0.0])
    assert Eikonal(weighted(world)).of(start, goal) > 2.0 * 13.0
    shut = replace(world, obstacles=(Rectangle((5.0, 5.0), 10.0, 1.0, np.pi / 2),))
    assert Eikonal(weighted(shut)).of(start, goal) == pytest.approx(0.0, abs=1e-9)


@given(st.integers(0, 2**32 - 1), st.floats(1.0, 3.0))
def test_an_ellipse_holds_all_places_of_paths_that_are_no_longer(seed: int, factor: float) -> None:
    a, b = np.random.default_rng(seed).uniform(-5.0, 5.0, (2, 2))
    apart, angle = float(np.hypot(*(b - a))), np.linspace(0.0, 2.0 * np.pi, 500)
    major, minor = 0.5 * factor * apart, 0.5 * apart * np.sqrt(factor**2 - 1.0)
    c, s = (b - a) / apart
    u, v = major * np.cos(angle), minor * np.sin(angle)
    rim = np.column_stack([c * u - s * v, s * u + c * v]) + 0.5 * (a + b)
    assert shapely.covers(ellipse(a, b, factor * apart), shapely.points(rim)).all()
