"""The source method's figures: workspace and C-space, executions of Algorithm 2, landmarks, and paths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import count
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from matplotlib.collections import LineCollection
from matplotlib.colors import hsv_to_rgb
from matplotlib.figure import Figure

from trailmark.plotting.canvas import DPI, fill, picture_of, set_limits, tidy, view, write
from trailmark.plotting.plan import draw_plan
from trailmark.plotting.world import draw_end, draw_goal, regions_of
from trailmark.shown import HATCH, LANDMARK, OUTSIDE, START, TEXT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from trailmark.landmarks.executions import Execution
    from trailmark.path import Path
    from trailmark.roadmap import Roadmap
    from trailmark.world import Query, Robot, World

__all__ = ["draw_execution", "draw_initial_execution", "draw_landmarks", "save_landmarks_figure"]

BLACK, GREY = "#000000", "#c3c6cc"
FORBIDDEN, ENCLOSED, VALID = "#d55e00", "#cc79a7", "#0072b2"

_SHOWN_POINTS = 4000
_PANEL = 12.0  # square inches of a panel
_LEGEND = ["obstacle", "C-obstacle", "C-obstacle at every heading", "outside"]
_LEGEND += ["valid point", "forbidden point", "enclosed point", "obstacle's box"]
_LEGEND += [
    "edge, certified",
    "landmark",
    "K-means centre",
    "centre that the robot cannot use",
    "moved to",
    "start",
    "goal",
    "path",
]
_LEGEND += ["robot along the path"]


def save_landmarks_figure(
    file: str | FilePath,
    world: World,
    robot: Robot,
    executions: Sequence[Execution],
    planned: Sequence[tuple[Query, Roadmap, Path | None]] = (),
) -> None:
    """Write a picture of executions in a world, panel by panel.

    Workspace; C-space; the first execution before K-means; each execution after it; the landmarks that the robot can
    use, with the first query's start and goal; the shortest path of each query over them.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``.
        world: where.
        robot: whose C-space.
        executions: one or more, of one method.
        planned: queries of the world, each with the roadmap of the first execution's landmarks and the shortest path
            over it, None where its certified edges do not connect the query's ends.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    grown = [False, True, False, *(False for _ in executions), True, *(True for _ in planned)]
    figure, all_axes = _grid(world, len(grown))
    regions = regions_of(world, robot)
    # A disc has the same C-obstacle at every heading; of others it is what all headings have in common.
    name = "C-obstacle" if robot.sweep_radius == 0.0 else "C-obstacle at every heading"
    for axes, margin in zip(all_axes, grown, strict=True):
        _draw_ground(axes, world, regions, name if margin else None)
    rest = iter(all_axes)
    _title(next(rest), "workspace")
    _title(next(rest), f"C-space: grown by {robot.describe()}")
    axes = next(rest)
    draw_initial_execution(axes, executions[0])
    _title(axes, f"initial execution: {len(executions[0].samples):,} points")
    for number, execution in zip(count(1), executions, strict=False):
        axes = next(rest)
        draw_execution(axes, execution, world.bounds)
        forbidden = int(execution.forbidden.sum())
        _title(axes, f"execution {number}: {forbidden:,} forbidden, {len(execution.samples) - forbidden:,} valid")
    axes = next(rest)
    draw_landmarks(axes, executions[0])
    _title(axes, f"landmarks, k = {len(executions[0].centres)}")
    for query in [query for query, _, _ in planned][:1] or world.queries[:1]:
        _draw_ends(axes, robot, query)
        _title(axes, f"landmarks, k = {len(executions[0].centres)}; {query.name}")
    for query, roadmap, path in planned:
        axes = next(rest)
        draw_plan(axes, robot, path, roadmap, query.start, query.goals)
        k = len(executions[0].repaired)
        answer = f"the {k} landmarks do not connect it" if path is None else f"over {k} landmarks, cost {path.cost:.4g}"
        _title(axes, f"{query.name}: {answer}")
    title = f"{world.name}: {len(executions[0].samples):,} points, k = {len(executions[0].centres)}"
    style: dict[str, Any] = {"fontsize": 13, "fontweight": "bold", "parse_math": False}
    figure.text(0.0, 1.0 + 0.3 / figure.get_figheight(), title, ha="left", va="bottom", **style)
    _legend(figure, all_axes)
    write(figure, picture_of(world, file))


