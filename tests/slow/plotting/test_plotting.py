"""Pictures are checked by their pixels: shapely says which must be dark, and the drawn image must agree."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path as FilePath
from types import SimpleNamespace
from typing import Any

import networkx as nx
import numpy as np
import pytest
import shapely
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from tests.helpers.pictures import colours_of, is_colour

from trailmark import CurvePath, Moving, OutputError, Path, PlanResult, StateChecker, Steering, check_path, plotting
from trailmark.motion import motion_of
from trailmark.plotting import OBSTACLE, draw_plan, save_audit_figure, save_world_figure
from trailmark.plotting.world import draw_world
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.shown import COLLISION, REPAIRED
from trailmark.world import Query, Robot, World
from trailmark.world.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

CAR = Robot.rectangle(0.8, 0.4)
START, GOAL = (1.0, 1.0, 0.0), (9.0, 5.0, math.pi / 2)
ROOM = World(
    "room",
    (0.0, 0.0, 10.0, 6.0),
    (
        # Clockwise outline and hole on purpose: winding must not depend on how a file lists its vertices.
        Polygon(np.array([[3, 2], [3, 5], [7, 5], [7, 2]]), (np.array([[4, 3], [4, 4], [6, 4], [6, 3]]),)),
        Rectangle((6.5, 4.5), 2.0, 0.6, 0.4),  # overlaps the outline and the hole
        Disc((1.5, 4.0), 0.7),
        Disc((9.8, 0.2), 0.6),  # reaches out of the bounds
    ),
    CAR,
    queries=(Query("round", START, GOAL), Query("back", GOAL, START)),
)


class Canvas:
    """An image of axes that fill it, with its pixels' world coordinates."""

    def __init__(self, view: tuple[float, float, float, float], per_metre: int = 40) -> None:
        xmin, ymin, xmax, ymax = view
        figure = Figure(figsize=((xmax - xmin) * per_metre / 100, (ymax - ymin) * per_metre / 100), dpi=100)
        self.canvas: Any = FigureCanvasAgg(figure)
        self.axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.view = view
        self.size = 1.0 / per_metre

    def pixels(self) -> Any:
        """Return (rgb in 0..1 of shape (h, w, 3), x of shape (h, w), y of shape (h, w))."""
        self.axes.set_axis_off()
        self.axes.set_xlim(self.view[0], self.view[2])
        self.axes.set_ylim(self.view[1], self.view[3])
        self.canvas.draw()
        rgb = np.asarray(self.canvas.buffer_rgba())[..., :3] / 255.0
        rows, columns = np.indices(rgb.shape[:2])
        return rgb, self.view[0] + (columns + 0.5) * self.size, self.view[3] - (rows + 0.5) * self.size


def result_of(path: Path | None, status: str = "solved") -> Any:
    history = () if path is None else ((0.004, 1.2 * path.cost), (0.05, path.cost))
    bound = None if path is None else 0.95 * path.cost
    return PlanResult(status, path, 0, bound, None, None, 0, 0, history=history, time={"total": 0.25})  # type: ignore[arg-type]  # status is one


BLOCKED, FREE, UNDECIDED = 0, 1, 2


def roadmap_of(configurations: list[tuple[float, float, float]], status: list[int]) -> Any:
    """A roadmap whose i-th edge joins the nodes i and i + 1."""
    kinds = np.array(status, dtype=np.uint8)
    edges = np.array([[i, i + 1] for i in range(len(kinds))], dtype=np.int32).reshape(-1, 2)
    at = np.array(configurations).reshape(-1, 3)
    motion = motion_of(StateChecker(ROOM, CAR))
    return SimpleNamespace(configurations=at, edges=edges, status=kinds, certified=kinds == FREE, motion=motion)


PATH = Path(np.array([START, (8.0, 1.2, 0.0), (8.5, 3.0, 1.2), GOAL]))
ROADMAP = roadmap_of([START, (5.0, 1.0, 0.5), (8.0, 1.2, 0.0), (8.5, 3.0, 1.2), GOAL], [FREE, UNDECIDED, BLOCKED, FREE])


