"""Pictures of plans: a roadmap, a path with the robot along it, the two ends, the cost over time; and of audits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from trailmark import se2
from trailmark.plotting.canvas import annotate, draw_lines, figure_of, picture_of, points_per_metre, tidy, write
from trailmark.plotting.world import draw_end, draw_goal, draw_robots, draw_world
from trailmark.shown import (
    ALL,
    AVOID,
    BODY,
    CANDIDATE,
    COLLISION,
    EDGE,
    GOAL,
    LANDMARK,
    PATH,
    REPAIRED,
    START,
    TEXT,
    Layers,
)
from trailmark.verify.motions import Motions, merged
from trailmark.world.goals import goals_of

if TYPE_CHECKING:
    import networkx as nx
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap
    from trailmark.trajectories import Path
    from trailmark.verify import PathAudit
    from trailmark.world import Robot, World
    from trailmark.world.goals import Goal

__all__ = ["draw_audit", "draw_plan", "draw_progress", "plan_facts", "save_audit_figure", "save_plan_figure"]

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
        goal = path.states[-1] if goal is None else goal
    here = None if start is None else np.asarray(start, dtype=np.float64)
    if here is not None:
        draw_end(axes, robot, here, START, "o", "start")
    if (goals := goals_of(goal)) is not None:
        for each in goals:
            draw_goal(axes, robot, each, np.asarray(here) if path is None else path.states[-1])
    elif goal is not None:
        draw_end(axes, robot, np.asarray(goal, dtype=np.float64), GOAL, "s", "goal")


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
    route: nx.DiGraph | None = None,
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
        route: the route graph that was planned on (:func:`trailmark.read_route_graph`), left out if None.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    figure, axes = figure_of(world)
    draw_world(axes, world, robot, layers)
    if route is not None and layers.edges:
        lines = np.array([[route.nodes[node]["position"] for node in edge] for edge in route.edges])
        draw_lines(axes, lines, LANDMARK, 1.2, 3.0)
        axes.plot([], [], color=LANDMARK, lw=1.2, zorder=3.0, label="route graph")
    draw_plan(axes, robot, result.path, roadmap, start, goal, layers)
    if layers.ends and result.path is not None:
        for leg in result.legs[:-1]:
            x, y = leg.path.states[-1, :2]  # type: ignore[union-attr]  # each leg of a path has one
            axes.plot(x, y, "D", color=PATH, ms=7.0, mec="white", mew=1.0, ls="none", zorder=8.0, label="via point")
    annotate(figure, axes, world.name if query is None else f"{world.name} · {query}", plan_facts(result, robot))
    if layers.progress:
        _add_progress(figure, axes, result.history, result.time.get("total") or 0.0, result.lower_bound)
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
            axes.plot([], [], color=style[0], lw=1.5, zorder=style[2], label=label)
    if not layers.landmarks:
        return
    axes.plot([], [], "o", ms=3.0, mew=0, color=LANDMARK, zorder=4.0, label="landmark")
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
    if layers.footprints:
        poses = path.at(np.linspace(0.0, 1.0, n))
        draw_robots(axes, robot, poses, (*to_rgb(BODY), 0.7), PATH, 0.6, 5.0, label="robot along the path")
    if not layers.path:
        return
    xy = path.states[:, :2]
    axes.plot(*xy.T, color="white", lw=3.6, alpha=0.9, zorder=6.0, solid_joinstyle="round")
    axes.plot(*xy.T, color=PATH, lw=2.0, zorder=6.1, solid_joinstyle="round", label="path")


WIDTH, HEIGHT, BESIDE, BELOW = 2.3, 1.3, 0.75, 0.3  # inches: of the panel, and between it and plan or legend
ROOM = 0.03
"""Share of the costs' range that stays free above and below."""


def draw_progress(axes: Axes, history: Sequence[tuple[float, float]], total: float, bound: float | None = None) -> None:
    """Draw the best path's cost over time, a step for each better path, and the lower bound as a line.

    Args:
        axes: what to draw on; time is on a logarithmic axis.
        history: (seconds, cost in metres) of each better path, one or more, by time; :attr:`PlanResult.history`.
        total: seconds until planning ended.
        bound: metres; left out if None.
    """
    times, costs = np.array(history, dtype=np.float64).T
    end = max(total, times[-1])
    axes.step(1e3 * np.append(times, end), np.append(costs, costs[-1]), where="post", color=PATH, lw=1.4, label="cost")
    axes.plot(1e3 * times, costs, "o", ms=2.6, mew=0, color=PATH)
    if bound is not None:
        axes.axhline(bound, color=AVOID, lw=1.2, ls="--", label="lower bound")
    axes.set_xscale("log")
    axes.set_xlim(1e3 * times[0] / 1.3, 1e3 * end * 1.1)
    # Within few decades their halves and fifths have room, too.
    few = times[-1] < 200.0 * times[0] and end < 200.0 * times[0]
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=5))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ms, _: f"{ms:g}"))
    axes.xaxis.set_minor_locator(NullLocator())
    low, high = min([costs[-1], *([] if bound is None else [bound])]), costs[0]
    room = max(ROOM * (high - low), 1e-3 * high, 1e-9)
    axes.set_ylim(low - 2.0 * room, high + 2.0 * room)
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
    axes.set_xlabel("planning time [ms]")
    axes.set_ylabel("cost")


