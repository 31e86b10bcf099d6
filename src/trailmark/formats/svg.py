"""A path in its world as SVG: a drawing to scale, 1:100, whose coordinates are metres, y up, exactly as planned.

For drawing programs and documents; ``--plot`` makes pictures with axes.
"""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

import numpy as np

from trailmark import se2
from trailmark.path import Path
from trailmark.robot import Robot
from trailmark.shapes import Disc, Shape
from trailmark.world import World
from trailmark.zones import KeepOutZone

__all__ = ["drawing_text"]

_HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" xmlns:dc="http://purl.org/dc/elements/1.1/" width="{width!r}cm" '
    'height="{height!r}cm" viewBox="{left!r} {top!r} {width!r} {height!r}">\n'
    "<metadata><dc:title>trailmark</dc:title></metadata>\n<title>{title}</title>\n"
)
_MARGIN, _STROKE = 0.02, 0.003
"""Shares of the world's larger side."""

BODIES = 40
"""Places along the path at which the robot is drawn, at most."""


def drawing_text(world: World, robot: Robot, path: Path | None) -> str:
    """Return the drawing: bounds, boundary, zones, obstacles, the path, and the robot at places along it.

    Each is a ``path`` of its own with a ``class``, discs are circles; their coordinates are those of the world.

    Args:
        world: what there is.
        robot: drawn at start, goal, and about every length of its own.
        path: None draws the world alone.
    """
    xmin, ymin, xmax, ymax = world.bounds
    size = max(xmax - xmin, ymax - ymin)
    margin, stroke = _MARGIN * size, _STROKE * size
    box = {"left": xmin - margin, "top": -ymax - margin}
    box |= {"width": xmax - xmin + 2.0 * margin, "height": ymax - ymin + 2.0 * margin}
    corners = np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]])
    parts = [_HEAD.format(**box, title=escape(world.name))]
    parts.append(f'<g transform="scale(1 -1)" stroke-width="{stroke!r}" fill="none" stroke="none">')
    parts.append(_element("bounds", [corners], 'fill="#ffffff" stroke="#333333"'))
    if world.boundary is not None:
        parts.append(_element("boundary", world.boundary.rings(), 'stroke="#333333"'))
    for zone in world.zones:
        colour = "#d95f02" if isinstance(zone, KeepOutZone) else "#7570b3"
        parts.append(_element(f"zone {zone.kind}", zone.region.rings(), f'fill="{colour}" fill-opacity="0.25"'))
    parts += [_shape("obstacle", shape, 'fill="#666666"') for shape in world.obstacles]
    if path is not None:
        count = int(np.clip(path.cost / (2.0 * robot.circumradius), 1, BODIES))
        for q in path.at(np.linspace(0.0, 1.0, count + 1)):
            outline = se2.transform(q, robot.outline.vertices)
            parts.append(_element("robot", [outline], 'stroke="#1b9e77" stroke-opacity="0.6"'))
        line = "M" + "L".join(map(_point, path.states[:, :2].tolist()))
        parts.append(f'<path class="path" d="{line}" stroke="#e7298a" stroke-linejoin="round"/>')
    return "\n".join([*parts, "</g>", "</svg>", ""])


def _shape(name: str, shape: Shape, style: str) -> str:
    if isinstance(shape, Disc):
        (x, y), r = shape.center, shape.radius
        return f'<circle class="{name}" cx="{x!r}" cy="{y!r}" r="{r!r}" {style}/>'
    return _element(name, shape.polygon().rings(), style)


def _element(name: str, rings: Iterable[se2.FloatArray], style: str) -> str:
    line = "".join("M" + "L".join(map(_point, ring.tolist())) + "Z" for ring in rings)
    return f'<path class="{name}" d="{line}" fill-rule="evenodd" {style}/>'


def _point(point: list[float]) -> str:
    return f"{point[0]!r} {point[1]!r}"