def test_dark_pixels_are_obstacles_and_white_ones_are_free() -> None:
    canvas = Canvas(ROOM.bounds)
    plotting.draw_world(canvas.axes, ROOM)
    rgb, x, y = canvas.pixels()
    solid = shapely.union_all([shape.polygon(1e-3).shapely() for shape in ROOM.obstacles])
    points = shapely.points(x, y)
    far = shapely.distance(points, solid.boundary) > 2 * canvas.size
    inside = shapely.contains(solid, points)
    frame = (np.minimum(x, 10 - x) < 0.1) | (np.minimum(y, 6 - y) < 0.1)
    assert is_colour(rgb[far & inside & ~frame], plotting.OBSTACLE).all()
    assert is_colour(rgb[far & ~inside & ~frame], "white").all()
    hole = shapely.contains(shapely.box(4.1, 3.1, 5.4, 3.9), points)
    assert hole.sum() > 1000
    assert is_colour(rgb[hole], "white").all()


@pytest.mark.parametrize("robot", [Robot.disc(0.3), CAR, Robot.polygon([[-0.2, -0.3], [1, -0.3], [1, 0.2], [-0.2, 1]])])
def test_margin_is_what_the_reference_point_cannot_enter(robot: Robot) -> None:
    canvas = Canvas(ROOM.bounds)
    plotting.draw_world(canvas.axes, ROOM, robot)
    rgb, x, y = canvas.pixels()
    outline = robot.outline.shapely()
    radius = shapely.distance(shapely.Point(0, 0), outline.exterior)
    solid = shapely.union_all([shape.polygon(1e-3).shapely() for shape in ROOM.obstacles])
    walls = shapely.box(*ROOM.bounds).exterior
    points = shapely.points(x, y)
    reach = np.minimum(shapely.distance(points, solid), shapely.distance(points, walls))
    grey = (reach > 2 * canvas.size) & (reach < radius - 2 * canvas.size)
    assert grey.sum() > 500
    assert is_colour(rgb[grey], plotting.MARGIN).all()
    assert is_colour(rgb[reach > radius + 2 * canvas.size], "white").all()


def test_outside_of_boundary_and_bounds_is_shaded_over_what_lies_there() -> None:
    triangle = np.array([[1.0, 0.5], [9.0, 0.5], [5.0, 5.5]])
    world = World("triangle", (0, 0, 10, 6), (Disc((1.0, 5.0), 0.8), Disc((5.0, 2.0), 0.5)), boundary=Polygon(triangle))
    canvas = Canvas((-0.2, -0.2, 10.2, 6.2))
    plotting.draw_world(canvas.axes, world)
    rgb, x, y = canvas.pixels()
    points, region = shapely.points(x, y), shapely.Polygon(triangle)
    far = shapely.distance(points, region.exterior) > 0.1
    outside, inside = far & ~shapely.contains(region, points), far & shapely.contains(region, points)
    assert not is_colour(rgb[outside], "white").any()
    assert not is_colour(rgb[outside], plotting.OBSTACLE).any()
    assert is_colour(rgb[inside], "white").any()
    assert is_colour(rgb[inside], plotting.OBSTACLE).any()


def test_path_robot_and_ends_are_visible() -> None:
    canvas = Canvas(ROOM.bounds)
    plotting.draw_world(canvas.axes, ROOM, CAR)
    plotting.draw_plan(canvas.axes, CAR, PATH, ROADMAP)
    rgb, x, y = canvas.pixels()
    points = shapely.points(x, y)
    on_path = shapely.distance(points, shapely.LineString(PATH.states[:, :2])) < canvas.size / 2
    ends = shapely.MultiPoint([START[:2], GOAL[:2]])
    between = on_path & (shapely.distance(points, ends) > 0.6)
    assert between.sum() > 200
    assert is_colour(rgb[between], plotting.PATH, 0.1).all()
    for end, colour in ((START, plotting.START), (GOAL, plotting.GOAL)):
        near = shapely.distance(points, shapely.Point(end[:2])) < 1.2 * canvas.size
        assert is_colour(rgb[near], colour, 0.1).all()
    # The goal's footprint stands upright: 0.4 m wide, 0.8 m high.
    tinted = (np.abs(rgb - 1.0).max(axis=-1) > 0.2) & (np.hypot(x - GOAL[0], y - GOAL[1]) < 0.5)
    assert np.ptp(y[tinted]) > 0.75
    beside = (np.abs(x - GOAL[0]) > 0.3) & (np.abs(y - GOAL[1] - 0.3) < 0.1) & (np.abs(x - GOAL[0]) < 0.45)
    assert is_colour(rgb[beside], "white").all()


