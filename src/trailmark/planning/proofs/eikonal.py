"""Eikonal: lower bounds on ∫ density ds over all paths of the reference point, by a function of bounded slope.

A function w with w(start) = 0 whose slope is nowhere more than the density rises along a path by no more than what the
path costs; so a path to the goal costs at least w(goal). Here w is linear on triangles: each square of a grid is cut
into two, and the slope on a triangle is at most the least density that its square may have. Squares that the robot's
inscribed disc cannot be centred in bound nothing: no path leads there.

The fast marching method gives a function u whose slope is nearly that, but larger where fronts are curved: about the
start, behind corners. Let R(t) >= 1 be the largest ratio of slope and density among the triangles on which u takes the
value t. Then w = ∫ dt / R(t) from 0 to u keeps within the densities: on each triangle it differs between corners by
1/R times as much as u or less, along both of the legs.

Sources: viscosity subsolutions: Crandall & Lions, "Viscosity solutions of Hamilton-Jacobi equations", Trans. AMS 277,
1983; the method: Kimmel & Sethian, "Computing geodesic paths on manifolds", PNAS 95, 1998.
"""

from __future__ import annotations

from math import exp, hypot, sqrt

import numpy as np

from trailmark.collision.distances import point_clearance
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.heading import turn
from trailmark.jit import array_callee, callee, njit
from trailmark.motion import WeightedMotion
from trailmark.motion.density import FAR, Density
from trailmark.planning.fast_marching import march, on_diagonal
from trailmark.se2 import FloatArray

__all__ = ["Eikonal"]

SQUARES = 1 << 15
"""About how many the bounds are divided into."""

LEVELS = 1 << 12
"""Values of u that ratios are told apart for."""


