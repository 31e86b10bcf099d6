# ruff: noqa: E741, N806 # the filter's own symbols
"""Motion and sensor models: Jacobians against numerical ones, arcs against integration, inverses undone, angles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.numerical import jacobian, turned

from trailmark.estimation import Detection, MotionModel, PoseIncrement, RangeBearing, Unicycle
from trailmark.estimation.models import as_range_bearing

FloatArray = NDArray[np.float64]

# Headings at both ends of their range, turns of none at all, next to none, and around where the series takes over.
TURNS = [0.0, 1e-300, 1e-12, -1e-8, 1e-5, -1e-3, 0.0999, 0.1, 0.1001, 0.2, -0.2, 0.2001, 3.0, -12.0]
poses = st.tuples(
    st.floats(-100, 100), st.floats(-100, 100), st.sampled_from([-np.pi, np.pi, 0.0]) | st.floats(-3.2, 3.2)
).map(np.array)
velocities = st.tuples(
    st.sampled_from([0.0, 1e-9]) | st.floats(-5, 5),
    st.sampled_from(TURNS) | st.floats(-4, 4),
    st.sampled_from([0.0, 1e-6, 1.0]) | st.floats(0.001, 2.0),
).map(np.array)
steps = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.sampled_from([0.0, np.pi]) | st.floats(-4, 4)).map(np.array)

UNICYCLE = Unicycle(0.1, 0.05, (0.01, 0.02, 0.03, 0.04))
INCREMENT = PoseIncrement(0.1, 0.2, 0.05, (0.01, 0.02, 0.03))


@pytest.mark.slow
@pytest.mark.parametrize("model", [UNICYCLE, INCREMENT])
@given(x=poses, u=velocities | steps)
def test_a_step_is_f_and_its_jacobians(model: MotionModel, x: FloatArray, u: FloatArray) -> None:
    found, angle = model.step(x, u), turned(2)
    assert np.allclose(angle(found.pose, model.f(x, u)), 0.0, rtol=0.0, atol=1e-13)
    assert -np.pi < found.pose[2] <= np.pi
    F = jacobian(lambda pose: model.f(pose, u), x, difference=angle)
    W = jacobian(lambda w: model.f(x, u, w), np.zeros(len(model.Q(u))), difference=angle)
    assert np.allclose(found.F, F, rtol=1e-8, atol=1e-8)
    assert np.allclose(found.W, W, rtol=1e-8, atol=1e-8)


@pytest.mark.slow
@given(poses, velocities)
def test_arc_is_the_integral_of_the_velocities(x: FloatArray, u: FloatArray) -> None:
    v, omega, dt = u
    node, weight = np.polynomial.legendre.leggauss(40)
    heading = x[2] + omega * dt * 0.5 * (1.0 + node)
    drive = 0.5 * dt * v * np.array([weight @ np.cos(heading), weight @ np.sin(heading), 0.0])
    end = x + drive + (0.0, 0.0, omega * dt)
    assert np.allclose(turned(2)(UNICYCLE.f(x, u), end), 0.0, atol=1e-12)


@given(poses, steps)
def test_increment_is_the_product_of_rigid_motions(x: FloatArray, u: FloatArray) -> None:
    def matrix(q: FloatArray) -> FloatArray:
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.array([[c, -s, q[0]], [s, c, q[1]], [0.0, 0.0, 1.0]])

    assert np.allclose(matrix(INCREMENT.f(x, u)), matrix(x) @ matrix(u), atol=1e-12)


@pytest.mark.slow
@given(poses, velocities, st.integers(2, 7))
def test_with_a_period_an_interval_adds_the_same_however_it_is_cut(x: FloatArray, u: FloatArray, parts: int) -> None:
    # Straight ahead, so that what is left is the cutting alone and not how heading errors carry on.
    model = Unicycle(0.1, 0.0, period=0.1)
    whole = np.array([u[0], 0.0, u[2]])
    part = np.array([u[0], 0.0, u[2] / parts])
    added, cut = (W @ model.Q(step) @ W.T for step in (whole, part) for W in [model.step(x, step).W])
    assert np.allclose(added, parts * cut, rtol=1e-9, atol=1e-15)


SENSOR = RangeBearing(0.1, 0.02, growth=0.3)

headings = st.sampled_from([-np.pi, np.pi, 0.0, np.pi / 2]) | st.floats(-3.2, 3.2)
near_poses = st.tuples(st.floats(-20, 20), st.floats(-20, 20), headings).map(np.array)
# Points at every distance from 1 cm to 100 m, so that bearings of near ones change quickly.
offsets = st.tuples(st.floats(-2, 2), headings).map(lambda p: 10.0 ** p[0] * np.array([np.cos(p[1]), np.sin(p[1])]))


@pytest.mark.slow
@given(x=near_poses, offset=offsets)
def test_jacobians(x: FloatArray, offset: FloatArray) -> None:
    sensor, l, d = SENSOR, x[:2] + offset, float(np.hypot(*offset))
    difference = turned(1)
    step = min(1e-3 * d, 1e-3)
    # Central differences of fourth order lose 1e-16·|x|/step to rounding.
    atol = 1e-12 / step + 1e-8
    zero = np.zeros(len(sensor.R))
    found, functions = (
        sensor.linearised(x, l),
        (lambda p: sensor.h(p, l), lambda p: sensor.h(x, p), lambda v: sensor.h(x, l, v)),
    )
    assert np.allclose(difference(found.z_hat, sensor.h(x, l)), 0.0)
    for by, function, at in zip((found.H_pose, found.H_feature, sensor.V(x, l)), functions, (x, l, zero), strict=True):
        assert np.allclose(by, jacobian(function, at, step, difference), rtol=1e-7, atol=atol)


@pytest.mark.slow
@given(x=near_poses, offset=offsets)
def test_inverse(x: FloatArray, offset: FloatArray) -> None:
    sensor, l = SENSOR, x[:2] + offset
    z = sensor.h(x, l)
    found, G_pose, G_z = sensor.inverse(x, z)
    assert np.allclose(found, l, atol=1e-9)
    assert np.allclose(sensor.residual(sensor.h(x, found), z), 0.0, atol=1e-6)
    by_pose = jacobian(lambda p: sensor.inverse(p, z).feature, x, 1e-4, np.subtract)
    by_reading = jacobian(lambda r: sensor.inverse(x, r).feature, z, 1e-4, np.subtract)
    assert np.allclose(G_pose, by_pose, rtol=1e-7, atol=1e-7)
    assert np.allclose(G_z, by_reading, rtol=1e-7, atol=1e-7)


def test_what_a_linearised_reading_misses() -> None:
    rng, r, sensor = np.random.default_rng(0), 3.0, RangeBearing(0.1, 0.02)
    C = np.array([[0.03, 0.004], [0.004, 0.01]])
    off = rng.multivariate_normal(np.zeros(2), C, 200_000) * [1.0, r]  # along and across the line of sight
    missed = sensor.h(np.zeros(3), np.add(off, [r, 0.0])) - [r, 0.0] - off / [1.0, r]
    found = sensor.curvature(np.array([r, 0.4]), C)
    assert np.diagonal(found) == pytest.approx((missed**2).mean(axis=0), rel=0.1)
    assert found[0, 1] == 0.0
    # On the feature, or with no idea of the bearing, all stays finite.
    assert np.isfinite(sensor.curvature(np.zeros(2), np.diag([1.0, 1e18]))).all()
    assert all(np.isfinite(part).all() for part in sensor.linearised(np.array([1.0, 2.0, 0.3]), np.array([1.0, 2.0])))


def test_a_point_by_x_and_y_becomes_range_and_bearing() -> None:
    rng, P = np.random.default_rng(0), np.array([[0.04, 0.01], [0.01, 0.02]])
    found = as_range_bearing(Detection(1.0, np.array([3.0, 4.0]), "cartesian", 7, P))
    assert (found.t, found.kind, found.identity) == (1.0, "range-bearing", 7)
    assert found.z == pytest.approx([5.0, np.arctan2(4.0, 3.0)])
    x, y = rng.multivariate_normal([3.0, 4.0], 1e-4 * P, 100_000).T
    assert found.covariance == pytest.approx(1e4 * np.cov(np.hypot(x, y), np.arctan2(y, x)), rel=0.03, abs=1e-4)
