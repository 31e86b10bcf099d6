"""Pictures of worlds: obstacles, start and goal with the robot's outline and heading, paths as lines."""

# Tested by tests/benchmark/report/test_details.py.
from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from trailmark.benchmark.problems import Problem, read_problem
from trailmark.errors import TrailmarkError
from trailmark.sketch.frame import FloatArray, Frame, inside_of
from trailmark.sketch.svg import element, points, text
from trailmark.zones import KeepOutZone

__all__ = ["Scene", "Worlds", "scene_of"]

OBSTACLE = "#565c66"  # lighter than in other pictures: lines of black lie over it
WIDTH, TALLEST = 400.0, 520.0
MAX_CHARACTERS = 60_000.0  # of a world's outlines, and of its discs
MARGIN = 0.02  # of the longer side
BODIES = 9  # robots drawn along the best path
REACH = 7.0  # a robot smaller than this gets a larger mark at its ends
ZOOM = 2.0  # half a pixel at this enlargement is what curves are true to


@dataclass(frozen=True)
class Scene:
    """A problem as a picture, in parts: its world, its ends, and lines through it.

    Attributes:
        problem: world, robot, query.
    """

    problem: Problem

    @cached_property
    def _frame(self) -> Frame:
        return Frame.around(self.problem.world.bounds, MARGIN, WIDTH, TALLEST)

    @property
    def size(self) -> tuple[float, float]:
        """Of the picture, in the units of its view box; the scale bar's line included."""
        width, height = self._frame.size
        return width, height + 24.0

    def background(self) -> str:
        """Return what problems in the same world share: its free space, its obstacles and the scale bar."""
        frame, world = self._frame, self.problem.world
        width, height = frame.size
        parts = [element("rect", width=width, height=height, class_="outside")]
        parts.append(element("path", d=frame.region([inside_of(world)]), class_="free"))
        # Apart from one another, so that the cells of a grid map stay cells.
        solid = (world.obstacles, tuple(zone.region for zone in world.zones if isinstance(zone, KeepOutZone)))
        parts += [frame.obstacles(shapes, 0.5 / ZOOM, OBSTACLE, MAX_CHARACTERS) for shapes in solid]
        return "".join([*parts, *frame.ruler(class_="axis")])

    def ends(self) -> str:
        """Return start and goal: the robot there, its heading, and a letter."""
        query = self.problem.query
        return "".join([*self._end(query.start, "S", "start"), *self._end(query.pose(), "G", "goal")])

    def line(self, states: FloatArray) -> str:
        """Return path data of the motions through states, shape (n, 3)."""
        return self._frame.line(self.problem.path(states).states[:, :2])

    def bodies(self, states: FloatArray) -> str:
        """Return path data of the robot's outline at a few configurations along a path."""
        along = self.problem.path(states).at(np.linspace(0.0, 1.0, BODIES)[1:-1])
        return self._frame.bodies(self.problem.robot, along)

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


class Worlds:
    """Pictures of the worlds of many problems, each drawn once: reading a large one takes seconds.

    Attributes:
        pictures: what :meth:`Scene.background` returned, in the order in which they were needed.
    """

    def __init__(self) -> None:
        self.pictures: list[str] = []
        self._numbers: dict[bytes, int] = {}

    def scene(self, text: str) -> tuple[Scene, int] | None:
        """Return a problem's scene, for all but its background, and the number of its world's picture.

        None where the text is no problem that can be drawn.
        """
        # The same but for the queries: the same world.
        key = hashlib.sha256(_without("queries", text).encode()).digest()
        if key not in self._numbers:
            scene = scene_of(text)
            if scene is None:
                return None
            self._numbers[key] = len(self.pictures)
            self.pictures.append(scene.background())
        else:
            scene = scene_of(_without("grid", _without("obstacles", text))) or scene_of(text)
        return None if scene is None else (scene, self._numbers[key])


def _without(name: str, text: str) -> str:
    """Return a world file's text without one of its keys; whole where a list is not written a line an item."""
    return re.sub(rf"^{name}:.*\n(?:[ -].*\n?)*", "", text, flags=re.MULTILINE)


def scene_of(text_of_world: str) -> Scene | None:
    """Return the scene of a problem's text; None where the text is no problem that can be drawn."""
    try:
        return Scene(read_problem(text_of_world))
    except (TrailmarkError, IndexError):
        return None
