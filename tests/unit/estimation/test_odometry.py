# ruff: noqa: N806 # the filter's own symbols: F, P, W
"""Odometry put together: as the filter does it, step by step."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from trailmark.estimation.ekf_slam import EkfSlam
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.models import PoseIncrement, RangeBearing, Unicycle
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


@pytest.mark.parametrize(
    ("driven", "stepped", "stated"),
    [(True, False, False), (False, True, True), (True, True, False), (True, True, True)],
)
def test_motions_are_those_of_the_filter(driven: bool, stepped: bool, stated: bool) -> None:
    records = [*(velocities(3) if driven else []), *(increments(3, stated) if stepped else [])]
    records.sort(key=lambda record: record.t)
    instants = np.array([0.0, 0.5, 1.31, 4.0, 60.0])
    track = OdometryTrack(records)
    assert track.states_noise == (stated and not driven)
    found = track.motions(instants)
    P_found = found.covariance(track.stated_variances(VELOCITY, INCREMENT))
    for i, (begin, end) in enumerate(itertools.pairwise(instants)):
        slam = EkfSlam(RangeBearing(0.1, 0.1), velocity=VELOCITY, increment=INCREMENT)
        own = [record for record in records if begin < record.t <= end]
        before = [r for r in records if isinstance(r, Odometry) and r.t <= begin]
        held = [before[-1]._replace(t=begin)] if before else []
        result = slam.run([*held, *own, Odometry(end, 0.0, 0.0)])
        if len(result.trajectory):
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


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize(
    ("begin", "end", "late", "expected"), [(2.4, 3.6, False, [3, 4]), (2.4, 2.55, False, []), (2.4, 3.6, True, [])]
)
def test_odometry_is_missing_where_it_is_silent(
    velocities: bool, begin: float, end: float, late: bool, expected: list[int]
) -> None:
    """For a part of the time between scans; but not where one record is lost, or where all come late."""
    records: list[Record] = []
    for t in np.arange(0.05, 6.0, 0.1).tolist():
        silent = begin < t < end
        at = end if silent and late else t
        if late or not silent:
            records += [Odometry(at, 0.5, 0.1) if velocities else Increment(at, 0.05, 0.0, 0.01)]
    records += [Odometry(6.0, 0.0, 0.0)] if velocities else []
    records = sorted([*records, *(bare(float(t)) for t in range(6))], key=lambda record: record.t)
    assert np.flatnonzero(missing_odometry(log(records))).tolist() == expected


@pytest.mark.parametrize("velocities", [True, False])
@pytest.mark.parametrize("speed", [0.5, 0.0])
def test_odometry_is_missing_before_it_begins_unless_the_robot_stands(velocities: bool, speed: float) -> None:
    records: list[Record] = [bare(float(t)) for t in range(6)]
    times = np.arange(2.5, 6.0, 0.1).tolist()
    records += [Odometry(t, speed, 0.0) if velocities else Increment(t, 0.1 * speed, 0.0, 0.0) for t in times]
    records = sorted([*records, Odometry(6.0, 0.0, 0.0)] if velocities else records, key=lambda record: record.t)
    expected = [1, 2, 3] if speed else [] if velocities else [1, 2]  # no increments among many say nothing
    assert np.flatnonzero(missing_odometry(log(records))).tolist() == expected
