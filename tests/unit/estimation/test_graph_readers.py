"""The Victoria Park file: increments, trees, and lines that do not belong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Detection, Increment, Pose

LINES = (
    "LANDMARK 0 7 5.0 -1.0 0.4 0 0.4",
    "ODOMETRY 0 1 1.0 0.5 0.25 0.01 0.001 0.002 0.03 0.004 0.05",
    "ODOMETRY 1 4 2.0 0.0 0.0 0.01 0 0 0.02 0 0.03",
    "LANDMARK 4 7 3.0 -1.5 0.4 0.1 0.5",
)
MOTION = "ODOMETRY 4 5 1 0 0 0.01 0 0 0.01 0 0.01"


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_small_log(tmp_path: Path) -> None:
    log = load_log(write(tmp_path / "park.txt", "", LINES[0], "# a comment", *LINES[1:]))
    assert (log.name, log.landmarks.shape) == ("park", (0, 3))
    seen, moved, again, last = log.records
    assert isinstance(seen, Detection)
    assert isinstance(moved, Increment)
    assert isinstance(again, Increment)
    assert isinstance(last, Detection)
    assert (seen.t, seen.kind, seen.identity) == (0.0, "range-bearing", 7)
    assert seen.z == pytest.approx([np.hypot(5.0, 1.0), np.arctan2(-1.0, 5.0)])
    assert seen.covariance == pytest.approx(np.diag([0.4, 0.04]))
    assert (moved[:4], again.t) == ((1.0, 1.0, 0.5, 0.25), 4.0)
    assert np.array_equal(np.array(moved[4]), [[0.01, 0.001, 0.002], [0.001, 0.03, 0.004], [0.002, 0.004, 0.05]])
    assert (last.t, last.z.tolist(), last.kind, last.identity) == (4.0, [3.0, -1.5], "cartesian", 7)
    assert np.array_equal(np.array(last[4]), [[0.4, 0.1], [0.1, 0.5]])


@pytest.mark.parametrize(
    ("line", "problem", "records"),
    [
        (MOTION[:-10], "ODOMETRY: expected 11 columns i, j, dx, dy, dtheta, c11", 4),
        (LINES[3][:-3] + " 0.5 1", "LANDMARK: expected 7 columns i, j, x, y, c11, c12, c22", 4),
        (
            "LANDMARK 4 7 nan 1 0.4 0 0.4",
            "expected LANDMARK, two whole and then finite numbers, got 'LANDMARK 4 7 nan 1 0.4 0 0.4'",
            4,
        ),
        (
            "LANDMARK 4 7 2 1 0.4 0 -0.4",
            "covariance: expected the upper triangle of a positive definite matrix, got [0.4, 0.0, -0.4]",
            4,
        ),
        ("LANDMARK 1 7 2 1 0.4 0 0.4", "expected pose 4, got pose 1, a pose left behind: the line is out of order", 4),
        ("ODOMETRY 4 4 1 0 0 0.01 0 0 0.01 0 0.01", "motion from pose 4: expected to a later pose, got pose 4", 4),
        ("LANDMRK 4 7 2 1 0.4 0 0.4", "expected a line with ODOMETRY, LANDMARK, got 'LANDMRK 4 7 2 1 0.4 0 0.4'", 4),
    ],
)
def test_bad_lines(tmp_path: Path, line: str, problem: str, records: int) -> None:
    path = write(tmp_path / "park.txt", *LINES, line)
    with pytest.raises(FormatError) as caught:
        load_log(path)
    assert str(caught.value).startswith(f"{path}:5: ")
    assert problem in str(caught.value)
    log = load_log(path, skip_bad=True)
    assert (len(log.records), log.dropped) == (records, 1)


def test_a_motion_that_is_missing(tmp_path: Path) -> None:
    path = write(tmp_path / "park.txt", *LINES[:2], *LINES[3:], MOTION)
    with pytest.raises(FormatError, match=r"park.txt:3: expected pose 1, got pose 4, the motion to it is missing"):
        load_log(path)
    # Left out on purpose, as a bad line would be, what follows is taken as it stands.
    log = load_log(path, skip_bad=True)
    assert [(type(r), r.t) for r in log.records] == [(Detection, 0), (Increment, 1), (Detection, 4), (Increment, 5)]
    assert log.dropped == 0


TEXT = """VERTEX_SE2 0 1 2 0.5
VERTEX_SE2 1 2 2 0.5
VERTEX_SE2 3 3 2 0.6
VERTEX_XY 10 4 4
FIX 0
EDGE_SE2 0 1 1.0 0.1 0.01 100 0 0 25 0 400
EDGE_SE2 1 3 0.9 0.0 0.02 4 1 0 4 0 16
EDGE_SE2 3 0 -2 0 0 1 0 0 1 0 1
EDGE_SE2_XY 1 10 2.0 1.0 4 0 16
"""


def test_a_graph_becomes_a_drive(tmp_path: Path) -> None:
    path = tmp_path / "drive.g2o"
    path.write_text(TEXT)
    log = load_log(path)
    first, step, seen, last = log.records
    assert first == Pose(0.0, 1.0, 2.0, 0.5)
    assert isinstance(step, Increment)
    assert step[:4] == (1.0, 1.0, 0.1, 0.01)
    assert step.covariance == pytest.approx(np.diag([0.01, 0.04, 0.0025]))
    assert isinstance(seen, Detection)
    assert (seen.t, seen.kind, seen.identity, seen.z.tolist()) == (1.0, "cartesian", 10, [2.0, 1.0])
    assert seen.covariance == pytest.approx(np.diag([0.25, 0.0625]))
    assert isinstance(last, Increment)
    assert last.covariance is not None
    assert np.linalg.inv(last.covariance)[0] == pytest.approx([4.0, 1.0, 0.0])
    assert log.notes == ("1 edges between poses that do not follow one another left out",)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("EDGE_SE2 0 1 1 2", "expected EDGE_SE2 and 11 finite numbers"),
        ("EDGE_SE3 0 1 1 2", "expected a line with VERTEX_SE2, EDGE_SE2, EDGE_SE2_XY"),
        ("EDGE_SE2 0 1 1 2 0 1 2 0 1 0 1", "positive definite"),
    ],
)
def test_bad_lines_of_a_graph(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "drive.g2o"
    path.write_text(TEXT + line + "\n")
    with pytest.raises(FormatError, match=f"drive.g2o:10: .*{message}"):
        load_log(path)
    assert load_log(path, skip_bad=True).dropped == 1
