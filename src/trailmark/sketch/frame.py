"""Frame: where the points of a world lie in a picture, and what outlines and lines are there, in few characters."""

# Tested by tests/sketch/test_sketch.py and tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.formats.cell_obstacles import CellObstacles
from trailmark.shapes import Disc, Shape
from trailmark.sketch.cells import cells_image
from trailmark.sketch.svg import element, points, text
from trailmark.world import Robot, World

__all__ = ["Frame", "inside_of"]

FloatArray = NDArray[np.float64]

VERTEX, CIRCLE = 7.0, 40.0
"""Characters that one takes, about."""

MANY = 400
"""Obstacles from which on they are drawn as one region, without seams: few outlines for the cells of a grid map."""

SHARP = 0.5
"""Units of a cell's side above which cells stay sharp: pictures are shown at about twice their size."""


@dataclass(frozen=True)
class Frame:
    """A part of the plane as a picture, whose origin is its upper left corner.

    Attributes:
        left: metres.
        top: metres.
        width: metres.
        height: metres.
        scale: units of the picture a metre.
    """

    left: float
    top: float
    width: float
    height: float
    scale: float

    @classmethod
    def around(cls, bounds: tuple[float, float, float, float], pad: float, widest: float, tallest: float) -> Frame:
        """Return the frame of a box (xmin, ymin, xmax, ymax; metres).

        Args:
            bounds: of what is shown.
            pad: around it, as a share of its longer side.
            widest: units that the picture takes at most.
            tallest: units.
        """
        xmin, ymin, xmax, ymax = bounds
        pad *= max(xmax - xmin, ymax - ymin)
        width, height = xmax - xmin + 2.0 * pad, ymax - ymin + 2.0 * pad
        return cls(xmin - pad, ymax + pad, width, height, min(widest / width, tallest / height))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in units of the picture."""
        return self.width * self.scale, self.height * self.scale

    def at(self, xy: FloatArray) -> FloatArray:
        """Return where points (n, 2), metres, are in the picture."""
        return np.column_stack([xy[:, 0] - self.left, self.top - xy[:, 1]]) * self.scale

    def line(self, xy: FloatArray, closed: bool = False) -> str:
        """Return path data of a line through points (n, 2), metres, right to a quarter of a unit."""
        line = self.at(xy)
        if len(line) > 2 and not closed:
            line = shapely.get_coordinates(shapely.simplify(shapely.LineString(line), 0.25))
        return points(line[:, 0], line[:, 1], closed)

    def region(self, shapes: Any) -> str:
        """Return path data of the outlines and holes of polygons."""
        rings = shapely.get_rings(shapely.get_parts(np.asarray(shapes, dtype=object)))
        return "".join(self.line(shapely.get_coordinates(ring)[:-1], closed=True) for ring in rings)

    def bodies(self, robot: Robot, states: FloatArray) -> str:
        """Return path data of the robot's outline at configurations (n, 3)."""
        outlines = se2.transform(states, robot.outline.vertices)
        return "".join(self.line(outline, closed=True) for outline in outlines)

    def obstacles(self, shapes: Iterable[Shape], tolerance: float, fill: str, limit: float = math.inf) -> str:
        """Return obstacles as elements; those of a grid map as an image.

        Args:
            shapes: obstacles.
            tolerance: units of the picture by which outlines may be simplified.
            fill: their colour, such as ``#808080``.
            limit: characters of outlines, and of circles; where they would be more, outlines are simplified further,
                and what is small is left out.
        """
        cells: object = shapes
        if isinstance(cells, CellObstacles) and cells.upright:
            return self._cells(cells, fill)
        discs = [shape for shape in shapes if isinstance(shape, Disc)]
        rest = [shape.polygon().shapely() for shape in shapes if not isinstance(shape, Disc)]
        parts = []
        if rest:
            solid = shapely.union_all(np.array(rest, dtype=object)) if len(rest) > MANY else shapely.multipolygons(rest)
            rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(solid)))
            parts.append(element("path", d=self._rings(rings, tolerance, limit), fill=fill))
        if discs:
            discs = sorted(discs, key=lambda disc: -disc.radius)[: int(min(len(discs), limit / CIRCLE))]
            at, radii = self.at(np.array([disc.center for disc in discs])), [disc.radius * self.scale for disc in discs]
            circles = (
                element("circle", cx=x, cy=y, r=max(0.6, r)) for (x, y), r in zip(at.tolist(), radii, strict=True)
            )
            parts.append(element("g", "".join(circles), fill=fill))
        return "".join(parts)

    def _cells(self, cells: CellObstacles, fill: str) -> str:
        """Return the cells of a grid map as an image."""
        rows, columns = cells.occupied.shape
        ((left, top),) = self.at(np.array([[cells.origin[0], cells.origin[1] + rows * cells.cell]])).tolist()
        side = cells.cell * self.scale
        return element(
            "image",
            x=left,
            y=top,
            width=columns * side,
            height=rows * side,
            href=cells_image(cells.occupied, fill),
            preserveAspectRatio="none",
            style="image-rendering:" + ("pixelated" if side > SHARP else "auto"),
        )

    def _rings(self, rings: Any, tolerance: float, limit: float) -> str:
        """Return path data of rings, simplified further where they would take more characters than ``limit``."""
        while True:
            metres = tolerance / self.scale
            shown = shapely.simplify(rings, metres)
            if tolerance > 1.0:
                left, low, right, high = shapely.bounds(shown).T
                shown = shown[np.maximum(right - left, high - low) > metres]
            if VERTEX * shapely.get_num_coordinates(shown).sum() <= limit or tolerance > max(self.size):
                return "".join(self.line(shapely.get_coordinates(ring)[:-1], closed=True) for ring in shown)
            tolerance *= 2.0

    def ruler(self, **style: str) -> list[str]:
        """Return a bar of a round length below the picture, with its length in metres.

        Args:
            style: attributes of the bar; its text has the class ``tick``.
        """
        power = 10.0 ** math.floor(math.log10(0.3 * self.width))
        metres = max(power * m for m in (1.0, 2.0, 5.0) if power * m <= 0.3 * self.width)
        long, height = metres * self.scale, self.size[1]
        bar = element("path", d=f"M2 {height + 8:.1f}v6h{long:.1f}v-6", **style)
        return [bar, text(long + 8.0, height + 16.0, f"{metres:g} m", class_="tick")]


def inside_of(world: World) -> shapely.Geometry:
    """Return what lies inside bounds and boundary."""
    inside = shapely.box(*world.bounds)
    return inside if world.boundary is None else inside.intersection(world.boundary.shapely())
