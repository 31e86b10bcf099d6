"""Where scans were taken from: against poses that are added up by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.odometry import missing_odometry, scan_poses
from trailmark.estimation.records import Increment, Log, Odometry, Pose, Record, Scan


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


def test_odometry_starts_at_the_first_scans_pose() -> None:
    records: list[Record] = [bare(0.0)._replace(pose=(5.0, 1.0, math.pi / 2)), Increment(1.0, 2.0, 0.0, 0.0), bare(1.0)]
    _, x = scan_poses(log(records))
    assert x == pytest.approx(np.array([[5, 1, math.pi / 2], [5, 3, math.pi / 2]]), abs=1e-12)


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
