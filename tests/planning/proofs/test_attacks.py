"""Worlds made to break proofs: nothing is called infeasible that is not, and no bound is above what a path costs.

``python -m benchmarks.soundness`` does the same at length.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from tests.helpers.attack_worlds import SHAPES, Attack, abutting, carved, collinear, slit, uneven
from tests.support.trials import few, trials

from trailmark.collision import StateChecker
from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs import LowerBound, enclosed
from trailmark.planning.proofs.bound import LARGE
from trailmark.shapes import Polygon, Rectangle
from trailmark.world import Robot, World

OFFSETS = (0.0, 1e3, 1e4, 1e5, 1e6, 5e6)
SCALES = (1.0, 1.0, 0.1, 30.0, 1e4)


def judge(attack: Attack, *factors: float) -> None:
    """The bound is below the known cost, and is more than the straight way's: something was proven.

    Of a large world no more is looked at than paths need that cost these factors of the known cost.
    """
    start, goal = attack.states[0], attack.states[-1]
    most = attack.cost * (1.0 + 1e-12) + 1e-9
    for large, known in ((LARGE, np.inf), *((0, factor * attack.cost) for factor in factors)):
        found = LowerBound(attack.world, attack.robot, large=large).of(start, goal, known)
        assert found.cost <= most
        # No part of the proof gave way to rounding, either.
        assert len(found.path) >= 2 or found.cost >= attack.cost * (1.0 - 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("make", [uneven, collinear, abutting, slit, carved])
def test_discs(make: Callable[..., Attack]) -> None:
    for seed in {*trials(8, of=4), 4, 17}:  # these two: large and far away, small and far away
        judge(make(seed, scale=SCALES[seed % 5], offset=OFFSETS[seed % 6]), 1.05, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_other_shapes_in_corridors_of_their_own(shape: str) -> None:
    first = 3 * sorted(SHAPES).index(shape)
    for seed in {*(first + trial for trial in trials(3)), 11}:  # the last one: far away, for every shape
        factor = 1.0 if seed == 11 else 1.05
        judge(carved(seed, shape, scale=SCALES[seed % 5], offset=OFFSETS[seed % 6]), factor)


@pytest.mark.slow
def test_a_shallow_wall_is_not_called_shut() -> None:
    hole = [(-5, -5), (5, -5), (5, 2), (3.3135, 2.0005), (2.1258, 2.0023), (2.1252, 2.0098), (-1.034, 2.0035)]
    hole += [(-1.8091, 2.0023), (-2.2011, 2.0086), (-2.6773, 2.0089), (-5, 2)]
    wall = Polygon(np.array([(-6, -6), (6, -6), (6, 3), (-6, 3)]), (np.array(hole),))
    post = Polygon(np.array([(1.984, -5.5), (2.024, -5.5), (2.024, 0.00414), (1.984, 0.00414)]))
    world = World("shallow", (-6, -6, 6, 3), (wall, post))
    result = LandmarkPlanner(world, Robot.disc(1.0), seed=0).plan((-3, -2, 0), (3.5, -2, 0), 5.0, gap=0.1)
    assert result.status == "solved"
    assert result.path is not None
    assert result.lower_bound is not None
    assert result.lower_bound <= result.path.cost


@pytest.mark.parametrize("offset", OFFSETS)
def test_a_wall_with_vertices_in_a_row_is_gone_round_at_any_heading(offset: float) -> None:
    x = np.linspace(0, 10, 11)
    for heading in np.linspace(0.0, 2.0 * np.pi, few(15), endpoint=False):
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])

        def at(v: Any, turn: Any = turn) -> Any:
            return np.atleast_2d(v) @ turn + offset

        wall = Polygon(at(np.r_[[[0, 0], [10, 0]], np.c_[x[::-1], 0 * x + 1]]))
        spike = Polygon(at([[4.9, -9], [5.1, -9], [5.1, 0.5], [4.9, 0.5]]))
        corners = at([[-3, -12], [13, -12], [13, 4], [-3, 4]])
        world = World("row", (*corners.min(0), *corners.max(0)), (wall, spike))
        start, goal = (np.append(at(p)[0], 0.0) for p in ([1, -1], [9, -1]))
        found = LowerBound(world, Robot.disc(0.5)).of(start, goal)
        # Around the wall's ends and over it; the way below the spike is longer.
        assert found.cost == pytest.approx(17.359, abs=5e-4)


def test_abutting_rectangles_do_not_end_the_process() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    world = World("row", (-6, -6, 6, 6), tuple(Rectangle((i * c, i * s), 1.0, 0.5, 0.7) for i in (-1, 0, 1)))
    result = LandmarkPlanner(world, Robot.disc(0.4), seed=0).plan((s, -c, 0), (-s, c, 0), 1.0, gap=0.01)
    assert result.status == "solved"
    assert result.path is not None
    assert result.lower_bound is not None
    assert 4.8 < result.lower_bound <= result.path.cost < 4.9


@pytest.mark.slow
def test_a_corner_that_is_just_wide_enough_is_not_called_shut() -> None:
    # At 45 degrees, where it is longest, a rectangle fits around if length <= 2 (sqrt(2) corridor - width).
    corridor, width, spare = 0.6, 0.5, 1e-6
    robot = Robot.rectangle(2.0 * (np.sqrt(2.0) * corridor - width) - spare, width)
    wall = Rectangle((1.5 + corridor / 2.0, 1.5 + corridor / 2.0), 3.0 - corridor, 3.0 - corridor)
    checker = StateChecker(World("corner", (0.0, 0.0, 3.0, 3.0), (wall,)), robot)
    start, forwards, backwards = (2.2, 0.3, 0.0), (0.3, 2.2, -np.pi / 2), (0.3, 2.2, np.pi / 2)
    assert not enclosed(checker, start, forwards, seconds=5.0)  # it ends by itself before
    # There is no room to arrive the other way round.
    assert enclosed(checker, start, backwards)
