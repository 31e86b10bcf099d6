"""Animations of drives through a changing world, as GIF."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray

from trailmark.errors import OutputError
from trailmark.plotting.canvas import annotate, figure_of, picture_of
from trailmark.plotting.world import draw_end, draw_robots, draw_world
from trailmark.shown import GOAL, PATH

if TYPE_CHECKING:
    from PIL.Image import Image

    from trailmark.se2 import FloatArray
    from trailmark.trajectories import Path, Trajectory
    from trailmark.world import Robot, World

__all__ = ["Frame", "save_animation", "save_trajectory_animation", "write_gif"]

FRAME_SECONDS, MAX_FRAMES = 0.1, 150
"""Of a drive along a trajectory: how long a frame is shown; a longer drive is shown faster than it is."""

_DPI = 80

LEGEND_ROOM = 1.6
"""Inches that an animation's legend gets (:func:`trailmark.plotting.canvas.figure_of`)."""


class Frame(NamedTuple):
    """One moment of a drive.

    Attributes:
        world: as it is then.
        robot_at: where the robot is, shape (3,).
        path: that it follows; None if it has none.
        note: a few words on what happened.
    """

    world: World
    robot_at: FloatArray
    path: Path | None
    note: str = ""


def save_animation(
    file: str | FilePath, frames: Iterable[Frame], robot: Robot, goal: FloatArray | None = None, *, seconds: float = 0.1
) -> None:
    """Write an animation, whole or not at all, that begins again at its end.

    Args:
        file: a ``.gif``.
        frames: at least one; worlds of the same bounds.
        robot: that drives.
        goal: marked in all frames, shape (3,).
        seconds: that each frame is shown.

    Raises:
        OutputError: another suffix, no frame, a file that cannot be written, or one that a world was read from.
    """
    from PIL import Image

    pictures, target = [], gif_of(None, file)
    for frame in frames:
        gif_of(frame.world, file)
        pictures.append(Image.fromarray(_drawn(frame, robot, goal)).convert("P", palette=Image.Palette.ADAPTIVE))
    if not pictures:
        raise OutputError(f"{file}: expected at least one frame, got none")
    write_gif(target, pictures, seconds)


def gif_of(world: World | None, file: str | FilePath) -> FilePath:
    """Return the file for an animation in a world.

    Raises:
        OutputError: another suffix than ``.gif``, or a file that the world was read from.
    """
    path = FilePath(file)
    if path.suffix.lower() != ".gif":
        raise OutputError(f"{file}: expected a file that ends in .gif, got {path.suffix or 'no suffix'}")
    return path if world is None else picture_of(world, path)


def save_trajectory_animation(file: str | FilePath, trajectory: Trajectory, world: World, robot: Robot) -> None:
    """Write a robot's drive along a trajectory as a GIF, whole or not at all.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    count = int(np.clip(np.ceil(trajectory.duration / FRAME_SECONDS), 1, MAX_FRAMES)) + 1
    t = np.linspace(0.0, trajectory.duration, count)
    speed = np.hypot(*trajectory.velocity(t)[:, :2].T)
    frames = (
        Frame(world, q, trajectory.path, f"{now:.1f} s, {pace:.2f} m/s")
        for now, q, pace in zip(t, trajectory.at(t), speed, strict=True)
    )
    save_animation(file, frames, robot, trajectory.path.states[-1], seconds=FRAME_SECONDS)


def write_gif(file: FilePath, pictures: Sequence[Image], seconds: float) -> None:
    """Write pictures, at least one, as a GIF that begins again at its end; each is shown so many seconds."""
    from trailmark.formats.files import write_atomically

    data = io.BytesIO()
    duration = max(20, round(1000.0 * seconds))
    first, *others = pictures
    shown = {"duration": duration, "loop": 0, "disposal": 1, "optimize": False}
    first.save(data, "GIF", save_all=True, append_images=others, **shown)
    write_atomically(file, data.getvalue())


def _drawn(frame: Frame, robot: Robot, goal: FloatArray | None) -> NDArray[np.uint8]:
    """Return a frame's picture, shape (height, width, 3)."""
    figure, axes = figure_of(frame.world, room=LEGEND_ROOM)
    figure.set_dpi(_DPI)
    draw_world(axes, frame.world)
    if goal is not None:
        draw_end(axes, robot, goal, GOAL, "s", "goal")
    if frame.path is not None:
        axes.plot(*frame.path.states[:, :2].T, color=PATH, lw=2.0, zorder=6.0, solid_joinstyle="round", label="path")
    draw_robots(axes, robot, [frame.robot_at], PATH, "white", 1.0, 7.0, label="robot")
    annotate(figure, axes, frame.world.name, frame.note)
    canvas: Any = FigureCanvasAgg(figure)  # whose methods have no types
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
