"""Sensor logs that others published."""

from __future__ import annotations

import gzip
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Record, Scan


@cache
def loaded(path: Path) -> Log:
    return load_log(path)


def scans(records: tuple[Record, ...]) -> list[Scan]:
    return [r for r in records if isinstance(r, Scan)]


@pytest.mark.slow
def test_the_intel_log(shared_data: Path) -> None:
    path = shared_data / "carmen" / "intel-corrected.log.gz"
    log = loaded(path)
    assert log.name == "intel-corrected"
    times = [r.t for r in log.records]
    assert times == sorted(times)
    # Counted again without the reader.
    text = gzip.decompress(path.read_bytes()).decode()
    lines = [line.split() for line in text.splitlines()]
    raw = [line for line in lines if line[0] == "FLASER"]
    found = scans(log.records)
    assert np.array_equal([s.ranges for s in found], [[float(v) for v in line[2:182]] for line in raw])
    assert np.array_equal(np.array([s.pose for s in found]), [[float(v) for v in line[182:185]] for line in raw])
    assert found[0].range_max == 81.83
    assert sum(isinstance(r, Increment) for r in log.records) == sum(line[0] == "ODOM" for line in lines) - len(raw) - 1
    # The corrections are left out: no increment is larger than the robot could move in a fifth of a second or two.
    steps = np.array([r[1:4] for r in log.records if isinstance(r, Increment)])
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < 0.6
    assert np.abs(steps[:, 2]).max() < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["intel", "aces"])
def test_scans_of_corrected_logs_fall_together(shared_data: Path, name: str) -> None:
    """The beams' angles: turned by half a degree, or spread over half a turn to its end, the scans spread wider."""
    found = scans(loaded(shared_data / "carmen" / f"{name}-corrected.log.gz").records)[::3]
    pose = np.array([s.pose for s in found])
    ranges = np.array([s.ranges for s in found])
    first, step = found[0].angle_min, found[0].angle_increment

    def cells(start: float, increment: float) -> int:
        angle = pose[:, 2:] + start + increment * np.arange(180)
        x, y = pose[:, :1] + ranges * np.cos(angle), pose[:, 1:2] + ranges * np.sin(angle)
        near = ranges < 8.0
        return len(set(zip((x[near] / 0.05).round().tolist(), (y[near] / 0.05).round().tolist(), strict=True)))

    half = math.radians(0.5)
    assert cells(first, step) < min(cells(first + half, step), cells(first - half, step), cells(first, math.pi / 179))


@pytest.mark.slow
def test_victoria_park(shared_data: Path) -> None:
    path = shared_data / "victoria" / "victoria_park.txt"
    log = load_log(path)
    rows = [line.split() for line in path.read_text().splitlines()]
    moved = np.array([row[2:6] for row in rows if row[0] == "ODOMETRY"], dtype=float)
    seen = np.array([[row[1], row[3], row[4], row[2]] for row in rows if row[0] == "LANDMARK"], dtype=float)
    seen[:, 1], seen[:, 2] = np.hypot(seen[:, 1], seen[:, 2]), np.arctan2(seen[:, 2], seen[:, 1])
    assert np.array_equal([r[:4] for r in log.records if isinstance(r, Increment)], moved)
    found = [(r.t, *r.z, r.identity) for r in log.records if isinstance(r, Detection)]
    assert np.array(found, dtype=float) == pytest.approx(seen)
    assert len({r.identity for r in log.records if isinstance(r, Detection)}) == 151
    times = [r.t for r in log.records]
    assert times == sorted(times)


@pytest.mark.slow
def test_mrclam(shared_data: Path) -> None:
    path = shared_data / "mrclam6"
    with pytest.raises(FormatError, match=r"Robot3_Measurement\.dat:3758: .*got 34"):
        load_log(path, robot=3)
    log = load_log(path, robot=3, skip_bad=True)
    # Counted again without the reader: by column, from the file.
    rows = np.loadtxt(path / "Robot3_Measurement.dat")
    barcodes = dict(np.loadtxt(path / "Barcodes.dat", dtype=int)[:, ::-1].tolist())
    subjects = np.array([barcodes.get(int(code), 0) for code in rows[:, 1]])
    detections = [r for r in log.records if isinstance(r, Detection)]
    assert log.dropped == np.sum(subjects == 0) == 2
    assert log.notes == (f"{np.sum((subjects > 0) & (subjects < 6))} sightings of other robots left out",)
    assert [d.identity for d in detections] == subjects[subjects > 5].tolist()
    assert np.array_equal([(d.t, *d.z) for d in detections], rows[subjects > 5][:, [0, 2, 3]])
    odometry = np.array([r for r in log.records if isinstance(r, Odometry)])
    assert np.array_equal(odometry, np.loadtxt(path / "Robot3_Odometry.dat"))
    truth = np.array([r[:4] for r in log.records if isinstance(r, Pose) and r.truth])
    assert np.array_equal(truth, np.loadtxt(path / "Robot3_Groundtruth.dat"))
    times = [r.t for r in log.records]
    assert times == sorted(times)
    assert log.landmarks[:, 0].tolist() == list(range(6, 21))
