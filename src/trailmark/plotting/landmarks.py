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

from trailmark.plotting.canvas import DPI, entries_of, fill, picture_of, set_limits, tidy, view, write
from trailmark.plotting.plan import draw_plan
from trailmark.plotting.world import draw_ground, regions_of
from trailmark.shown import AVOID, COLLISION, LANDMARK, PATH, REPAIRED, TEXT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from trailmark.landmarks.executions import Execution
    from trailmark.roadmap import Roadmap
    from trailmark.trajectories import Path
    from trailmark.world import Query, Robot, World

__all__ = ["draw_execution", "draw_initial_execution", "draw_landmarks", "save_landmarks_figure"]

FORBIDDEN, ENCLOSED, VALID, UNUSABLE = AVOID, REPAIRED, PATH, COLLISION

_SHOWN_POINTS = 4000
_PANEL, _GAP = 12.0, 0.45  # square inches of a panel; inches between panels


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
    first, k = executions[0], len(executions[0].centres)
    solid, margin, inside = regions_of(world, robot)
    # A disc has the same C-obstacle at every heading; of others it is what all headings have in common.
    name = "C-obstacle" if robot.sweep_radius == 0.0 else "C-obstacle at every heading"
    figure, panels = _grid(world, 4 + len(executions) + len(planned))
    rest = iter(panels)

    def panel(title: str, grown: bool) -> Axes:
        axes = next(rest)
        set_limits(axes, world, labels=False)
        draw_ground(axes, world, solid, margin if grown else (), inside, grown=name)
        axes.set_title(title, fontsize=8.5, loc="left", pad=4.0, color=TEXT, parse_math=False)
        return axes

    panel("workspace", False)
    panel(f"C-space: grown by {robot.describe()}", True)
    draw_initial_execution(panel(f"initial execution: {len(first.samples):,} points", False), first)
    for number, execution in zip(count(1), executions, strict=False):
        forbidden = int(execution.forbidden.sum())
        valid = len(execution.samples) - forbidden
        axes = panel(f"execution {number}: {forbidden:,} forbidden, {valid:,} valid", False)
        draw_execution(axes, execution, world.bounds)
    query = next(iter([query for query, _, _ in planned] or world.queries), None)
    axes = panel(f"landmarks, k = {k}" + (f"; {query.name}" if query else ""), True)
    draw_landmarks(axes, first)
    if query is not None:
        draw_plan(axes, robot, None, None, query.start, query.goals)
    for query, roadmap, path in planned:
        landmarks = f"{len(first.repaired)} landmarks"
        answer = f"the {landmarks} do not connect it" if path is None else f"over {landmarks}, cost {path.cost:.4g}"
        draw_plan(panel(f"{query.name}: {answer}", True), robot, path, roadmap, query.start, query.goals)
    style: dict[str, Any] = {"fontsize": 13, "fontweight": "bold", "parse_math": False}
    title = f"{world.name}: {len(first.samples):,} points, k = {k}"
    figure.text(0.0, 1.0 + 0.3 / figure.get_figheight(), title, ha="left", va="bottom", **style)
    entries = entries_of(panels)
    figure.legend(
        entries.values(),
        entries.keys(),
        loc="upper left",
        bbox_to_anchor=(0.0, -0.45 / figure.get_figheight()),
        ncols=max(1, min(len(entries), int(figure.get_figwidth() / 2.3))),
        fontsize=8.5,
        frameon=False,
        borderaxespad=0.0,
    )
    write(figure, picture_of(world, file))


def draw_initial_execution(axes: Axes, execution: Execution) -> None:
    """Draw all points drawn, the forbidden ones apart, and the boxes that forbid them."""
    points, shown = execution.samples[:, :2], _shown(len(execution.samples))
    boxes = shapely.box(*execution.boxes.T) if len(execution.boxes) else []
    fill(axes, boxes, "none", 3.5, label="obstacle's box", edgecolor=FORBIDDEN, linewidth=0.8)
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
        axes.plot(*centres[invalid].T, "X", ms=size + 1.0, color=UNUSABLE, label=label, **style)


def _grid(world: World, panels: int) -> tuple[Figure, list[Axes]]:
    """Return a figure and its panels, as many columns as make it nearest to three by two."""
    xmin, ymin, xmax, ymax = view(world)
    ratio = min(max((xmax - xmin) / (ymax - ymin), 0.25), 4.0)
    width, height = math.sqrt(_PANEL * ratio), math.sqrt(_PANEL / ratio)

    def misfit(columns: int) -> float:
        # An empty place counts a little, so that the last row is full where it can be.
        shape = columns * (width + _GAP) / (math.ceil(panels / columns) * (height + _GAP))
        return abs(math.log(shape / 1.5)) + 0.1 * (-panels % columns)

    columns = min(range(1, panels + 1), key=misfit)
    rows = math.ceil(panels / columns)
    figure = Figure(figsize=(columns * (width + _GAP), rows * (height + _GAP)), dpi=DPI, facecolor="white")
    grid = figure.subplots(rows, columns, squeeze=False)
    figure.subplots_adjust(0.0, 0.0, 1.0, 1.0, wspace=_GAP / width, hspace=_GAP / height)
    for axes in grid.flat[panels:]:
        axes.remove()
    for axes in grid.flat[:panels]:
        tidy(axes, 7)
    return figure, list(grid.flat[:panels])


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
