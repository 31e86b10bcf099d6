"""Pictures of worlds: obstacles, what lies outside, the margin that the robot makes of them, starts and goals."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from trailmark import se2
from trailmark.colours import GOAL, HATCH, MARGIN, OBSTACLE, OUTSIDE, PATH, START, TEXT
from trailmark.layers import ALL, Layers
from trailmark.plotting.canvas import (
    DPI,
    LONG_SIDE,
    annotate,
    figure_of,
    fill,
    picture_of,
    points_per_metre,
    set_limits,
    view,
    write,
)
from trailmark.plotting.scene import world_facts
from trailmark.plotting.zones import draw_zones

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.goals import Goal
    from trailmark.moving import Moving
    from trailmark.world import Robot, World

__all__ = ["draw_end", "draw_goal", "draw_queries", "draw_world", "regions_of", "save_world_figure"]

Regions = NDArray[Any]
"""Polygons, shape (n,)."""

_MANY_VERTICES = 20_000
_SHOWN_QUERIES, _NAMED_QUERIES = 12, 6
_CLEARANCE_CELLS = 400  # along the world's longer side


def draw_world(axes: Axes, world: World, robot: Robot | None = None, layers: Layers = ALL) -> None:
    """Draw obstacles, zones, what lies outside, and the margin that the robot's reference point cannot enter.

    The margin is the obstacles and walls grown by :attr:`Robot.reference_radius`: no heading is valid there, so
    no landmark and no path ever touches it. Sets limits and an equal aspect.

    Args:
        axes: what to draw on; one unit is a metre.
        world: the world; curves in it are drawn to half a pixel.
        robot: whose margin to draw; none without it.
        layers: what to show.
    """
    set_limits(axes, world)
    solid, margin, inside = regions_of(world, robot if layers.margin else None)
    fill(axes, margin, MARGIN, 1.0, label="C-obstacle at every heading")
    if layers.clearance:
        _draw_clearance(axes, world)
    if layers.obstacles:
        fill(axes, solid, OBSTACLE, 1.5, label="obstacle")
        for motion in filter(None, world.moving):
            _draw_motion(axes, motion)
    if layers.zones:
        draw_zones(axes, world.zones)
    if layers.outside:
        beyond = shapely.box(*view(world)).difference(inside)
        fill(axes, [beyond], OUTSIDE, 2.0, edgecolor=HATCH, hatch="////", label="outside")
    fill(axes, [inside], "none", 2.5, edgecolor=OBSTACLE, linewidth=1.0)


def _draw_clearance(axes: Axes, world: World) -> None:
    """Shade free space by the distance to the nearest obstacle, with contours at round distances."""
    from trailmark.collision.field import build_field
    from trailmark.collision.obstacles import build_grid

    size = max(world.bounds[2] - world.bounds[0], world.bounds[3] - world.bounds[1]) / _CLEARANCE_CELLS
    field = build_field(build_grid(world, size))
    rows, columns = field.distance.shape
    x, y = field.x0 + size * (np.arange(columns) + 0.5), field.y0 + size * (np.arange(rows) + 0.5)
    ends = (field.x0, field.x0 + size * columns, field.y0, field.y0 + size * rows)
    # Not by axes.imshow, which sets limits and aspect anew.
    image = AxesImage(axes, cmap="YlGnBu_r", origin="lower", extent=ends, alpha=0.55, zorder=0.5)
    image.set_data(field.distance)
    axes.add_image(image)
    levels = MaxNLocator(nbins=6, steps=[1, 2, 5, 10]).tick_values(0.0, float(field.distance.max()))[1:]
    lines = axes.contour(x, y, field.distance, levels=levels, colors=[TEXT], linewidths=0.6, zorder=0.6)
    axes.clabel(lines, fontsize=7, fmt=lambda metres: f"{metres:g} m")


def _draw_motion(axes: Axes, motion: Moving) -> None:
    """Draw where a moving obstacle is now, on the region that it sweeps, and an arrow to where it will be."""
    now, then = (motion.at(time).polygon() for time in (0.0, motion.until))
    fill(axes, [now.shapely()], "none", 1.6, edgecolor="white", linewidth=1.0)
    tail, tip = (polygon.vertices.mean(axis=0) for polygon in (now, then))
    arrow = {"arrowstyle": "-|>", "color": "white", "lw": 1.6, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", tip, tail, arrowprops=arrow, zorder=1.7)


def regions_of(world: World, robot: Robot | None) -> tuple[Regions, Regions, shapely.Geometry]:
    """Return what a picture of the world consists of: obstacles, margin, and what lies inside bounds and boundary.

    Curves are right to half a pixel. The margin is empty without a robot.
    """
    pixel = world.extent / (LONG_SIDE * DPI)
    inside = inside_of(world)
    solid = np.array([shape.polygon(pixel / 8).shapely() for shape in world.obstacles], dtype=object)
    if shapely.get_num_coordinates(solid).sum() > _MANY_VERTICES:
        solid = shapely.simplify(solid, pixel / 2)
    if robot is None or robot.reference_radius <= pixel / 2:
        return solid, np.empty(0, dtype=object), inside
    radius = robot.reference_radius
    arc = min(16, math.ceil(math.sqrt(radius / pixel)))  # then a chord lies within half a pixel of its arc
    grown = shapely.buffer(solid, radius, quad_segs=arc)
    shrunk = shapely.simplify(inside, pixel / 2).buffer(-radius, quad_segs=arc)
    return solid, np.array([inside.difference(shrunk), *grown], dtype=object), inside


def save_world_figure(file: str | FilePath, world: World) -> None:
    """Write a picture of a world and the first of its queries; ``file`` as for :func:`save_plan_figure`.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    figure, axes = figure_of(world)
    draw_world(axes, world, world.robot)
    draw_queries(axes, world)
    annotate(figure, axes, world.name, world_facts(world))
    write(figure, picture_of(world, file))


