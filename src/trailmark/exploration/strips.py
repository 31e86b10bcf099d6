"""Strips along the bounds that are closed to a robot that does not know exactly where in them it is."""

from __future__ import annotations

from typing import Final

import numpy as np

from trailmark.exploration.known_map import KnownMap
from trailmark.se2 import FloatArray
from trailmark.shapes import Rectangle
from trailmark.world import Robot

__all__ = ["bounds_margins", "cells_that_meet", "strips_along"]

PARTS: Final = 4
"""Of a cell's side, to a whole number of which strips are widened: few readings change them."""


def bounds_margins(covariance: FloatArray, robot: Robot, deviations: float) -> FloatArray:
    """Return how far the robot must stay away from the bounds along x and along y, metres, shape (2,).

    The bounds are known in the frame that the robot began in: no detection tells where they are. The farther it has
    driven, the less certain its pose is in that frame, so that strips become wider on the way.

    Args:
        covariance: of the robot's pose in the axes of the bounds, shape (3, 3).
        robot: whose farthest point an error of the heading moves.
        deviations: standard deviations to keep.
    """
    x, y, heading = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # Not the root of squares: an error of the heading and the one of the place that it has led to are correlated.
    return np.asarray(deviations * (np.array([x, y]) + heading * robot.sweep_radius))


def strips_along(known: KnownMap, margins: FloatArray) -> dict[str, Rectangle]:
    """Return strips along the inside of the bounds, by name, at least as wide as the margins along x and y, metres."""
    xmin, ymin, xmax, ymax = known.bounds
    width, height, part = xmax - xmin, ymax - ymin, known.cell / PARTS
    dx, dy = np.minimum(part * np.ceil(margins / part), (width, height)).tolist()
    x, y, strips = 0.5 * (xmin + xmax), 0.5 * (ymin + ymax), dict[str, Rectangle]()
    if dx > 0.0:
        strips["bounds-left"] = Rectangle((xmin + 0.5 * dx, y), dx, height)
        strips["bounds-right"] = Rectangle((xmax - 0.5 * dx, y), dx, height)
    if dy > 0.0:
        strips["bounds-bottom"] = Rectangle((x, ymin + 0.5 * dy), width, dy)
        strips["bounds-top"] = Rectangle((x, ymax - 0.5 * dy), width, dy)
    return strips


def cells_that_meet(known: KnownMap, strip: Rectangle) -> tuple[slice, slice]:
    """Return the rows and columns of the cells that a strip meets."""
    half = 0.5 * np.array([strip.length, strip.width]) - 1e-9 * known.cell
    rows, columns = known.cells_of(np.asarray(strip.center) + np.array([-half, half]))
    return slice(int(rows[0]), int(rows[1]) + 1), slice(int(columns[0]), int(columns[1]) + 1)
