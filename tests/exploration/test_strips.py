"""Strips along the bounds that are closed to a robot that does not know exactly where it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from trailmark.exploration.known_map import FREE, OCCUPIED, KnownMap, bounds_margins, cells_that_meet, strips_along
from trailmark.se2 import transform
from trailmark.world import Robot

BOUNDS = (-1.0, 2.0, 3.05, 5.0)


def test_strips_are_at_least_as_wide_as_the_margins_and_less_than_a_cell_wider() -> None:
    known = KnownMap(BOUNDS, 0.1)
    for margins in ([0.013, 0.2], [0.1, 0.3], [0.0, 0.07], [9.0, 0.001]):
        strips = strips_along(known, np.array(margins))
        closed = shapely.union_all([strip.polygon().shapely() for strip in strips.values()])
        dx, dy = margins
        inner = shapely.box(BOUNDS[0] + dx, BOUNDS[1] + dy, BOUNDS[2] - dx, BOUNDS[3] - dy)
        ring = shapely.box(*BOUNDS) if 2.0 * dx > 4.05 else shapely.box(*BOUNDS).difference(inner)
        assert ring.difference(closed.buffer(1e-9)).is_empty
        assert shapely.box(*BOUNDS).buffer(1e-9).covers(closed)
        assert closed.area <= ring.area + 0.1 * 0.25 * 2.0 * (4.05 + 3.0) + 1e-9
    assert not strips_along(known, np.zeros(2))


def test_the_cells_of_a_strip_are_all_that_it_meets() -> None:
    known = KnownMap(BOUNDS, 0.1)
    state = np.full(known.state.shape, FREE, dtype=np.uint8)
    for strip in strips_along(known, np.array([0.11, 0.2])).values():
        state[cells_that_meet(known, strip)] = OCCUPIED
    # 0.125 m are two columns of cells; on the right, where the last column is half outside, as many.
    assert (state[5] == OCCUPIED).nonzero()[0].tolist() == [0, 1, 39, 40]
    assert (state[:, 5] == OCCUPIED).nonzero()[0].tolist() == [0, 1, 28, 29]


def test_margins_hold_for_errors_of_place_and_heading_that_add_up() -> None:
    robot, rng = Robot.rectangle(0.8, 0.4), np.random.default_rng(0)
    lever = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.3], [0.0, 0.3, 1.0]]) * 0.05
    covariance = lever @ lever.T
    margins = bounds_margins(covariance, robot, 3.0)
    errors = rng.multivariate_normal(np.zeros(3), covariance, 20000)
    moved = np.array([transform(error, robot.outline.vertices) for error in errors]) - robot.outline.vertices
    for axis in range(2):
        worst = moved[..., axis].max(axis=1)
        assert (worst > margins[axis]).mean() <= 0.5 * math.erfc(3.0 / math.sqrt(2.0)) * 1.5
    assert bounds_margins(covariance, Robot.disc(5.0), 3.0) == pytest.approx(3.0 * np.sqrt(np.diag(covariance)[:2]))
