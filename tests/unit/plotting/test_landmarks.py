"""The source method's figures, checked by their pixels: shapely says what must be black, grey or white."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.helpers.pictures import colours_of, is_colour

from trailmark import Disc, Path, Polygon, Query, Rectangle, Roadmap, Robot, StateChecker, World
from trailmark.landmarks.executions import execute_paper
from trailmark.plotting import landmarks, save_landmarks_figure
from trailmark.shown import GOAL, LANDMARK, MARGIN, OBSTACLE, PATH, START

ROBOT = Robot.disc(0.4)
QUERY = Query("round", (1.0, 1.0, 0.0), (9.0, 5.0, 0.0))
YARD = (Rectangle((7, 1), 2.4, 0.2), Rectangle((7, 2.6), 2.4, 0.2), Rectangle((5.9, 1.8), 0.2, 1.8))
ROOM = World(
    "room",
    (0.0, 0.0, 10.0, 6.0),
    (
        *(Polygon(np.array([[3, 3], [3, 5], [5, 5], [5, 4.5], [3.5, 4.5], [3.5, 3]])), Disc((1.5, 4.0), 0.7)),
        *(*YARD, Rectangle((8.1, 1.8), 0.2, 1.8), Disc((9.8, 3.5), 0.6)),
    ),
    ROBOT,
    queries=(QUERY, Query("back", QUERY.goal, QUERY.start)),
)
PLANNED: Any = [
    (QUERY, Roadmap(StateChecker(ROOM)), Path(np.array([QUERY.start, (5.5, 4.0, 0.0), QUERY.goal]))),
    (ROOM.queries[1], Roadmap(StateChecker(ROOM)), None),
]


@pytest.mark.slow
def test_the_whole_figure(tmp_path: FilePath) -> None:
    checker, start, file = StateChecker(ROOM), np.array(QUERY.start), tmp_path / "room.png"
    executions = [execute_paper(checker, 400, 8, random_state=seed, start=start) for seed in range(3)]
    save_landmarks_figure(file, ROOM, ROBOT, executions, PLANNED)
    with Image.open(file) as picture:
        assert min(picture.size) > 600
    rgb, counts = colours_of(file)
    for colour in (OBSTACLE, MARGIN, landmarks.VALID, landmarks.FORBIDDEN, START, GOAL, PATH, LANDMARK):
        assert counts[is_colour(rgb, colour)].sum() > 50, colour
    assert 0.3 < counts[is_colour(rgb, "white")].sum() / counts.sum() < 0.95
