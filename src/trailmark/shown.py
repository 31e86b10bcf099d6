"""What pictures show and in which colours; and how worlds, robots, roadmaps and results show themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from typing import Any

from trailmark.arguments import truth
from trailmark.errors import ConfigurationError, expected_name

__all__ = ["ALL", "Layers", "Shown"]

# Okabe & Ito's colours ("Color Universal Design", 2008), which colour-blind readers tell apart.
OBSTACLE, MARGIN, OUTSIDE, HATCH, TEXT = "#3f4249", "#c9ccd2", "#eceef1", "#b4b9c2", "#55585f"
START, GOAL, PATH, BODY, LANDMARK = "#009e73", "#d55e00", "#0072b2", "#d8e9f4", "#9c4a79"
COLLISION, REPAIRED = "#c1121f", "#cc79a7"
AVOID, PREFER, ONE_WAY, SPEED = "#e69f00", "#009e73", "#56b4e9", "#f0e442"
EDGE, CANDIDATE = "#dca6c5", "#ecdde5"  # tints of their purple: the roadmap is the path's background


@dataclass(frozen=True)
class Layers:
    """What a picture shows, as far as there is such a thing in it.

    Attributes:
        obstacles: what blocks the robot; what moves with an arrow to where it will be.
        margin: where the robot's reference point cannot be at any heading: obstacles and walls, grown.
        outside: what lies beyond bounds and boundary, hatched.
        zones: areas with a cost, a rule or a speed limit.
        clearance: the distance to the nearest obstacle as shades of colour, with contours. Not shown by default.
        queries: a world's queries, in pictures of worlds.
        edges: the roadmap's edges.
        landmarks: the roadmap's nodes.
        path: the line that the reference point follows.
        footprints: the robot along the path.
        ends: start and goal, with the robot there.
        progress: cost over time, beside pictures of plans that are written to files.
    """

    obstacles: bool = True
    margin: bool = True
    outside: bool = True
    zones: bool = True
    clearance: bool = False
    queries: bool = True
    edges: bool = True
    landmarks: bool = True
    path: bool = True
    footprints: bool = True
    ends: bool = True
    progress: bool = True

    @classmethod
    def of(cls, chosen: Mapping[str, bool]) -> Layers:
        """Return the default layers, but for those that are named.

        Raises:
            ConfigurationError: an unknown name, or a value that is neither True nor False.
        """
        names = [field.name for field in fields(cls)]
        for name, value in chosen.items():
            if name not in names:
                raise ConfigurationError(f"layers: {expected_name(name, names)}")
            truth(value, f"layers: {name}:")
        return cls(**chosen)


ALL = Layers()
"""What is shown by default."""


_PROMPT = "trailmark.plotting.prompt"
"""It stands above what it draws: the one hand-over upwards, by name."""


class Shown:
    """Draws itself into axes of matplotlib, and as a small picture where a notebook shows it."""

    def plot(self, ax: Any = None, *, robot: Any = None, roadmap: Any = None, **layers: bool) -> Any:
        """Draw this with matplotlib, and return the axes.

        Args:
            ax: :class:`matplotlib.axes.Axes` to draw on: limits and aspect are set, title and legend are left to you
                (``ax.legend()``). By default those of a new figure of :mod:`matplotlib.pyplot`, with both.
            robot: the :class:`trailmark.Robot` to draw; by default the one that this was made for.
            roadmap: a :class:`trailmark.Roadmap` to draw as well, such as ``planner.roadmap``.
            layers: what to show or not, such as ``margin=False``: :class:`trailmark.shown.Layers`.

        Raises:
            ConfigurationError: an unknown layer, or a result that does not know its world.
        """
        prompt = import_module(_PROMPT)
        return prompt.plot(prompt.scene_of(self, robot, roadmap), ax, layers)

    def _repr_png_(self) -> bytes:
        prompt = import_module(_PROMPT)
        picture: bytes = prompt.png_of(prompt.scene_of(self))
        return picture
