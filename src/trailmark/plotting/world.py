"""Pictures of worlds: obstacles, zones, what lies outside, the margin that a robot makes of them, both ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex, to_rgb
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from trailmark import se2
from trailmark.plotting.canvas import (
    DPI,
    LONG_SIDE,
    annotate,
    figure_of,
    fill,
    picture_of,
    points_per_metre,
    set_limits,
    show_image,
    view,
    write,
)
from trailmark.shown import (
    ALL,
    AVOID,
    COLLISION,
    GOAL,
    HATCH,
    MARGIN,
    OBSTACLE,
    ONE_WAY,
    OUTSIDE,
    PATH,
    PREFER,
    SPEED,
    START,
    TEXT,
    Layers,
)
from trailmark.world.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.world import Robot, World
    from trailmark.world.goals import Goal
    from trailmark.world.moving import Moving

__all__ = [
    "HALO",
    "draw_end",
    "draw_goal",
    "draw_ground",
    "draw_queries",
    "draw_robots",
    "draw_world",
    "regions_of",
    "save_world_figure",
    "world_facts",
]

Regions = NDArray[Any]
"""Polygons, shape (n,)."""

HALO = [withStroke(linewidth=2.2, foreground="white")]
"""Of texts and thin lines, which are seen on whatever lies below."""

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
    draw_ground(axes, world, solid if layers.obstacles else (), margin, inside, outside=layers.outside)
    if layers.outside and world.unknown:
        regions = [region.shapely() for region in world.unknown]
        fill(axes, regions, OUTSIDE, 1.6, edgecolor=HATCH, hatch="....", label="unknown")
    if layers.clearance:
        _draw_clearance(axes, world)
    for motion in filter(None, world.moving if layers.obstacles else ()):
        _draw_motion(axes, motion)
    if layers.zones:
        _draw_zones(axes, world.zones)


def draw_ground(
    axes: Axes,
    world: World,
    solid: Any,
    margin: Any,
    inside: shapely.Geometry,
    *,
    obstacle: str = "obstacle",
    grown: str = "C-obstacle at every heading",
    outside: bool = True,
) -> None:
    """Draw regions as every picture has them: obstacles dark, what is grown from them grey, the outside hatched.

    Args:
        axes: with limits set.
        world: whose surroundings are outside.
        solid: obstacles.
        margin: regions below them.
        inside: what lies inside bounds and boundary.
        obstacle: name of the obstacles in the legend.
        grown: name of the margin there.
        outside: whether to hatch what lies beyond.
    """
    fill(axes, margin, MARGIN, 1.0, label=grown)
    fill(axes, solid, OBSTACLE, 1.5, label=obstacle)
    if outside:
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
    show_image(axes, field.distance, (field.x0, field.y0), size, cmap="YlGnBu_r", alpha=0.55, zorder=0.5)
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


def world_facts(world: World) -> str:
    """Return size, obstacles, queries and robot of a world in a line."""
    facts = [f"{world.bounds[2] - world.bounds[0]:g} × {world.bounds[3] - world.bounds[1]:g} m"]
    facts.append(f"{len(world.obstacles):,} obstacle{'' if len(world.obstacles) == 1 else 's'}")
    facts.append(f"{len(world.queries):,} quer{'y' if len(world.queries) == 1 else 'ies'}")
    facts.append(world.robot.describe() if world.robot else "no robot")
    return " · ".join(facts)


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
            note.set(fontsize=8, color=TEXT, parse_math=False, path_effects=HALO)


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
        draw_robots(axes, robot, [q], (*to_rgb(colour), 0.45), colour, 1.4, 7.0)
        if robot.sweep_radius > 0.0 and reach > 4.0:
            ahead = shapely.LineString([(0.0, 0.0), (robot.circumradius, 0.0)]).intersection(robot.outline.shapely())
            front = robot.circumradius if ahead.is_empty else ahead.bounds[2]
            heading = se2.transform(q, [(0.0, 0.0), (front, 0.0)])
            axes.plot(*heading.T, color=colour, lw=1.8, zorder=7.5, solid_capstyle="round")
    # A robot of a few pixels would be lost on a large map: then the mark is the larger.
    size = 5.0 if reach > 8.0 else 8.0
    axes.plot(*q[:2], marker, color=colour, ms=size, mec="white", mew=1.0, ls="none", zorder=8.0, label=label)


def draw_robots(
    axes: Axes, robot: Robot, poses: Any, face: Any, edge: Any, width: float, zorder: float, **style: Any
) -> PolyCollection:
    """Draw a robot at poses, shape (n, 3)."""
    outlines = se2.transform(np.asarray(poses, dtype=np.float64), robot.outline.vertices)
    bodies = PolyCollection(list(outlines), facecolors=face, edgecolors=edge, linewidths=width, zorder=zorder, **style)
    axes.add_collection(bodies, autolim=False)
    return bodies


def inside_of(world: World) -> shapely.Geometry:
    """Return what lies inside bounds and boundary."""
    inside = shapely.box(*world.bounds)
    return inside if world.boundary is None else inside.intersection(world.boundary.shapely())


FAINT, STRONG = 0.12, 0.6
"""Shares of its colour that a cost zone has for a factor of 1, and for one of 10 or 0.1 and beyond."""

ROOM = 14.0
"""Points that a zone is wide at least where a text or an arrow stands in it."""

NOTED = 12
"""Zones at most in which texts and arrows stand, the largest ones: a mask's are many."""


