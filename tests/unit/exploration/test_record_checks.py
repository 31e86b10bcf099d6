"""Records that cannot be used."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.estimation.records import Detection, Increment, Odometry, Record, Scan
from trailmark.exploration.mapper import CARRIED, RecordChecks

SCAN = Scan(1.0, np.full(8, 2.0), -1.0, 0.25, 5.0)
STEP = Increment(1.0, 0.1, 0.0, 0.0, np.diag([1e-4, 1e-4, 1e-4]))
SEEN = Detection(1.0, np.array([2.0, 0.3]), identity=3)


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (SCAN._replace(t=0.5), "in the order of time"),
        (SCAN, "its time again"),
        (SCAN._replace(t=2.0, ranges=np.full(7, 2.0)), "expected 8 ranges"),
        (SCAN._replace(t=2.0, ranges=np.full(8, -1.0)), "0 or more, got -1"),
        (SCAN._replace(t=2.0, ranges=np.full(8, np.nan)), "8 beams without any"),
        (SCAN._replace(t=2.0, angle_increment=math.nan), "finite angles"),
        (SCAN._replace(t=math.nan), "its time"),
        (STEP._replace(t=2.0, dx=4.0), "got a jump of 4 m"),
        (STEP._replace(t=2.0, dtheta=4.0), "got a jump of"),
        (STEP._replace(t=2.0, dy=math.inf), "finite"),
        (STEP._replace(t=2.0, covariance=-np.eye(3)), "covariance"),
        (STEP, "got it again"),
        (Odometry(2.0, math.nan, 0.0), "finite"),
        (Odometry(2.0, 1e3, 0.0), "a jump"),
        (SEEN, "expected odometry and scans"),
    ],
)
def test_a_record_that_cannot_be_used_is_refused_with_a_reason(record: Record, said: str) -> None:
    checks = RecordChecks(Scan, 5.0)
    assert checks.refusal(STEP) == checks.refusal(SCAN) == ""
    assert said in checks.refusal(record)
    assert checks.refusal(SCAN._replace(t=3.0)) == ""


@pytest.mark.parametrize(
    ("record", "said"),
    [
        (SEEN, "got it again"),
        (SEEN._replace(z=np.array([2.0])), "two finite numbers"),
        (SEEN._replace(z=np.array([2.0, np.nan])), "two finite numbers"),
        (SEEN._replace(t=2.0, z=np.array([-1.0, 0.0])), "got -1 m"),
        (SEEN._replace(t=2.0, z=np.array([30.0, 0.0])), "got 30 m"),
        (SEEN._replace(t=2.0, covariance=np.eye(3)), "covariance"),
        (SCAN, "expected odometry and detections"),
    ],
)
def test_so_is_a_detection(record: Record, said: str) -> None:
    checks = RecordChecks(Detection, 5.0)
    assert checks.refusal(SEEN) == checks.refusal(SEEN._replace(identity=4)) == ""
    assert said in checks.refusal(record)


def test_what_may_be_is_let_through() -> None:
    checks = RecordChecks(Scan, 5.0)
    far = SCAN._replace(ranges=np.array([np.inf, np.nan, 0.0, 2.0, 5.0, 9.0, 1.0, 1.0]))
    carried = STEP._replace(dx=40.0, covariance=CARRIED)
    good: list[Record] = [
        Odometry(0.0, 1.0, 0.1),
        Odometry(0.0, 0.5, 0.1),
        STEP,
        STEP._replace(dx=0.2),
        carried,
        far,
        SCAN._replace(t=1.1),
    ]
    assert [checks.refusal(record) for record in good] == [""] * 7
