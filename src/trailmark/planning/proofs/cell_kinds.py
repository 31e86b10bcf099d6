"""What a cell of SE(2) is: blocked, so that no path leads through it; else free or mixed, by which a flood is guided.

Source: Zhu & Latombe, "New heuristic algorithms for efficient hierarchical path planning", IEEE Trans. Robotics and
Automation 1991 (the three kinds).
"""

from __future__ import annotations

from math import cos, hypot, pi, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.distances import point_clearance, point_depth, ring_clearance
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import field_clearance, field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import callee, njit
from trailmark.planning.proofs.cells import (
    BLOCKED,
    FREE,
    LEVEL,
    MIXED,
    STATE,
    UNKNOWN,
    Division,
    I,
    J,
    K,
)
from trailmark.planning.proofs.region import MARGIN
from trailmark.se2 import FloatArray

__all__ = ["decided", "kind_of", "room_for_cores"]


@njit
def room_for_cores(division: Division) -> FloatArray:
    """Return room for any core, shape (v, 2)."""
    most = 1
    for ring in range(len(division.rings) - 1):
        most = max(most, division.rings[ring + 1] - division.rings[ring])
    return np.empty((most, 2))


@njit
def kind_of(
    cells: NDArray[np.int32],
    cell: int,
    division: Division,
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
    finest: int,
) -> int:
    """Return BLOCKED, FREE or MIXED, and take it down.

    Args:
        cells: the table, shape (n, COLUMNS or more).
        cell: which.
        division: how space is divided.
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint about the pivot.
        placed: room for any core, shape (v, 2).
        finest: the finest level: what its core is not clear of may still turn out to be blocked.
    """
    known = cells[cell, STATE]
    if known != UNKNOWN:
        return int(known)
    level = cells[cell, LEVEL]
    half = division.half[level]
    x, y = division.x0 + (2 * cells[cell, I] + 1) * half, division.y0 + (2 * cells[cell, J] + 1) * half
    theta = (2 * cells[cell, K] + 1) * pi / (1 << division.turns[level]) - pi
    found = decided(level, finest, x, y, cos(theta), sin(theta), division, grid, field, robot, placed)
    cells[cell, STATE] = found
    return found


@callee
def decided(
    level: int,
    finest: int,
    x: float,
    y: float,
    c: float,
    s: float,
    division: Division,
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
    placed: FloatArray,
) -> int:
    """Return what the cell of a level is, BLOCKED, FREE or MIXED, whose centre lies there, the heading by c and s."""
    enough = division.open[level] + MARGIN
    if field_clearance(field, robot, x, y, c, s, enough) >= enough:
        return FREE
    # The core lies deeper in the robot than touching and rounding reach, wherever in the cell the robot is.
    if _gap(level, 0.0, x, y, c, s, division, grid, robot.dilation, placed) <= 0.0:
        return BLOCKED
    if _deep(level, x, y, c, s, division, grid, field, robot):
        return BLOCKED
    return FREE if _gap(finest, enough, x, y, c, s, division, grid, robot.dilation, placed) >= enough else MIXED


@callee
def _gap(
    level: int,
    enough: float,
    x: float,
    y: float,
    c: float,
    s: float,
    division: Division,
    grid: ObstacleGrid,
    dilation: float,
    placed: FloatArray,
) -> float:
    """Return the clearance of a level's core, dilated, 0 on overlap; it may be less if above ``enough`` and MARGIN."""
    gap = max(enough, MARGIN)
    for ring in range(division.cores[level], division.cores[level + 1]):
        begin, end = division.rings[ring], division.rings[ring + 1]
        for k in range(begin, end):
            px, py = division.points[k, 0], division.points[k, 1]
            placed[k - begin, 0], placed[k - begin, 1] = c * px - s * py, s * px + c * py
        # The dilated core is as deep in the dilated robot as the core is in the robot.
        gap = min(gap, ring_clearance(grid, placed, end - begin, x, y, gap + dilation) - dilation)
        if gap <= 0.0:
            return 0.0
    return gap


@callee
def _deep(
    level: int,
    x: float,
    y: float,
    c: float,
    s: float,
    division: Division,
    grid: ObstacleGrid,
    field: ClearanceField,
    robot: Footprint,
) -> bool:
    """Return whether one of the robot's discs meets obstacles wherever in the cell the robot is.

    Distances change by no more than the disc's centre moves; below 0 they are depths.
    """
    shift, turn = sqrt(2.0) * division.half[level], 2.0 * sin(0.5 * pi / (1 << division.turns[level]))
    for k in range(len(robot.inner)):
        bx, by = robot.inner[k, 0], robot.inner[k, 1]
        px, py = x + c * bx - s * by, y + s * bx + c * by
        most = robot.inner[k, 2] - shift - turn * hypot(bx, by) - 2.0 * MARGIN
        # Outside of the grid everything is blocked, and the distances' own search has nothing to look at.
        across = max(grid.x0 - px, px - grid.x0 - grid.columns * grid.size)
        beyond = max(across, grid.y0 - py, py - grid.y0 - grid.rows * grid.size)
        if beyond > -MARGIN:
            if beyond >= MARGIN - most:
                return True
            continue
        if field_value(field, px, py) - field.slack >= max(most, 0.0):
            continue
        if most > 0.0:
            if point_clearance(grid, px, py, most) < most:
                return True
        elif point_depth(grid, px, py, MARGIN - most) >= MARGIN - most:
            return True
    return False