def test_empty_roadmap_and_single_state_path_can_be_drawn() -> None:
    canvas = Canvas(ROOM.bounds)
    plotting.draw_plan(canvas.axes, CAR, Path(np.array([START])), roadmap_of([], []))
    assert is_colour(canvas.pixels()[0], plotting.GOAL).any()


@pytest.mark.parametrize("suffix", plotting.PICTURE_SUFFIXES)
def test_the_same_plan_gives_the_same_bytes(tmp_path: FilePath, suffix: str) -> None:
    files = [tmp_path / f"{name}{suffix}" for name in "ab"]
    for file in files:
        plotting.save_plan_figure(file, ROOM, CAR, result_of(PATH), ROADMAP, START, GOAL, "round")
    first, second = (file.read_bytes() for file in files)
    assert first == second
    assert first.startswith({".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"}[suffix])
    assert b"<dc:date>" not in first
    assert b"CreationDate" not in first
    assert sorted(tmp_path.iterdir()) == files


def test_via_points_and_route_graphs_are_drawn_and_named(tmp_path: FilePath) -> None:
    legs = tuple(result_of(Path(PATH.states[i : i + 2])) for i in range(3))
    through, graph = replace(result_of(PATH), legs=legs), nx.DiGraph([(0, 1)])
    nx.set_node_attributes(graph, {0: (2.0, 5.5), 1: (8.0, 5.5)}, "position")
    for name, plan, route in (("plain", result_of(PATH), None), ("both", through, graph)):
        for kind in ("png", "svg"):
            plotting.save_plan_figure(tmp_path / f"{name}.{kind}", ROOM, CAR, plan, None, START, GOAL, route=route)
    for label in ("via point", "route graph"):
        named = [f"<!-- {label} -->" in (tmp_path / f"{name}.svg").read_text() for name in ("plain", "both")]
        assert named == [False, True]
    ink = {}
    for name in ("plain", "both"):
        rgb, counts = colours_of(tmp_path / f"{name}.png")
        ink[name] = [counts[is_colour(rgb, colour)].sum() for colour in (plotting.PATH, plotting.LANDMARK)]
    assert ink["both"][0] > ink["plain"][0] + 2 * 40  # two diamonds
    assert ink["both"][1] > ink["plain"][1] + 300  # 6 m of a line


@pytest.mark.parametrize("status", ["timeout", "infeasible"])
def test_without_a_path_the_picture_shows_the_roadmap(tmp_path: FilePath, status: str) -> None:
    plotting.save_plan_figure(tmp_path / "none.png", ROOM, CAR, result_of(None, status), ROADMAP, START, GOAL)
    rgb, counts = colours_of(tmp_path / "none.png")
    for colour in (plotting.LANDMARK, plotting.START, plotting.GOAL, plotting.OBSTACLE, plotting.MARGIN):
        assert counts[is_colour(rgb, colour)].sum() > 20
    assert counts[is_colour(rgb, plotting.PATH)].sum() < 5


def test_names_are_not_taken_for_formulas_and_other_suffixes_are_refused(tmp_path: FilePath) -> None:
    world = World("cost_$5$ ^{ \\frac", ROOM.bounds, queries=(Query("$", START, GOAL),))
    plotting.save_world_figure(tmp_path / "name.png", world)
    assert (tmp_path / "name.png").stat().st_size > 1000
    for name in ("plan.bmp", "plan", "plan.png.gz"):
        with pytest.raises(OutputError, match=r"expected \.png, \.svg, \.pdf"):
            plotting.save_world_figure(tmp_path / name, ROOM)
    assert [file.name for file in tmp_path.iterdir()] == ["name.png"]


def test_no_global_state_of_pyplot() -> None:
    program = "import sys, trailmark.plotting; sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], timeout=300.0, check=False).returncode == 0


def test_the_path_drawn_is_the_curve() -> None:
    drawn = Figure().add_subplot()
    path = CurvePath(np.array([(3.0, 3.0, 0.0), (10.0, 12.0, 3.0), (16.0, 5.0, -1.5)]), Steering(2.0))
    draw_plan(drawn, Robot.rectangle(2.0, 1.0).steered(2.0), path)
    (line,) = [line for line in drawn.lines if line.get_label() == "path"]
    x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    assert np.hypot(np.diff(x), np.diff(y)).sum() > 0.999 * path.length
    where = path.at(np.linspace(0.0, 1.0, 500))[:, :2]
    gaps = np.hypot(where[:, None, 0] - x, where[:, None, 1] - y).min(axis=1)
    assert np.quantile(gaps, 0.3) < 0.1


