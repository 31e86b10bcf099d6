"""Disc ways: certified, and as short as lower bounds, visibility graphs (networkx, shapely) and geometry say."""

from __future__ import annotations

import math
from itertools import pairwise

import networkx
import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import random_world
from tests.support.trials import few, trials

from trailmark.collision import StateChecker
from trailmark.planning.pipeline import disc_path
from trailmark.planning.proofs import LowerBound
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def length(way: FloatArray) -> float:
    return sum(math.dist(a, b) for a, b in pairwise(way))


def judged(world: World, radius: float, start: FloatArray, goal: FloatArray, most: float = np.inf) -> FloatArray:
    """A disc's way, which is empty or leads from start to goal through free space for certain."""
    way = disc_path(world, radius, start, goal, most)
    assert way.shape[1:] == (2,)
    if len(way):
        assert np.array_equal(way[0], start)
        assert np.array_equal(way[-1], goal)
        states = np.column_stack([way, np.zeros(len(way))])
        checker = StateChecker(world, Robot.disc(radius))
        assert checker.motions_valid(states[:-1], states[1:]).all()
        steps = [np.linspace(a, b, 2 + int(math.dist(a, b) / (0.02 * radius))) for a, b in pairwise(way)]
        points = np.concatenate(steps)
        assert not Oracle(world, Robot.disc(radius)).collides(np.column_stack([points, np.zeros(len(points))])).any()
    return way


def bound(world: World, radius: float, start: FloatArray, goal: FloatArray) -> float:
    return LowerBound(world, Robot.disc(radius)).of(np.append(start, 0.0), np.append(goal, 0.0)).cost


def shortest(world: World, radius: float, start: FloatArray, goal: FloatArray) -> float:
    """The shortest path by a graph of all that see each other, round corners cut fine."""
    grown = [
        shapely.Point(s.center).buffer(s.radius + radius, quad_segs=24)
        if isinstance(s, Disc)
        else s.polygon().shapely().buffer(radius, quad_segs=24)
        for s in world.obstacles
    ]
    xmin, ymin, xmax, ymax = world.bounds
    free = shapely.box(xmin + radius, ymin + radius, xmax - radius, ymax - radius) - shapely.union_all(grown)
    points = np.vstack([start, goal, shapely.get_coordinates(free)])
    i, j = np.triu_indices(len(points), 1)
    lines = shapely.linestrings(np.stack([points[i], points[j]], axis=1))
    room = free.buffer(1e-9)
    shapely.prepare(room)
    seen = shapely.covers(room, lines)
    graph = networkx.Graph()
    graph.add_nodes_from((0, 1))
    graph.add_weighted_edges_from(zip(i[seen], j[seen], shapely.length(lines[seen]), strict=True))
    return float(networkx.dijkstra_path_length(graph, 0, 1))


@pytest.mark.slow
@settings(max_examples=few(40, of=5))
@given(seed=st.integers(0, 10_000), radius=st.sampled_from([0.05, 0.3, 0.8]), boundary=st.booleans())
# A corner of 16 degrees, for which GEOS takes one chord.
@example(seed=1238, radius=0.05, boundary=False)
def test_ways_are_free_and_as_short_as_bounds_tell(seed: int, radius: float, boundary: bool) -> None:
    world = random_world(seed, 15, size=14.0, radii=(0.3, 2.5), discs=0.4, holes=0.3, boundary=boundary)
    q = np.random.default_rng(seed).uniform(0.0, 14.0, (200, 2))
    q = q[StateChecker(world, Robot.disc(1.04 * radius + 0.01)).valid(np.column_stack([q, np.zeros(len(q))]))]
    if len(q) < 2:
        return
    start, goal = q[:2]
    way = judged(world, radius, start, goal)
    least = bound(world, radius, start, goal)
    # Obstacles grown by a little more: no gap that is taken for one by this bound is missed.
    most = bound(world, 1.03 * radius + 0.01, start, goal)
    if len(way) == 0:
        assert most == np.inf
        return
    assert least * (1.0 - 1e-9) <= length(way) <= most * (1.0 + 1e-9)
    if most < 1.004 * least:
        assert length(way) <= 1.005 * least
    # What is known to be no shorter does not change the way, but for rounding; what is known to be shorter, ends it.
    again = judged(world, radius, start, goal, length(way) * (1.0 + 1e-9))
    assert length(again) == pytest.approx(length(way))


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(6))
def test_a_visibility_graph_has_no_shorter_way(seed: int) -> None:
    world = random_world(seed, 5, size=12.0, radii=(0.8, 2.0), discs=0.5)
    q = np.random.default_rng(seed).uniform(1.0, 11.0, (100, 2))
    q = q[StateChecker(world, Robot.disc(0.45)).valid(np.column_stack([q, np.zeros(len(q))]))]
    start, goal = q[np.argmin(q.sum(axis=1))], q[np.argmax(q.sum(axis=1))]
    way = judged(world, 0.4, start, goal)
    # The graph's corners lie 0.06 % inside of circles of at most 2.4 m, the way's 0.12 % and the disc's spare outside.
    assert length(way) == pytest.approx(shortest(world, 0.4, start, goal), rel=4e-3)


def test_gaps_are_taken_with_little_to_spare_and_missed_with_none() -> None:
    start, goal = np.array([2.0, 5.0]), np.array([18.0, 5.0])
    for width, found in ((1.0 + 0.01, True), (1.0, False), (0.99, False)):
        depth = 5.0 - 0.5 * width
        walls = (Rectangle((10.0, 0.5 * depth), 1.0, depth), Rectangle((10.0, 10.0 - 0.5 * depth), 1.0, depth))
        world = World("slit", (0.0, 0.0, 20.0, 10.0), walls)
        way = judged(world, 0.5, start, goal)
        assert length(way) == pytest.approx(16.0 if found else 0.0)


def test_ways_lead_through_holes_and_stay_within_boundaries() -> None:
    # A ring with a way around within it; outside of it the boundary leaves none.
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    ring = Polygon(10.0 + 8.0 * square, (10.0 + 6.0 * square,))
    world = World("ring", (0.0, 0.0, 20.0, 20.0), (ring, Disc((10.0, 10.0), 3.0)))
    start, goal = np.array([6.0, 10.0]), np.array([14.0, 10.0])
    tangent, angle = math.sqrt(4.0**2 - 3.5**2), math.pi - 2.0 * math.acos(3.5 / 4.0)
    assert length(judged(world, 0.5, start, goal)) == pytest.approx(2.0 * tangent + 3.5 * angle, rel=3e-3)
    # From the hole to what lies outside there is none.
    assert len(judged(world, 0.5, start, np.array([1.0, 1.0]))) == 0
    # An L-shaped boundary: around its inner corner, which nothing else marks.
    corner = Polygon(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 8.0], [8.0, 8.0], [8.0, 20.0], [0.0, 20.0]]))
    world = World("L", (0.0, 0.0, 20.0, 20.0), boundary=corner)
    way = judged(world, 1.0, np.array([18.0, 7.0 - 0.01]), np.array([7.0 - 0.01, 18.0]))
    assert length(way) == pytest.approx(20.0 + 0.5 * math.pi, rel=3e-3)
    beside = judged(world, 1.0, np.array([18.0, 4.0]), np.array([14.0, 3.0]))
    assert length(beside) == pytest.approx(math.sqrt(17.0))
