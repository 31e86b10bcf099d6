"""Pictures of maps made from logs: obstacles as measured and as grown, their uncertainty, the robot's trajectory."""

from __future__ import annotations

import math
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from matplotlib.collections import EllipseCollection

from trailmark.plotting.canvas import annotate, figure_of, fill, picture_of, points_per_metre, set_limits, write
from trailmark.plotting.world import HALO, draw_end, draw_ground
from trailmark.shapes import Disc
from trailmark.shown import GOAL, HATCH, LANDMARK, OBSTACLE, OUTSIDE, PATH, START

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.estimation.mapping import MappedLog
    from trailmark.world import ObstacleEstimate

__all__ = ["draw_map", "save_map_figure"]

PROBABILITY = 0.95
"""Of the ellipses and outlines that show how well an obstacle is known."""

_MIN_HALF_LENGTH = 3.5  # points: half the length of the typical ellipse, below which all are drawn larger
_SCALES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


def save_map_figure(file: str | FilePath, mapped: MappedLog) -> None:
    """Write a picture of the map made from a log.

    Args:
        file: ends in ``.png``, ``.svg`` or ``.pdf``; the same input gives the same bytes (SVG, PDF: no date).
        mapped: of :func:`trailmark.estimation.map_log`.

    Raises:
        OutputError: another suffix, a file that cannot be written, or one that the world was read from.
    """
    world, found = mapped.world, mapped.figures()
    figure, axes = figure_of(world)
    draw_map(axes, mapped)
    counts = [(found["obstacles"][f"{kind}s"], kind) for kind in ("disc", "wall", "heap")]
    facts = [f"{n:,} {kind}{'' if n == 1 else 's'}" for n, kind in counts if n]
    facts.append(f"{found['trajectory']['length']:,.0f} m driven")
    facts.append("as measured" if world.risk is None else f"grown for {world.risk.confidence:g}")
    if found["nis"] is not None:
        facts.append(f"NIS {found['nis']['mean']:.2f} of {found['nis']['expected']:.2f}")
    annotate(figure, axes, world.name, " · ".join(facts))
    write(figure, picture_of(world, file))


def draw_map(axes: Axes, mapped: MappedLog) -> None:
    """Draw obstacles, how well they are known, and where the robot went.

    Discs have the ellipses that hold their centres with probability PROBABILITY, all drawn larger by one factor, which
    the legend states, where they would be too small to see. What scans showed has the outline of its growth: the
    world's, or that by PROBABILITY where the world stands as it was measured. Sets limits and an equal aspect.
    """
    from trailmark.estimation.risk import grow

    world = mapped.world
    set_limits(axes, world)
    pairs = list(zip(world.obstacles, world.estimates or (None,) * len(world.obstacles), strict=True))
    pixel = 0.05 / points_per_metre(axes)
    known = [(shape, estimate) for shape, estimate in pairs if estimate is not None]
    unknown = [shape.polygon().shapely() for shape, estimate in pairs if estimate is None]
    fill(axes, unknown, OUTSIDE, 0.6, edgecolor=HATCH, linewidth=0.5, label="unknown")
    margin, name = list[Any](), ""
    if world.risk is not None:
        margin, name = [shape for shape, _ in known], f"grown for {world.risk.confidence:g}"
    elif mapped.scans is not None:
        margin, name = [grow(estimate, PROBABILITY) for _, estimate in known], f"where it lies, {PROBABILITY:.0%} each"
    grown = [shape.polygon(pixel).shapely() for shape in margin]
    measured = [estimate.mean.polygon(pixel).shapely() for _, estimate in known]
    inside = shapely.box(*world.bounds)
    draw_ground(axes, world, measured, grown, inside, obstacle="obstacle as measured", grown=name)
    if mapped.scans is None:
        _draw_ellipses(axes, [estimate for _, estimate in known])
    _draw_trajectory(axes, mapped)


def _draw_ellipses(axes: Axes, estimates: list[ObstacleEstimate]) -> None:
    """Draw the ellipses of discs' centres; points lie within with probability PROBABILITY."""
    discs = [(estimate.mean, estimate.covariance) for estimate in estimates if isinstance(estimate.mean, Disc)]
    if not discs:
        return
    values, vectors = np.linalg.eigh(np.array([covariance[:2, :2] for _, covariance in discs]))
    # Chi-square with two degrees of freedom stays under −2·ln(1 − p) with probability p.
    half = np.sqrt(-2.0 * math.log(1.0 - PROBABILITY) * np.maximum(values, 0.0))
    typical = float(np.median(half[:, 1])) * points_per_metre(axes)
    scale = next((scale for scale in _SCALES if scale * typical >= _MIN_HALF_LENGTH), 1)
    long, short = 2.0 * scale * half[:, 1], 2.0 * scale * half[:, 0]
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    at = np.array([disc.center for disc, _ in discs])
    ellipses = EllipseCollection(long, short, angles, units="xy", offsets=at, offset_transform=axes.transData)
    ellipses.set(facecolors="none", edgecolors=LANDMARK, linewidths=1.0, zorder=4.0, path_effects=HALO)
    axes.add_collection(ellipses, autolim=False)
    # A tree would be lost on the map of a park.
    axes.plot(*at.T, "o", ms=1.6, mew=0, color=OBSTACLE, zorder=4.1)
    drawn = "" if scale == 1 else f", drawn {scale} × as large"
    axes.plot([], [], "o", color=LANDMARK, mfc="none", zorder=4.0, label=f"{PROBABILITY:.0%} ellipse{drawn}")


def _draw_trajectory(axes: Axes, mapped: MappedLog) -> None:
    poses = mapped.trajectory[:, 1:]
    if len(poses) == 0:
        return
    names = {"match": "scan matching", "slam": "EKF-SLAM", "log": "the log's poses", "odometry": "odometry alone"}
    style: dict[str, Any] = {"color": PATH, "lw": 0.9, "alpha": 0.9, "zorder": 3.5, "solid_joinstyle": "round"}
    axes.plot(*poses[:, :2].T, label=f"trajectory, by {names[mapped.poses]}", **style)
    if mapped.matched is not None:
        odometry = mapped.matched.odometry[:, :2]
        axes.plot(*odometry.T, color=LANDMARK, lw=0.7, ls=":", zorder=3.4, label="by odometry alone")
    for q, colour, marker, label in ((poses[0], START, "o", "its start"), (poses[-1], GOAL, "s", "its end")):
        draw_end(axes, mapped.world.robot, q, colour, marker, label)
