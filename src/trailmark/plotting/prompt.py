"""Pictures at a prompt and in notebooks: what the ``plot`` methods of worlds, robots, roadmaps and results draw."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from trailmark.plotting.canvas import annotate, figure_of, set_limits
from trailmark.plotting.plan import draw_plan
from trailmark.plotting.world import draw_end, draw_queries, draw_world
from trailmark.shown import PATH, Layers
from trailmark.world import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.plotting.canvas import Scene

__all__ = ["plot", "png_of"]

NOTEBOOK_DPI = 96


def plot(scene: Scene, ax: Axes | None, layers: Mapping[str, bool]) -> Axes:
    """Draw a scene and return the axes; :meth:`trailmark.shown.Shown.plot` describes the arguments."""
    shown, robot, world = Layers.of(layers), scene.robot, scene_world(scene)
    axes = ax
    if axes is None:
        from matplotlib import pyplot

        axes = figure_of(world, pyplot.figure)[1]
    if scene.world is None and robot is not None:
        set_limits(axes, world)
        draw_end(axes, robot, np.zeros(3), PATH, "o", "robot")
    else:
        draw_world(axes, world, robot, shown)
        if scene.queries and shown.queries:
            draw_queries(axes, world)
    if robot is not None:
        draw_plan(axes, robot, scene.path, scene.roadmap, scene.start, scene.goal, shown)
    if ax is None and isinstance(figure := axes.get_figure(root=True), Figure):
        annotate(figure, axes, scene.title, scene.facts)
    return axes


def png_of(scene: Scene) -> bytes:
    """Return a scene as a PNG, as notebooks show it."""
    figure, axes = figure_of(scene_world(scene))
    plot(scene, axes, {})
    annotate(figure, axes, scene.title, scene.facts)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=NOTEBOOK_DPI, bbox_inches="tight")
    return buffer.getvalue()


def scene_world(scene: Scene) -> World:
    """Return the world that a scene shows; for a robot on its own, an empty one around it."""
    if scene.world is not None:
        return scene.world
    assert scene.robot is not None  # noqa: S101  # a scene has a world or a robot
    reach = 1.2 * scene.robot.circumradius
    return World("robot", (-reach, -reach, reach, reach))
