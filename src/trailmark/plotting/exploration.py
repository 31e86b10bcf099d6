"""An exploration as a picture, and as an animation of how the map became known."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from trailmark import se2
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN
from trailmark.exploration.result import landmarks_of
from trailmark.plotting.animation import LEGEND_ROOM, gif_of, write_gif
from trailmark.plotting.canvas import (
    annotate,
    draw_note,
    figure_of,
    picture_of,
    points_per_metre,
    set_limits,
    show_image,
    write,
)
from trailmark.plotting.world import HALO, draw_end
from trailmark.shown import GOAL, LANDMARK, MARGIN, OBSTACLE, PATH, START, TEXT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.exploration.result import ExplorationResult

__all__ = ["coarse", "draw_exploration", "save_exploration_animation", "save_exploration_figure"]

TIME_COLOURS = "viridis_r"
"""Late is dark: what was driven last is drawn on top, and is seen on it."""

MAX_FRAMES, FRAME_SECONDS, LAST_FRAMES = 110, 0.11, 14
"""Of an animation: 12 s of drive, and its end for another 1.5 s."""

NUMBER_ROOM = np.array([15.0, 9.0])
"""Points that the numbers of two landmarks are apart, along x or along y."""

DPI, MAX_CELLS, COLOURS = 80, 150_000, 250
"""Of an animation: about a cell for two pixels, and what a GIF can hold beside three colours of ours."""

MARK: dict[str, Any] = {"color": LANDMARK, "marker": "o", "ls": "none", "ms": 5.0, "mec": "white", "mew": 0.8}
"""Of a landmark."""


def save_exploration_figure(file: str | FilePath, result: ExplorationResult) -> None:
    """Write a picture of what an exploration found, and of the robot's way.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``; the same input gives the same bytes.
        result: of :meth:`trailmark.exploration.Explorer.run`.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    figure, axes = figure_of(result.world)
    draw_exploration(axes, result)
    last = result.history[-1]
    facts = [result.status, f"{last.area:,.1f} m² known", f"{last.distance:,.1f} m driven in {last.time:,.0f} s"]
    facts.append(f"{_plural(last.landmarks)} ({result.strategy})")
    facts += [] if result.evaluation is None else [f"{result.evaluation.seen:.1%} seen"]
    annotate(figure, axes, result.world.name, " · ".join(facts))
    write(figure, picture_of(result.world, file))


def draw_exploration(axes: Axes, result: ExplorationResult) -> None:
    """Draw the cells, the robot's way coloured by time, and its landmarks; sets limits and an equal aspect."""
    set_limits(axes, result.world)
    history, known, landmarks = result.history, result.known, landmarks_of(result.history)
    show_image(axes, picture_of_cells(known.state), known.origin, known.cell, interpolation="nearest", zorder=0.5)
    _name_cells(axes)
    way, time = np.array([row.pose[:2] for row in history]), np.array([row.time for row in history])
    pieces = LineCollection(list(np.stack([way[:-1], way[1:]], axis=1)), array=time[:-1], cmap=TIME_COLOURS)
    pieces.set(linewidths=1.6, zorder=4.0, capstyle="round")
    pieces.set_clim(time[0], max(time[-1], time[0] + 1e-9))
    axes.add_collection(pieces, autolim=False)
    bar = axes.inset_axes((1.03, 0.0, 0.02, 0.45))
    axes.figure.colorbar(pieces, cax=bar).outline.set_visible(False)
    bar.tick_params(labelsize=7, color=TEXT, labelcolor=TEXT)
    bar.set_title("time [s]", fontsize=7, color=TEXT, loc="left")
    axes.plot(*landmarks[:, :2].T, zorder=6.0, label="landmarks, in their order", **MARK)
    _number_landmarks(axes, landmarks)
    draw_end(axes, result.world.robot, history[0].pose, START, "o", "start")
    draw_end(axes, result.world.robot, history[-1].pose, GOAL, "s", "end")


def _name_cells(axes: Axes) -> None:
    """Add what the colours of cells mean to the legend."""
    for face, edge, label in ((OBSTACLE, OBSTACLE, "occupied"), ("white", MARGIN, "free"), (MARGIN, MARGIN, "unknown")):
        axes.plot([], [], "s", ms=8.0, color=face, mec=edge, zorder=0.5, label=label)


