"""Pictures at a prompt and in notebooks: what the ``plot`` methods of worlds, robots, roadmaps and results draw."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from trailmark.errors import ConfigurationError
from trailmark.plotting.canvas import annotate, figure_of, set_limits
from trailmark.plotting.plan import draw_plan, plan_facts
from trailmark.plotting.world import draw_end, draw_queries, draw_world, world_facts
from trailmark.shown import PATH, Layers
from trailmark.world import Robot, World

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.roadmap import Roadmap
    from trailmark.trajectories import Path

__all__ = ["Scene", "plot", "png_of", "scene_of"]

NOTEBOOK_DPI = 96


class Scene(NamedTuple):
    """What a picture is of; None for what there is not."""

    title: str
    facts: str
    world: World | None = None  # None for a robot on its own
    robot: Robot | None = None
    roadmap: Roadmap | None = None
    path: Path | None = None
    start: tuple[float, float, float] | None = None
    goal: Any = None  # configuration or goals
    queries: bool = False  # whether the world's queries belong to it


def scene_of(shown: object, robot: Robot | None = None, roadmap: Roadmap | None = None) -> Scene:
    """Return the picture of a world, a robot, a roadmap or a result.

    Args:
        shown: what is shown.
        robot: in the place of its own.
        roadmap: shown as well.

    Raises:
        ConfigurationError: something else, or a result that does not know its world and robot.
    """
    if isinstance(shown, Robot):
        return Scene("robot", shown.describe(), robot=shown)
    if isinstance(shown, World):
        body = robot or shown.robot
        return Scene(shown.name, world_facts(shown), shown, body, roadmap, queries=True)
    # Later, since these bring in all that plans.
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap

    if isinstance(shown, Roadmap):
        world, body = shown.checker.world, robot or shown.checker.robot
        facts = f"{len(shown):,} landmarks · {len(shown.edges):,} edges · {body.describe()}"
        return Scene(world.name, facts, world, body, shown)
    if not isinstance(shown, PlanResult) or shown.world is None or shown.robot is None:
        raise ConfigurationError(f"picture: expected a result that knows its world and robot, got {shown!r:.80}")
    body = robot or shown.robot
    facts = plan_facts(shown, body)
    return Scene(shown.world.name, facts, shown.world, body, roadmap, shown.path, shown.start, shown.target)


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
