"""Pictures at a prompt and in notebooks: what the ``plot`` methods of worlds, robots, roadmaps and results draw."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from trailmark.layers import Layers
from trailmark.plotting.canvas import annotate, figure_of, set_limits
from trailmark.plotting.plan import draw_plan
from trailmark.plotting.world import draw_end, draw_queries, draw_world
from trailmark.sketch.colours import PATH
from trailmark.world import World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.sketch import Scene

__all__ = ["plot"]


def plot(scene: Scene, ax: Axes | None, layers: Mapping[str, bool]) -> Axes:
    """Draw a scene and return the axes; :meth:`trailmark.shown.Shown.plot` describes the arguments."""
    shown, robot, world = Layers.of(layers), scene.robot, scene.world
    if world is None:
        assert robot is not None  # noqa: S101  # a scene has a world or a robot
        reach = 1.2 * robot.circumradius
        world = World("robot", (-reach, -reach, reach, reach))
    axes = ax
    if axes is None:
        from matplotlib import pyplot

        axes = figure_of(world, pyplot.figure)[1]
    if scene.world is None:
        set_limits(axes, world)
        draw_end(axes, robot, np.zeros(3), PATH, "o", "robot")
    else:
        draw_world(axes, world, robot, shown)
        if scene.queries and shown.queries:
            draw_queries(axes, world)
    if robot is not None:
        draw_plan(axes, robot, scene.path, scene.roadmap, scene.start, scene.goal, shown)
    figure = axes.get_figure(root=True)
    if ax is None and figure is not None:
        annotate(figure, axes, scene.title, scene.facts)
    return axes
