"""Pictures of maps made from logs: obstacles as measured and as grown, their uncertainty, the robot's trajectory."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from matplotlib.collections import EllipseCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from trailmark.plotting.canvas import (
    annotate,
    draw_legend,
    figure_of,
    fill,
    picture_of,
    points_per_metre,
    set_limits,
    view,
    write,
)
from trailmark.plotting.world import draw_end
from trailmark.shapes import Disc
from trailmark.shown import GOAL, HATCH, LANDMARK, MARGIN, OBSTACLE, OUTSIDE, PATH, START

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.estimation.mapping import MappedLog
    from trailmark.world import ObstacleEstimate, World

__all__ = ["draw_map", "save_map_figure"]

PROBABILITY = 0.95
"""Of the ellipses and outlines that show how well an obstacle is known."""

_MIN_HALF_LENGTH = 3.5  # points: half the length of the typical ellipse, below which all are drawn larger
_SCALES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)

Entry = tuple[Any, str]


def save_map_figure(file: str | FilePath, mapped: MappedLog) -> None:
    """Write a picture of the map made from a log.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``; the same input gives the same bytes (SVG, PDF: no date).
        mapped: of :func:`trailmark.estimation.map_log`.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    world = mapped.world
    figure, axes = figure_of(world)
    entries = draw_map(axes, mapped)
    found = mapped.figures()
    kinds = {"discs": "disc", "walls": "wall", "heaps": "heap"}
    counts = [(n, kinds[kind]) for kind, n in found["obstacles"].items() if kind in kinds and n]
    facts = [f"{n:,} {name}{'' if n == 1 else 's'}" for n, name in counts]
    facts.append(f"{found['trajectory']['length']:,.0f} m driven")
    facts.append("as measured" if world.risk is None else f"grown for {world.risk.confidence:g}")
    if found["nis"] is not None:
        facts.append(f"NIS {found['nis']['mean']:.2f} of {found['nis']['expected']:.2f}")
    annotate(figure, axes, world.name, " · ".join(facts))
    draw_legend(figure, axes, {label: handle for handle, label in entries})
    write(figure, picture_of(world, file))


def draw_map(axes: Axes, mapped: MappedLog) -> list[Entry]:
    """Draw obstacles, how well they are known, and where the robot went; return the legend's entries.

    Discs have the ellipses that hold their centres with probability PROBABILITY, all drawn larger by one factor, which
    the legend states, where they would be too small to see. What scans showed has the outline of its growth: the
    world's, or that by PROBABILITY where the world stands as it was measured. Sets limits and an equal aspect.
    """
    world = mapped.world
    window = view(world)
    set_limits(axes, world)
    estimates = world.estimates or (None,) * len(world.obstacles)
    pairs = list(zip(world.obstacles, estimates, strict=True))
    inside = shapely.box(*world.bounds)
    outside = [shapely.box(*window).difference(inside)]
    fill(axes, outside, OUTSIDE, 0.5, edgecolor=HATCH, hatch="////")
    fill(axes, [shape.polygon().shapely() for shape, estimate in pairs if estimate is None], OUTSIDE, 0.6)
    known = [(shape, estimate) for shape, estimate in pairs if estimate is not None]
    pixel = 0.05 / points_per_metre(axes)
    measured = [estimate.mean.polygon(pixel).shapely() for _, estimate in known]
    entries: list[Entry] = [(Patch(fc=OBSTACLE), "obstacle as measured")]
    if world.risk is not None:
        fill(axes, [shape.polygon(pixel).shapely() for shape, _ in known], MARGIN, 1.0)
        entries.append((Patch(fc=MARGIN), f"grown for {world.risk.confidence:g}"))
    elif mapped.scans is not None:
        fill(axes, _regions([estimate for _, estimate in known], pixel), MARGIN, 1.0)
        entries.append((Patch(fc=MARGIN), f"where it lies, {PROBABILITY:.0%} each"))
    fill(axes, measured, OBSTACLE, 1.5)
    if any(estimate is None for _, estimate in pairs):
        entries.append((Patch(fc=OUTSIDE, ec=HATCH, lw=0.5), "unknown"))
    if mapped.scans is None:
        entries += _draw_ellipses(axes, [estimate for _, estimate in known])
    fill(axes, [inside], "none", 2.5, edgecolor=OBSTACLE, linewidth=1.0)
    return entries + _draw_trajectory(axes, mapped, world)


def _regions(estimates: list[ObstacleEstimate], pixel: float) -> list[Any]:
    from trailmark.estimation.risk import grow

    return [grow(estimate, PROBABILITY).polygon(pixel).shapely() for estimate in estimates]


def _draw_ellipses(axes: Axes, estimates: list[ObstacleEstimate]) -> list[Entry]:
    """Draw the ellipses of discs' centres; points lie within with probability PROBABILITY."""
    discs = [estimate for estimate in estimates if isinstance(estimate.mean, Disc)]
    if not discs:
        return []
    values, vectors = np.linalg.eigh(np.array([estimate.covariance[:2, :2] for estimate in discs]))
    # Chi-square with two degrees of freedom stays under −2·ln(1 − p) with probability p.
    half = np.sqrt(-2.0 * math.log(1.0 - PROBABILITY) * np.maximum(values, 0.0))
    typical = float(np.median(half[:, 1])) * points_per_metre(axes)
    scale = next((scale for scale in _SCALES if scale * typical >= _MIN_HALF_LENGTH), 1)
    long, short = 2.0 * scale * half[:, 1], 2.0 * scale * half[:, 0]
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    at = np.array([estimate.mean.center for estimate in discs if isinstance(estimate.mean, Disc)])
    ellipses = EllipseCollection(long, short, angles, units="xy", offsets=at, offset_transform=axes.transData)
    ellipses.set(facecolors="none", edgecolors=LANDMARK, linewidths=1.0, zorder=4.0)
    # Seen on the dark of an obstacle too.
    ellipses.set_path_effects([withStroke(linewidth=2.2, foreground="white")])
    axes.add_collection(ellipses, autolim=False)
    # A tree would be lost on the map of a park.
    axes.plot(*at.T, "o", ms=1.6, mew=0, color=OBSTACLE, zorder=4.1)
    drawn = "" if scale == 1 else f", drawn {scale} × as large"
    return [(Line2D([], [], color=LANDMARK, marker="o", mfc="none", ls="none"), f"{PROBABILITY:.0%} ellipse{drawn}")]


def _draw_trajectory(axes: Axes, mapped: MappedLog, world: World) -> list[Entry]:
    poses = mapped.trajectory[:, 1:]
    if len(poses) == 0:
        return []
    axes.plot(*poses[:, :2].T, color=PATH, lw=0.9, alpha=0.9, zorder=3.5, solid_joinstyle="round")
    before: list[Entry] = []
    if mapped.matched is not None:
        axes.plot(*mapped.matched.odometry[:, :2].T, color=LANDMARK, lw=0.7, ls=":", zorder=3.4)
        before = [(Line2D([], [], color=LANDMARK, lw=1.0, ls=":"), "by odometry alone")]
    names = {"match": "scan matching", "slam": "EKF-SLAM", "log": "the log's poses", "odometry": "odometry alone"}
    entries: list[Entry] = [(Line2D([], [], color=PATH, lw=1.5), f"trajectory, by {names[mapped.poses]}"), *before]
    for q, colour, marker, label in ((poses[0], START, "o", "its start"), (poses[-1], GOAL, "s", "its end")):
        draw_end(axes, world.robot, q, colour, marker, "_")
        entries.append((Line2D([], [], color=colour, marker=marker, ls="none", mec="white"), label))
    return entries