def _add_progress(
    figure: Figure, plan: Axes, history: Sequence[tuple[float, float]], total: float, bound: float | None
) -> None:
    """Add a small panel with :func:`draw_progress`, if there was progress, beside the plan or below its legend."""
    legend = plan.get_legend()
    if len(history) < 2 or legend is None:  # a chart of one flat line says nothing
        return
    box, entries = (part.get_window_extent() for part in (plan, legend))
    under = entries.y0 - figure.dpi * (BELOW + HEIGHT)
    if entries.y1 <= box.y0:  # the legend lies below the plan, and the panel below both
        at = (box.x0, under, box.width)
    else:  # beside the plan, at its foot if the legend leaves room there
        at = (box.x1 + figure.dpi * BESIDE, min(box.y0, under), figure.dpi * WIDTH)
    corners = figure.transFigure.inverted().transform([at[:2], (at[0] + at[2], at[1] + figure.dpi * HEIGHT)])
    axes = figure.add_axes((*corners[0], *(corners[1] - corners[0])))
    draw_progress(axes, history, total, bound)
    tidy(axes, 7)
    axes.spines[["left", "bottom"]].set_visible(True)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(fontsize=8, color=TEXT)
    axes.legend(loc="best", fontsize=7, frameon=False, handlelength=1.6, borderaxespad=0.0)


def plan_facts(result: PlanResult, robot: Robot) -> str:
    """Return what a plan found in a line: cost, length, turning, time and robot."""
    from trailmark.trajectories import CurvePath

    seconds = f"{result.time.get('total') or math.nan:.3g} s"
    if result.path is not None:
        path = result.path
        facts = f"cost {path.cost:.4g} = {path.length:.4g} m + {se2.ROTATION_WEIGHT:g} × {path.rotation:.3g} rad"
        if result.objective is not None or result.goal is not None:
            # Not the sum of length and turning alone.
            facts = f"cost {result.cost:.4g}, {path.length:.4g} m, {path.rotation:.3g} rad"
        if isinstance(path, CurvePath):
            facts = f"{path.length:.4g} m, {path.cusps} change{'' if path.cusps == 1 else 's'} of direction"
        return f"{facts} · {seconds} · {robot.describe()}"
    why = "no path exists (proven)" if result.status == "infeasible" else f"no path found in {seconds}"
    return f"{why} · {robot.describe()}"


SHOWN = 12
"""Robots that are drawn along one colliding stretch at most."""


def draw_audit(axes: Axes, robot: Robot, audit: PathAudit, repaired: Path | None = None) -> None:
    """Draw an audited path, red where it collides, with a mark where the least clearance is, on axes with limits set.

    Args:
        axes: what to draw on, usually after :func:`draw_world`.
        robot: its footprint is drawn along the path.
        audit: of the path.
        repaired: a path that takes its place, drawn dashed; none if None.
    """
    draw_plan(axes, robot, audit.path)
    scale = Motions.of(audit.path, robot.circumradius)
    for begin, end in merged([scale.interval(c.motions) for c in audit.collisions]):
        stretch = scale.states(begin, end)
        count = int(np.clip(2 + (end - begin) / robot.circumradius, 2, SHOWN))
        poses = scale.poses(np.linspace(begin, end, count))
        draw_robots(axes, robot, poses, (*to_rgb(COLLISION), 0.25), COLLISION, 0.8, 6.2)
        axes.plot(*stretch[:, :2].T, color=COLLISION, lw=3.0, zorder=6.4, solid_capstyle="round", label="collides")
        axes.plot(*stretch[:1, :2].T, "x", color=COLLISION, ms=7.0, mew=2.0, zorder=8.5)
    if audit.free:
        x, y, _ = audit.min_clearance_state
        axes.plot(x, y, "D", color="white", mec=TEXT, ms=6.0, mew=1.4, zorder=8.5, label="least clearance")
    if repaired is not None:
        axes.plot(
            *repaired.states[:, :2].T, color=REPAIRED, lw=1.8, ls=(0, (3, 1.5)), zorder=6.6, label="repaired path"
        )


def save_audit_figure(
    file: str | FilePath, world: World, robot: Robot, audit: PathAudit, repaired: Path | None = None
) -> None:
    """Write a picture of an audit.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``; the same input gives the same bytes (SVG, PDF: no date).
        world: that the path was audited in.
        robot: whose path it is.
        audit: of the path.
        repaired: a path that takes its place; none if None.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    figure, axes = figure_of(world)
    draw_world(axes, world, robot)
    draw_audit(axes, robot, audit, repaired)
    facts = f"least clearance {audit.min_clearance:.4g} m"
    if not audit.free:
        deepest = max(audit.collisions, key=lambda collision: collision.depth)
        facts = f"{len(audit.collisions)} collisions, {deepest.depth:.3g} m at the deepest"
    annotate(figure, axes, f"{world.name} · audit", f"{facts} · {audit.length:.4g} m · {robot.describe()}")
    write(figure, picture_of(world, file))