def draw_initial_execution(axes: Axes, execution: Execution) -> None:
    """Draw all points drawn, the forbidden ones apart, and the boxes that forbid them."""
    points, shown = execution.samples[:, :2], _shown(len(execution.samples))
    boxes = shapely.box(*execution.boxes.T) if len(execution.boxes) else []
    style: dict[str, Any] = {"edgecolor": FORBIDDEN, "linewidth": 0.8}
    fill(axes, boxes, "none", 3.5, label="obstacle's box", **style)
    inside = execution.forbidden & ~execution.enclosed
    for mask, marker, colour, label in (
        (~execution.forbidden, ".", VALID, "valid point"),
        (inside, "x", FORBIDDEN, "forbidden point"),
        (execution.enclosed, "+", ENCLOSED, "enclosed point"),
    ):
        at = points[mask & shown]
        if len(at):
            size = 3.0 if marker == "." else 3.2
            axes.plot(*at.T, marker, ms=size, mew=0.7, color=colour, ls="none", zorder=4.0, label=label)


def draw_execution(axes: Axes, execution: Execution, bounds: tuple[float, float, float, float]) -> None:
    """Draw the valid points in their clusters' colours, the centres, and the borders between clusters within bounds.

    Clusters in SE(2) overlap in the plane and have no borders there.
    """
    centres = execution.centres[:, :2]
    colours = _colours(centres)
    points = execution.samples[~execution.forbidden, :2]
    shown = _shown(len(points))
    x, y = points[shown].T
    axes.scatter(x, y, s=5.0, c=colours[execution.labels[shown]], lw=0, zorder=4.0)
    if execution.centres.shape[1] == 2 and 1 < len(centres) <= 500:
        inside = shapely.box(*bounds)
        cells = shapely.get_parts(shapely.voronoi_polygons(shapely.MultiPoint(centres), extend_to=inside))
        rings = [shapely.get_coordinates(cell) for cell in shapely.intersection(cells, inside)]
        axes.add_collection(LineCollection(rings, colors=TEXT, linewidths=0.5, zorder=4.5), autolim=False)
    _draw_centres(axes, centres, execution.invalid)


def draw_landmarks(axes: Axes, execution: Execution) -> None:
    """Draw the centres, those that the robot cannot use apart, each with an arrow to what stands in for it."""
    centres = execution.centres[:, :2]
    _draw_centres(axes, centres, execution.invalid)
    for a, b in zip(centres[execution.invalid], execution.repaired[execution.invalid, :2], strict=True):
        axes.plot(*b, "o", ms=4.5, color=LANDMARK, mec="white", mew=0.6, zorder=7.0, label="moved to")
        if np.hypot(*(b - a)) > 0.0:
            axes.annotate("", b, a, arrowprops={"arrowstyle": "->", "color": LANDMARK, "lw": 1.0}, zorder=6.5)


def _draw_centres(axes: Axes, centres: NDArray[np.float64], invalid: NDArray[np.bool_]) -> None:
    size = max(2.5, min(8.0, 8.0 * math.sqrt(40.0 / len(centres))))
    style: dict[str, Any] = {"ls": "none", "mec": "white", "mew": 0.8, "zorder": 6.0}
    if not invalid.all():
        axes.plot(*centres[~invalid].T, "o", ms=size, color=LANDMARK, label="K-means centre", **style)
    if invalid.any():
        label = "centre that the robot cannot use"
        axes.plot(*centres[invalid].T, "X", ms=size + 1.0, color=FORBIDDEN, label=label, **style)


