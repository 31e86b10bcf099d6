# ruff: noqa: E741, N802, N806 # the filter's own symbols
"""The SLAM filter against filterpy's dense one and the filter written on the group."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from trailmark.estimation import PoseIncrement, RangeBearing, SlamFilter, Unicycle
from trailmark.estimation.slam_filter import carried, moved

FloatArray = NDArray[np.float64]

SENSOR = RangeBearing(0.1, 0.03)
MOTION = Unicycle(0.1, 0.05)
R = np.diag([0.1**2, 0.03**2])
J = np.array([[0.0, -1.0], [1.0, 0.0]])


def wander(ekf: SlamFilter, updates: int, rng: np.random.Generator) -> None:
    """Features all around, then readings of them, a step between any two."""
    for _ in range(20):
        ekf.add_feature([rng.uniform(1.0, 20.0), rng.uniform(-np.pi, np.pi)], SENSOR)
    ids = list(ekf.features)
    for _ in range(updates):
        ekf.predict(MOTION, [0.5, rng.uniform(-0.5, 0.5), 0.1])
        i = ids[rng.integers(len(ids))]
        ekf.update(SENSOR.sample(ekf.pose, ekf.feature(i), rng), SENSOR, i)


@pytest.mark.slow
def test_covariance_stays_symmetric_and_positive_definite_over_a_thousand_updates() -> None:
    # A start that is certain: the hardest, since what the features then share is the motion's noise alone.
    ekf = SlamFilter()
    wander(ekf, 1000, np.random.default_rng(1))
    assert np.array_equal(ekf.P, ekf.P.T)
    np.linalg.cholesky(ekf.P)
    assert -np.pi < ekf.pose[2] <= np.pi


class Dense(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy ships no type information
    """filterpy's EKF of a pose and features, all in full: W Q Wᵀ and V R Vᵀ for its Q and R."""

    def move(self, motion: Unicycle, u: FloatArray) -> None:
        step, n = motion.step(self.x[:3], u), len(self.x)
        self.F, self.Q = np.eye(n), np.zeros((n, n))
        self.F[:3, :3], self.Q[:3, :3] = step.F, step.W @ motion.Q(u) @ step.W.T
        self.next_pose = step.pose
        self.predict()

    def predict_x(self, u: int = 0) -> None:
        self.x[:3] = self.next_pose

    def read(self, z: FloatArray, sensor: RangeBearing, at: slice) -> None:
        def H(x: FloatArray) -> FloatArray:
            found, full = sensor.linearised(x[:3], x[at]), np.zeros((2, len(x)))
            full[:, :3], full[:, at] = found.H_pose, found.H_feature
            return full

        noise = sensor.noise(self.x[:3], self.x[at])
        self.update(z, H, lambda x: sensor.h(x[:3], x[at]), noise, residual=sensor.residual)


@pytest.mark.slow
def test_equal_to_filterpys_dense_filter_on_the_same_data() -> None:
    """Each step from the same state is the same, but for the frame of the error; so are whole runs, nearly."""
    rng, posts = np.random.default_rng(0), np.array([[6.0, 3.0], [8.0, -2.0], [12.0, 4.0], [15.0, -3.0]])
    sensor, motion = RangeBearing(0.03, 0.01), Unicycle(0.02, 0.01, period=1.0)
    ekf, pose = SlamFilter(), np.zeros(3)
    ids = [ekf.add_feature(sensor.sample(pose, post, rng), sensor) for post in posts]
    whole, each = (Dense(dim_x=len(ekf.x), dim_z=2) for _ in range(2))
    whole.x, whole.P = ekf.x.copy(), ekf.P.copy()
    for k in range(60):
        u = np.array([0.2, 0.02, 1.0])
        pose = motion.sample(pose, u, rng)
        i = k % len(posts)
        z = sensor.sample(pose, posts[i], rng)
        each.x, each.P = ekf.x.copy(), ekf.P.copy()
        ekf.predict(motion, u)
        each.move(motion, u)
        assert np.allclose(ekf.x, each.x, rtol=0.0, atol=1e-12)
        assert np.allclose(ekf.P, each.P, rtol=0.0, atol=1e-12)
        before, at = ekf.x.copy(), ekf.features[ids[i]]
        found = ekf.update(z, sensor, ids[i])
        each.read(z, sensor, at)
        assert np.allclose(found.S, each.S, rtol=1e-9)
        assert np.allclose(found.y, each.y, atol=1e-12)
        turn = np.eye(len(ekf.x))
        turn[:, 2] += carried(before, ekf.x)
        assert np.allclose(ekf.x, moved(before, each.K @ each.y), rtol=0.0, atol=1e-9)
        assert np.allclose(ekf.P, turn @ each.P @ turn.T, rtol=0.0, atol=1e-9)
        whole.move(motion, u)
        whole.read(z, sensor, at)
    sigma = np.sqrt(np.diag(ekf.P))
    assert (np.abs(ekf.x - whole.x) < 0.2 * sigma).all()
    assert np.allclose(sigma, np.sqrt(np.diag(whole.P)), rtol=0.1)