def draw_queries(axes: Axes, world: World) -> None:
    """Draw the first of a world's queries, with their names if they are few."""
    shown = world.queries[:_SHOWN_QUERIES]
    for query in shown:
        start = np.array(query.start)
        draw_end(axes, world.robot, start, START, "o", "start")
        for goal in query.goals:
            ends = np.array([start, goal.nearest(start)[0]])
            axes.plot(*ends[:, :2].T, color=PATH, lw=0.8, ls=(0, (4, 3)), alpha=0.8, zorder=5.0)
            draw_goal(axes, world.robot, goal, start)
        if len(shown) <= _NAMED_QUERIES:
            note = axes.annotate(query.name, query.start[:2], xytext=(6, 6), textcoords="offset points", zorder=9.0)
            note.set(fontsize=8, color=TEXT, parse_math=False)
            note.set_bbox({"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8})


def draw_goal(axes: Axes, robot: Robot | None, goal: Goal, start: se2.FloatArray) -> None:
    """Draw a goal: the positions that it allows, and the robot at the one nearest to the start, shape (3,)."""
    if goal.region is not None or goal.position_tolerance > 0.0:
        center, radius = goal.disc
        allowed = shapely.Point(center).buffer(radius) if goal.region is None else goal.region.shapely()
        fill(axes, [allowed], GOAL + "33", 3.0, edgecolor=GOAL, linewidth=1.2)
    draw_end(axes, robot, goal.nearest(start)[0], GOAL, "s", "goal")


def draw_end(axes: Axes, robot: Robot | None, q: se2.FloatArray, colour: str, marker: str, label: str) -> None:
    """Draw a start or goal (3,): the robot standing there, its heading, and a mark that is seen at any scale."""
    reach = 0.0 if robot is None else robot.circumradius * points_per_metre(axes)
    if robot is not None:
        body = PolyCollection([se2.transform(q, robot.outline.vertices)], facecolors=(*to_rgb(colour), 0.45))
        body.set(edgecolors=colour, linewidths=1.4, zorder=7.0)
        axes.add_collection(body, autolim=False)
        if robot.sweep_radius > 0.0 and reach > 4.0:
            ahead = shapely.LineString([(0.0, 0.0), (robot.circumradius, 0.0)]).intersection(robot.outline.shapely())
            front = robot.circumradius if ahead.is_empty else ahead.bounds[2]
            heading = se2.transform(q, [(0.0, 0.0), (front, 0.0)])
            axes.plot(*heading.T, color=colour, lw=1.8, zorder=7.5, solid_capstyle="round")
    # A robot of a few pixels would be lost on a large map: then the mark is the larger.
    size = 5.0 if reach > 8.0 else 8.0
    axes.plot(*q[:2], marker, color=colour, ms=size, mec="white", mew=1.0, zorder=8.0, label=label)


def inside_of(world: World) -> shapely.Geometry:
    """Return what lies inside bounds and boundary."""
    inside = shapely.box(*world.bounds)
    return inside if world.boundary is None else inside.intersection(world.boundary.shapely())
