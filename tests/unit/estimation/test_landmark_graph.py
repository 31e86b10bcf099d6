# ruff: noqa: N806 # the names are those of the literature: P
"""The batch optimum against gtsam built by another hand, its covariances against dense algebra, and outliers."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.alignment import aligned

from trailmark.estimation import Detection
from trailmark.estimation.landmark_graph import Readings, Smoother, polar_readings, relative_covariance
from trailmark.estimation.models import RangeBearing
from trailmark.se2 import compose, wrap

FloatArray = NDArray[np.float64]
POSTS = np.array([[2.0, 1.0], [4.0, -1.0], [5.0, 2.0], [0.0, 3.0]])
SIGMA = np.array([0.05, 0.01])


def problem(seed: int = 0) -> tuple[FloatArray, FloatArray, Readings, NDArray[np.intp], FloatArray]:
    """A drive past four posts: motions, covariances, readings, their posts, true poses."""
    rng = np.random.default_rng(seed)
    steps = np.tile([0.4, 0.0, 0.15], (20, 1))
    P = np.tile(np.diag([0.01, 0.004, 0.02]) ** 2, (20, 1, 1))
    poses = [np.zeros(3)]
    for step in steps:
        poses.append(np.asarray(compose(poses[-1], step)))
    truth = np.array(poses)
    u = steps + rng.standard_normal((20, 3)) * [0.01, 0.004, 0.02]
    instant, of = (grid.ravel() for grid in np.mgrid[0:21, 0:4])
    dx, dy = (POSTS[of] - truth[instant, :2]).T
    z = np.column_stack([np.hypot(dx, dy), wrap(np.arctan2(dy, dx) - truth[instant, 2])])
    z += SIGMA * rng.standard_normal(z.shape)
    return u, P, Readings(instant, z, np.tile(np.diag(SIGMA**2), (len(z), 1, 1)), True), of, truth


def test_it_is_the_optimum_of_the_factors() -> None:
    u, P, readings, of, truth = problem()
    found = Smoother(u, P, readings, of).solve(truth, POSTS)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    for i, (motion, covariance) in enumerate(zip(u, P, strict=True)):
        c, s = np.cos(-motion[2]), np.sin(-motion[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        noise = gtsam.noiseModel.Gaussian.Covariance(turn @ covariance @ turn.T)
        graph.add(gtsam.BetweenFactorPose2(i, i + 1, gtsam.Pose2(*motion), noise))
    noise = gtsam.noiseModel.Diagonal.Sigmas(SIGMA[::-1].copy())
    for at, (r, bearing), j in zip(readings.instant, readings.z, of, strict=True):
        graph.add(gtsam.BearingRangeFactor2D(int(at), 100 + int(j), gtsam.Rot2(bearing), r, noise))
    for i, pose in enumerate(truth):
        values.insert(i, gtsam.Pose2(*pose))
    for j, post in enumerate(POSTS):
        values.insert(100 + j, post)
    best = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    assert found.features == pytest.approx(np.array([best.atPoint2(100 + j) for j in range(4)]), abs=1e-4)
    assert found.poses == pytest.approx(gtsam.utilities.extractPose2(best), abs=1e-4)


def test_covariances_are_those_of_dense_algebra() -> None:
    u, P, readings, of, truth = problem(1)
    smoother = Smoother(u, P, readings, of)
    found = smoother.solve(truth, POSTS)
    system = smoother.linearised(found)
    dense = system.A.toarray()
    inverse = np.linalg.inv(dense.T @ dense)
    assert system.covariance(np.arange(63, 71)) == pytest.approx(inverse[63:, 63:], rel=1e-6, abs=1e-12)
    moved, read = smoother.residuals(found)
    b = smoother.whitened(found, moved[:, :, None], read[:, :, None])
    assert system.estimate(b) == pytest.approx(0.0, abs=1e-4)  # at the optimum nothing is left to gain
    assert float((b**2).sum()) == pytest.approx(2.0 * found.error, rel=1e-3)
    exact = 1.0 - np.einsum("ij,jk,ik->i", dense, inverse, dense)
    noisy = np.mean([system.redundancy(np.random.default_rng(i)) for i in range(60)], axis=0)
    assert noisy == pytest.approx(exact, abs=0.15)
    assert exact.sum() == pytest.approx(dense.shape[0] - dense.shape[1])


def test_misread_readings_hardly_matter() -> None:
    u, P, readings, of, truth = problem(2)
    clean = Smoother(u, P, readings, of).solve(truth, POSTS)
    z = readings.z.copy()
    z[::9] += [2.0, 0.7]
    found = Smoother(u, P, readings._replace(z=z), of).solve(truth, POSTS)
    assert np.abs(found.features - clean.features).max() < 0.1
    without = of.copy()
    without[::9] = -1
    exact = Smoother(u, P, readings._replace(z=z), without).solve(truth, POSTS)
    assert np.abs(exact.features - clean.features).max() < 0.05
    assert np.isnan(Smoother(u, P, readings, without).residuals(exact)[1][::9]).all()


@pytest.mark.slow
def test_errors_after_alignment() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-5.0, 5.0, (7, 2))
    root = 1e-3 * rng.standard_normal((14, 14))
    joint = root @ root.T
    found = []
    for _ in range(4000):
        wrong = points + (root @ rng.standard_normal(14)).reshape(-1, 2)
        found.append((aligned(wrong, points)(wrong) - points).reshape(-1))
    assert np.cov(np.array(found).T) == pytest.approx(relative_covariance(points, joint), abs=4e-6)


@pytest.mark.parametrize("count", [1, 2, 6])
def test_an_error_of_the_frame_is_none(count: int) -> None:
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (count, 2))
    turn = np.column_stack([-points[:, 1], points[:, 0]]).reshape(-1) + 0.5
    assert np.abs(relative_covariance(points, np.outer(turn, turn))).max() < 1e-9


def test_readings_have_the_noise_that_is_stated_or_the_sensor_s() -> None:
    own = np.diag([0.04, 0.01])
    detections = [Detection(1.0, np.array([2.0, 0.3])), Detection(2.0, np.array([2.0, 0.3]), covariance=own)]
    found = polar_readings(detections, np.array([1.0, 2.0]), RangeBearing(0.1, 0.02, 0.5))
    assert found.instant.tolist() == [0, 1]
    assert found.covariance == pytest.approx(np.array([np.diag([0.2**2, 0.02**2]), own]))
    assert not found.stated
    assert polar_readings(detections[1:], np.array([2.0]), RangeBearing(0.1, 0.02)).stated
