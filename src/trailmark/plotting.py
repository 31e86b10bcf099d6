"""Pictures of worlds and plans, by matplotlib; import this module only when a picture is asked for.

The ``draw_*`` functions draw on any matplotlib axes; the ``save_*`` functions lay out a figure of their own and
write it whole or not at all. No pyplot, hence no global state and no display. Colours are Okabe & Ito's
("Color Universal Design", 2008), which colour-blind readers tell apart; shape and line width repeat what colour says.
"""

from __future__ import annotations

import io
import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import shapely
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator

from trailmark import se2
from trailmark.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from trailmark.path import Path
    from trailmark.planning import PlanResult
    from trailmark.roadmap import Roadmap
    from trailmark.world import Robot, World

__all__ = ["PICTURE_SUFFIXES", "draw_plan", "draw_world", "save_plan_figure", "save_world_figure"]

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")

OBSTACLE, MARGIN, OUTSIDE, HATCH, TEXT = "#3f4249", "#c9ccd2", "#eceef1", "#b4b9c2", "#55585f"
START, GOAL, PATH, BODY, LANDMARK = "#009e73", "#d55e00", "#0072b2", "#d8e9f4", "#9c4a79"
EDGE, CANDIDATE = "#dca6c5", "#ecdde5"  # tints of Okabe & Ito's purple: the roadmap is the path's background

_LONG_SIDE = 7.5  # inches of the axes
_DPI = 160
_MANY_VERTICES = 20_000
_LEGEND = ["start", "goal", "path", "robot along the path", "landmark", "edge, certified", "edge, not checked"]
_LEGEND += ["obstacle", "C-obstacle at every heading", "outside"]
_SHOWN_QUERIES, _NAMED_QUERIES = 12, 6


def draw_world(axes: Axes, world: World, robot: Robot | None = None) -> None:
    """Draw obstacles, what lies outside, and the margin that the robot's reference point cannot enter.

    The margin is the obstacles and walls grown by :attr:`Robot.reference_radius`: no heading is valid there, so
    no landmark and no path ever touches it. Sets limits and an equal aspect.

    Args:
        axes: what to draw on; one unit is a metre.
        world: the world; curves in it are drawn to half a pixel.
        robot: whose margin to draw; none without it.
    """
    view, pixel = _view(world), world.extent / (_LONG_SIDE * _DPI)
    inside = shapely.box(*world.bounds)
    if world.boundary is not None:
        inside = inside.intersection(world.boundary.shapely())
    solid = np.array([shape.polygon(pixel / 8).shapely() for shape in world.obstacles], dtype=object)
    if shapely.get_num_coordinates(solid).sum() > _MANY_VERTICES:
        solid = shapely.simplify(solid, pixel / 2)
    if robot is not None and robot.reference_radius > pixel / 2:
        radius = robot.reference_radius
        arc = min(16, math.ceil(math.sqrt(radius / pixel)))  # then a chord lies within half a pixel of its arc
        grown = shapely.buffer(solid, radius, quad_segs=arc)
        shrunk = shapely.simplify(inside, pixel / 2).buffer(-radius, quad_segs=arc)
        _fill(axes, [inside.difference(shrunk), *grown], MARGIN, 1.0, label="C-obstacle at every heading")
    _fill(axes, solid, OBSTACLE, 1.5, label="obstacle")
    _fill(axes, [shapely.box(*view).difference(inside)], OUTSIDE, 2.0, edgecolor=HATCH, hatch="////", label="outside")
    _fill(axes, [inside], "none", 2.5, edgecolor=OBSTACLE, linewidth=1.0)
    axes.set_xlim(view[0], view[2])
    axes.set_ylim(view[1], view[3])
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def draw_plan(
    axes: Axes,
    robot: Robot,
    path: Path | None = None,
    roadmap: Roadmap | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
) -> None:
    """Draw a roadmap, a path with the robot along it, and the two ends, on axes whose limits are set.

    Args:
        axes: what to draw on, usually after :func:`draw_world`.
        robot: its footprint is drawn along the path and at the ends.
        path: drawn from its first to its last state.
        roadmap: edges thin, certified ones stronger; landmarks with a tick along the heading (none for a disc).
        start: configuration, shape (3,); default: the path's first state.
        goal: configuration, shape (3,); default: the path's last state.
    """
    if roadmap is not None and len(roadmap.configurations):
        _draw_roadmap(axes, robot, roadmap)
    if path is not None:
        _draw_path(axes, robot, path)
        start = path.states[0] if start is None else start
        goal = path.states[-1] if goal is None else goal
    for q, colour, marker, label in ((start, START, "o", "start"), (goal, GOAL, "s", "goal")):
        if q is not None:
            _draw_end(axes, robot, np.asarray(q, dtype=np.float64), colour, marker, label)


