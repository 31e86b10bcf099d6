"""What a map's fit to its log is judged by, and the warnings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark.estimation.logs.records import Increment, Odometry, Pose, Record, Scan
from trailmark.estimation.maps.map_checks import (
    detection_warnings,
    duration,
    explained_share,
    log_warnings,
    scan_warnings,
    top_speed,
)
from trailmark.estimation.maps.map_settings import MappingSettings
from trailmark.estimation.maps.obstacle_estimates import disc_estimates
from trailmark.estimation.slam.slam_result import Counts, SlamResult, Update
from trailmark.shapes import Disc, Polygon
from trailmark.world import World


def test_explained_is_what_ends_near_an_outline() -> None:
    outline = np.array([[2.0, -2.0], [3.0, -2.0], [3.0, 2.0], [2.0, 2.0]])
    hole = np.array([[2.3, -0.5], [2.3, 0.5], [2.7, 0.5], [2.7, -0.5]])
    wall = Polygon(outline, (hole,))
    world = World("w", (-5.0, -5.0, 5.0, 5.0), (wall, Disc((0.0, 3.0), 0.5)))
    # On the wall, 0.1 m before it, amid it, on its hole's outline, on the disc, nowhere, and nothing met.
    angles = [0.0, 0.0, 0.0, 0.0, 90.0, 180.0, 200.0]
    ranges = [2.0, 1.9, 2.2, 2.3, 2.5, 3.0, 8.0]
    scans = [Scan(0.0, np.array([r]), math.radians(a), 0.1, 8.0) for r, a in zip(ranges, angles, strict=True)]
    # 2.2 m lies within 0.15 m of the hole.
    assert explained_share(world, scans, np.zeros((7, 3)), MappingSettings()) == pytest.approx(5 / 6)
    assert math.isnan(explained_share(world, scans[-1:], np.zeros((1, 3)), MappingSettings()))
    assert explained_share(World("e", world.bounds), scans, np.zeros((7, 3)), MappingSettings()) == 0.0


def test_durations_leave_out_what_no_clock_says() -> None:
    assert duration(np.array([3.0, 4.5, 9.0])) == 6.0
    assert duration(np.array([0.0, 4294967296.0, 4294967301.0])) == 5.0
    assert duration(np.repeat([1.13486e9, 1.13487e9], 200)) is None
    assert duration(np.empty(0)) == 0.0


def test_warnings_say_what_is_wrong_and_what_to_try() -> None:
    t = 0.5 * np.arange(100)
    slow = np.column_stack([t, t, np.zeros((100, 2))])
    assert top_speed(slow) == pytest.approx(1.0)
    assert scan_warnings(0.95, slow, "match") == []
    assert scan_warnings(math.nan, slow, "match") == []
    (poor,) = scan_warnings(0.48, slow, "odometry")
    assert "48%" in poor
    assert "--poses match" in poor
    fast = slow * [1.0, 40.0, 1.0, 1.0]
    (speed,) = scan_warnings(0.95, fast, "match")
    assert "40 m/s" in speed


def test_maps_of_detections_that_look_wrong() -> None:
    line = np.column_stack([np.arange(30.0), np.linspace(0.0, 10.0, 30), np.zeros((30, 2))])
    updates = tuple(Update(float(t), 2.0, 2, 0.0) for t in range(200))
    counts = Counts(detections=100, used=100)
    right = SlamResult(line, np.zeros((30, 3, 3)), (), updates, (), counts)
    apart = disc_estimates([[0.0, 0.0], [0.2, 0.0]], [1e-4 * np.eye(2)] * 2, 0.05)
    assert detection_warnings(right, apart, False, "slam") == []
    loud = right._replace(updates=tuple(u._replace(nis=9.0) for u in updates))
    (nis,) = detection_warnings(loud, apart, False, "slam")
    assert "--fit-noise on" in nis
    assert "larger" in nis
    assert detection_warnings(loud, apart, True, "slam") == []
    near = disc_estimates([[0.0, 0.0], [0.2, 0.0]], [1e-2 * np.eye(2)] * 2, 0.05)
    (double,) = detection_warnings(right, near, False, "slam")
    assert "1 of 2 features" in double
    misread = right._replace(counts=replace(counts, outliers=9))
    (share,) = detection_warnings(misread, apart, False, "slam")
    assert "9%" in share
    (fast,) = detection_warnings(right._replace(trajectory=line * [1.0, 99.0, 1.0, 1.0]), apart, False, "slam")
    assert "m/s" in fast


def test_a_log_of_two_clocks_and_scans_that_met_nothing() -> None:
    def scan(t: float, reading: float = 1.0) -> Scan:
        return Scan(t, np.array([reading, math.nan]), 0.0, 0.1, 5.0)

    moves: list[Record] = [Pose(0.0, 0.0, 0.0, 0.0), Increment(1.0, 1.0, 0.0, 0.0), Increment(3.0, 1.0, 0.0, 0.0)]
    assert log_warnings([*moves, scan(3.0)], detected=False) == []
    (apart,) = log_warnings([*moves, scan(1.7e9)], detected=False)
    assert "odometry (1.000 to 3.000 s)" in apart
    assert "do not overlap" in apart
    (before,) = log_warnings([scan(0.5), *moves], detected=False)
    assert "do not overlap" in before
    # The last velocity holds on.
    assert log_warnings([Odometry(0.0, 1.0, 0.0), scan(9.0)], detected=False) == []
    for nothing in (math.inf, 5.0, math.nan):
        (blind,) = log_warnings([*moves, scan(1.0, nothing), scan(2.0, nothing), scan(3.0)], detected=False)
        assert "2 of 3 scans met nothing" in blind
