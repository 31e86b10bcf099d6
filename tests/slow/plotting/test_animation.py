"""Animations and pictures of maps made from logs."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from trailmark import Disc, OutputError, Path, Rectangle, World
from trailmark.estimation import Detector, MappedLog, MapSettings, RangeBearing, Scanner, Unicycle, map_log, simulate
from trailmark.plotting import Frame, save_animation, save_trajectory_animation
from trailmark.plotting.mapped import draw_map
from trailmark.shown import GOAL
from trailmark.shown import PATH as PATH_COLOUR
from trailmark.world import ObstacleEstimate, Robot

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


def test_bad_files_are_refused_and_nothing_is_written(tmp_path: FilePath) -> None:
    with pytest.raises(OutputError, match=r"expected a file that ends in \.gif"):
        save_animation(tmp_path / "drive.png", frames(), ROBOT)
    with pytest.raises(OutputError, match="expected at least one frame"):
        save_animation(tmp_path / "drive.gif", [], ROBOT)
    with pytest.raises(OutputError):
        save_animation(tmp_path / "nowhere" / "drive.gif", frames(), ROBOT)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("goal", [1.0, 1.3])
def test_a_drive_is_shown_at_the_times_that_it_takes(tmp_path: FilePath, goal: float) -> None:
    drive = Path(np.array([[1.0, 3.0, 3.0], [goal, 3.0, 3.0 if goal == 1.0 else -3.0]])).timed(1.0, 1.0, 1.0)
    save_trajectory_animation(tmp_path / "drive.gif", drive, WORLD, ROBOT)
    with Image.open(tmp_path / "drive.gif") as picture:
        assert getattr(picture, "n_frames", 1) in (1, int(np.ceil(drive.duration / 0.1)) + 1)
        assert goal == 1.0 or picture.info["duration"] == 100


WAY = [[1.0, 1.0], [7.0, 1.5], [7.0, 4.5], [1.5, 4.5]]


@cache
def mapped(scans: bool = False, confidence: float | None = None) -> MappedLog:
    discs = tuple(Disc(centre, 0.2) for centre in [(3.0, 2.5), (5.0, 3.0), (8.5, 3.0), (0.5, 3.0)])
    world = World("yard", (0.0, 0.0, 9.0, 6.0), discs)
    detector = None if scans else Detector(RangeBearing(0.05, 0.02))
    scanner = Scanner(beams=91, period=2.0) if scans else None
    log = simulate(
        world, WAY, Unicycle(0.01, 0.005, period=1.0), detector=detector, scanner=scanner, random_state=1
    ).log
    return map_log(log, MapSettings(radius=0.2), robot=Robot.disc(0.2), confidence=confidence)


def drawn(result: MappedLog) -> tuple[Any, list[str]]:
    axes = Figure(figsize=(6.0, 4.0)).add_subplot()
    draw_map(axes, result)
    return axes, axes.get_legend_handles_labels()[1]


def ellipses(axes: Any) -> Any:
    (found,) = (artist for artist in axes.collections if isinstance(artist, EllipseCollection))
    return found


def with_covariance(result: MappedLog, covariance: np.ndarray[Any, Any]) -> MappedLog:
    means = [estimate.mean for estimate in result.world.estimates if estimate is not None]
    estimates = tuple(ObstacleEstimate(mean, covariance) for mean in means)
    return result._replace(world=World("yard", result.world.bounds, tuple(means), estimates=estimates))


def test_ellipses_hold_centres_with_their_probability() -> None:
    angle = 0.4
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    covariance = turn @ np.diag([0.25, 0.04]) @ turn.T
    axes, labels = drawn(with_covariance(mapped(), covariance))
    found = ellipses(axes)
    # Chi-square with two degrees of freedom stays under 5.991 with probability 0.95.
    np.testing.assert_allclose(found.get_widths(), 2.0 * math.sqrt(5.991464547) * 0.5, rtol=1e-8)
    np.testing.assert_allclose(found.get_heights(), 2.0 * math.sqrt(5.991464547) * 0.2, rtol=1e-8)
    np.testing.assert_allclose(np.mod(found.get_angles(), 180.0), math.degrees(angle), atol=1e-6)
    centres = [e.mean.center for e in mapped().world.estimates if e is not None and isinstance(e.mean, Disc)]
    np.testing.assert_allclose(found.get_offsets(), centres)
    assert "95% ellipse" in labels


@pytest.mark.parametrize(
    ("scans", "confidence", "expected"),
    [
        (False, None, "trajectory, by EKF-SLAM"),
        (False, 0.99, "grown for 0.99"),
        (True, None, "where it lies, 95% each"),
        (True, 0.9, "grown for 0.9"),
        (True, 0.9, "trajectory, by scan matching"),
        (True, None, "unknown"),
    ],
)
def test_the_legend_names_what_is_drawn(scans: bool, confidence: float | None, expected: str) -> None:
    axes, labels = drawn(mapped(scans, confidence))
    assert expected in labels
    assert {"obstacle as measured", "its start", "its end"} <= set(labels)
    way = max(axes.lines, key=lambda line: len(line.get_xdata()))
    np.testing.assert_array_equal(np.column_stack(way.get_data()), mapped(scans, confidence).trajectory[:, 1:3])