def test_a_stated_covariance_counts_instead_of_the_sensor_s() -> None:
    stated = np.array([[0.04, 0.001], [0.001, 0.002]])
    for P in (np.zeros((3, 3)), np.diag([0.1, 0.1, 0.01])):
        ekf, other = SlamFilter((0, 0, 0), P), SlamFilter((0, 0, 0), P)
        i = ekf.add_feature([2.0, 0.3], SENSOR, stated)
        G_z = SENSOR.inverse(np.zeros(3), [2.0, 0.3]).G_z
        G_pose = SENSOR.inverse(np.zeros(3), [2.0, 0.3]).G_pose
        assert np.allclose(ekf.feature_covariance(i), G_z @ stated @ G_z.T + G_pose @ P @ G_pose.T)
        other.add_feature([2.0, 0.3], SENSOR)
        assert np.allclose(
            ekf.innovation([2.1, 0.2], SENSOR, i, stated).S - stated, ekf.innovation([2.1, 0.2], SENSOR, i).S - R
        )
        assert not np.allclose(ekf.feature_covariance(i), other.feature_covariance(0))
        ekf.predict(PoseIncrement(1.0, 1.0, 1.0), [1.0, 0.0, 0.0], np.diag([0.01, 0.02, 0.03]))
        F = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
        assert np.allclose(ekf.pose_covariance, F @ P @ F.T + np.diag([0.01, 0.02, 0.03]))


def test_ids_stay_when_others_go() -> None:
    ekf = SlamFilter()
    ids = [ekf.add_known_feature([float(k), 0.0], k * np.eye(2)) for k in range(4)]
    ekf.remove_feature(ids[1])
    assert list(ekf.features) == [ids[0], ids[2], ids[3]]
    assert [ekf.feature(i)[0] for i in ekf.features] == [0.0, 2.0, 3.0]
    assert ekf.feature_covariance(ids[3])[1, 1] == 3.0
    assert len(ekf.x) == 9
    assert ekf.add_known_feature([9.0, 9.0]) not in ids


def everything_turned(ekf: SlamFilter) -> FloatArray:
    """Return how the state moves when all of it turns about the origin."""
    direction = np.zeros(len(ekf.x))
    direction[2] = 1.0
    for at in [slice(0, 2), *ekf.features.values()]:
        direction[at] = J @ ekf.x[at]
    return direction


@pytest.mark.slow
def test_readings_tell_nothing_of_how_the_map_is_turned() -> None:
    # vᵀ P⁻¹ v is the information on moving along v. Readings add none along a turn of everything; noise takes some.
    rng = np.random.default_rng(3)
    ekf = SlamFilter((1.0, 2.0, 0.5), np.diag([0.1, 0.1, 0.05]) ** 2)
    truth, pose = rng.uniform(-6.0, 6.0, (8, 2)), ekf.pose
    ids = [ekf.add_feature(SENSOR.sample(pose, l, rng), SENSOR) for l in truth]
    v = everything_turned(ekf)
    before = float(v @ np.linalg.solve(ekf.P, v))
    for k in range(80):
        ekf.update(SENSOR.sample(pose, truth[k % 8], rng), SENSOR, ids[k % 8])
    v = everything_turned(ekf)
    assert float(v @ np.linalg.solve(ekf.P, v)) == pytest.approx(before, rel=1e-6)
