# ruff: noqa: N806 # the filter's own symbols: F, P, W
"""Odometry put together: as the filter does it, step by step."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from trailmark.estimation.ekf_slam import EkfSlam
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import PoseIncrement, Unicycle
from trailmark.estimation.odometry import OdometryTrack, missing_odometry, scan_poses
from trailmark.estimation.records import Increment, Log, Odometry, Pose, Record, Scan

VELOCITY = Unicycle(0.02, 0.05, (0.1, 0.0, 0.0, 0.2), period=1.0)
INCREMENT = PoseIncrement(0.01, 0.01, 0.02, (0.003, 0.004, 0.005))


def velocities(seed: int = 0) -> list[Record]:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.02, 0.3, 60))
    return [Odometry(float(t), *rng.normal([0.4, 0.0], [0.2, 0.7]).tolist()) for t in times]


def increments(seed: int = 0, covariance: bool = False) -> list[Record]:
    rng = np.random.default_rng(seed)
    P = np.diag([1e-4, 2e-4, 3e-4]) if covariance else None
    steps = rng.normal([0.2, 0.0, 0.0], 0.1, (39, 3)).tolist()
    return [Increment(float(t), step[0], step[1], step[2], P) for t, step in enumerate(steps, start=1)]


def test_velocities_give_the_motion_of_the_filters_steps() -> None:
    records, instants = velocities(), np.array([0.5, 1.3, 1.31, 4.0, 20.0])
    track = OdometryTrack(records)
    found = track.motions(instants)
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    cuts = np.unique(np.concatenate([[r.t for r in records], instants]))
    for i in range(len(instants) - 1):
        x, P = np.zeros(3), np.zeros((3, 3))
        own = cuts[(cuts >= instants[i]) & (cuts <= instants[i + 1])]
        for a, b in itertools.pairwise(own):
            held = [r for r in records if isinstance(r, Odometry) and r.t <= a]
            if held:
                u = np.array([held[-1].v, held[-1].omega, b - a])
                x, F, W = VELOCITY.step(x, u)
                P = F @ P @ F.T + W @ VELOCITY.Q(u) @ W.T
        assert found.u[i, :2] == pytest.approx(x[:2], abs=1e-12)
        assert np.cos(found.u[i, 2] - x[2]) == pytest.approx(1.0)
        assert P_found[i] == pytest.approx(P, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [True, False])
def test_increments_give_the_motion_of_the_filters_steps(stated: bool) -> None:
    records, instants = increments(covariance=stated), np.array([0.0, 3.0, 4.0, 17.5])
    track = OdometryTrack(records)
    assert track.states_noise == stated
    found = track.motions(instants)
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    for i in range(len(instants) - 1):
        x, P = np.zeros(3), np.zeros((3, 3))
        for r in records:
            if isinstance(r, Increment) and instants[i] < r.t <= instants[i + 1]:
                u = np.array(r[1:4])
                x, F, W = INCREMENT.step(x, u)
                P = F @ P @ F.T + W @ (INCREMENT.Q(u) if r.covariance is None else r.covariance) @ W.T
        assert found.u[i] == pytest.approx(x, abs=1e-12)
        assert P_found[i] == pytest.approx(P, abs=1e-12)


@pytest.mark.parametrize("stated", [True, False])
def test_velocities_and_increments_add_up_as_in_the_filter(stated: bool) -> None:
    records = sorted([*velocities(3), *increments(3, stated)], key=lambda record: record.t)
    instants = np.array([0.0, 4.0, 60.0])
    track = OdometryTrack(records)
    assert not track.states_noise
    found = track.motions(instants)
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    for i in range(2):
        slam = EkfSlam({}, velocity=VELOCITY, increment=INCREMENT)
        own = [record for record in records if instants[i] < record.t <= instants[i + 1]]
        before = [r for r in records if isinstance(r, Odometry) and r.t <= instants[i]]
        held = [before[-1]._replace(t=instants[i])] if before else []
        result = slam.run([*held, *own, Odometry(instants[i + 1], 0.0, 0.0)])
        assert found.u[i, :2] == pytest.approx(result.trajectory[-1, 1:3], abs=1e-9)
        assert np.cos(found.u[i, 2] - result.trajectory[-1, 3]) == pytest.approx(1.0)
        assert P_found[i] == pytest.approx(result.covariances[-1], rel=1e-6, abs=1e-9)


def test_calibration_turns_stated_velocities_into_driven_ones() -> None:
    true = np.array([0.9, 1.1, 0.02])
    track = OdometryTrack([Odometry(0.0, 1.0, 0.05), Odometry(2.0, 0.0, 0.0)])
    moved = track.motions(np.array([0.0, 5.0]), true).u[0]
    assert moved[2] == pytest.approx(1.1 * 2.0 * 0.05)
    assert np.hypot(*moved[:2]) == pytest.approx(1.8, rel=1e-3)
    assert np.arctan2(moved[1], moved[0]) == pytest.approx(0.02 + 0.055)


def test_a_repeated_increment_counts_once() -> None:
    step = Increment(1.0, 1.0, 0.0, 0.0)
    once, twice = OdometryTrack([step]), OdometryTrack([step, step])
    instants = np.array([0.0, 2.0])
    assert twice.motions(instants).u == pytest.approx(once.motions(instants).u)


def log(records: list[Record]) -> Log:
    return Log("log", tuple(records), np.empty((0, 3)))


def bare(t: float) -> Scan:
    return Scan(t, np.ones(3), 0.0, 0.1, 9.0)


def test_poses_by_increments() -> None:
    records: list[Record] = [Pose(0.0, 1.0, 2.0, math.pi / 2)]
    for t in (1.0, 2.0, 3.0):
        records += [Increment(t, 1.0, 0.0, math.pi / 2), bare(t)]
    found, x = scan_poses(log(records))
    assert len(found) == 3
    assert x == pytest.approx(np.array([[1, 3, math.pi], [0, 3, -math.pi / 2], [0, 2, 0]]), abs=1e-12)


def test_poses_by_velocities() -> None:
    records: list[Record] = [Odometry(0.0, 1.0, 0.0), bare(2.0), Odometry(3.0, math.pi / 2, math.pi / 2), bare(4.0)]
    _, x = scan_poses(log(records), "odometry")
    # Three metres ahead, then a quarter of a circle of radius 1 to the left.
    assert x == pytest.approx(np.array([[2, 0, 0], [4, 1, math.pi / 2]]), abs=1e-12)


def test_poses_of_the_scans_themselves() -> None:
    stated = [bare(1.0)._replace(pose=(1.0, 0.0, 0.0)), bare(2.0)._replace(pose=(2.0, 0.0, 0.0))]
    records: list[Record] = [stated[0], Increment(1.5, 0.5, 0.0, 0.0), stated[1]]
    for source in ("auto", "log"):
        assert scan_poses(log(records), source)[1][:, 0].tolist() == [1.0, 2.0]
    assert scan_poses(log(records), "odometry")[1][:, 0].tolist() == [1.0, 1.5]
    # Truth is never used.
    assert scan_poses(log([Pose(0.0, 9, 9, 9, truth=True), bare(1.0)]))[1].tolist() == [[0.0, 0.0, 0.0]]
    with pytest.raises(EstimationError, match="poses: expected them in the log, got 1 of 2 scans without one"):
        scan_poses(log([stated[0], bare(2.0)]), "log")


def test_odometry_is_missing_where_there_is_none_among_much() -> None:
    def driven(counts: list[int]) -> Log:
        records: list[Record] = []
        for i, count in enumerate(counts):
            records += [*(Increment(float(i), 0.1, 0.0, 0.0) for _ in range(count)), bare(float(i))]
        return log(records)

    assert missing_odometry(driven([0, 4, 0, 5, 4])).tolist() == [False, False, True, False, False]
    # Where they alternate, one may come late.
    assert not missing_odometry(driven([1, 1, 0, 2, 1])).any()
    # Velocities hold until others come.
    assert not missing_odometry(log([Odometry(0.0, 1.0, 0.0), bare(1.0), bare(2.0)])).any()
