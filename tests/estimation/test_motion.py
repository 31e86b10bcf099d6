# ruff: noqa: N806 # the filter's own symbols
"""Motion models: Jacobians against numerical ones, arcs against integration, noise against its statistics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.estimation.numerical import jacobian, turned

from trailmark.estimation.models import MotionModel, PoseIncrement, Unicycle

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


def check(model: MotionModel, x: FloatArray, u: FloatArray, q: int) -> None:
    F = jacobian(lambda pose: model.f(pose, u), x, difference=turned(2))
    W = jacobian(lambda w: model.f(x, u, w), np.zeros(q), difference=turned(2))
    assert np.allclose(model.F(x, u), F, rtol=1e-8, atol=1e-8)
    assert np.allclose(model.W(x, u), W, rtol=1e-8, atol=1e-8)


@pytest.mark.slow
@given(poses, velocities)
def test_one_step_is_f_and_its_jacobians(x: FloatArray, u: FloatArray) -> None:
    for model in (UNICYCLE, INCREMENT):
        step = model.step(x, u)
        assert np.allclose(turned(2)(step.pose, model.f(x, u)), 0.0, rtol=0.0, atol=1e-13)
        assert -np.pi < step.pose[2] <= np.pi
        assert np.allclose(step.F, model.F(x, u), rtol=1e-13, atol=1e-13)
        assert np.allclose(step.W, model.W(x, u), rtol=1e-13, atol=1e-15)


@pytest.mark.slow
@given(poses, velocities)
def test_unicycle_jacobians(x: FloatArray, u: FloatArray) -> None:
    check(UNICYCLE, x, u, 2)


@given(poses, steps)
def test_increment_jacobians(x: FloatArray, u: FloatArray) -> None:
    check(INCREMENT, x, u, 3)


@pytest.mark.parametrize("turn", [*TURNS, 5e-5, 1e-4, 0.05, 0.5])
def test_slope_across_the_turn_to_twelve_digits(turn: float) -> None:
    # ∂(x, y)/∂ω of the arc with v = dt = 1 from the origin: the derivatives of sin(ω)/ω and (1 − cos ω)/ω, by
    # their own power series in extended precision, which converges quickly for the turns here.
    w = np.longdouble(turn)
    x_slope = y_slope = np.longdouble(0)
    factorial = np.longdouble(1)
    for k in range(1, 80):
        factorial *= k
        sign = 1 if (k // 2) % 2 == 0 else -1
        if k % 2 == 1 and k > 1:
            x_slope += sign * (k - 1) * w ** (k - 2) / factorial
        elif k % 2 == 0:
            y_slope += -sign * (k - 1) * w ** (k - 2) / factorial
    found = UNICYCLE.W(np.zeros(3), np.array([1.0, turn, 1.0]))[:2, 1]
    assert np.allclose(found, [float(x_slope), float(y_slope)], rtol=1e-12, atol=1e-17)


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
    added = model.W(x, whole) @ model.Q(whole) @ model.W(x, whole).T
    cut = parts * (model.W(x, part) @ model.Q(part) @ model.W(x, part).T)
    assert np.allclose(added, cut, rtol=1e-9, atol=1e-15)
