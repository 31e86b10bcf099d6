# ruff: noqa: E741, N806 # the filter's own symbols
"""Sensor models: Jacobians against numerical ones, inverses undone, angles and lines with two names."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.estimation.numerical import jacobian, turned

from trailmark.estimation import Cartesian, EstimationError, LinePolar, RangeBearing, SensorModel

FloatArray = NDArray[np.float64]

SENSORS: list[SensorModel] = [
    RangeBearing(0.1, 0.02),
    RangeBearing(0.1, 0.02, growth=0.3),
    Cartesian(0.1, 0.2),
    LinePolar(0.1, 0.02),
]
ANGLE = {"RangeBearing": (1,), "Cartesian": (), "LinePolar": (1,)}
"""Which numbers of a reading are angles."""

headings = st.sampled_from([-np.pi, np.pi, 0.0, np.pi / 2]) | st.floats(-3.2, 3.2)
poses = st.tuples(st.floats(-20, 20), st.floats(-20, 20), headings).map(np.array)
# Points at every distance from 1 cm to 100 m, so that bearings of near ones change quickly.
offsets = st.tuples(st.floats(-2, 2), headings).map(lambda p: 10.0 ** p[0] * np.array([np.cos(p[1]), np.sin(p[1])]))
lines = st.tuples(st.floats(-20, 20), headings).map(np.array)
seeds = st.integers(0, 99999)


def feature(sensor: SensorModel, x: FloatArray, offset: FloatArray, line: FloatArray) -> FloatArray:
    return line if sensor.feature_kind == "line" else x[:2] + offset


def distance(sensor: SensorModel, x: FloatArray, l: FloatArray) -> float:
    """Of the robot from the feature; 0 is where a reading jumps or loses its derivative."""
    if sensor.feature_kind == "line":
        return abs(float(l[0] - x[0] * np.cos(l[1]) - x[1] * np.sin(l[1])))
    return float(np.hypot(*(l - x[:2])))


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
@given(x=poses, offset=offsets, line=lines)
def test_jacobians(sensor: SensorModel, x: FloatArray, offset: FloatArray, line: FloatArray) -> None:
    l = feature(sensor, x, offset, line)
    d = distance(sensor, x, l)
    assume(d > 5e-3)
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
@given(x=poses, offset=offsets, line=lines)
def test_inverse(sensor: SensorModel, x: FloatArray, offset: FloatArray, line: FloatArray) -> None:
    l = feature(sensor, x, offset, line)
    assume(distance(sensor, x, l) > 5e-3)
    # A line's foot point must not lie where its name changes either, for the numerical Jacobians' sake.
    assume(sensor.feature_kind != "line" or abs(l[0]) > 5e-3)
    z = sensor.h(x, l)
    found, G_pose, G_z = sensor.inverse(x, z)
    difference = turned(1) if sensor.feature_kind == "line" else np.subtract
    expected = LinePolar.canonical(l) if sensor.feature_kind == "line" else l
    assert np.allclose(difference(found, expected), 0.0, atol=1e-9)
    assert np.allclose(sensor.residual(sensor.h(x, found), z), 0.0, atol=1e-6)
    atol = 1e-7
    assert np.allclose(
        G_pose, jacobian(lambda p: sensor.inverse(p, z).feature, x, 1e-4, difference), rtol=1e-7, atol=atol
    )
    assert np.allclose(G_z, jacobian(lambda r: sensor.inverse(x, r).feature, z, 1e-4, difference), rtol=1e-7, atol=atol)


@pytest.mark.parametrize("sensor", SENSORS)
def test_batches_are_row_by_row(sensor: SensorModel) -> None:
    rng = np.random.default_rng(1)
    x, l = rng.normal(size=(4, 1, 3)), rng.normal(size=(5, 2)) * 3.0
    z, v = sensor.h(x, l), rng.normal(size=(4, 5, 2)) * 0.01
    cases: list[tuple[FloatArray, Callable[[int, int], FloatArray]]] = [
        (z, lambda i, j: sensor.h(x[i, 0], l[j])),
        (sensor.h(x, l, v), lambda i, j: sensor.h(x[i, 0], l[j], v[i, j])),
        (sensor.H_pose(x, l), lambda i, j: sensor.H_pose(x[i, 0], l[j])),
        (sensor.H_feature(x, l), lambda i, j: sensor.H_feature(x[i, 0], l[j])),
        (sensor.V(x, l), lambda i, j: sensor.V(x[i, 0], l[j])),
        (sensor.noise(x, l), lambda i, j: sensor.noise(x[i, 0], l[j])),
        (sensor.inverse(x, z).feature, lambda i, j: sensor.inverse(x[i, 0], z[i, j]).feature),
        (sensor.inverse(x, z).G_pose, lambda i, j: sensor.inverse(x[i, 0], z[i, j]).G_pose),
        (sensor.inverse(x, z).G_z, lambda i, j: sensor.inverse(x[i, 0], z[i, j]).G_z),
        (sensor.residual(z, z[0, 0]), lambda i, j: sensor.residual(z[i, j], z[0, 0])),
    ]
    for whole, row in cases:
        assert whole.shape[:2] == (4, 5)
        assert all(np.allclose(whole[i, j], row(i, j), atol=1e-14) for i in range(4) for j in range(5))


def test_a_reading_by_hand() -> None:
    # At (1, 2), looking up: a point 3 m to the right and 4 m ahead.
    x, l = [1.0, 2.0, np.pi / 2], [4.0, 6.0]
    assert np.allclose(RangeBearing(0.1, 0.1).h(x, l), [5.0, -np.arctan2(3.0, 4.0)])
    assert np.allclose(Cartesian(0.1, 0.1).h(x, l), [4.0, -3.0])
    # The wall x = 4 is 3 m away, to the right.
    assert np.allclose(LinePolar(0.1, 0.1).h(x, [4.0, 0.0]), [3.0, -np.pi / 2])
    # The wall x = −1 is 2 m away, to the left, by whichever of its names.
    for name in ([1.0, np.pi], [-1.0, 0.0]):
        assert np.allclose(LinePolar(0.1, 0.1).h(x, name), [2.0, np.pi / 2])


@given(x=poses, line=lines, seed=seeds)
def test_a_line_s_reading_is_a_matter_of_its_points(x: FloatArray, line: FloatArray, seed: int) -> None:
    # Points of the line, seen from the pose, lie on the line that is read.
    along = np.random.default_rng(seed).uniform(-10.0, 10.0, 5)
    normal, side = np.array([np.cos(line[1]), np.sin(line[1])]), np.array([-np.sin(line[1]), np.cos(line[1])])
    points = line[0] * normal + along[:, None] * side
    c, s = np.cos(x[2]), np.sin(x[2])
    seen = (points - x[:2]) @ np.array([[c, -s], [s, c]])
    rho, alpha = LinePolar(0.1, 0.1).h(x, line)
    assert rho >= 0.0
    assert -np.pi < alpha <= np.pi
    assert np.allclose(seen @ [np.cos(alpha), np.sin(alpha)], rho, atol=1e-9)


@given(rho=st.floats(-0.2, 0.2), alpha=headings, rho_hat=st.floats(0.0, 0.2), turn=st.floats(-0.5, 0.5))
def test_residual_of_a_line_through_the_robot(rho: float, alpha: float, rho_hat: float, turn: float) -> None:
    # Both names of the same reading give the same small residual, however near the line passes.
    sensor = LinePolar(0.1, 0.1)
    z_hat = np.array([rho_hat, alpha])
    for z in ([rho, alpha + turn], [-rho, alpha + turn + np.pi], [-rho, alpha + turn - np.pi]):
        assert np.allclose(sensor.residual(z, z_hat), [rho - rho_hat, turn], atol=1e-12)


@given(x=poses, line=lines)
def test_the_name_of_a_line_does_not_matter_to_the_filter(x: FloatArray, line: FloatArray) -> None:
    # Sign changes of H's rows come and go with those of the line's covariance: what the filter makes of it is one.
    sensor = LinePolar(0.1, 0.1)
    assume(distance(sensor, x, line) > 1e-6)
    other = np.array([-line[0], line[1] + np.pi])
    assert np.allclose(sensor.residual(sensor.h(x, line), sensor.h(x, other)), 0.0, atol=1e-9)
    assert np.allclose(sensor.H_pose(x, line), sensor.H_pose(x, other), atol=1e-9)
    assert np.allclose(sensor.H_feature(x, line), sensor.H_feature(x, other) @ np.diag([-1.0, 1.0]), atol=1e-9)


@given(
    st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6), st.sampled_from([0.0, np.pi, -np.pi, 3 * np.pi, -5 * np.pi, 1e6])
)
def test_bearings_are_compared_the_shorter_way_round(a: float, b: float, base: float) -> None:
    y = RangeBearing(0.1, 0.1).residual([3.0, base + a], [1.0, base + b - 2 * np.pi])
    assert np.allclose(y, [2.0, a - b], atol=1e-9)
    full = RangeBearing(0.1, 0.1).residual([0.0, np.pi], [0.0, -np.pi])
    assert full[1] == 0.0


def test_residual_leaves_its_arguments_alone() -> None:
    for sensor in SENSORS:
        z, z_hat = np.array([1.0, 3.0]), np.array([0.5, -3.0])
        sensor.residual(z, z_hat)
        assert (z.tolist(), z_hat.tolist()) == ([1.0, 3.0], [0.5, -3.0])


def test_a_point_under_the_robot_has_finite_jacobians() -> None:
    sensor = RangeBearing(0.1, 0.1)
    x = np.array([1.0, 2.0, 0.3])
    assert np.isfinite(sensor.h(x, x[:2])).all()
    assert np.isfinite(sensor.H_pose(x, x[:2])).all()
    assert np.isfinite(sensor.H_feature(x, x[:2])).all()


@pytest.mark.parametrize("sensor", SENSORS)
def test_samples_have_the_stated_covariance(sensor: SensorModel) -> None:
    x, l = np.array([1.0, 2.0, 3.1]), np.array([6.0, 1.0])
    drawn = sensor.sample(np.broadcast_to(x, (20000, 3)), l, np.random.default_rng(1))
    y = sensor.residual(drawn, sensor.h(x, l))
    R = sensor.noise(x, l)
    assert np.allclose(y.T @ y / len(y), R, atol=0.05 * R.max())


def test_noise_that_grows_with_range() -> None:
    sensor = RangeBearing(0.1, 0.02, growth=0.5)
    assert np.allclose(sensor.noise(np.zeros(3), [4.0, 0.0]), np.diag([0.3**2, 0.02**2]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RangeBearing(0.0, 0.1), "RangeBearing: sigma_range: expected .*, got 0.0"),
        (lambda: RangeBearing(0.1, np.nan), "RangeBearing: sigma_bearing: expected .*, got nan"),
        (lambda: RangeBearing(0.1, 0.1, -1.0), "RangeBearing: growth: expected .*, got -1.0"),
        (lambda: Cartesian(0.1, -0.1), "Cartesian: sigma_y: expected .*, got -0.1"),
        (lambda: LinePolar(np.inf, 0.1), "LinePolar: sigma_rho: expected .*, got inf"),
    ],
)
def test_bad_noise(make: Callable[[], object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        make()


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
