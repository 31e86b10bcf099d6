"""CARMEN logs: raw, corrected, the newer scans; beams, times, and what is wrong with a line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.readers.carmen import JITTER
from trailmark.estimation.records import Increment, Log, Pose, Record, Scan

FloatArray = NDArray[np.float64]
HEAD = "# message formats defined: PARAM SYNC ODOM FLASER RLASER TRUEPOS HELLO"


def odom(t: float, x: float, y: float, theta: float) -> str:
    return f"ODOM {x} {y} {theta} 0.1 0.2 0 {t} pippo {t}"


def flaser(t: float, ranges: list[float], laser: tuple[float, ...], robot: tuple[float, ...]) -> str:
    fields = [len(ranges), *ranges, *laser, *robot, t, "pippo", t]
    return " ".join(map(str, ["FLASER", *fields]))


def load(path: Path, *lines: str, skip_bad: bool = False) -> Log:
    path.write_text("\n".join(lines) + "\n")
    return load_log(path, skip_bad=skip_bad)


def scans(records: tuple[Record, ...]) -> list[Scan]:
    return [r for r in records if isinstance(r, Scan)]


def driven(log: Log) -> FloatArray:
    """Where the increments lead, from the first pose: rotation matrices, unlike the reader."""
    place = np.eye(3)
    for record in log.records:
        if isinstance(record, Pose | Increment):
            x, y, theta = record[1:4]
            place = place @ [[math.cos(theta), -math.sin(theta), x], [math.sin(theta), math.cos(theta), y], [0, 0, 1]]
    return np.array([place[0, 2], place[1, 2], math.atan2(place[1, 0], place[0, 0])])


def test_a_raw_log(tmp_path: Path) -> None:
    # The laser sits 0.2 m ahead of the robot's reference point.
    log = load(
        tmp_path / "a.clf",
        HEAD,
        "PARAM robot_frontlaser_offset 0.2 nohost 0",
        odom(1.0, 1.0, 2.0, 0.0),
        flaser(1.5, [1.0, 2.0, 81.83, 81.91], (2.2, 2.0, 0.0), (2.0, 2.0, 0.0)),
        odom(2.0, 3.0, 2.0, math.pi / 2),
        flaser(2.5, [0.0, 2.0, 3.0, 4.0], (3.0, 3.2, math.pi / 2), (3.0, 3.0, math.pi / 2)),
        "RLASER whatever",
        "HELLO declared above",
        odom(3.0, 3.0, 4.0, -math.pi / 2),
    )
    assert [(type(r), r.t) for r in log.records] == [
        (Pose, 1.0),
        (Increment, 1.5),
        (Scan, 1.5),
        (Increment, 2.0),
        (Increment, 2.5),
        (Scan, 2.5),
        (Increment, 3.0),
    ]
    assert log.records[0] == Pose(1.0, 1.0, 2.0, 0.0, truth=False)
    moved = np.array([r[1:4] for r in log.records if isinstance(r, Increment)])
    expected = [[1, 0, 0], [1, 0, np.pi / 2], [1, 0, 0], [1, 0, np.pi]]
    assert np.abs(np.abs(moved) - expected).max() < 1e-12
    assert np.abs(driven(log) - (3.0, 4.0, -np.pi / 2)).max() < 1e-12
    first = scans(log.records)[0]
    assert np.abs(np.array(first.mount) - (0.2, 0.0, 0.0)).max() < 1e-9
    assert first.pose is None
    assert first.ranges.tolist() == [1.0, 2.0, 81.83, 81.91]
    assert first.range_max == 81.83  # what lies above it are codes of faults
    assert (first.angle_min, first.angle_increment) == (-math.pi / 2, math.pi / 4)
    assert log.notes == ()


def test_gmappings_corrected_log(tmp_path: Path) -> None:
    garbage = 1.08499e-42
    log = load(
        tmp_path / "a.log",
        HEAD,
        odom(1.0, 0.0, 0.0, 0.0),
        odom(2.0, 1.0, 0.0, 0.0),
        flaser(2.0, [1.0, 2.0], (0.9, 0.1, 0.5), (0.9, 0.1, 0.5)),
        odom(garbage, 0.9, 0.1, 0.5),
        "NEFF 15",
        odom(3.0, 0.9 + math.cos(0.5), 0.1 + math.sin(0.5), 0.5),
        flaser(3.0, [1.0, 2.0], (2.0, 1.0, 0.25), (2.0, 1.0, 0.25)),
        odom(13.2, 2.0, 1.0, 0.25),
        "NEFF 14.9",
        odom(4.0, 2.0, 1.0, 0.5),
    )
    # Odometry: ahead, ahead, a turn; the corrections in between are no motion.
    moved = np.array([r[1:4] for r in log.records if isinstance(r, Increment)])
    assert np.abs(moved - [[1, 0, 0], [1, 0, 0], [0, 0, 0.25]]).max() < 1e-12
    assert [r.t for r in log.records] == [1.0, 2.0, 2.0, 3.0, 3.0, 4.0]
    assert [s.pose for s in scans(log.records)] == [(0.9, 0.1, 0.5), (2.0, 1.0, 0.25)]
    assert {s.mount for s in scans(log.records)} == {(0.0, 0.0, 0.0)}


def test_whether_the_poses_are_corrected_can_be_told(tmp_path: Path) -> None:
    lines = [flaser(1.0, [1.0], (1.1, 0.0, 0.0), (1.0, 0.0, 0.0)), flaser(2.0, [1.0], (2.1, 0.0, 0.0), (2.0, 0.0, 0.0))]
    path = tmp_path / "a.log"
    path.write_text("\n".join(lines))
    for corrected, expected in (
        (None, [None, None]),
        (False, [None, None]),
        (True, [(1.0, 0.0, 0.0), (2.0, 0.0, 0.0)]),
    ):
        found = scans(load_log(path, corrected=corrected).records)
        assert [s.pose for s in found] == expected
        assert np.abs(np.array([s.mount for s in found]) - (0.1, 0.0, 0.0)).max() < 1e-9


def test_the_newer_scans_and_the_simulators_truth(tmp_path: Path) -> None:
    beams = "0 -2.356 4.712 1.178 20.0 0.01 0 5 1 2 3 4 30 2 100 200"
    log = load(
        tmp_path / "a.log",
        f"ROBOTLASER1 {beams} 1.1 2.0 0.0 1.0 2.0 0.0 0.5 0.1 0.3 0.2 1e9 7.5 host 0.1",
        "TRUEPOS 1.5 2.5 0.5 1.0 2.0 0.0 8.0 host 0.6",
    )
    pose, scan, truth = log.records
    assert pose == Pose(7.5, 1.0, 2.0, 0.0)
    assert isinstance(scan, Scan)
    assert scan.ranges.tolist() == [1, 2, 3, 4, 30]
    assert (scan.t, scan.angle_min, scan.angle_increment, scan.range_max) == (7.5, -2.356, 1.178, 20.0)
    assert np.abs(np.array(scan.mount) - (0.1, 0.0, 0.0)).max() < 1e-9
    assert truth == Pose(8.0, 1.5, 2.5, 0.5, truth=True)


@pytest.mark.parametrize(
    ("n", "first", "step"),
    [(180, -90.0, 1.0), (181, -90.0, 1.0), (360, -90.0, 0.5), (361, -90.0, 0.5), (401, -50.0, 0.25), (1, -90.0, 180.0)],
)
def test_beams(tmp_path: Path, n: int, first: float, step: float) -> None:
    log = load(tmp_path / "a.log", flaser(1.0, [2.0] * n, (0, 0, 0), (0, 0, 0)))
    scan = scans(log.records)[0]
    assert math.degrees(scan.angle_min) == pytest.approx(first)
    assert math.degrees(scan.angle_increment) == pytest.approx(step)


@pytest.mark.parametrize(
    ("largest", "range_max"), [(50.0, 50.0), (81.83, 81.83), (81.91, 81.83), (8.191, 8.183), (8.0, 8.0), (100.0, 100.0)]
)
def test_range_max(tmp_path: Path, largest: float, range_max: float) -> None:
    lines = [flaser(t, [1.0, largest / t], (0, 0, 0), (0, 0, 0)) for t in (1.0, 2.0)]
    assert {s.range_max for s in scans(load(tmp_path / "a.log", *lines).records)} == {range_max}


def test_times_a_little_out_of_order(tmp_path: Path) -> None:
    lines = [
        odom(1.0, 0, 0, 0),
        odom(3.0, 1, 0, 0),
        odom(3.0 - JITTER, 2, 0, 0),
        odom(2.5, 3, 0, 0),
        odom(3.5, 4, 0, 0),
    ]
    log = load(tmp_path / "a.log", *lines)
    assert [r.t for r in log.records] == [1.0, 3.0, 3.0, 3.0, 3.5]
    assert log.notes == ("2 times up to 2 s behind the latest one raised to it",)
    assert log.dropped == 0


GOOD = (HEAD, odom(5.0, 0, 0, 0), flaser(6.0, [1.0, 2.0], (0, 0, 0), (0, 0, 0)))


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("ODOM 0 0 0 0 0 0 7 pippo", "ODOM: expected 9 columns after it, got 8"),
        (
            "ODOM 0 nan 0 0 0 0 7 pippo 7",
            "expected ODOM, finite numbers, host, time, got 'ODOM 0 nan 0 0 0 0 7 pippo 7'",
        ),
        ("OD", "expected a line with ODOM, FLASER, ROBOTLASER1, TRUEPOS or the like, got 'OD'"),
        ("FLASER 3 1 2 0 0 0 0 0 0 7 pippo 7", "FLASER: expected n + 10 (n = 3"),
        ("FLASER 2 1 inf 0 0 0 0 0 0 7 pippo 7", "expected FLASER, finite numbers, host, time"),
        ("FLASER 2 1 -2 0 0 0 0 0 0 7 pippo 7", "FLASER: range: expected 0 or more, got -2"),
        ("FLASER 0 0 0 0 0 0 0 7 pippo 7", "FLASER: expected n + 10 (n = 0"),
        ("FLASER 1e300 1 2 0 0 0 0 0 0 7 pippo 7", " columns after it, got 12"),
        (
            "ROBOTLASER1 0 -1 2 1 20 0 0 5 1 2 3 4 5 0 0 0 0 0 0 0 0 0 0 0 0 7 host",
            "expected n + m + 23 (n ranges and m remissions) columns",
        ),
        (odom(3.9, 0, 0, 0), "time: expected at most 2 s before 6.0, got 3.9"),
    ],
)
def test_bad_lines(tmp_path: Path, line: str, problem: str) -> None:
    path = tmp_path / "a.log"
    with pytest.raises(FormatError) as caught:
        load(path, *GOOD, line)
    assert str(caught.value).startswith(f"{path}:4: ")
    assert problem in str(caught.value)
    log = load(path, *GOOD, line, skip_bad=True)
    assert (len(log.records), log.dropped) == (len(load(path, *GOOD).records), 1)


def test_a_single_reading_far_beyond_all_others_is_a_glitch(tmp_path: Path) -> None:
    """It must not pass for the largest range, or all that met nothing would be walls."""
    rng = np.random.default_rng(0)
    lines = []
    for i in range(20):
        ranges = np.where(rng.random(180) < 0.1, 50.0, rng.uniform(0.5, 9.0, 180)).round(2)
        lines.append(flaser(float(i), ([1000.0, *ranges[1:]] if i == 7 else ranges.tolist()), (i, 0, 0), (i, 0, 0)))
    log = load(tmp_path / "a.log", *lines)
    assert {scan.range_max for scan in scans(log.records)} == {50.0}
    assert np.isnan(scans(log.records)[7].ranges[0])
    assert sum(np.isnan(scan.ranges).sum() for scan in scans(log.records)) == 1
    assert log.notes == ("1 reading up to 1000 m, far beyond all others, left out as glitches",)


def test_rounded_times_give_way_to_the_loggers(tmp_path: Path) -> None:
    lines = [f"ODOM {i} 0 0 0 0 0 1.13486e+09 pippo {10.0 + 0.5 * i}" for i in range(9)]
    assert [r.t for r in load(tmp_path / "a.log", *lines).records] == [10.0 + 0.5 * i for i in range(9)]