def picture_of_cells(state: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the colours of cells, shape (rows, columns, 3)."""
    colours = np.zeros((3, 3))
    for kind, colour in ((UNKNOWN, MARGIN), (FREE, "#ffffff"), (OCCUPIED, OBSTACLE)):
        colours[kind] = to_rgb(colour)
    return np.asarray(np.rint(255.0 * colours)).astype(np.uint8)[state]


def coarse(
    state: NDArray[np.uint8], first: NDArray[np.float32], cell: float, limit: int
) -> tuple[NDArray[np.uint8], NDArray[np.float32], float]:
    """Return a grid of at most about ``limit`` cells, and their side: squares of cells, where there are more.

    A square is occupied if one of its cells is, else free if one is, and is known from the first of them on.
    """
    size = int(np.ceil(np.sqrt(state.size / limit)))
    if size == 1:
        return state, first, cell
    rows, columns = (-(-n // size) for n in state.shape)
    pad = [(0, rows * size - state.shape[0]), (0, columns * size - state.shape[1])]
    blocks = (rows, size, columns, size)
    # FREE is above UNKNOWN, and OCCUPIED above FREE.
    found = np.pad(state, pad, constant_values=UNKNOWN).reshape(blocks).max(axis=(1, 3))
    times = np.pad(first, pad, constant_values=np.inf).reshape(blocks).min(axis=(1, 3))
    return found, times, size * cell


def _number_landmarks(axes: Axes, landmarks: se2.FloatArray) -> None:
    """Write their numbers beside landmarks, shape (k, 3), where there is room."""
    numbered, room = list[int](), NUMBER_ROOM / points_per_metre(axes)
    for i, at in enumerate(landmarks[:, :2]):
        if (np.abs(landmarks[numbered, :2] - at) < room).all(axis=1).any():
            continue
        note = axes.annotate(str(i + 1), at, xytext=(4, 3), textcoords="offset points", zorder=9.0)
        note.set(fontsize=7, color=LANDMARK, path_effects=HALO)
        numbered.append(i)


def save_exploration_animation(file: str | FilePath, result: ExplorationResult) -> None:
    """Write a GIF: the map as it became known, the robot, where it drives to and along which path.

    Cells are shown as they were at the end, from the time on at which they were known first.

    Raises:
        OutputError: another suffix than ``.gif``, or a file that cannot be written.
    """
    from PIL import Image

    target = gif_of(result.world, file)
    rows = np.unique(np.linspace(0, len(result.history) - 1, MAX_FRAMES).astype(int))
    film = _Film(result)
    last = Image.fromarray(film.drawn(int(rows[-1])))
    palette = last.quantize(COLOURS, dither=Image.Dither.NONE)
    # Of what is small, or not in the last frame, the colours would be some others.
    own = [round(255.0 * part) for colour in (GOAL, PATH, LANDMARK) for part in to_rgb(colour)]
    palette.putpalette([*(palette.getpalette() or [])[: 3 * COLOURS], *own])
    pictures = [
        Image.fromarray(film.drawn(row)).quantize(palette=palette, dither=Image.Dither.NONE) for row in rows.tolist()
    ]
    write_gif(target, [*pictures, *[pictures[-1]] * LAST_FRAMES], FRAME_SECONDS)


class _Film:
    """The figure of an animation, of which each frame draws only what moves."""

    def __init__(self, result: ExplorationResult) -> None:
        self.result, known = result, result.known
        self.driven = np.array([row.pose[:2] for row in result.history])
        state, self.first_known, cell = coarse(known.state, result.first_known, known.cell, MAX_CELLS)
        self.cells, self.unknown = picture_of_cells(state), picture_of_cells(np.full_like(state, UNKNOWN))
        figure, axes = figure_of(result.world, room=LEGEND_ROOM)
        figure.set_dpi(DPI)
        canvas: Any = FigureCanvasAgg(figure)  # whose methods have no types
        self.canvas, self.axes = canvas, axes
        set_limits(axes, result.world)
        self.image = show_image(axes, self.unknown, known.origin, cell, interpolation="nearest")
        (self.way,) = axes.plot([], [], color=PATH, lw=1.2, alpha=0.6, label="driven")
        (self.path,) = axes.plot([], [], color=GOAL, lw=1.6, ls=(0, (4, 2)), label="path")
        (self.target,) = axes.plot([], [], "o", color=GOAL, ms=7.0, mec="white", mew=1.0, label="next landmark")
        (self.marks,) = axes.plot([], [], label="landmarks", **MARK)
        self.landmarks = landmarks_of(result.history)
        self.body = PolyCollection([], facecolors=PATH, edgecolors="white", label="robot")
        axes.add_collection(self.body, autolim=False)
        _name_cells(axes)
        annotate(figure, axes, result.world.name, "")
        self.note = draw_note(axes, "", 6)
        self.note.set(fontsize=9)
        canvas.draw()
        self.empty = canvas.copy_from_bbox(figure.bbox)

    def drawn(self, i: int) -> NDArray[np.uint8]:
        """Return the picture of a row of the history, shape (height, width, 3)."""
        row, robot = self.result.history[i], self.result.world.robot
        nothing = np.empty((2, 0))
        known = self.first_known <= np.float32(row.time)
        self.image.set_data(np.where(known[..., None], self.cells, self.unknown))
        self.way.set_data(*self.driven[: i + 1].T)
        self.path.set_data(*(nothing if row.path is None else row.path[:, :2].T))
        self.target.set_data(*(nothing if row.target is None else row.target[:2, None]))
        self.marks.set_data(*self.landmarks[: row.landmarks, :2].T)
        self.body.set_verts([] if robot is None else [se2.transform(row.pose, robot.outline.vertices)])
        facts = f"{row.time:.0f} s   {row.area:.0f} m² known   {row.distance:.1f} m driven"
        self.note.set_text(f"{facts}   {_plural(row.landmarks)}")
        self.canvas.restore_region(self.empty)
        for artist in (self.image, self.way, self.path, self.marks, self.target, self.body, self.note):
            self.axes.draw_artist(artist)
        return np.asarray(self.canvas.buffer_rgba())[..., :3].copy()


def _plural(landmarks: int) -> str:
    return f"{landmarks} landmark{'' if landmarks == 1 else 's'}"
