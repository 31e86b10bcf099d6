"""Pictures of explorations: the cells are those of the map, and an animation reveals them in their order."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from tests.helpers.made_exploration import made_exploration

from trailmark.errors import OutputError
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.plotting.exploration import draw_exploration, save_exploration_animation, save_exploration_figure

GREY, WHITE, DARK = (201, 204, 210), (255, 255, 255), (63, 66, 73)
"""Of unknown, free and occupied cells."""


def test_the_picture_shows_the_cells_and_each_landmark() -> None:
    result = made_exploration()
    axes = Figure().add_subplot()
    draw_exploration(axes, result)
    (image,) = axes.images
    cells = np.asarray(image.get_array())
    for state, colour in ((UNKNOWN, GREY), (FREE, WHITE), (OCCUPIED, DARK)):
        assert np.array_equal((cells == colour).all(axis=2), result.known.state == state)
    assert image.get_extent() == pytest.approx([0.0, 8.0, 0.0, 5.0])
    assert [text.get_text() for text in axes.texts if text.get_text()] == ["1", "2", "3", "4"]
    assert {"occupied", "free", "unknown", "start", "end"} <= set(axes.get_legend_handles_labels()[1])


@pytest.mark.slow
def test_an_exploration_of_one_reading_and_without_robot_is_drawn(tmp_path: Path) -> None:
    result = made_exploration()
    world = replace(result.world, robot=None)
    short = replace(result, history=result.history[:1], world=world, evaluation=None)
    save_exploration_figure(tmp_path / "a.png", short)
    save_exploration_animation(tmp_path / "a.gif", short)
    assert (tmp_path / "a.png").stat().st_size > 5000


@pytest.mark.slow
def test_the_animation_reveals_the_map(tmp_path: Path) -> None:
    file = tmp_path / "a.gif"
    result = made_exploration()
    save_exploration_animation(file, replace(result, history=(*result.history[:-1:2], result.history[-1])))
    assert file.stat().st_size < 1_000_000
    grey, aimed, seconds = [], 0, 0.0
    with Image.open(file) as film:
        for i in range(film.n_frames):  # type: ignore[attr-defined]
            film.seek(i)
            seconds += 1e-3 * film.info["duration"]
            pixels = np.asarray(film.convert("RGB"))[::3, ::3].astype(int)
            aimed += bool((abs(pixels - (213, 94, 0)).max(axis=2) < 6).any())
            grey.append(int((abs(pixels - GREY).max(axis=2) < 6).sum()))
    assert len(grey) >= 40
    assert 4.0 < seconds < 7.5
    assert aimed > 25, "the landmark that is driven to has its own colour"
    # Landmarks and the robot hide some cells.
    assert grey[0] > 4 * grey[-1] > 0
    assert np.diff(grey).max() < 60


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"expected a file that ends in \.gif, got \.png"):
        save_exploration_animation(tmp_path / "a.png", made_exploration())
    with pytest.raises(OutputError, match="suffix: expected"):
        save_exploration_figure(tmp_path / "a.gif", made_exploration())
