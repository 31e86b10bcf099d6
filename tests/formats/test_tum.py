"""TUM trajectories: what evo would read."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from trailmark.errors import OutputError, WorldError
from trailmark.formats.path_files import write_tum


def test_rows_are_time_place_and_quaternion(tmp_path: Path) -> None:
    trajectory = np.array(
        [[1134863807.658747, 1.0, -2.0, 0.3], [1134863808.0, 1.5, -2.0, -math.pi / 2], [2e9, 0.0, 0.0, math.pi]]
    )
    write_tum(tmp_path / "a.tum", trajectory)
    rows = np.loadtxt(tmp_path / "a.tum")
    assert rows.shape == (3, 8)
    assert (rows[:, :3] == trajectory[:, :3]).all()
    assert (rows[:, 3:6] == 0.0).all()
    assert np.allclose(2.0 * np.arctan2(rows[:, 6], rows[:, 7]), trajectory[:, 3])


def test_what_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(WorldError, match="trajectory"):
        write_tum(tmp_path / "a.tum", np.zeros((2, 3)))
    with pytest.raises(OutputError):
        write_tum(tmp_path / "no" / "a.tum", np.zeros((2, 4)))
