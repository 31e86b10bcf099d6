"""Pictures of plans: a roadmap, a path with the robot along it, the two ends."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from trailmark import se2
from trailmark.colours import BODY, CANDIDATE, EDGE, GOAL, LANDMARK, PATH, START
from trailmark.goals import goals_of
from trailmark.layers import ALL, Layers
from trailmark.plotting.canvas import annotate, draw_lines, figure_of, picture_of, points_per_metre, write
from trailmark.plotting.progress import add_progress
from trailmark.plotting.scene import plan_facts
from trailmark.plotting.world import draw_end, draw_goal, draw_world

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from trailmark.goals import Goal
    from trailmark.path import Path
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap
    from trailmark.world import Robot, World

__all__ = ["draw_plan", "save_plan_figure"]


_MANY_LANDMARKS = 2_000
"""From here on ticks along their headings would be noise."""


def draw_plan(
    axes: Axes,
    robot: Robot,
    path: Path | None = None,
    roadmap: Roadmap | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | tuple[Goal, ...] | None = None,
    layers: Layers = ALL,
) -> None:
    """Draw a roadmap, a path with the robot along it, and the two ends, on axes whose limits are set.

    Args:
        axes: what to draw on, usually after :func:`draw_world`.
        robot: its footprint is drawn along the path and at the ends.
        path: drawn from its first to its last state.
        roadmap: edges thin, certified ones stronger; landmarks with a tick along the heading (none for a disc).
        start: configuration, shape (3,); default: the path's first state.
        goal: configuration, shape (3,), or goals; default: the path's last state.
        layers: what to show.
    """
    if roadmap is not None and len(roadmap.configurations):
        _draw_roadmap(axes, robot, roadmap, layers)
    if path is not None:
        _draw_path(axes, robot, path, layers)
    if not layers.ends:
        return
    if path is not None:
        start = path.states[0] if start is None else start
    goals = goals_of(goal)
    if goals is not None:
        for each in goals:
            draw_goal(axes, robot, each, path.states[-1] if path is not None else np.asarray(start))
        goal = None
    if path is not None and goal is None:
        goal = path.states[-1]
    for q, colour, marker, label in ((start, START, "o", "start"), (goal, GOAL, "s", "goal")):
        if q is not None:
            draw_end(axes, robot, np.asarray(q, dtype=np.float64), colour, marker, label)


def save_plan_figure(
    file: str | FilePath,
    world: World,
    robot: Robot,
    result: PlanResult,
    roadmap: Roadmap | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | tuple[Goal, ...] | None = None,
    query: str | None = None,
    layers: Layers = ALL,
) -> None:
    """Write a picture of a plan, with its cost over time; without a path it shows the roadmap, which tells why.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``; the same input gives the same bytes (SVG, PDF: no date).
        world: what was planned in.
        robot: what was planned for.
        result: status, path, times, history and lower bound.
        roadmap: left out if None.
        start: configuration, shape (3,).
        goal: configuration, shape (3,), or goals.
        query: its name, for the title.
        layers: what to show.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    figure, axes = figure_of(world)
    draw_world(axes, world, robot, layers)
    draw_plan(axes, robot, result.path, roadmap, start, goal, layers)
    annotate(figure, axes, world.name if query is None else f"{world.name} · {query}", plan_facts(result, robot))
    if layers.progress:
        add_progress(figure, axes, result.history, result.time.get("total") or 0.0, result.lower_bound)
    write(figure, picture_of(world, file))


def _draw_roadmap(axes: Axes, robot: Robot, roadmap: Roadmap, layers: Layers) -> None:
    from trailmark.collision.kernels import BLOCKED

    at, status = roadmap.configurations, roadmap.status
    # Edges that are not checked yet may run through obstacles, which therefore lie over them.
    for chosen, style, label in (
        (~roadmap.certified & (status != BLOCKED), (CANDIDATE, 0.5, 1.2), "edge, not checked"),
        (roadmap.certified, (EDGE, 0.8, 3.0), "edge, certified"),
    ):
        edges = roadmap.edges[chosen]
        if layers.edges and len(edges):
            draw_lines(axes, roadmap.motion.lines(at[edges[:, 0]], at[edges[:, 1]]), *style)
            axes.plot([], [], color=style[0], lw=1.5, label=label)
    if not layers.landmarks:
        return
    axes.plot([], [], "o", ms=3.0, mew=0, color=LANDMARK, label="landmark")
    size = min(3.0, max(0.8, 3.0 * math.sqrt(400 / len(at))))
    axes.plot(*at[:, :2].T, "o", ms=size, mew=0, color=LANDMARK, zorder=4.0)
    crowded = len(at) > _MANY_LANDMARKS
    if not crowded and (robot.sweep_radius > 0.0 or robot.turning_radius is not None):
        tick = 2.2 * size / points_per_metre(axes)
        tips = at[:, :2] + tick * np.column_stack([np.cos(at[:, 2]), np.sin(at[:, 2])])
        draw_lines(axes, np.stack([at[:, :2], tips], axis=1), LANDMARK, 0.3 * size, 4.0)


def _draw_path(axes: Axes, robot: Robot, path: Path, layers: Layers) -> None:
    # By cost, so that the robot also shows where it turns in place; some dozens at most.
    n = min(48, max(8, math.ceil(path.cost / (2.0 * robot.circumradius)))) + 1
    shown = se2.transform(path.at(np.linspace(0.0, 1.0, n)), robot.outline.vertices)
    robots = PolyCollection(list(shown), facecolors=(*to_rgb(BODY), 0.7), edgecolors=PATH)
    robots.set(linewidths=0.6, zorder=5.0, label="robot along the path")
    if layers.footprints:
        axes.add_collection(robots, autolim=False)
    if not layers.path:
        return
    xy = path.states[:, :2]
    axes.plot(*xy.T, color="white", lw=3.6, alpha=0.9, zorder=6.0, solid_joinstyle="round")
    axes.plot(*xy.T, color=PATH, lw=2.0, zorder=6.1, solid_joinstyle="round", label="path")
