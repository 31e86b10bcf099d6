"""Tangent searches: bounds that no path is shorter than, among shapely's regions; paths that shapely finds free."""

from __future__ import annotations

import heapq
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.trials import trials

from trailmark import Robot, StateChecker, World
from trailmark.planning.pipeline import disc_path
from trailmark.proofs import LowerBound
from trailmark.se2 import FloatArray
from trailmark.search.grid_tangents import GridTangents, TangentSearch
from trailmark.search.heap import heap_grow, heap_pop, heap_push

SPARES = (2e-3, 2e-4, 2e-5)


def ended(search: TangentSearch) -> TangentSearch:
    while not search.run(7):
        pass
    return search


def tangents_of(world: World, radius: float) -> GridTangents:
    found = GridTangents.of(world, radius)
    assert found is not None
    return found


def length(path: FloatArray) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum()) if len(path) else math.inf


@pytest.mark.parametrize("seed", trials(12, of=2))
def test_bounds_lie_between_shapelys_region_and_its_shortest_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cell, origin = float(rng.choice([1.0, 0.05])), tuple(rng.choice([0.0, -3.3, 1e4 + 0.123], 2))
    world = World.from_grid(rng.random(rng.integers(4, 13, 2)) < rng.choice([0.1, 0.25, 0.4]), cell, origin)
    radius = cell * float(rng.choice([0.1, 0.4, 0.499, 0.5, 0.8, 1.7]))
    plain = replace(world, obstacles=tuple(world.obstacles))
    xmin, ymin, xmax, ymax = world.bounds
    q = np.column_stack([rng.uniform(xmin, xmax, 80), rng.uniform(ymin, ymax, 80), np.zeros(80)])
    q = q[StateChecker(plain, Robot.disc(radius)).valid(q)][:16]
    tangents, reference = tangents_of(world, radius), LowerBound(plain, Robot.disc(radius))
    solid = shapely.union_all([s.polygon().shapely() for s in plain.obstacles])
    edge = shapely.box(*world.bounds).exterior
    for start, goal in zip(q[::2], q[1::2], strict=False):
        search = ended(tangents.search(start[:2], goal[:2]))
        bound, known = tangents.bound(search), reference.of(start, goal).cost
        assert bound <= length(disc_path(plain, radius, start[:2], goal[:2], np.inf)) + 1e-12
        assert bound >= (known if math.isfinite(known) else 0.0) * (1.0 - 1e-6) - 1e-5
        for spare in SPARES if math.isfinite(search.length) else ():
            path = tangents.bends(search, spare)
            if tangents.certified(path):
                assert np.allclose(path[[0, -1]], [start[:2], goal[:2]])
                assert min(shapely.LineString(path).distance(thing) for thing in (solid, edge)) >= radius - 1e-9
                assert bound <= length(path)


def test_a_gap_as_wide_as_the_disc_is_counted_as_open_and_a_narrower_one_is_not() -> None:
    occupied = np.zeros((5, 7), np.bool_)
    occupied[:, 3] = True
    occupied[2, 3] = False
    ends = np.array([1.0, 2.5]), np.array([6.0, 2.5])
    world = World.from_grid(occupied, 1.0)
    assert ended(tangents_of(world, 0.5).search(*ends)).length == pytest.approx(5.0)
    assert math.isinf(ended(tangents_of(world, 0.51).search(*ends)).length)


def test_bounds_rise_while_the_search_goes_on_and_a_guide_is_soon_there() -> None:
    occupied = np.random.default_rng(3).random((60, 60)) < 0.25
    occupied[0], occupied[-1] = False, False
    tangents = tangents_of(World.from_grid(occupied, 1.0), 0.4)
    ends = np.array([0.5, 0.5]), np.array([59.5, 59.5])
    search, bounds = tangents.search(*ends), list[float]()
    while not search.run(50):
        bounds.append(search.bound)
    assert math.isfinite(search.length)
    assert bounds == sorted(bounds)
    assert bounds[0] < search.bound <= search.length + 1e-12
    guided = ended(tangents.search(*ends, spare=2e-3, guide=0.97 * tangents.guide(*ends)))
    assert guided.expanded < 0.2 * search.expanded
    assert guided.bound == pytest.approx(59.0 * math.sqrt(2.0))
    assert search.length <= guided.length < 1.05 * search.length


@pytest.mark.slow
@given(st.lists(st.floats(-1e9, 1e9), max_size=40), st.data())
def test_entries_come_out_smallest_first(numbers: list[float], data: st.DataObject) -> None:
    keys, values, size = np.empty(1), np.empty(1, np.int64), 0
    expected: list[float] = []
    for value, key in enumerate(numbers):
        if size == len(keys):
            keys, values = heap_grow(keys, values)
        size = heap_push(keys, values, size, key, value)
        heapq.heappush(expected, key)
        if data.draw(st.booleans()):
            size = heap_pop(keys, values, size)
            assert keys[size] == heapq.heappop(expected) == numbers[values[size]]
    while size:
        size = heap_pop(keys, values, size)
        assert keys[size] == heapq.heappop(expected) == numbers[values[size]]
    assert expected == []
