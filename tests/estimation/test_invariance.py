# ruff: noqa: E741, N803, N806 # the filter's own symbols: l, P, H, W, S, K, T
"""The invariant error: against the filter written on the group itself, and what no reading may tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares
from tests.support.trials import few

from trailmark.estimation import RangeBearing, SlamFilter, Unicycle

FloatArray = NDArray[np.float64]

SENSOR = RangeBearing(0.1, 0.03)
R = np.diag([0.1**2, 0.03**2])
MOTION = Unicycle(0.1, 0.05)
Q = np.diag([0.1**2, 0.05**2])
J = np.array([[0.0, -1.0], [1.0, 0.0]])


class OnTheGroup:
    """The right-invariant EKF on SE₁₊ₙ(2), matrices in full: X = [Rot, p, l₁, …; 0, I] = exp(ξ) X̂, ξ = (θ, p, l…)."""

    def __init__(self, pose: FloatArray, P: FloatArray) -> None:
        self.theta, self.points = float(pose[2]), [pose[:2].copy()]
        # From x, y, theta as they are to theta first, and to what turns with the map.
        T = np.zeros((3, 3))
        T[0, 2] = 1.0
        T[1:, :2], T[1:, 2] = np.eye(2), -J @ pose[:2]
        self.P = T @ P @ T.T

    def predict(self, v: float, omega: float, dt: float) -> None:
        c, s = np.cos(self.theta), np.sin(self.theta)
        end = self.theta + omega * dt
        ce, se = np.cos(end), np.sin(end)
        step = v / omega * np.array([se - s, c - ce])
        W = np.zeros((len(self.P), 2))
        after = self.points[0] + step
        slope = np.array([-step[0] / omega + v / omega * dt * ce, -step[1] / omega + v / omega * dt * se])
        W[0, 1] = dt
        W[1:3, 0] = step / v
        W[1:3, 1] = slope - J @ after * dt
        for i, l in enumerate(self.points[1:]):
            W[3 + 2 * i : 5 + 2 * i, 1] = -J @ l * dt
        self.points[0], self.theta = after, end
        # F is the identity: whatever the estimates.
        self.P = self.P + W @ Q @ W.T

    def add(self, z: FloatArray) -> None:
        a = self.theta + z[1]
        ahead = z[0] * np.array([np.cos(a), np.sin(a)])
        G = np.column_stack([[np.cos(a), np.sin(a)], J @ ahead])
        n = len(self.P)
        # The point turns and shifts with the robot: by the group's error it errs as the robot does, and by its reading.
        copy = np.zeros((n + 2, n))
        copy[:n], copy[n:, 1:3] = np.eye(n), np.eye(2)
        self.P = copy @ self.P @ copy.T
        self.P[n:, n:] += G @ R @ G.T
        self.points.append(self.points[0] + ahead)

    def update(self, z: FloatArray, i: int) -> None:
        d = self.points[1 + i] - self.points[0]
        r = float(np.hypot(*d))
        H = np.zeros((2, len(self.P)))
        H[:, 3 + 2 * i : 5 + 2 * i] = np.array([d / r, J @ d / r**2])
        H[:, 1:3] = -H[:, 3 + 2 * i : 5 + 2 * i]
        y = z - [r, np.arctan2(d[1], d[0]) - self.theta]
        y[1] = np.angle(np.exp(1j * y[1]))
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        xi = K @ y
        k = len(self.points)
        algebra = np.zeros((2 + k, 2 + k))
        algebra[:2, :2], algebra[:2, 2:] = xi[0] * J, xi[1:].reshape(-1, 2).T
        turn = expm(algebra)
        self.points = [turn[:2, :2] @ p + turn[:2, 2 + n] for n, p in enumerate(self.points)]
        self.theta += float(xi[0])
        self.P = (np.eye(len(self.P)) - K @ H) @ self.P

    def usual(self) -> tuple[FloatArray, FloatArray]:
        """Return x and P in the order and with the error of the filter under test."""
        n = len(self.P)
        T = np.zeros((n, n))
        T[2, 0], T[:2, 1:3] = 1.0, np.eye(2)
        T[3:, 3:] = np.eye(n - 3)
        rows = [slice(0, 2), *(slice(3 + 2 * i, 5 + 2 * i) for i in range(len(self.points) - 1))]
        for at, p in zip(rows, self.points, strict=True):
            T[at, 0] = J @ p
        heading = np.angle(np.exp(1j * self.theta))
        return np.concatenate([self.points[0], [heading], *self.points[1:]]), T @ self.P @ T.T


@pytest.mark.slow
@settings(max_examples=few(15))
@given(seed=st.integers(0, 99999), steps=st.integers(1, 40))
def test_equal_to_the_filter_on_the_group(seed: int, steps: int) -> None:
    rng = np.random.default_rng(seed)
    start, P = rng.uniform(-2.0, 2.0, 3), np.diag(rng.uniform(0.001, 0.1, 3))
    ekf, group = SlamFilter(start, P), OnTheGroup(start, P)
    for _ in range(steps):
        ids = list(ekf.features)
        what = rng.choice(["predict", "update", "add"], p=[0.35, 0.4, 0.25])
        if what == "predict":
            u = np.array([rng.uniform(0.1, 1), rng.choice([-1, 1]) * rng.uniform(0.1, 1), rng.uniform(0.1, 1)])
            ekf.predict(MOTION, u)
            group.predict(*u)
        elif what == "add" or not ids:
            z = np.array([rng.uniform(1.0, 10.0), rng.uniform(-np.pi, np.pi)])
            ekf.add_feature(z, SENSOR)
            group.add(z)
        else:
            i = int(rng.integers(len(ids)))
            z = np.asarray(SENSOR.sample(ekf.pose, ekf.feature(ids[i]), rng))
            ekf.update(z, SENSOR, ids[i])
            group.update(z, i)
        x, covariance = group.usual()
        assert np.allclose(ekf.x, x, atol=1e-8)
        assert np.allclose(ekf.P, covariance, atol=1e-8)
        assert np.array_equal(ekf.P, ekf.P.T)


def everything_turned(ekf: SlamFilter) -> FloatArray:
    """Return how the state moves when all of it turns about the origin."""
    direction = np.zeros(len(ekf.x))
    direction[2] = 1.0
    for at in [slice(0, 2), *ekf.features.values()]:
        direction[at] = J @ ekf.x[at]
    return direction


@pytest.mark.slow
@pytest.mark.parametrize("iterations", [1, 3])
def test_readings_tell_nothing_of_how_the_map_is_turned(iterations: int) -> None:
    # vᵀ P⁻¹ v is the information on moving along v. Readings add none along a turn of everything; noise takes some.
    rng = np.random.default_rng(3)
    ekf = SlamFilter((1.0, 2.0, 0.5), np.diag([0.1, 0.1, 0.05]) ** 2, iterations=iterations)
    truth, pose = rng.uniform(-6.0, 6.0, (8, 2)), ekf.pose
    ids = [ekf.add_feature(SENSOR.sample(pose, l, rng), SENSOR) for l in truth]
    v = everything_turned(ekf)
    before = float(v @ np.linalg.solve(ekf.P, v))
    for k in range(80):
        ekf.update(SENSOR.sample(pose, truth[k % 8], rng), SENSOR, ids[k % 8])
    v = everything_turned(ekf)
    assert float(v @ np.linalg.solve(ekf.P, v)) == pytest.approx(before, rel=1e-6)


def test_an_iterated_update_is_the_best_fit_of_prior_and_reading() -> None:
    # One landmark far off to the side: bearing alone tells its place, and the straight line is far from the arc.
    prior, P = np.array([5.0, 0.0]), np.diag([0.5, 3.0]) ** 2
    sensor, z = RangeBearing(0.05, 0.01), np.array([6.5, 0.6])
    found = {}
    for iterations in (1, 10):
        ekf = SlamFilter(iterations=iterations)
        i = ekf.add_known_feature(prior, P)
        ekf.update(z, sensor, i)
        found[iterations] = ekf.feature(i)

    def residuals(l: FloatArray) -> FloatArray:
        off = (l - prior) / np.sqrt(np.diag(P))
        return np.array([*off, (np.hypot(*l) - z[0]) / 0.05, (np.arctan2(l[1], l[0]) - z[1]) / 0.01])

    best = least_squares(residuals, prior, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    assert np.hypot(*(found[10] - best)) < 5e-3
    assert np.hypot(*(found[1] - best)) > 0.3


def test_merged_points_are_the_mean_by_their_covariances() -> None:
    ekf = SlamFilter()
    a, b = np.array([1.0, 2.0]), np.array([1.3, 2.2])
    A, B = np.diag([0.04, 0.01]), np.array([[0.02, 0.01], [0.01, 0.03]])
    keep, drop = ekf.add_known_feature(a, A), ekf.add_known_feature(b, B)
    other = ekf.add_known_feature([9.0, 9.0], np.eye(2))
    ekf.merge_features(keep, drop)
    together = np.linalg.inv(np.linalg.inv(A) + np.linalg.inv(B))
    assert np.allclose(ekf.feature(keep), together @ (np.linalg.solve(A, a) + np.linalg.solve(B, b)), atol=1e-5)
    assert np.allclose(ekf.feature_covariance(keep), together, atol=1e-5)
    assert np.allclose(ekf.feature(other), [9.0, 9.0])
    assert list(ekf.features) == [keep, other]
