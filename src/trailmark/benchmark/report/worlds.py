"""Pictures of worlds: obstacles, start and goal with the robot's outline and heading, a path of each planner."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trailmark.benchmark.problems import Problem, read_problem
from trailmark.benchmark.report.charts import WIDTH
from trailmark.benchmark.report.palette import Style
from trailmark.errors import TrailmarkError
from trailmark.keep_out import with_keep_outs
from trailmark.sketch.frame import FloatArray, Frame, inside_of
from trailmark.sketch.svg import drawing, element, points, text

__all__ = ["Scene", "scene_of"]

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
    def _frame(self) -> Frame:
        return Frame.around(self.problem.world.bounds, MARGIN, WIDTH, TALLEST)

    @property
    def height(self) -> float:
        """Of the picture, in the units of its view box; the scale bar's line included."""
        return self._frame.size[1] + 24.0

    def background(self) -> str:
        """Return the definition of the world's picture, which :meth:`picture` refers to; once a page."""
        frame, world = self._frame, self.problem.world
        width, height = frame.size
        parts = [element("rect", width=width, height=height, class_="outside")]
        parts.append(element("path", d=frame.region([inside_of(world)]), class_="free"))
        parts.append(frame.obstacles(with_keep_outs(world).obstacles, 0.5 / ZOOM, {"class_": "solid"}))
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
        width, height = self._frame.size
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
        whole = [frame, element("g", "".join(parts), clip_path=f"url(#{clip})"), *self._frame.ruler(class_="axis")]
        return drawing(width, self.height, label, whole, "chart world")

    def _path(self, states: FloatArray) -> str:
        return self._frame.line(self.problem.path(states).states[:, :2])

    def _bodies(self, states: FloatArray) -> str:
        along = self.problem.path(states).at(np.linspace(0.0, 1.0, BODIES)[1:-1])
        return element("path", d=self._frame.bodies(self.problem.robot, along), class_="body")

    def _end(self, configuration: tuple[float, float, float], letter: str, kind: str) -> list[str]:
        """Return the robot at an end, an arrow along its heading, and a letter beside it."""
        frame, robot = self._frame, self.problem.robot
        q = np.array(configuration)
        x, y = frame.at(q[None, :2])[0].tolist()
        size = robot.circumradius * frame.scale
        parts = [element("path", d=frame.bodies(robot, q[None]), class_=f"end {kind}")]
        if size < REACH:
            parts.append(element("circle", cx=x, cy=y, r=REACH - 2.0, class_=f"end {kind}"))
        reach = max(size, REACH) + 5.0
        cos, sin = math.cos(q[2]), -math.sin(q[2])
        tip = np.array([x + reach * cos, y + reach * sin])
        wings = [tip - 5.0 * np.array([cos, sin]) + side * np.array([-sin, cos]) for side in (3.0, -3.0)]
        parts.append(
            element(
                "path",
                d=points(*np.array([[x, y], tip - 3.0 * np.array([cos, sin])]).T),
                class_=f"heading {kind}",
            )
        )
        parts.append(
            element(
                "path",
                d=points([tip[0], *(w[0] for w in wings)], [tip[1], *(w[1] for w in wings)], closed=True),
                class_=f"tip {kind}",
            )
        )
        # Behind the robot, where no arrow is.
        aside = max(size, REACH) + 8.0
        place = min(max(x - aside * cos, 8.0), frame.size[0] - 8.0)
        below = min(max(y - aside * sin + 4.0, 13.0), frame.size[1] - 4.0)
        parts.append(text(place, below, letter, class_=f"letter {kind}", text_anchor="middle"))
        return parts


def scene_of(text_of_world: str, key: int) -> Scene | None:
    """Return the scene of a problem's text; None where the text is no problem that can be drawn."""
    try:
        return Scene(read_problem(text_of_world), key)
    except (TrailmarkError, IndexError):
        return None
