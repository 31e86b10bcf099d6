# ruff: noqa: E741, N806 # the filter's own symbols
"""The SLAM filter against a dense textbook EKF, filterpy's own update, and what each mode promises."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.trials import few

from trailmark.estimation import (
    EstimationError,
    PoseIncrement,
    RangeBearing,
    SlamFilter,
    Unicycle,
)

FloatArray = NDArray[np.float64]

SENSOR = RangeBearing(0.1, 0.03)
MOTION = Unicycle(0.1, 0.05)
Q = np.diag([0.1**2, 0.05**2])
R = np.diag([0.1**2, 0.03**2])


def wrapped(angle: float) -> float:
    return float(np.angle(np.exp(1j * angle)))


def reading(ekf: SlamFilter, feature: int, rng: np.random.Generator) -> FloatArray:
    return np.asarray(SENSOR.sample(ekf.pose, ekf.feature(feature), rng))


def wander(ekf: SlamFilter, updates: int, rng: np.random.Generator) -> None:
    """Features all around, then readings of them, a step between any two."""
    for _ in range(20):
        ekf.add_feature([rng.uniform(1.0, 20.0), rng.uniform(-np.pi, np.pi)], SENSOR)
    ids = list(ekf.features)
    for _ in range(updates):
        ekf.predict(MOTION, [0.5, rng.uniform(-0.5, 0.5), 0.1])
        i = ids[rng.integers(len(ids))]
        ekf.update(reading(ekf, i, rng), SENSOR, i)


@pytest.mark.slow
def test_covariance_stays_symmetric_and_positive_definite_over_a_thousand_updates() -> None:
    # A start that is certain: the hardest, since what the features then share is the motion's noise alone.
    ekf = SlamFilter()
    wander(ekf, 1000, np.random.default_rng(1))
    assert np.array_equal(ekf.P, ekf.P.T)
    np.linalg.cholesky(ekf.P)
    assert -np.pi < ekf.pose[2] <= np.pi


@pytest.mark.slow
def test_covariance_stays_positive_with_a_prior_much_wider_than_the_readings() -> None:
    rng = np.random.default_rng(2)
    sharp = RangeBearing(1e-4, 1e-4)
    ekf = SlamFilter((0.0, 0.0, 0.0), np.diag([1e-12, 1e-12, 1e-12]))
    i = ekf.add_known_feature([5.0, 0.0], 1e4 * np.eye(2))
    for _ in range(500):
        ekf.update(sharp.sample(ekf.pose, [5.0, 0.0], rng), sharp, i)
        assert np.linalg.eigvalsh(ekf.P).min() > 0.0
    assert np.array_equal(ekf.P, ekf.P.T)


@pytest.mark.slow
def test_predictions_of_readings() -> None:
    rng = np.random.default_rng(4)
    ekf = SlamFilter()
    wander(ekf, 100, rng)
    prediction = ekf.predict_readings(SENSOR)
    assert prediction.ids == tuple(ekf.features)
    joint = ekf.joint_covariance(prediction)
    for k, i in enumerate(prediction.ids):
        z = reading(ekf, i, rng)
        innovation = ekf.innovation(z, SENSOR, i)
        assert np.allclose(innovation.S, prediction.S[k], atol=1e-12)
        assert np.allclose(innovation.S - prediction.R[k], joint[k, :, k, :], atol=1e-12)
        assert np.allclose(innovation.y, SENSOR.residual(z, prediction.z_hat[k]))
    # Two at once: what is off the diagonal of their S is what they share.
    pair = [prediction.ids[3], prediction.ids[11]]
    both = ekf.update_batch([reading(ekf, i, rng) for i in pair], SENSOR, pair)
    assert np.allclose(both.S[:2, 2:], joint[3, :, 11, :], atol=1e-12)
    assert np.array_equal(joint.reshape(40, 40).round(12), joint.reshape(40, 40).T.round(12))


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


@pytest.mark.slow
def test_mapping_from_certain_poses_keeps_features_apart() -> None:
    rng = np.random.default_rng(6)
    truth = rng.uniform(-5.0, 5.0, (8, 2))
    ekf = SlamFilter(mode="mapping")
    alone = [SlamFilter(mode="mapping") for _ in truth]
    ids = [ekf.add_feature(SENSOR.h(np.zeros(3), l), SENSOR) for l in truth]
    for one, l in zip(alone, truth, strict=True):
        one.add_feature(SENSOR.h(np.zeros(3), l), SENSOR)
    for _ in range(200):
        pose, k = rng.uniform(-8.0, 8.0, 3), int(rng.integers(8))
        z = SENSOR.sample(pose, truth[k], rng)
        for f, i in ((ekf, ids[k]), (alone[k], 0)):
            f.set_pose(pose)
            f.update(z, SENSOR, i)
            assert np.allclose(f.pose - pose, [0.0, 0.0, wrapped(pose[2]) - pose[2]])
            assert not f.pose_covariance.any()
    for k, i in enumerate(ids):
        assert np.allclose(ekf.feature(i), alone[k].feature(0), atol=1e-12)
        assert np.allclose(ekf.feature_covariance(i), alone[k].feature_covariance(0), atol=1e-12)
        e = ekf.feature(i) - truth[k]
        assert e @ np.linalg.solve(ekf.feature_covariance(i), e) < 20.0
    off = ekf.P[3:, 3:] * (1.0 - np.kron(np.eye(8), np.ones((2, 2))))
    assert not off.any()


@pytest.mark.slow
def test_mapping_from_uncertain_poses_counts_their_errors() -> None:
    rng = np.random.default_rng(7)
    nees = []
    P = np.diag([0.1, 0.1, 0.02]) ** 2
    truth = np.array([[4.0, 1.0], [4.0, -1.0]])
    for _ in range(few(200, of=2)):
        ekf = SlamFilter(mode="mapping")
        for k in range(10):
            given_pose = np.array([0.2 * k, 0.0, 0.0])
            pose = given_pose + rng.normal(0, 1, 3) * np.sqrt(np.diag(P))
            ekf.set_pose(given_pose, P)
            z = SENSOR.sample(pose, truth, rng)
            if k == 0:
                ids = [ekf.add_feature(row, SENSOR) for row in z]
            else:
                ekf.update_batch(z, SENSOR, ids)
                assert np.array_equal(ekf.pose, given_pose)
                assert np.array_equal(ekf.pose_covariance, P)
            assert np.array_equal(ekf.P, ekf.P.T)
        assert np.linalg.eigvalsh(ekf.P).min() > 0.0
        e = ekf.x[3:] - truth.reshape(-1)
        nees.append(e @ np.linalg.solve(ekf.P[3:, 3:], e))
    assert 3.3 < np.mean(nees) < 4.9


def test_ids_stay_when_others_go() -> None:
    ekf = SlamFilter()
    ids = [ekf.add_known_feature([float(k), 0.0], k * np.eye(2)) for k in range(4)]
    ekf.remove_feature(ids[1])
    assert list(ekf.features) == [ids[0], ids[2], ids[3]]
    assert [ekf.feature(i)[0] for i in ekf.features] == [0.0, 2.0, 3.0]
    assert ekf.feature_covariance(ids[3])[1, 1] == 3.0
    assert ekf.dim_x == len(ekf.x) == 9
    assert ekf.add_known_feature([9.0, 9.0]) not in ids


def slam() -> SlamFilter:
    ekf = SlamFilter()
    ekf.add_known_feature([1.0, 2.0], np.eye(2))
    return ekf


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SlamFilter(mode="slamm"), "did you mean 'slam'"),  # type: ignore[arg-type]  # wrong on purpose
        (
            lambda: SlamFilter((0, 0, 0), np.eye(2)),
            r"expected a finite covariance of shape \(3, 3\)",
        ),
        (lambda: SlamFilter((0, 0, 0), -np.eye(3)), "positive semidefinite"),
        (lambda: SlamFilter(np.zeros((2, 3))), r"pose: expected shape \(3,\), got \(2, 3\)"),
        (lambda: slam().update([1.0, 0.0], SENSOR, 7), "feature: expected the id of one of the 1 features, got 7"),
        (lambda: slam().remove_feature(7), "feature: expected the id of one of the 1 features, got 7"),
        (lambda: slam().update([np.nan, 0.0], SENSOR, 0), "finite"),
        (lambda: slam().update([1.0, 0.0, 0.0], SENSOR, 0), "1 times 2 finite numbers"),
        (lambda: slam().update([1.0, 0.0], SENSOR, 0, -9 * np.eye(2)), "positive semidefinite"),
        (
            lambda: slam().update_batch(np.ones((2, 2)), SENSOR, [0, 0]),
            "expected one reading of each feature",
        ),
        (lambda: slam().add_feature([np.inf, 0.0], SENSOR), "2 finite numbers"),
        (lambda: slam().add_known_feature([np.inf, 0.0]), "finite numbers"),
        (lambda: slam().predict(MOTION, [np.nan, 0.0, 1.0]), "odometry"),
        (lambda: slam().set_pose([0, 0, 0]), "expected mode 'mapping', got 'slam'"),
        (lambda: slam().predict_update(None, None, None), "expected predict, then update"),
        (
            lambda: SlamFilter(mode="mapping").predict(MOTION, [1, 0, 1]),
            "expected set_pose",
        ),
    ],
)
def test_misuse(call: Callable[[], object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        call()


def test_a_refused_reading_changes_nothing() -> None:
    ekf = slam()
    x, P = ekf.x.copy(), ekf.P.copy()
    with pytest.raises(EstimationError):
        ekf.update([np.nan, 0.0], SENSOR, 0)
    assert np.array_equal(ekf.x, x)
    assert np.array_equal(ekf.P, P)
    assert "features=1" in repr(ekf)
