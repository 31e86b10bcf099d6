"""Trajectory files hold every digit, and are written whole or not at all."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest
import yaml

from trailmark import Path
from trailmark.errors import ConfigurationError, OutputError
from trailmark.formats.path_files import HEADER, write_trajectory

TRAJECTORY = Path(np.array([[1.0, 3.0, 0.0], [7.0, 3.0, 1.0], [7.0, 5.0, 1.0]])).timed(1.0, 0.7, 1.0)


def test_rows_are_the_arrays(tmp_path: FilePath) -> None:
    file = tmp_path / "drive.csv"
    write_trajectory(file, TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq)
    assert file.read_text().splitlines()[0] == HEADER
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(rows, np.column_stack([TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq]))


@pytest.mark.parametrize("name", ["drive.yaml", "drive.nav2.json"])
def test_nav2s_message_has_a_point_a_row(tmp_path: FilePath, name: str) -> None:
    file = tmp_path / name
    write_trajectory(file, TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq, "odom")
    message = yaml.safe_load(file.read_text())
    assert message["header"]["frame_id"] == "odom"
    assert len(message["points"]) == len(TRAJECTORY.t)
    assert message["points"][-1]["pose"]["position"]["y"] == 5.0


def test_what_cannot_be_written_is_refused(tmp_path: FilePath) -> None:
    t, q, dq = TRAJECTORY.t, TRAJECTORY.q, TRAJECTORY.dq
    with pytest.raises(OutputError, match="suffix"):
        write_trajectory(tmp_path / "drive.txt", t, q, dq)
    with pytest.raises(ConfigurationError, match=r"expected shapes \(n,\), \(n, 3\) and \(n, 3\), got"):
        write_trajectory(tmp_path / "drive.csv", t[1:], q, dq)
    with pytest.raises(OutputError):
        write_trajectory(tmp_path / "nowhere" / "drive.csv", t, q, dq)
    assert list(tmp_path.iterdir()) == []
