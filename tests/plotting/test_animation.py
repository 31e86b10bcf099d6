"""Animations: as many pictures as frames, shown as long as asked for; whole or not at all."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from trailmark import Disc, Path, Rectangle, World
from trailmark.errors import OutputError
from trailmark.plotting import Frame, save_animation, save_trajectory_animation
from trailmark.shown import GOAL
from trailmark.shown import PATH as PATH_COLOUR
from trailmark.world import Robot

WORLD = World("room", (0.0, 0.0, 8.0, 4.0), (Rectangle((4.0, 1.0), 1.0, 2.0),))
ROBOT = Robot.rectangle(0.6, 0.4)
PATH = Path(np.array([[1.0, 3.0, 0.0], [7.0, 3.0, 0.0]]))


def frames() -> list[Frame]:
    changed = WORLD.edited(add={"pallet": Disc((6.0, 1.0), 0.4)})
    return [
        Frame(WORLD, PATH.at(0.0), PATH, "starts"),
        Frame(changed, PATH.at(0.5), PATH, "a pallet"),
        Frame(changed, PATH.at(1.0), None),
    ]


@pytest.mark.slow
def test_each_frame_is_a_picture(tmp_path: FilePath) -> None:
    file = tmp_path / "drive.gif"
    save_animation(file, frames(), ROBOT, PATH.states[-1], seconds=0.2)
    with Image.open(file) as picture:
        assert picture.format == "GIF"
        assert getattr(picture, "n_frames", 1) == 3
        assert picture.info["duration"] == 200
        assert picture.info["loop"] == 0
        shown = []
        for number in range(3):
            picture.seek(number)
            shown.append(np.asarray(picture.convert("RGB")).astype(int))
    height = len(shown[0])
    for colour in (GOAL, PATH_COLOUR):  # in the picture, and in the legend below it
        near = np.abs(shown[0] - np.round(255.0 * np.array(to_rgb(colour)))).max(axis=2) <= 4
        assert near[: int(0.8 * height)].any()
        assert near[int(0.8 * height) :].any()
    assert (shown[0][: int(0.06 * height)].min(axis=2) < 60).any(), "a title"
    assert (shown[0] != shown[1]).any()
    assert (shown[1] != shown[2]).any()


@pytest.mark.slow
def test_bad_files_are_refused_and_nothing_is_written(tmp_path: FilePath) -> None:
    with pytest.raises(OutputError, match=r"expected a file that ends in \.gif"):
        save_animation(tmp_path / "drive.png", frames(), ROBOT)
    with pytest.raises(OutputError, match="expected at least one frame"):
        save_animation(tmp_path / "drive.gif", [], ROBOT)
    with pytest.raises(OutputError):
        save_animation(tmp_path / "nowhere" / "drive.gif", frames(), ROBOT)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("goal", [1.0, 1.3])
def test_a_drive_is_shown_at_the_times_that_it_takes(tmp_path: FilePath, goal: float) -> None:
    drive = Path(np.array([[1.0, 3.0, 3.0], [goal, 3.0, 3.0 if goal == 1.0 else -3.0]])).timed(1.0, 1.0, 1.0)
    save_trajectory_animation(tmp_path / "drive.gif", drive, WORLD, ROBOT)
    with Image.open(tmp_path / "drive.gif") as picture:
        assert getattr(picture, "n_frames", 1) in (1, int(np.ceil(drive.duration / 0.1)) + 1)
        assert goal == 1.0 or picture.info["duration"] == 100
