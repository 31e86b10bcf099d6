"""Lower bounds hold for every path, are tight for discs, and prove that there is none only where there is none."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few, trials

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.library import find_world
from trailmark.path import Path
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.planning.proofs import LowerBound
from trailmark.planning.proofs.region import free_region
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World


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
@pytest.mark.parametrize("name", ["disc", "L", "offset"])
def test_no_path_costs_less(name: str) -> None:
    # From the last down: its bounds are the nearest to the costs of paths.
    for seed in (3 - trial for trial in trials(4, of=2)):
        world = random_world(seed, 40, size=30.0, radii=(0.5, 2.0), discs=0.3, holes=0.1)
        planner = LandmarkPlanner(world, ROBOTS[name], seed=seed, settings=PlannerSettings(patience=2))
        bound = LowerBound(world, ROBOTS[name])
        rng = np.random.default_rng(seed)
        q = rng.uniform((0, 0, -np.pi), (30, 30, np.pi), (200, 3))
        q = q[planner.checker.valid(q)]
        for start, goal in zip(q[:3], q[3:6], strict=True):
            result = planner.plan(start, goal, 20.0, max_iterations=2)
            found = bound.of(start, goal)
            assert found.cost >= se2.distance(start, goal) - 1e-9
            assert result.path is not None
            assert found.cost <= result.path.cost + 1e-9


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


def ragged_outline(corners: int, seed: int = 0) -> shapely.Polygon:
    """Return a polygon about (5, 5) with that many corners, which leaves bays and holes between them."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    radius = 3.5 + rng.uniform(-0.4, 0.4, corners)
    outline = shapely.Polygon(np.column_stack([5.0 + radius * np.cos(angle), 5.0 + radius * np.sin(angle)]))
    return outline.difference(shapely.unary_union([shapely.Point(x, y).buffer(0.3) for x in (4, 5, 6) for y in (4, 6)]))


def test_a_region_that_would_take_too_long_is_given_up() -> None:
    outline = ragged_outline(2000)
    vertices = shapely.get_coordinates(outline.exterior)[:-1]
    world, start, goal = World("ragged", (0.0, 0.0, 10.0, 10.0), (Polygon(vertices),)), (0.5, 0.5, 0), (9.5, 9.5, 0)
    bound, ends = LowerBound(world, Robot.disc(0.2)), (np.array(start, float), np.array(goal, float))
    assert bound.of(*ends, left=0.0).cost == pytest.approx(np.hypot(9.0, 9.0))
    bound.make_region(0.0)
    assert bound.seconds_for_region() > 0.0
    assert bound.of(*ends).cost > np.hypot(9.0, 9.0) + 1.0
