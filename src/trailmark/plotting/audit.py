"""Pictures of audits: a path, where it collides, and where it comes nearest to an obstacle."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb

from trailmark import se2
from trailmark.audit.attribution import merged_intervals
from trailmark.audit.scale import Scale
from trailmark.colours import COLLISION, REPAIRED, TEXT
from trailmark.plotting.canvas import annotate, figure_of, picture_of, write
from trailmark.plotting.plan import draw_plan
from trailmark.plotting.world import draw_world

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from trailmark.audit import PathAudit
    from trailmark.path import Path
    from trailmark.world import Robot, World

__all__ = ["draw_audit", "save_audit_figure"]

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
    scale = Scale(audit.path.states, robot.circumradius)
    for begin, end in merged_intervals([scale.interval(c.motions) for c in audit.collisions]):
        stretch = scale.part(begin, end)
        count = int(np.clip(2 + (end - begin) / robot.circumradius, 2, SHOWN))
        places = se2.transform(scale.poses(np.linspace(begin, end, count)), robot.outline.vertices)
        bodies = PolyCollection(list(places), facecolors=(*to_rgb(COLLISION), 0.25), edgecolors=COLLISION)
        bodies.set(linewidths=0.8, zorder=6.2)
        axes.add_collection(bodies, autolim=False)
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
