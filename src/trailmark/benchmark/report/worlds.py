"""Pictures of worlds: obstacles, start and goal with the robot's outline and heading, a path of each planner."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import se2
from trailmark.benchmark.problems import Problem, read_problem
from trailmark.benchmark.report.charts import WIDTH
from trailmark.benchmark.report.palette import Style
from trailmark.benchmark.report.svg import drawing, element, points, text
from trailmark.errors import TrailmarkError
from trailmark.keep_out import with_keep_outs
from trailmark.shapes import Disc

__all__ = ["Scene", "scene_of"]

FloatArray = NDArray[np.float64]

TALLEST = 520.0
MARGIN = 0.02  # of the longer side
BODIES = 9  # robots drawn along the best path
REACH = 7.0  # a robot smaller than this gets a larger mark at its ends
ZOOM = 2.0  # half a pixel at this enlargement is what curves are true to


@dataclass(frozen=True)
class Scene:
    """A problem as a picture: what all pictures of it share is drawn once.

    Attributes:
        problem: world, robot, query.
        key: tells the background from all others on the page.
    """

    problem: Problem
    key: int

    @property
    def _view(self) -> tuple[float, float, float, float, float]:
        """Left, top and size of the view in metres, and pixels a metre."""
        xmin, ymin, xmax, ymax = self.problem.world.bounds
        pad = MARGIN * max(xmax - xmin, ymax - ymin)
        width, height = xmax - xmin + 2 * pad, ymax - ymin + 2 * pad
        scale = min(WIDTH / width, TALLEST / height)
        return xmin - pad, ymax + pad, width, height, scale

    @property
    def height(self) -> float:
        """Of the picture, in the units of its view box; the scale bar's line included."""
        return self._view[3] * self._view[4] + 24.0

    def background(self) -> str:
        """Return the definition of the world's picture, which :meth:`picture` refers to; once a page."""
        _, _, width, height, scale = self._view
        pixel = 0.5 / (scale * ZOOM)
        world = self.problem.world
        inside = shapely.box(*world.bounds)
        if world.boundary is not None:
            inside = inside.intersection(world.boundary.shapely())
        parts = [element("rect", width=width * scale, height=height * scale, class_="outside")]
        parts.append(element("path", d=self._region([inside]), class_="free"))
        discs, rest = [], []
        for shape in with_keep_outs(world).obstacles:
            if isinstance(shape, Disc):
                (x, y), r = self._at(np.array([shape.center]))[0], max(0.6, shape.radius * scale)
                discs.append(element("circle", cx=float(x), cy=float(y), r=float(r)))
            else:
                rest.append(shape.polygon().shapely())
        if rest:
            # Cells of a grid map become few outlines, without seams.
            solid = shapely.union_all(np.array(rest, dtype=object)) if len(rest) > 400 else shapely.multipolygons(rest)
            parts.append(element("path", d=self._region([shapely.simplify(solid, pixel)]), class_="solid"))
        if discs:
            parts.append(element("g", "".join(discs), class_="solid"))
        return element("g", "".join(parts), id=f"w{self.key}")

    def picture(
        self,
        paths: Mapping[str, FloatArray],
        styles: Mapping[str, Style],
        best: FloatArray | None,
        refused: Sequence[FloatArray],
        label: str,
    ) -> str:
        """Return the world with paths in it.

        Args:
            paths: states of shape (n, 3), by planner; the last is drawn on top.
            styles: of each planner.
            best: states of the path that the robot is drawn along.
            refused: paths that the referee did not accept.
            label: the text alternative.
        """
        height = self._view[3] * self._view[4]
        clip = f"v{self.key}"
        parts = [element("use", href=f"#w{self.key}")]
        if best is not None:
            parts.append(self._bodies(best))
        parts += [element("path", d=self._path(states), class_="refused mark") for states in refused]
        for name, states in paths.items():
            style = styles[name]
            title = element("title", name.replace("&", "&amp;").replace("<", "&lt;"))
            parts.append(element("path", d=self._path(states), class_="halo-line", stroke_width=style.width + 1.6))
            parts.append(
                element(
                    "path",
                    title,
                    d=self._path(states),
                    stroke=style.colour,
                    stroke_width=style.width,
                    stroke_dasharray=style.dash or None,
                    class_="line mark",
                )
            )
        query = self.problem.query
        parts += self._end(query.start, "S", "start")
        parts += self._end(query.pose(), "G", "goal")
        frame = element("clipPath", element("rect", width=WIDTH, height=height), id=clip)
        whole = [frame, element("g", "".join(parts), clip_path=f"url(#{clip})"), *self._ruler(height)]
        return drawing(self._view[2] * self._view[4], self.height, label, whole, "chart world")

    def _at(self, points: FloatArray) -> FloatArray:
        left, top, _, _, scale = self._view
        return np.column_stack([points[:, 0] - left, top - points[:, 1]]) * scale

    def _path(self, states: FloatArray) -> str:
        line = self._at(self.problem.path(states).states[:, :2])
        if len(line) > 2:
            line = shapely.get_coordinates(shapely.simplify(shapely.LineString(line), 0.25))
        return _drawn(line)

    def _region(self, shapes: Sequence[shapely.Geometry]) -> str:
        rings = shapely.get_rings(shapely.get_parts(np.array(shapes, dtype=object)))
        return "".join(_drawn(self._at(shapely.get_coordinates(ring))[:-1], closed=True) for ring in rings)

    def _bodies(self, states: FloatArray) -> str:
        along = self.problem.path(states).at(np.linspace(0.0, 1.0, BODIES)[1:-1])
        outlines = se2.transform(along, self.problem.robot.outline.vertices)
        return element("path", d="".join(_drawn(self._at(o), closed=True) for o in outlines), class_="body")

    def _end(self, configuration: tuple[float, float, float], letter: str, kind: str) -> list[str]:
        """Return the robot at an end, an arrow along its heading, and a letter beside it."""
        scale = self._view[4]
        robot = self.problem.robot
        q = np.array(configuration)
        outline = self._at(se2.transform(q, robot.outline.vertices))
        x, y = self._at(q[None, :2])[0].tolist()
        size = robot.circumradius * scale
        parts = [element("path", d=_drawn(outline, closed=True), class_=f"end {kind}")]
        if size < REACH:
            parts.append(element("circle", cx=x, cy=y, r=REACH - 2.0, class_=f"end {kind}"))
        reach = max(size, REACH) + 5.0
        cos, sin = math.cos(q[2]), -math.sin(q[2])
        tip = np.array([x + reach * cos, y + reach * sin])
        wings = [tip - 5.0 * np.array([cos, sin]) + side * np.array([-sin, cos]) for side in (3.0, -3.0)]
        parts.append(
            element(
                "path",
                d=_drawn(np.array([[x, y], tip - 3.0 * np.array([cos, sin])])),
                class_=f"heading {kind}",
            )
        )
        parts.append(element("path", d=_drawn(np.array([tip, *wings]), closed=True), class_=f"tip {kind}"))
        # Behind the robot, where no arrow is.
        aside = max(size, REACH) + 8.0
        place = min(max(x - aside * cos, 8.0), self._view[2] * scale - 8.0)
        below = min(max(y - aside * sin + 4.0, 13.0), self._view[3] * scale - 4.0)
        parts.append(text(place, below, letter, class_=f"letter {kind}", text_anchor="middle"))
        return parts

    def _ruler(self, height: float) -> list[str]:
        """Return a bar of a round length, in metres."""
        width, scale = self._view[2], self._view[4]
        power = 10.0 ** math.floor(math.log10(0.3 * width))
        metres = max(power * m for m in (1.0, 2.0, 5.0) if power * m <= 0.3 * width)
        long = metres * scale
        bar = element("path", d=f"M2 {height + 8:.1f}v6h{long:.1f}v-6", class_="axis")
        return [bar, text(long + 8.0, height + 16.0, f"{metres:g} m", class_="tick")]


def scene_of(text_of_world: str, key: int) -> Scene | None:
    """Return the scene of a problem's text; None where the text is no problem that can be drawn."""
    try:
        return Scene(read_problem(text_of_world), key)
    except (TrailmarkError, IndexError):
        return None


def _drawn(line: FloatArray, closed: bool = False) -> str:
    """Return path data of points, shape (n, 2), in the picture's coordinates."""
    return points(line[:, 0], line[:, 1], closed)
