"""The source method's figures, checked by their pixels: shapely says what must be black, grey or white."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from tests.support.pictures import colours_of, is_colour

from trailmark.collision import StateChecker
from trailmark.colours import GOAL, LANDMARK, PATH, START
from trailmark.errors import OutputError
from trailmark.landmarks.executions import Execution, execute_paper, execute_se2
from trailmark.path import Path
from trailmark.plotting import landmarks, save_landmarks_figure
from trailmark.plotting.canvas import write
from trailmark.plotting.world import regions_of
from trailmark.roadmap import Roadmap
from trailmark.shapes import Disc, Polygon, Rectangle
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
SOLID = shapely.union_all([shape.polygon(1e-3).shapely() for shape in ROOM.obstacles])
PLANNED: Any = [
    (QUERY, Roadmap(StateChecker(ROOM)), Path(np.array([QUERY.start, (5.5, 4.0, 0.0), QUERY.goal]))),
    (ROOM.queries[1], Roadmap(StateChecker(ROOM)), None),
]


@pytest.fixture(scope="module")
def executions() -> list[Execution]:
    checker = StateChecker(ROOM)
    start = np.array(QUERY.start)
    return [execute_paper(checker, 400, 8, random_state=seed, start=start) for seed in range(3)]


class Canvas:
    """An image of axes that fill it and show the room's bounds."""

    def __init__(self, per_metre: int = 50) -> None:
        self.per_metre = per_metre
        figure = Figure(figsize=(10.0, 6.0), dpi=per_metre)
        self.canvas: Any = FigureCanvasAgg(figure)
        self.axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self._limits()

    def _limits(self) -> None:
        self.axes.set_axis_off()
        self.axes.set_xlim(0.0, 10.0)
        self.axes.set_ylim(0.0, 6.0)

    def pixels(self) -> Any:
        """Return rgb in 0..1 (h, w, 3), and the pixels' places as points (h, w)."""
        rgb = self.colours()
        return rgb, self.points(*np.indices(rgb.shape[:2]))

    def colours(self) -> Any:
        """Return rgb in 0..1 (h, w, 3)."""
        self._limits()
        self.canvas.draw()
        return np.asarray(self.canvas.buffer_rgba())[..., :3] / 255.0

    def points(self, rows: Any, columns: Any) -> Any:
        """Return the places of pixels as points."""
        return shapely.points((columns + 0.5) / self.per_metre, 6.0 - (rows + 0.5) / self.per_metre)


@pytest.mark.slow
@pytest.mark.parametrize("margin", [None, "C-obstacle"])
def test_obstacles_are_black_and_the_margin_grey(margin: str | None) -> None:
    canvas = Canvas(per_metre=30)
    landmarks._draw_ground(canvas.axes, ROOM, regions_of(ROOM, ROBOT), margin)
    rgb, points = canvas.pixels()
    walls = shapely.box(*ROOM.bounds).exterior
    off_frame = shapely.distance(walls, points) > 0.1
    gap = shapely.distance(SOLID, points)
    inside = (gap == 0.0) & (shapely.distance(SOLID.boundary, points) > 0.05) & off_frame
    assert is_colour(rgb[inside], landmarks.BLACK).all()
    reach = np.minimum(gap, shapely.distance(walls, points))
    grown = (gap > 0.05) & (reach < 0.35) & off_frame
    assert grown.sum() > 3600
    assert is_colour(rgb[grown], landmarks.GREY if margin else "white").all()
    assert is_colour(rgb[reach > 0.45], "white").all()


@pytest.mark.slow
def test_the_initial_execution_shows_boxes_and_all_kinds_of_points(executions: list[Execution]) -> None:
    canvas = Canvas(per_metre=160)
    landmarks.draw_initial_execution(canvas.axes, executions[0])
    rgb = canvas.colours()
    boxes = shapely.union_all([shapely.box(*box) for box in executions[0].boxes])
    orange = is_colour(rgb, landmarks.FORBIDDEN, 0.2)
    assert orange.sum() > 500
    assert (shapely.distance(boxes, canvas.points(*np.nonzero(orange))) < 0.1).all()
    blue = is_colour(rgb, landmarks.VALID, 0.1)
    assert blue.sum() > 300
    assert not shapely.contains(boxes.buffer(-0.15), canvas.points(*np.nonzero(blue))).any()
    assert executions[0].enclosed.any()
    pink = is_colour(rgb, landmarks.ENCLOSED, 0.15)
    assert pink.any()
    assert shapely.contains(shapely.box(5.9, 0.9, 8.1, 2.7), canvas.points(*np.nonzero(pink))).all()


@pytest.mark.slow
def test_an_execution_shows_centres_and_as_many_colours_as_clusters(executions: list[Execution]) -> None:
    canvas = Canvas()
    canvas.axes.set_xlim(0.0, 10.0)
    canvas.axes.set_ylim(0.0, 6.0)
    landmarks.draw_execution(canvas.axes, executions[0], ROOM.bounds)
    rgb, points = canvas.pixels()
    centres = executions[0].centres
    for centre, invalid in zip(centres, executions[0].invalid, strict=True):
        near = shapely.distance(shapely.Point(centre), points) < 0.04
        assert is_colour(rgb[near], landmarks.FORBIDDEN if invalid else LANDMARK, 0.05).any()
    colours = landmarks._colours(centres)
    assert len(np.unique(colours.round(3), axis=0)) == 8
    for label, colour in enumerate(colours):
        like = np.abs(rgb - colour).max(axis=-1) < 0.05
        assert like.any()
        far = np.linalg.norm(shapely.get_coordinates(points[like])[:, None] - centres[None], axis=2)
        assert (far[:, label] < far.min(axis=1) + 0.1).mean() > 0.9


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
    for colour in (landmarks.BLACK, landmarks.GREY, landmarks.VALID, landmarks.FORBIDDEN, START, GOAL, PATH, LANDMARK):
        assert counts[is_colour(rgb, colour)].sum() > 50, colour
    assert 0.3 < counts[is_colour(rgb, "white")].sum() / counts.sum() < 0.95


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(executions: list[Execution], tmp_path: FilePath) -> None:
    files = [tmp_path / "a.svg", tmp_path / "b.svg"]
    for file in files:
        save_landmarks_figure(file, ROOM, ROBOT, executions[:1])
    assert files[0].read_bytes() == files[1].read_bytes()


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


@pytest.mark.slow
def test_other_suffixes_are_refused(executions: list[Execution], tmp_path: FilePath) -> None:
    with pytest.raises(OutputError, match=r"/room\.gif: suffix: expected \.png, \.svg, \.pdf, got"):
        save_landmarks_figure(tmp_path / "room.gif", ROOM, ROBOT, executions)
