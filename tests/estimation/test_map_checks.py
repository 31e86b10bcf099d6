"""What a map's fit to its log is judged by, and the warnings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.association import Counts
from trailmark.estimation.ekf_slam import Assignment, MapFeature, SlamResult
from trailmark.estimation.mapped_log import association_doubts, gap_warnings, log_warnings
from trailmark.estimation.obstacles import disc_estimates
from trailmark.estimation.records import Detection, Increment, Odometry, Pose, Record, Scan


def test_gaps_in_odometry_are_told() -> None:
    times = [0.1 * i for i in range(100)]
    steady: list[Record] = [Odometry(t, 0.5, 0.0) for t in times]
    later: list[Record] = [Odometry(130.0 + t, 0.5, 0.0) for t in times]
    assert gap_warnings(steady) == gap_warnings([]) == gap_warnings(steady[:1]) == []
    assert gap_warnings([record._replace(t=100.0 * record.t) for record in steady]) == []
    (gap,) = gap_warnings(steady + later)
    assert "a gap of 120 s from 9.9 s on" in gap
    assert "velocity" in gap
    (end,) = gap_warnings([*steady, Detection(40.0, np.ones(2))])
    assert "a gap of 30 s" in end
    (two,) = gap_warnings([Increment(r.t + d, 0.1, 0.0, 0.0) for d in (0.0, 30.0, 70.0) for r in steady])
    assert "a gap of 30 s from 39.9 s on (2 gaps in all)" in two
    assert "velocity" not in two


def unnamed(places: list[list[float]], read: NDArray[np.bool_]) -> SlamResult:
    """Read from the origin, whichever the rows say; a second an instant."""
    trajectory = np.column_stack([np.arange(float(len(read))), np.zeros((len(read), 3))])
    features = tuple(MapFeature(i, None, np.array(p), np.eye(2), 9) for i, p in enumerate(places))
    assignments = []
    for t, i in np.argwhere(read).tolist():
        x, y = places[i]
        z = np.array([np.hypot(x, y), np.arctan2(y, x)])
        assignments.append(Assignment(float(t), None, i, Detection(float(t), z)))
    counts = Counts(detections=len(assignments), used=len(assignments))
    return SlamResult(trajectory, np.zeros((len(read), 3, 3)), features, (), tuple(assignments), counts)


def test_maps_without_identities_are_certified_only_where_nothing_speaks_against_them() -> None:
    places = [[2.0, -2.0], [3.0, -1.0], [4.0, 0.0], [3.0, 1.0], [2.0, 2.0]]
    read = np.ones((100, 5), dtype=bool)
    result, estimates = unnamed(places, read), disc_estimates(places, [1e-4 * np.eye(2)] * 5, 0.05)
    assert association_doubts(result, estimates, "slam") == []
    # Of two maps of the same things, each is read half of the time.
    half = read.copy()
    half[50:, 1], half[:50, 2] = False, False
    (missed,) = association_doubts(unnamed(places, half), estimates, "slam")
    assert "read 80% of the times" in missed
    (close,) = association_doubts(result, disc_estimates(places, [0.1 * np.eye(2)] * 5, 0.05), "slam")
    assert "5 of 5 features lie less than 5 standard deviations" in close
    # Carried at 50 s: all is new.
    cut = np.zeros((100, 10), dtype=bool)
    cut[:50, :5] = cut[50:, 5:] = True
    far = [[-x, y] for x, y in places]
    both = disc_estimates(places + far, [1e-4 * np.eye(2)] * 10, 0.05)
    carried = association_doubts(unnamed(places + far, cut), both, "slam")
    assert any("before and after 50.000 s" in doubt for doubt in carried)
    assert not any("before and after" in doubt for doubt in association_doubts(unnamed(places + far, cut), both, "log"))
    lost = result._replace(counts=replace(result.counts, used=460))
    assert association_doubts(lost, estimates, "slam") == ["8% of the readings are of no feature"]


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
