"""A robot along its trajectory: a GIF with a frame for each tenth of a second, a page that needs no other file."""

from __future__ import annotations

import json
import re
from pathlib import Path as FilePath

import numpy as np
import pytest
from PIL import Image

from trailmark import Disc, Path, Polygon, Rectangle, World
from trailmark.errors import OutputError
from trailmark.plotting import save_trajectory_animation
from trailmark.world import Robot
from trailmark.zones import SpeedZone

ZONE = SpeedZone(Polygon(np.array([[2.0, 2.0], [3.0, 2.0], [3.0, 4.0]])), 0.5)
WORLD = World("room <1>", (0.0, 0.0, 8.0, 4.0), (Rectangle((4.0, 1.0), 1.0, 2.0), Disc((7.0, 1.0), 0.5)), zones=(ZONE,))
ROBOT = Robot.rectangle(0.6, 0.4)
TRAJECTORY = Path(np.array([[1.0, 3.0, 3.0], [6.0, 3.0, -3.0], [7.0, 3.5, -3.0]])).timed(1.0, 1.0, 1.0)


@pytest.mark.slow
def test_a_gif_shows_the_robot_at_the_times_that_it_takes(tmp_path: FilePath) -> None:
    file = tmp_path / "drive.gif"
    short = Path(np.array([[1.0, 3.0, 3.0], [1.3, 3.0, -3.0]])).timed(1.0, 1.0, 1.0)
    save_trajectory_animation(file, short, WORLD, ROBOT)
    with Image.open(file) as picture:
        assert getattr(picture, "n_frames", 1) == int(np.ceil(short.duration / 0.1)) + 1 > 10
        assert picture.info["duration"] == 100


def test_a_page_holds_all_that_it_shows(tmp_path: FilePath) -> None:
    file = tmp_path / "drive.html"
    save_trajectory_animation(file, TRAJECTORY, WORLD, ROBOT)
    page = file.read_text(encoding="utf-8")
    assert "<title>room &lt;1&gt;</title>" in page
    assert "@" not in page
    assert not re.search(r"(src|href)=|https?://", page)
    found = re.search(r"rows = (\[.*?\]), end", page)
    assert found is not None
    rows = np.array(json.loads(found[1]))
    np.testing.assert_allclose(rows[[0, -1], 1:3], TRAJECTORY.q[[0, -1], :2], atol=1e-3)
    assert rows[-1, 0] == pytest.approx(TRAJECTORY.duration, abs=1e-3)
    # Headings go on beyond half a turn, since the page joins rows by straight lines.
    assert np.abs(np.diff(rows[:, 3])).max() < 0.2
    assert len(page) < 200_000


@pytest.mark.slow
def test_a_robot_that_stands_still_is_shown(tmp_path: FilePath) -> None:
    still = Path(np.array([[1.0, 3.0, 0.0]])).timed(1.0, 1.0, 1.0)
    for name in ("still.gif", "still.html"):
        save_trajectory_animation(tmp_path / name, still, WORLD, ROBOT)
        assert (tmp_path / name).stat().st_size > 0


def test_other_files_are_refused(tmp_path: FilePath) -> None:
    with pytest.raises(OutputError, match=r"suffix: expected .*\.gif.*\.html"):
        save_trajectory_animation(tmp_path / "drive.mp4", TRAJECTORY, WORLD, ROBOT)
    assert list(tmp_path.iterdir()) == []