class Eikonal:
    """Lower bounds for one weighted motion; densities of the squares are computed once.

    Args:
        motion: weighted.
    """

    def __init__(self, motion: WeightedMotion) -> None:
        self.motion = motion
        disc = motion.checker.robot.inscribed_disc
        # The reference point lies so much nearer to obstacles than the disc's centre, at most.
        self.radius = disc.radius - float(np.hypot(*disc.center))
        # Outside of the disc, it may lie outside of the bounds, too.
        beyond = motion.checker.robot.circumradius if self.radius < 0.0 else 0.0
        xmin, ymin, xmax, ymax = np.array(motion.checker.world.bounds) + beyond * np.array([-1.0, -1.0, 1.0, 1.0])
        self.x0, self.y0 = float(xmin), float(ymin)
        self.size = sqrt((xmax - xmin) * (ymax - ymin) / SQUARES)
        self.columns = max(2, int(np.ceil((xmax - xmin) / self.size)))
        self.rows = max(2, int(np.ceil((ymax - ymin) / self.size)))
        self._least: FloatArray | None = None

    def of(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a proven lower bound on the cost of every path between configurations, each of shape (3,)."""
        motion, shape = self.motion, (self.rows, self.columns)
        place = self.x0, self.y0, self.size
        if self._least is None:
            self._least = least_densities(
                motion.density, motion.checker.grid, motion.checker.field, *place, *shape, self.radius
            )
        found = float(_bound(self._least, *place, start[0], start[1], goal[0], goal[1]))
        car = motion.checker.robot.turning_radius is not None
        return found + (0.0 if car else motion.density.rotation * abs(turn(start[2], goal[2])))


@njit(nogil=True)
def least_densities(
    density: Density,
    grid: ObstacleGrid,
    field: ClearanceField,
    x0: float,
    y0: float,
    size: float,
    rows: int,
    columns: int,
    radius: float,
) -> FloatArray:
    """Return the least density in each square, shape (rows, columns), infinite where the robot cannot be.

    A zone counts wherever its border or its inside may meet the square.
    """
    found, reach = np.empty((rows, columns)), size * sqrt(0.5) * (1.0 + 1e-9)
    for row in range(rows):
        for column in range(columns):
            x, y = x0 + (column + 0.5) * size, y0 + (row + 0.5) * size
            farthest = field_value(field, x, y) + field.slack
            if density.clearance > 0.0 and farthest < FAR * density.decay:
                farthest = point_clearance(grid, x, y, farthest)
            farthest += reach
            if farthest < radius - 1e-6:
                found[row, column] = np.inf
                continue
            least = _least_of_zones(density, x, y, 0.5 * size * (1.0 + 1e-9))
            if density.clearance > 0.0:
                least += density.clearance * exp(-farthest / density.decay)
            found[row, column] = least * (1.0 - 1e-12)
    return found


@callee
def _least_of_zones(density: Density, x: float, y: float, half: float) -> float:
    """Return the least that a metre costs in a square about (x, y), nearness to obstacles left out."""
    factor, speed = 1.0, density.speed
    for z in range(len(density.zones)):
        zone = density.zones[z]
        if zone[2] > x + half or zone[4] < x - half or zone[3] > y + half or zone[5] < y - half:
            continue
        inside, border = False, False
        for e in range(int(zone[0]), int(zone[1])):
            ax, ay, bx, by = density.edges[e]
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside = not inside
            if _meets(ax - x, ay - y, bx - x, by - y, half):
                border = True
        # A square on the border has places in the zone and out of it: the cheaper of the two.
        if border or inside:
            if zone[6] < 1.0 or not border:
                factor *= zone[6]
            if not border:
                speed = min(speed, zone[7])
    return float(density.length * factor + density.time / speed)


@callee
def _meets(ax: float, ay: float, bx: float, by: float, half: float) -> bool:
    """Return whether the segment from a to b may meet the square about the origin; never False if it does."""
    if min(ax, bx) > half or max(ax, bx) < -half or min(ay, by) > half or max(ay, by) < -half:
        return False
    # The line's distance from the origin against the square's extent across it.
    dx, dy = bx - ax, by - ay
    return abs(ax * dy - ay * dx) <= half * (abs(dx) + abs(dy)) * (1.0 + 1e-9)


@njit
def _bound(least: FloatArray, x0: float, y0: float, size: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Return the bound from a to b by the least densities of squares; 0 where nothing can be told."""
    rows, columns = least.shape
    row, column = _square(ay, y0, size, rows), _square(ax, x0, size, columns)
    value = march(least, size, row, column)
    row, column = _square(by, y0, size, rows), _square(bx, x0, size, columns)
    lowest = value[row : row + 2, column : column + 2].min()
    if lowest == 0.0 or lowest == np.inf:
        return 0.0
    ratio = _ratios(value, least, size, lowest)
    return float((1.0 / ratio).sum() * lowest / len(ratio) * (1.0 - 1e-9))


@callee
def _square(place: float, begin: float, size: float, count: int) -> int:
    return min(count - 1, max(0, int(np.floor((place - begin) / size))))


@array_callee
def _ratios(value: FloatArray, least: FloatArray, size: float, highest: float) -> FloatArray:
    """Return the largest ratio of slope and density, >= 1, at equally wide levels of the value up to ``highest``."""
    ratio = np.ones(LEVELS)
    for row in range(least.shape[0]):
        for column in range(least.shape[1]):
            step = least[row, column] * size
            if step == np.inf:
                continue
            for a in range(2):
                for b in range(2):
                    if on_diagonal(row, column, a, b):
                        continue
                    corner = value[row + a, column + b]
                    across, along = value[row + 1 - a, column + b], value[row + a, column + 1 - b]
                    low, high = min(corner, across, along), max(corner, across, along)
                    if not low < highest:
                        continue
                    slope = hypot(across - corner, along - corner) / step
                    if slope > 1.0:
                        first = max(0, int(low / highest * LEVELS) - 1)
                        last = min(LEVELS - 1, int(min(high / highest, 1.0) * LEVELS) + 1)
                        for level in range(first, last + 1):
                            ratio[level] = max(ratio[level], slope)
    return ratio