WORLD_AUDIT = World("room", (0.0, 0.0, 10.0, 6.0), (Disc((5, 3), 1.0),), Robot.rectangle(0.8, 0.4))
ROBOT = Robot.rectangle(0.8, 0.4)


def share(file: FilePath, colour: str) -> float:
    """Return the share of a picture's pixels that have a colour."""
    rgb, counts = colours_of(file)
    return float(counts[is_colour(rgb, colour, 0.02)].sum() / counts.sum())


def test_what_collides_is_red_and_a_repaired_path_is_drawn(tmp_path: FilePath) -> None:
    file = tmp_path / "a.png"
    for states in ([[1, 3, 0], [9, 3, 0]], [[5, 4.3, 0], [5, 4.3, 3.0]]):  # through, and a turn in place
        repaired = Path(np.array([[1, 3, 0], [5, 5, 0], [9, 3, 0.0]]))
        save_audit_figure(file, WORLD_AUDIT, ROBOT, check_path(WORLD_AUDIT, ROBOT, states), repaired)
        assert share(file, COLLISION) > 0.0005
        assert share(file, REPAIRED) > 0.001
    save_audit_figure(file, WORLD_AUDIT, ROBOT, check_path(WORLD_AUDIT, ROBOT, [[1, 1, 0], [9, 1, 0]]))
    assert share(file, COLLISION) == 0.0


@pytest.mark.parametrize("velocity", [(1.0, 0.3), (0.0, 0.0)])
def test_a_moving_obstacle_has_an_arrow(tmp_path: FilePath, velocity: tuple[float, float]) -> None:
    still, moving = tmp_path / "still.png", tmp_path / "moving.png"
    motion = Moving(Rectangle((2, 2), 1.5, 1), velocity, 4.0)
    world = World("room", (0.0, 0.0, 10.0, 6.0), (motion,))  # type: ignore[arg-type]  # worlds take moving ones apart
    save_world_figure(moving, world)
    save_world_figure(still, World("room", (0.0, 0.0, 10.0, 6.0), world.obstacles))
    assert 0.0 < share(moving, OBSTACLE) < share(still, OBSTACLE)


def square(x: float, y: float, side: float = 3.0) -> Polygon:
    return Polygon(np.array([[x, y], [x + side, y], [x + side, y + side], [x, y + side]]))


ZONES: tuple[Zone, ...] = (
    CostZone(square(1, 1), 3.0),
    CostZone(square(6, 1), 0.5),
    KeepOutZone(square(11, 1)),
    OneWayZone(square(1, 6), math.pi / 2, 0.5),
    SpeedZone(square(6, 6), 0.25),
    SpeedZone(square(100, 100), 0.5),  # beyond the picture
    SpeedZone(square(11, 6, 0.01), 0.5),  # too small for a text
)


def test_zones_are_drawn_where_they_are() -> None:
    figure = Figure(figsize=(8.0, 5.0), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_world(axes, World("w", (0.0, 0.0, 16.0, 10.0), zones=ZONES))
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[::-1, :, :3] / 255.0

    def colours(x: float, y: float) -> np.ndarray:
        left, low = axes.transData.transform((x, y)).astype(int)
        return pixels[low : low + 40, left : left + 40].reshape(-1, 3)

    assert (colours(4.3, 4.3) == 1.0).all()  # nothing is there
    avoid, prefer = np.median(colours(1.2, 1.2), axis=0), np.median(colours(6.2, 1.2), axis=0)
    assert avoid[0] > avoid[1] > avoid[2]  # orange
    assert prefer[1] > prefer[0]  # green
    red = colours(11.2, 1.2)
    assert 0.05 < ((red[:, 0] > 0.6) & (red[:, 1] < 0.4)).mean() < 0.6  # hatched
    assert (colours(1.2, 6.2) != 1.0).any(axis=1).all()
    assert (colours(6.2, 6.2) != 1.0).any(axis=1).all()
    _, labels = axes.get_legend_handles_labels()
    assert set(labels) >= {"keep-out zone", "one-way zone", "speed zone", "avoid (cost zone)", "prefer (cost zone)"}
    assert sorted(text.get_text() for text in axes.texts) == ["", "× 0.5", "× 3", "≤ 0.25 m/s"]
