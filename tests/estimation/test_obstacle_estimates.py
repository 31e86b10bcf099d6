"""From features to obstacles: the covariance of a wall is that of its line, points and groups become what they are."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from trailmark.estimation.obstacles import disc_estimates, wall_estimate
from trailmark.shapes import Disc, Rectangle

angles = st.floats(-math.pi, math.pi)


# --- Discs


def test_points_become_discs() -> None:
    covariances = np.array([[[0.01, 0.002], [0.002, 0.02]], [[0.03, 0.0], [0.0, 0.03]]])
    first, second = disc_estimates([[1.0, 2.0], [3.0, 4.0]], covariances, [0.2, 0.3])
    assert first.mean == Disc((1.0, 2.0), 0.2)
    assert second.mean == Disc((3.0, 4.0), 0.3)
    assert np.array_equal(first.covariance, covariances[0])
    with_radius = disc_estimates([[1.0, 2.0]], covariances[:1], 0.2, 0.05)[0]
    assert with_radius.covariance == pytest.approx(np.array([[0.01, 0.002, 0], [0.002, 0.02, 0], [0, 0, 0.0025]]))
    assert disc_estimates(np.empty((0, 2)), np.empty((0, 2, 2)), 0.2) == []


# --- Walls


def corners(rho: float, alpha: float, low: float, high: float, thickness: float) -> np.ndarray:
    """The wall's corners, front first: points of the line at two places along it, and those behind."""
    n, t = np.array([math.cos(alpha), math.sin(alpha)]), np.array([-math.sin(alpha), math.cos(alpha)])
    front = np.array([rho * n + low * t, rho * n + high * t])
    return np.concatenate([front, front[::-1] + thickness * n])


@given(st.floats(-9, 9), angles, st.floats(-9, 9), st.floats(0.1, 9), st.floats(0.05, 0.5))
def test_a_wall_stands_behind_its_line(rho: float, alpha: float, low: float, length: float, thickness: float) -> None:
    estimate = wall_estimate((rho, alpha), np.zeros((2, 2)), (low, low + length), thickness=thickness)
    assert isinstance(estimate.mean, Rectangle)
    expected = shapely.Polygon(corners(rho, alpha, low, low + length, thickness))
    assert shapely.hausdorff_distance(estimate.mean.polygon().shapely(), expected) < 1e-9


@given(st.floats(-5, 5), angles, st.floats(-9, 9), st.floats(0.5, 9), st.integers(0, 2**32 - 1))
def test_a_walls_covariance_is_that_of_its_line(rho: float, alpha: float, low: float, length: float, seed: int) -> None:
    """Moving the line a little moves the wall's front, across itself, as the rectangle's covariance says."""
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(2, 2)) * 1e-3
    covariance, thickness = a @ a.T, 0.1
    estimate = wall_estimate((rho, alpha), covariance, (low, low + length), thickness=thickness, end_sigma=2e-3)
    # The line's displacement across itself at a place s along it: δρ − s·δα.
    for s in (low, low + 0.5 * length, low + length):
        g = np.array([1.0, -s])
        across = float(g @ covariance @ g)
        x, y = (low + 0.5 * length), s
        # The front's point at s, seen from the rectangle's centre: along by s − m, across by half the thickness.
        u = np.array([math.cos(alpha), math.sin(alpha)])
        arm = (y - x) * np.array([-u[1], u[0]]) - 0.5 * thickness * u
        row = np.array([*u, u @ np.array([-arm[1], arm[0]]), 0.0])
        assert float(row @ estimate.covariance @ row) == pytest.approx(across, rel=1e-6, abs=1e-15)
    # Each end moves along the line by itself.
    t = np.array([-math.sin(alpha), math.cos(alpha)])
    arm = 0.5 * thickness * np.array([math.cos(alpha), math.sin(alpha)])
    for end in (-0.5, 0.5):
        row = np.array([*t, t @ np.array([arm[1], -arm[0]]), end])
        assert float(row @ estimate.covariance @ row) == pytest.approx(4e-6, rel=1e-3)


def test_a_place_along_the_line_moves_both_ends_together() -> None:
    wall = wall_estimate((1.0, 0.6), np.zeros((2, 2)), (-1.0, 2.0), thickness=0.1, along_sigma=0.03)
    t = np.array([-math.sin(0.6), math.cos(0.6)])
    assert wall.covariance == pytest.approx(np.pad(9e-4 * np.outer(t, t), (0, 1)), abs=1e-15)
    both = wall_estimate((1.0, 0.6), np.zeros((2, 2)), (-1.0, 2.0), thickness=0.1, along_sigma=0.03, end_sigma=0.04)
    assert both.covariance[:2, :2] == pytest.approx((9e-4 + 8e-4) * np.outer(t, t))
    for end, other in ((-0.5, 0.5), (0.5, -0.5)):
        near, far = (np.array([*t, 0.0, sign]) for sign in (end, other))
        # By itself each end errs by the shared and its own part; together only by the shared one.
        assert float(near @ both.covariance @ near) == pytest.approx(25e-4)
        assert float(near @ both.covariance @ far) == pytest.approx(9e-4)
