"""Layers: what a picture of a world, a plan or a roadmap shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from trailmark.arguments import truth
from trailmark.errors import ConfigurationError, expected_name

__all__ = ["ALL", "Layers"]


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

    def __post_init__(self) -> None:
        for field in fields(self):
            truth(getattr(self, field.name), f"layers: {field.name}:")

    @classmethod
    def of(cls, chosen: Mapping[str, bool]) -> Layers:
        """Return the default layers, but for those that are named.

        Raises:
            ConfigurationError: an unknown name, or a value that is neither True nor False.
        """
        for name in chosen:
            _require_layer(name)
        return cls(**chosen)

    @classmethod
    def parse(cls, text: str) -> Layers:
        """Return the layers that a shell argument names: ``obstacles,path`` and no other.

        Raises:
            ConfigurationError: an unknown name.
        """
        named = {_require_layer(name.strip()) for name in text.split(",")}
        chosen: dict[str, Any] = {field.name: field.name in named for field in fields(cls)}
        return cls(**chosen)


ALL = Layers()
"""What is shown by default."""


def _require_layer(name: str) -> str:
    names = [field.name for field in fields(Layers)]
    if name not in names:
        raise ConfigurationError(f"layers: {expected_name(name, names)}")
    return name
