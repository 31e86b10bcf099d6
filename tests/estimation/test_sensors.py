# ruff: noqa: E741, N806 # the filter's own symbols
"""Sensor models: Jacobians against numerical ones, inverses undone, angles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.estimation.numerical import jacobian, turned

from trailmark.estimation import Cartesian, RangeBearing, SensorModel

FloatArray = NDArray[np.float64]

SENSORS: list[SensorModel] = [
    RangeBearing(0.1, 0.02),
    RangeBearing(0.1, 0.02, growth=0.3),
    Cartesian(0.1, 0.2),
]
ANGLE = {"RangeBearing": (1,), "Cartesian": ()}
"""Which numbers of a reading are angles."""

headings = st.sampled_from([-np.pi, np.pi, 0.0, np.pi / 2]) | st.floats(-3.2, 3.2)
poses = st.tuples(st.floats(-20, 20), st.floats(-20, 20), headings).map(np.array)
# Points at every distance from 1 cm to 100 m, so that bearings of near ones change quickly.
offsets = st.tuples(st.floats(-2, 2), headings).map(lambda p: 10.0 ** p[0] * np.array([np.cos(p[1]), np.sin(p[1])]))
seeds = st.integers(0, 99999)


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
@given(x=poses, offset=offsets)
def test_jacobians(sensor: SensorModel, x: FloatArray, offset: FloatArray) -> None:
    l, d = x[:2] + offset, float(np.hypot(*offset))
    difference = turned(*ANGLE[type(sensor).__name__])
    step = min(1e-3 * d, 1e-3)
    # Central differences of fourth order lose 1e-16·|x|/step to rounding.
    atol = 1e-12 / step + 1e-8
    zero = np.zeros(len(sensor.R))
    assert np.allclose(
        sensor.H_pose(x, l), jacobian(lambda p: sensor.h(p, l), x, step, difference), rtol=1e-7, atol=atol
    )
    assert np.allclose(
        sensor.H_feature(x, l), jacobian(lambda p: sensor.h(x, p), l, step, difference), rtol=1e-7, atol=atol
    )
    assert np.allclose(
        sensor.V(x, l), jacobian(lambda v: sensor.h(x, l, v), zero, step, difference), rtol=1e-7, atol=atol
    )


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
@given(x=poses, offset=offsets)
def test_inverse(sensor: SensorModel, x: FloatArray, offset: FloatArray) -> None:
    l = x[:2] + offset
    z = sensor.h(x, l)
    found, G_pose, G_z = sensor.inverse(x, z)
    assert np.allclose(found, l, atol=1e-9)
    assert np.allclose(sensor.residual(sensor.h(x, found), z), 0.0, atol=1e-6)
    atol = 1e-7
    assert np.allclose(
        G_pose, jacobian(lambda p: sensor.inverse(p, z).feature, x, 1e-4, np.subtract), rtol=1e-7, atol=atol
    )
    assert np.allclose(
        G_z, jacobian(lambda r: sensor.inverse(x, r).feature, z, 1e-4, np.subtract), rtol=1e-7, atol=atol
    )


def test_a_reading_by_hand() -> None:
    # At (1, 2), looking up: a point 3 m to the right and 4 m ahead.
    x, l = [1.0, 2.0, np.pi / 2], [4.0, 6.0]
    assert np.allclose(RangeBearing(0.1, 0.1).h(x, l), [5.0, -np.arctan2(3.0, 4.0)])
    assert np.allclose(Cartesian(0.1, 0.1).h(x, l), [4.0, -3.0])


@given(
    st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6), st.sampled_from([0.0, np.pi, -np.pi, 3 * np.pi, -5 * np.pi, 1e6])
)
def test_bearings_are_compared_the_shorter_way_round(a: float, b: float, base: float) -> None:
    y = RangeBearing(0.1, 0.1).residual([3.0, base + a], [1.0, base + b - 2 * np.pi])
    assert np.allclose(y, [2.0, a - b], atol=1e-9)
    full = RangeBearing(0.1, 0.1).residual([0.0, np.pi], [0.0, -np.pi])
    assert full[1] == 0.0


def test_a_point_under_the_robot_has_finite_jacobians() -> None:
    sensor = RangeBearing(0.1, 0.1)
    x = np.array([1.0, 2.0, 0.3])
    assert np.isfinite(sensor.h(x, x[:2])).all()
    assert np.isfinite(sensor.H_pose(x, x[:2])).all()
    assert np.isfinite(sensor.H_feature(x, x[:2])).all()


def test_what_a_linearised_reading_misses() -> None:
    rng, r, sensor = np.random.default_rng(0), 3.0, RangeBearing(0.1, 0.02)
    C = np.array([[0.03, 0.004], [0.004, 0.01]])
    off = rng.multivariate_normal(np.zeros(2), C, 200_000) * [1.0, r]  # along and across the line of sight
    missed = sensor.h(np.zeros(3), np.add(off, [r, 0.0])) - [r, 0.0] - off / [1.0, r]
    found = sensor.curvature(np.array([r, 0.4]), C)
    assert np.diagonal(found) == pytest.approx((missed**2).mean(axis=0), rel=0.1)
    assert found[0, 1] == 0.0
    assert not Cartesian(0.1, 0.2).curvature(np.array([r, 0.4]), C).any()
    # On the feature, or with no idea of the bearing, it stays finite.
    assert np.isfinite(sensor.curvature(np.zeros(2), np.diag([1.0, 1e18]))).all()
