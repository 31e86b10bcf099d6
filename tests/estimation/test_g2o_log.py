"""g2o graphs as logs: a drive with landmarks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.estimation.readers import load_log
from trailmark.estimation.records import Detection, Increment, Pose

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
        ("EDGE_SE2 0 1 1 2 nan 1 0 0 1 0 1", "11 finite numbers"),
        ("EDGE_SE2 0 1 1 2 0 1 2 0 1 0 1", "positive definite"),
    ],
)
def test_bad_lines(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "drive.g2o"
    path.write_text(TEXT + line + "\n")
    with pytest.raises(FormatError, match=f"drive.g2o:10: .*{message}"):
        load_log(path)
    assert load_log(path, skip_bad=True).dropped == 1