def save_plan_figure(
    file: str | FilePath,
    world: World,
    robot: Robot,
    result: PlanResult,
    roadmap: Roadmap | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    query: str | None = None,
) -> None:
    """Write a picture of a plan; without a path it shows the roadmap, which tells why.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``; the same input gives the same bytes (SVG, PDF: no date).
        world: what was planned in.
        robot: what was planned for.
        result: status, path, cost and times.
        roadmap: left out if None.
        start: configuration, shape (3,).
        goal: configuration, shape (3,).
        query: its name, for the title.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    figure, axes = _figure(world)
    draw_world(axes, world, robot)
    draw_plan(axes, robot, result.path, roadmap, start, goal)
    seconds = f"{result.time.get('total', math.nan):.3g} s"
    if result.path is not None:
        path = result.path
        facts = f"cost {path.cost:.4g} = {path.length:.4g} m + {se2.ROTATION_WEIGHT:g} × {path.rotation:.3g} rad"
        facts = f"{facts} · {seconds} · {robot.describe()}"
    else:
        why = "no path exists (proven)" if result.status == "infeasible" else f"no path found in {seconds}"
        facts = f"{why} · {robot.describe()}"
    _annotate(figure, axes, world.name if query is None else f"{world.name} · {query}", facts)
    _write(figure, FilePath(file))


def save_world_figure(file: str | FilePath, world: World) -> None:
    """Write a picture of a world and the first of its queries; ``file`` as for :func:`save_plan_figure`.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    figure, axes = _figure(world)
    draw_world(axes, world, world.robot)
    shown = world.queries[:_SHOWN_QUERIES]
    for query in shown:
        ends = np.array([query.start, query.goal])
        axes.plot(*ends[:, :2].T, color=PATH, lw=0.8, ls=(0, (4, 3)), alpha=0.8, zorder=5.0)
        for q, colour, marker, label in zip(ends, (START, GOAL), "os", ("start", "goal"), strict=True):
            _draw_end(axes, world.robot, q, colour, marker, label)
        if len(shown) <= _NAMED_QUERIES:
            note = axes.annotate(query.name, query.start[:2], xytext=(6, 6), textcoords="offset points", zorder=9.0)
            note.set(fontsize=8, color=TEXT, parse_math=False)
            note.set_bbox({"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8})
    facts = [f"{world.bounds[2] - world.bounds[0]:g} × {world.bounds[3] - world.bounds[1]:g} m"]
    facts.append(f"{len(world.obstacles):,} obstacle{'' if len(world.obstacles) == 1 else 's'}")
    facts.append(f"{len(world.queries):,} quer{'y' if len(world.queries) == 1 else 'ies'}")
    facts[-1] += f", {len(shown)} shown" if len(shown) < len(world.queries) else ""
    facts.append(world.robot.describe() if world.robot else "no robot")
    _annotate(figure, axes, world.name, " · ".join(facts))
    _write(figure, FilePath(file))


def _draw_roadmap(axes: Axes, robot: Robot, roadmap: Roadmap) -> None:
    from trailmark.collision.kernels import BLOCKED

    at, status = roadmap.configurations, roadmap.status
    # Edges that nobody has checked yet may run through obstacles, which therefore lie over them.
    _draw_lines(axes, at[roadmap.edges[~roadmap.certified & (status != BLOCKED)], :2], CANDIDATE, 0.5, 1.2)
    _draw_lines(axes, at[roadmap.edges[roadmap.certified], :2], EDGE, 0.8, 3.0)
    axes.plot([], [], color=CANDIDATE, lw=1.5, label="edge, not checked")
    axes.plot([], [], color=EDGE, lw=1.5, label="edge, certified")
    axes.plot([], [], "o", ms=3.0, mew=0, color=LANDMARK, label="landmark")
    size = min(3.0, max(0.8, 3.0 * math.sqrt(400 / len(at))))
    axes.plot(*at[:, :2].T, "o", ms=size, mew=0, color=LANDMARK, zorder=4.0)
    if robot.sweep_radius > 0.0:
        tick = 2.2 * size / _points_per_metre(axes)
        tips = at[:, :2] + tick * np.column_stack([np.cos(at[:, 2]), np.sin(at[:, 2])])
        _draw_lines(axes, np.stack([at[:, :2], tips], axis=1), LANDMARK, 0.3 * size, 4.0)


def _draw_path(axes: Axes, robot: Robot, path: Path) -> None:
    # By cost, so that the robot also shows where it turns in place; some dozens at most.
    n = min(48, max(8, math.ceil(path.cost / (2.0 * robot.circumradius)))) + 1
    shown = se2.transform(path.at(np.linspace(0.0, 1.0, n)), robot.outline.vertices)
    robots = PolyCollection(list(shown), facecolors=(*to_rgb(BODY), 0.7), edgecolors=PATH)
    robots.set(linewidths=0.6, zorder=5.0, label="robot along the path")
    axes.add_collection(robots, autolim=False)
    xy = path.states[:, :2]
    axes.plot(*xy.T, color="white", lw=3.6, alpha=0.9, zorder=6.0, solid_joinstyle="round")
    axes.plot(*xy.T, color=PATH, lw=2.0, zorder=6.1, solid_joinstyle="round", label="path")


def _draw_end(axes: Axes, robot: Robot | None, q: se2.FloatArray, colour: str, marker: str, label: str) -> None:
    reach = 0.0 if robot is None else robot.circumradius * _points_per_metre(axes)
    if robot is not None:
        body = PolyCollection([se2.transform(q, robot.outline.vertices)], facecolors=(*to_rgb(colour), 0.45))
        body.set(edgecolors=colour, linewidths=1.4, zorder=7.0)
        axes.add_collection(body, autolim=False)
        if robot.sweep_radius > 0.0 and reach > 4.0:
            ahead = shapely.LineString([(0.0, 0.0), (robot.circumradius, 0.0)]).intersection(robot.outline.shapely())
            front = robot.circumradius if ahead.is_empty else ahead.bounds[2]
            axes.plot(
                *se2.transform(q, [(0.0, 0.0), (front, 0.0)]).T,
                color=colour,
                lw=1.8,
                zorder=7.5,
                solid_capstyle="round",
            )
    # A robot of a few pixels would be lost on a large map: then the mark is the larger.
    size = 5.0 if reach > 8.0 else 8.0
    axes.plot(*q[:2], marker, color=colour, ms=size, mec="white", mew=1.0, zorder=8.0, label=label)


def _draw_lines(axes: Axes, lines: se2.FloatArray, colour: str, width: float, zorder: float) -> None:
    """Draw n line segments, shape (n, 2, 2), as one patch: tens of thousands of separate ones take seconds.

    They get thinner where their ink would fill most of the region they lie in, so that they stay a texture.
    """
    if len(lines) == 0:
        return
    scale = _points_per_metre(axes)
    ink = scale * np.hypot(*(lines[:, 1] - lines[:, 0]).T).sum()
    steps = np.linspace(0.0, 1.0, 8)[:, None, None]
    cells = np.floor(scale / 12.0 * (lines[:, 0] + steps * (lines[:, 1] - lines[:, 0])))
    room = 144.0 * len(np.unique(cells @ [1.0, 1e4]))  # square points: what the lines touch, in cells of 12 points
    codes = np.tile(np.array([Outline.MOVETO, Outline.LINETO], dtype=Outline.code_type), len(lines))
    thin = min(width, max(0.06, 0.7 * room / max(ink, 1e-9)))
    axes.add_artist(
        PathPatch(Outline(lines.reshape(-1, 2), codes), fill=False, edgecolor=colour, linewidth=thin, zorder=zorder)
    )


def _fill(axes: Axes, regions: Any, colour: str, zorder: float, **style: Any) -> None:
    """Fill polygonal regions as one patch; they may overlap (non-zero winding), and neighbours show no seam."""
    polygons = shapely.get_parts(np.asarray(regions, dtype=object))
    polygons = polygons[(shapely.get_type_id(polygons) == 3) & ~shapely.is_empty(polygons)]
    if len(polygons) == 0:
        return
    rings = shapely.get_rings(shapely.orient_polygons(polygons))
    points, ring = shapely.get_coordinates(rings, return_index=True)
    codes = np.full(len(points), Outline.LINETO, dtype=Outline.code_type)
    last = np.append(ring[1:] != ring[:-1], True)
    codes[last] = Outline.CLOSEPOLY
    codes[np.roll(last, 1)] = Outline.MOVETO
    style = {"edgecolor": "none", "linewidth": 0.0} | style
    # Not add_patch, which looks for the limits of every edge in Python: seconds on a grid map.
    axes.add_artist(PathPatch(Outline(points, codes), facecolor=colour, zorder=zorder, **style))


def _view(world: World) -> tuple[float, float, float, float]:
    xmin, ymin, xmax, ymax = world.bounds
    pad = 0.03 * max(xmax - xmin, ymax - ymin)
    return xmin - pad, ymin - pad, xmax + pad, ymax + pad


def _figure(world: World) -> tuple[Figure, Axes]:
    xmin, ymin, xmax, ymax = _view(world)
    scale = _LONG_SIDE / max(xmax - xmin, ymax - ymin)
    width, height = max(0.8, (xmax - xmin) * scale), max(0.8, (ymax - ymin) * scale)
    left, bottom, right, top = 0.7, 0.6, 0.2, 0.6
    whole = left + width + right, bottom + height + top
    figure = Figure(figsize=whole, dpi=_DPI, facecolor="white")
    axes = figure.add_axes((left / whole[0], bottom / whole[1], width / whole[0], height / whole[1]))
    axes.tick_params(labelsize=8, color=TEXT, labelcolor=TEXT)
    axes.spines[:].set_visible(False)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=8, steps=[1, 2, 5, 10]))
    return figure, axes


