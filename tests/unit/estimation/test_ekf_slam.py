# ruff: noqa: N806 # the names are those of the literature
"""Runs over simulated logs: what is found, how sure the filter is of it, and what becomes of odd records."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.helpers.trials import few, trials

from trailmark.estimation import (
    EkfSlam,
    EstimationError,
    PoseIncrement,
    RangeBearing,
    SlamFilter,
    SlamSettings,
    Unicycle,
    ekf_slam,
)
from trailmark.estimation.covariance import average, nees
from trailmark.estimation.ekf_slam import Gates, SlamResult
from trailmark.estimation.records import Detection, Increment, Odometry, Pose, Record

FloatArray = NDArray[np.float64]

SENSOR = RangeBearing(0.05, 0.02)
MOTION = Unicycle(0.05, 0.02)
POSTS = np.array([[3.0 * np.cos(a), 3.0 + 3.0 * np.sin(a)] for a in np.arange(12) * np.pi / 6]) * [1.6, 1.6]
REACH = 4.0


class Drive(NamedTuple):
    records: list[Record]
    truth: FloatArray
    """Rows t, x, y, theta of each reading's instant."""


def drive(seed: int, seconds: float = 40.0, clutter: float = 0.0) -> Drive:
    """Rounds inside a ring of posts: velocities ten times a second, readings of posts within reach twice a second."""
    rng = np.random.default_rng(seed)
    records: list[Record] = []
    pose, truth, dt = np.zeros(3), [], 0.1
    for k in range(int(seconds / dt)):
        t = k * dt
        if k % 5 == 0:
            truth.append((t, *pose))
            for i, post in enumerate(POSTS):
                if np.hypot(*(post - pose[:2])) < REACH:
                    records.append(Detection(t, SENSOR.sample(pose, post, rng), identity=i))
            if rng.random() < clutter:
                records.append(Detection(t, np.array([rng.uniform(0.5, REACH), rng.uniform(-np.pi, np.pi)])))
        u = np.array([0.6, 0.2, dt])
        records.append(Odometry(t, 0.6, 0.2))
        pose = np.asarray(MOTION.sample(pose, u, rng))
    return Drive(records, np.array(truth))


def slam(**changes: Any) -> EkfSlam:
    return EkfSlam(SENSOR, velocity=MOTION, **changes)


def pose_errors(result: SlamResult, truth: FloatArray) -> tuple[FloatArray, FloatArray]:
    at = np.searchsorted(result.trajectory[:, 0], truth[:, 0])
    error = result.trajectory[at, 1:] - truth[:, 1:]
    error[:, 2] = np.angle(np.exp(1j * error[:, 2]))
    return error, result.covariances[at]


@pytest.mark.slow
def test_consistent_over_many_runs() -> None:
    # NEES of the last pose over many runs, of the features too, and all NIS: in the bands that miss once in a thousand.
    ends, features, nis, dof = [], [], [], []
    for seed in trials(25, of=2):
        records, truth = drive(100 + seed, seconds=10.0)
        result = slam().run(records)
        assert result.counts.used == result.counts.detections == sum(f.readings for f in result.features)
        error, P = pose_errors(result, truth)
        ends.append(nees(error[-1], P[-1]))
        feature = next(f for f in result.features if f.identity == 0)
        features.append(nees(feature.mean - POSTS[0], feature.covariance))
        nis += [update.nis for update in result.updates]
        dof += [update.dof for update in result.updates]
    assert average(ends, 3, 0.999).inside
    assert average(features, 2, 0.999).inside
    assert average(nis, dof, 0.999).inside


@pytest.mark.slow
@pytest.mark.parametrize("clutter", [0.0, 0.5])
def test_unknown_identities_are_found_and_clutter_is_dropped(clutter: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ekf_slam, "TIMEOUT", 3.0)
    records, truth = drive(3, clutter=clutter)
    result = slam(settings=SlamSettings("joint")).run(records)
    assert len(result.features) == 12
    assert all(f.identity is None and f.readings >= 3 for f in result.features)
    error, _ = pose_errors(result, truth)
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.3
    # Each feature has readings of one post only.
    kept, owner = {f.id for f in result.features}, dict[int, int]()
    for assignment in result.assignments:
        if assignment.feature in kept and assignment.identity is not None:
            assert owner.setdefault(assignment.feature or 0, assignment.identity) == assignment.identity
    assert len(owner) == 12
    assert result.counts.cut_short == 0
    assert result.counts.used + result.counts.ambiguous == result.counts.detections
    assert (result.counts.dropped > 10) == (clutter > 0.0)


def increments(seed: int) -> list[Record]:
    rng, pose, records = np.random.default_rng(seed), np.zeros(3), list[Record]()
    model = PoseIncrement(0.02, 0.02, 0.01)
    for k in range(1, 80):
        u = np.array([0.3, 0.0, 0.1])
        pose = np.asarray(model.sample(pose, u, rng))
        records.append(Increment(float(k), *u.tolist()))
        records += [Detection(float(k), SENSOR.sample(pose, p, rng), identity=i) for i, p in enumerate(POSTS)]
    return records


def incremental(**changes: Any) -> EkfSlam:
    return EkfSlam(SENSOR, increment=PoseIncrement(0.02, 0.02, 0.01), **changes)


