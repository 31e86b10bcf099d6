"""Zones in pictures: cost tinted by its factor, keep-out hatched, one-way with an arrow, speed with its limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from matplotlib.colors import to_hex, to_rgb

from trailmark.colours import AVOID, COLLISION, ONE_WAY, PREFER, SPEED, TEXT
from trailmark.plotting.canvas import fill, points_per_metre
from trailmark.zones import CostZone, KeepOutZone, OneWayZone, SpeedZone, Zone

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_zones"]

FAINT, STRONG = 0.12, 0.6
"""Shares of its colour that a cost zone has for a factor of 1, and for one of 10 or 0.1 and beyond."""

ROOM = 14.0
"""Points that a zone is wide at least where a text or an arrow stands in it."""

NOTED = 12
"""Zones at most in which texts and arrows stand, the largest ones: a mask's are many."""


def draw_zones(axes: Axes, zones: Sequence[Zone]) -> None:
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
    note = axes.text(x, y, text, fontsize=7, color=TEXT, ha="center", va="center", zorder=1.8, clip_on=True)
    note.set(parse_math=False, rotation=90.0 if high - low > 2.0 * (right - left) else 0.0)