def _annotate(figure: Figure, axes: Axes, title: str, facts: str) -> None:
    """Write title and facts above the axes and the legend beside or, where they are wide, below."""
    lines: list[tuple[str, int, dict[str, Any]]] = [
        (title, 20, {"fontsize": 12, "fontweight": "bold"}),
        (facts, 6, {"fontsize": 9, "color": TEXT}),
    ]
    for text, up, style in lines:
        short = text if len(text) <= 90 else text[:89] + "…"
        note = axes.annotate(short, (0.0, 1.0), xytext=(0, up), xycoords="axes fraction", textcoords="offset points")
        note.set(va="bottom", ha="left", parse_math=False, **style)
    artists, labels = axes.get_legend_handles_labels()
    entries = {label: artists[labels.index(label)] for label in sorted(set(labels), key=_LEGEND.index)}
    wide = axes.bbox.width > 1.15 * axes.bbox.height
    axes.legend(
        entries.values(),
        entries.keys(),
        loc="upper left",
        bbox_to_anchor=(0.0, -0.55 * figure.dpi / axes.bbox.height) if wide else (1.02, 1.0),
        ncols=4 if wide else 1,
        fontsize=8,
        frameon=False,
        borderaxespad=0.0,
        handlelength=1.6,
    )


def _points_per_metre(axes: Axes) -> float:
    (left, low), (right, high) = axes.transData.transform([(0.0, 0.0), (1.0, 1.0)])
    return float(min(abs(right - left), abs(high - low))) * 72.0 / axes.figure.dpi


def _write(figure: Figure, file: FilePath) -> None:
    from trailmark.formats.files import write_atomically

    kind = file.suffix.lower()
    if kind not in PICTURE_SUFFIXES:
        raise OutputError(f"{file}: suffix {file.suffix!r} given, allowed: {', '.join(PICTURE_SUFFIXES)}")
    buffer = io.BytesIO()
    dateless: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(kind, {})
    with matplotlib.rc_context({"svg.hashsalt": "trailmark"}):
        figure.savefig(buffer, format=kind[1:], dpi=_DPI, bbox_inches="tight", pad_inches=0.12, metadata=dateless)
    write_atomically(file, buffer.getvalue())