@pytest.mark.slow
def test_neither_the_order_within_an_instant_nor_repeated_records_matter() -> None:
    records = increments(4)
    expected = incremental().run(records)
    turned: list[Record] = []
    for start in range(0, len(records), 13):
        turned += 2 * records[start : start + 13][::-1]
    # Readings in another order make other ids and another rounding, not another estimate.
    result = incremental().run(turned)
    assert result.counts.repeated == len(records)
    assert np.allclose(result.trajectory, expected.trajectory, atol=1e-9)
    assert len(expected.features) == 12
    for feature in expected.features:
        (same,) = [f for f in result.features if f.identity == feature.identity]
        assert np.allclose(same.mean, feature.mean, atol=1e-9)
        assert np.allclose(same.covariance, feature.covariance, atol=1e-9)


def test_velocities_hold_until_the_next() -> None:
    runner = slam(start=(1.0, 2.0, 0.0))
    result = runner.run(
        [
            Odometry(10.0, 1.0, 0.0),
            Detection(11.5, np.array([2.0, 0.0])),
            Odometry(12.0, 0.0, 1.0),
            Odometry(13.0, 5.0, 0.0),
        ]
    )
    expected = [[10.0, 1.0, 2.0, 0.0], [11.5, 2.5, 2.0, 0.0], [12.0, 3.0, 2.0, 0.0], [13.0, 3.0, 2.0, 1.0]]
    # The detection starts a feature (known identities are asked for, and it has none): it moves nothing.
    assert np.allclose(result.trajectory[:, :3], np.array(expected)[1:, :3])
    assert np.allclose(result.trajectory[:, 3], np.array(expected)[1:, 3])
    assert result.counts.unidentified == 1


def test_truth_and_references_are_not_estimated_from() -> None:
    records, _ = drive(7, seconds=3.0)
    extra: list[Record] = [Pose(1e9, 0.0, 0.0, 0.0, truth=True)]
    for record in records:
        extra += [record, Pose(record.t, 99.0, 99.0, 1.0, truth=True), Pose(record.t, 99.0, 99.0, 1.0)]
    result = slam().run(extra)
    assert np.array_equal(result.trajectory, slam().run(records).trajectory)
    assert result.counts.not_estimated_from == 2 * len(records) + 1


@pytest.mark.slow
def test_outliers_of_a_known_identity() -> None:
    records, truth = drive(11)
    rng = np.random.default_rng(11)
    bad = [
        record._replace(z=np.array([rng.uniform(1.0, 8.0), rng.uniform(-np.pi, np.pi)]))
        if isinstance(record, Detection) and rng.random() < 0.05 and record.t > 10.0
        else record
        for record in records
    ]
    gated = slam(gates=Gates(known=0.9999)).run(bad)
    ungated = slam().run(bad)
    error, _ = pose_errors(gated, truth)
    worse, _ = pose_errors(ungated, truth)
    assert 5 <= gated.counts.outliers <= sum(a is not b for a, b in zip(bad, records, strict=True))
    assert np.hypot(error[:, 0], error[:, 1]).max() < 0.3
    assert np.abs(worse).max() > 2.0 * np.abs(error).max()


def seeing() -> SlamFilter:
    ekf = SlamFilter()
    ekf.add_known_feature([1.0, 2.0], np.eye(2))
    return ekf


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: EkfSlam(SENSOR).run([Odometry(0.0, 1.0, 0.0)]), "the motion model for "),
        (lambda: EkfSlam(SENSOR).run([Increment(0.0, 1.0, 0.0, 0.0)]), "the motion model for "),
        (lambda: slam().run([Detection(0.0, np.ones(2), "range-baring")]), "did you mean 'range-bearing'"),
        (lambda: slam().run([Detection(0.0, np.array([np.nan, 0.0]), identity=1)]), "finite"),
        (lambda: slam().run([Odometry(0.0, np.inf, 0.0), Odometry(1.0, 0.0, 0.0)]), "finite"),
        (lambda: SlamSettings(association="closest"), "expected auto, joint, known"),  # type: ignore[arg-type]  # wrong on purpose
        (lambda: EkfSlam(SENSOR, settings=SlamSettings("auto")), "expected settings without 'auto'"),
        (lambda: SlamFilter(np.zeros((2, 3))), r"pose: expected shape \(3,\), got \(2, 3\)"),
        (lambda: seeing().update_batch(np.ones((2, 2)), SENSOR, [0, 0]), "expected one reading of each feature"),
        (lambda: seeing().update([1.0, 0.0], SENSOR, 7), "feature: expected the id of one of the 1 features, got 7"),
    ],
)
def test_misuse(call: Callable[[], object], message: str) -> None:
    with pytest.raises(EstimationError, match=message):
        call()


@pytest.mark.slow
def test_poses_that_are_given_stay_and_their_errors_count() -> None:
    """NEES of features read from poses whose errors are independent."""
    rng, P, found = np.random.default_rng(7), np.diag([0.1, 0.1, 0.02]) ** 2, []
    for _ in range(few(200, of=2)):
        records: list[Record] = []
        given = [np.array([0.2 * k, 0.0, 0.0]) for k in range(10)]
        for k, pose in enumerate(given):
            true = pose + rng.normal(0.0, 1.0, 3) * np.sqrt(np.diag(P))
            records.append(Pose(float(k), *pose.tolist()))
            records += [Detection(float(k), SENSOR.sample(true, POSTS[i], rng), identity=i) for i in (0, 1)]
        result = EkfSlam(SENSOR, mode="mapping", pose_covariance=P).run(records)
        assert np.array_equal(result.trajectory[:, 1:], given)
        assert np.array_equal(result.covariances, np.tile(P, (10, 1, 1)))
        found += [nees(f.mean - POSTS[f.identity or 0], f.covariance) for f in result.features]
    assert 1.6 < np.mean(found) < 2.5