def _draw_zones(axes: Axes, zones: Sequence[Zone]) -> None:
    """Draw zones, on axes whose limits are set, as far as they are in the picture."""
    (xmin, xmax), (ymin, ymax) = axes.get_xlim(), axes.get_ylim()
    window = shapely.box(xmin, ymin, xmax, ymax)
    noted = sorted(zones, key=lambda zone: -zone.region.area)[:NOTED]
    for zone in zones:
        region = zone.region.shapely().intersection(window)
        if region.area == 0.0:
            continue
        if isinstance(zone, CostZone):
            colour = AVOID if zone.factor >= 1.0 else PREFER
            strength = FAINT + (STRONG - FAINT) * min(1.0, abs(math.log10(zone.factor)))
            red, green, blue = 1.0 - strength * (1.0 - np.array(to_rgb(colour)))
            name = "avoid (cost zone)" if zone.factor >= 1.0 else "prefer (cost zone)"
            fill(axes, [region], to_hex((red, green, blue)), 1.1, edgecolor=colour, linewidth=0.8, label=name)
        elif isinstance(zone, SpeedZone):
            fill(axes, [region], SPEED + "55", 1.2, edgecolor="#b3a800", linewidth=0.8, label="speed zone")
        elif isinstance(zone, OneWayZone):
            fill(axes, [region], ONE_WAY + "44", 1.3, edgecolor=ONE_WAY, linewidth=0.8, label="one-way zone")
        else:
            fill(axes, [region], "none", 1.7, edgecolor=COLLISION, hatch="xxx", linewidth=1.0, label="keep-out zone")
        if not isinstance(zone, KeepOutZone) and any(zone is other for other in noted):
            _note(axes, zone, region)


def _note(axes: Axes, zone: CostZone | OneWayZone | SpeedZone, region: shapely.Geometry) -> None:
    """Write a zone's factor or limit in its middle, or draw its direction, where there is room."""
    middle = region.centroid if region.contains(region.centroid) else region.representative_point()
    x, y = middle.x, middle.y
    room = 2.0 * shapely.distance(middle, region.boundary)
    if room * points_per_metre(axes) < ROOM:
        return
    if isinstance(zone, OneWayZone):
        ahead = room * np.array([math.cos(zone.heading), math.sin(zone.heading)])
        arrow = {"arrowstyle": "-|>", "color": "#1f78b4", "lw": 1.8, "shrinkA": 0.0, "shrinkB": 0.0}
        tail, tip = np.array([x, y]) - 0.4 * ahead, np.array([x, y]) + 0.4 * ahead
        axes.annotate("", tip, tail, arrowprops=arrow, zorder=1.8)
        return
    left, low, right, high = region.bounds
    text = f"× {zone.factor:.3g}" if isinstance(zone, CostZone) else f"≤ {zone.limit:.3g} m/s"
    note = axes.text(x, y, text, fontsize=7, color=TEXT, ha="center", va="center", zorder=3.2, clip_on=True)
    note.set(parse_math=False, rotation=90.0 if high - low > 2.0 * (right - left) else 0.0, path_effects=HALO)
