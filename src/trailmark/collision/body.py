"""Body: a robot's region as the kernels of the audit take it, whole or without the rim that may touch."""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark.collision.footprint import TOUCHING_TOLERANCE, overlap_core
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import Robot

__all__ = ["Body", "core_of", "whole"]


class Body(NamedTuple):
    """A robot's region in its own frame: polygons, or a disc about the reference point. Lengths in metres.

    Attributes:
        vertices: (n, 2) of all outlines, one after another, counter-clockwise; the centre of a disc.
        following: (n,) the next vertex of the same outline.
        first: (outlines + 1,) where each outline begins.
        radius: of a disc; 0 for polygons.
        reach: largest distance of the region from the reference point.
        turning: largest distance of the region from the reference point as far as turning moves it: 0 for a disc.
    """

    vertices: FloatArray
    following: NDArray[np.int64]
    first: NDArray[np.int64]
    radius: float
    reach: float
    turning: float


def whole(robot: Robot) -> Body:
    """Return all of the robot."""
    if isinstance(robot.footprint, Disc):
        return _disc(robot.footprint.radius)
    return _polygons([robot.outline.rings()[0]])


def core_of(robot: Robot) -> Body:
    """Return what of the robot may meet no obstacle: all but a rim of 1e-7 m, since touching is allowed."""
    if isinstance(robot.footprint, Disc):
        radius = robot.footprint.radius
        return _disc(max(radius - TOUCHING_TOLERANCE, 0.5 * radius))
    outline = robot.outline.rings()[0]
    parts = [shapely.orient_polygons(part) for part in overlap_core(outline)]
    return _polygons([shapely.get_coordinates(part.exterior)[:-1] for part in parts] or [outline])


def _disc(radius: float) -> Body:
    return Body(np.zeros((1, 2)), np.zeros(1, np.int64), np.array([0, 1]), radius, radius, 0.0)


def _polygons(rings: list[FloatArray]) -> Body:
    vertices = np.ascontiguousarray(np.concatenate(rings))
    first = np.cumsum([0, *map(len, rings)])
    following = np.concatenate([np.roll(np.arange(a, b), -1) for a, b in pairwise(first)])
    reach = float(np.hypot(*vertices.T).max())
    return Body(vertices, following, first, 0.0, reach, reach)
