"""The source method's figures, checked by their pixels: shapely says what must be black, grey or white."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image
from tests.helpers.pictures import colours_of, is_colour

from trailmark.collision import StateChecker
from trailmark.landmarks.executions import Execution, execute_paper, execute_se2
from trailmark.plotting import landmarks, save_landmarks_figure
from trailmark.plotting.canvas import write
from trailmark.roadmap import Roadmap
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.shown import GOAL, LANDMARK, MARGIN, OBSTACLE, PATH, START
from trailmark.trajectories.path import Path
from trailmark.world import Query, Robot, World

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


@pytest.fixture(scope="module")
def executions() -> list[Execution]:
    checker = StateChecker(ROOM)
    start = np.array(QUERY.start)
    return [execute_paper(checker, 400, 8, random_state=seed, start=start) for seed in range(3)]


@pytest.fixture(scope="module")
def whole(executions: list[Execution], tmp_path_factory: pytest.TempPathFactory) -> tuple[FilePath, list[str]]:
    """The figure of three executions and two queries as a file, and the titles of its panels."""
    file = tmp_path_factory.mktemp("whole") / "room.png"
    with pytest.MonkeyPatch.context() as patched:
        return file, titles(patched, ROOM, ROBOT, executions, PLANNED, file=file)


@pytest.mark.slow
def test_the_whole_figure(whole: tuple[FilePath, list[str]]) -> None:
    with Image.open(whole[0]) as picture:
        assert min(picture.size) > 600
    rgb, counts = colours_of(whole[0])
    for colour in (OBSTACLE, MARGIN, landmarks.VALID, landmarks.FORBIDDEN, START, GOAL, PATH, LANDMARK):
        assert counts[is_colour(rgb, colour)].sum() > 50, colour
    assert 0.3 < counts[is_colour(rgb, "white")].sum() / counts.sum() < 0.95


def titles(monkeypatch: pytest.MonkeyPatch, *arguments: Any, file: FilePath | None = None) -> list[str]:
    """Return the panels' titles; the figure is written only to a file that is given."""
    drawn: list[Figure] = []

    def seen(figure: Figure, place: FilePath) -> None:
        drawn.append(figure)
        if file is not None:
            write(figure, place)

    monkeypatch.setattr(landmarks, "write", seen)
    save_landmarks_figure(file or "unused.png", *arguments)
    return [axes.get_title(loc="left") for axes in drawn[0].axes]


@pytest.mark.slow
def test_the_panels(executions: list[Execution], whole: tuple[FilePath, list[str]]) -> None:
    counts = [int(execution.forbidden.sum()) for execution in executions]
    assert whole[1] == [
        "workspace",
        "C-space: grown by disc 0.4 m",
        "initial execution: 400 points",
        *(f"execution {i + 1}: {count} forbidden, {400 - count} valid" for i, count in enumerate(counts)),
        "landmarks, k = 8; round",
        f"round: over 8 landmarks, cost {PLANNED[0][2].cost:.4g}",
        "back: the 8 landmarks do not connect it",
    ]


def test_a_world_without_queries_and_trailmarks_own_landmarks(monkeypatch: pytest.MonkeyPatch) -> None:
    hall = World("hall", (0.0, 0.0, 40.0, 4.0), (), Robot.rectangle(1.0, 0.5))
    assert hall.robot is not None
    found = execute_se2(StateChecker(hall), 300, 1, random_state=0)
    assert titles(monkeypatch, hall, hall.robot, [found]) == [
        *("workspace", "C-space: grown by rectangle 1 x 0.5 m", "initial execution: 300 points"),
        *(f"execution 1: {found.forbidden.sum()} forbidden, {(~found.forbidden).sum()} valid", "landmarks, k = 1"),
    ]