def _draw_ground(axes: Axes, world: World, regions: tuple[Any, Any, Any], margin: str | None) -> None:
    """Draw obstacles black and, under its name, the grown margin grey, as the source does."""
    solid, grown, inside = regions
    window, bounds = view(world), shapely.box(*world.bounds)
    fill(axes, [shapely.box(*window).difference(inside)], OUTSIDE, 0.5, edgecolor=HATCH, hatch="////", label="outside")
    if margin is not None:
        # Where obstacles reach out of bounds, so does what is grown from them.
        fill(axes, shapely.intersection(grown, bounds) if len(grown) else grown, GREY, 1.0, label=margin)
    fill(axes, shapely.intersection(solid, bounds) if len(solid) else solid, BLACK, 1.5, label="obstacle")
    fill(axes, [inside], "none", 2.5, edgecolor=BLACK, linewidth=1.0)
    set_limits(axes, world, labels=False)


def _draw_ends(axes: Axes, robot: Robot, query: Query) -> None:
    draw_end(axes, robot, np.asarray(query.start), START, "o", "start")
    for goal in query.goals:
        draw_goal(axes, robot, goal, np.asarray(query.start))


def _grid(world: World, panels: int) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels, as many columns as make it nearest to three by two."""
    xmin, ymin, xmax, ymax = view(world)
    ratio = min(max((xmax - xmin) / (ymax - ymin), 0.25), 4.0)
    width, height = math.sqrt(_PANEL * ratio), math.sqrt(_PANEL / ratio)
    gap = 0.45

    def shape(columns: int) -> float:
        return columns * (width + gap) / (math.ceil(panels / columns) * (height + gap))

    # An empty place counts a little, so that the last row is full where it can be.
    columns = min(range(1, panels + 1), key=lambda c: abs(math.log(shape(c) / 1.5)) + 0.1 * (-panels % c))
    rows = math.ceil(panels / columns)
    figure = Figure(figsize=(columns * (width + gap), rows * (height + gap)), dpi=DPI, facecolor="white")
    grid = figure.subplots(rows, columns, squeeze=False)
    figure.subplots_adjust(0.0, 0.0, 1.0, 1.0, wspace=gap / width, hspace=gap / height)
    for i, axes in enumerate(grid.flat):
        if i >= panels:
            axes.remove()
            continue
        tidy(axes, 7)
    return figure, list(grid.flat[:panels])


def _legend(figure: Figure, all_axes: Sequence[Axes]) -> None:
    entries: dict[str, Any] = {}
    for axes in all_axes:
        for artist, label in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, artist)
    labels = sorted(entries, key=_LEGEND.index)
    bottom = -0.45 / figure.get_figheight()
    columns = max(1, min(len(labels), int(figure.get_figwidth() / 2.3)))
    handles = [entries[label] for label in labels]
    style: dict[str, Any] = {"fontsize": 8.5, "frameon": False, "borderaxespad": 0.0}
    figure.legend(handles, labels, loc="upper left", bbox_to_anchor=(0.0, bottom), ncols=columns, **style)


def _title(axes: Axes, text: str) -> None:
    axes.set_title(text, fontsize=8.5, loc="left", pad=4.0, color=TEXT, parse_math=False)


def _shown(n: int) -> NDArray[np.bool_]:
    """Return which of n points to draw, shape (n,): a million of them would be one blot."""
    return np.arange(n) < _SHOWN_POINTS


def _colours(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a colour for each cluster, shape (k, 3); neighbours along x + y differ in hue and in lightness."""
    order = np.empty(len(centres), dtype=np.int64)
    order[np.argsort(centres.sum(axis=1))] = np.arange(len(centres))
    hue = (0.61803 * order) % 1.0
    value = 0.6 + 0.3 * ((order // 2) % 2)
    return np.asarray(hsv_to_rgb(np.column_stack([hue, np.full(len(hue), 0.75), value])))
