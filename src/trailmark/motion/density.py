"""Density: what a metre of the reference point's way costs at a place, and what that adds up to along a line.

Along a straight line the zones' part is exact, since a line crosses the border of a zone in points; what nearness to
obstacles costs is integrated by the midpoint rule. The distance d to the nearest obstacle changes by at most a metre a
metre, so over a piece of length 2r about a place the part exp(−d/λ) errs by at most

    exp(−d/λ) · (2λ·(exp(r/λ) − 1) − 2r),

the integral of exp((|u| − d)/λ) − exp(−d/λ) over −r <= u <= r.
"""

from __future__ import annotations

from math import exp, expm1, hypot
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.distances import point_clearance
from trailmark.collision.field import ClearanceField
from trailmark.collision.kernels import field_value
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.jit import array_callee, callee, njit
from trailmark.objective import Objective
from trailmark.se2 import FloatArray
from trailmark.world import World
from trailmark.zones import CostZone, SpeedZone

__all__ = ["Density", "build_density", "densities", "least_factor", "line_cost", "near_border", "sort_in_place"]

FAR = 4.0
"""Times the decay: from that distance on the clearance field is near enough, while nothing has to be proven."""

STEP = 0.2
"""Times the decay: how far apart nearness is evaluated, while nothing has to be proven."""


class Density(NamedTuple):
    """An objective in a world, as compiled code takes it.

    Attributes:
        edges: (e, 4), of all zones with a cost or a speed limit: x, y of one end and of the other, metres.
        zones: (z, 8): first edge and one behind the last, xmin, ymin, xmax, ymax, factor of the cost, speed limit.
        length: cost of a metre.
        time: cost of a second.
        clearance: cost of a metre at an obstacle, in addition.
        decay: metres over which that falls to 37 %.
        speed: metres per second where no zone limits it.
        rotation: cost of a radian.
        least: lower bound on the density wherever the reference point may be.
        most: upper bound on it, nearness to obstacles left out.
    """

    edges: FloatArray
    zones: FloatArray
    length: float
    time: float
    clearance: float
    decay: float
    speed: float
    rotation: float
    least: float
    most: float


def build_density(objective: Objective, world: World, farthest: float) -> Density:
    """Return the density of an objective in a world.

    Args:
        objective: weights.
        world: gives cost and speed zones.
        farthest: metres, no place of the world is farther from obstacles, boundary and bounds.
    """
    rows, edges = [], [np.empty((0, 4))]
    for zone in world.zones:
        factor = zone.factor if isinstance(zone, CostZone) else 1.0
        limit = zone.limit if isinstance(zone, SpeedZone) else np.inf
        # A speed limit matters only to who minds the time, a factor to who minds the length.
        if (factor == 1.0 or objective.length == 0.0) and (limit >= objective.max_speed or objective.time == 0.0):
            continue
        rings = [np.column_stack([ring, np.roll(ring, -1, axis=0)]) for ring in zone.region.rings()]
        own, first = np.concatenate(rings), sum(len(part) for part in edges)
        edges.append(own)
        rows.append([first, first + len(own), *own[:, :2].min(axis=0), *own[:, :2].max(axis=0), factor, limit])
    zones = np.array(rows, dtype=np.float64).reshape(-1, 8)
    least = objective.length * least_factor(zones) + objective.time / objective.max_speed
    least += objective.clearance * exp(-farthest / objective.decay)
    # Factors above 1 are bounded as their inverses are, which lie below 1.
    inverse = np.column_stack([zones[:, :6], 1.0 / zones[:, 6:7], zones[:, 7:]])
    most = objective.length / least_factor(inverse)
    most += objective.time / min(objective.max_speed, float(zones[:, 7].min(initial=np.inf)))
    return Density(
        np.ascontiguousarray(np.concatenate(edges)),
        zones,
        objective.length,
        objective.time,
        objective.clearance,
        objective.decay,
        objective.max_speed,
        objective.rotation,
        least * (1.0 - 1e-12),
        most,
    )


def least_factor(zones: FloatArray) -> float:
    """Return a lower bound on the product of factors at any place: of those below 1 whose boxes one of them meets."""
    cheap = zones[zones[:, 6] < 1.0]
    least = 1.0
    for zone in cheap:
        meets = (cheap[:, 2:4] <= zone[4:6]).all(axis=1) & (cheap[:, 4:6] >= zone[2:4]).all(axis=1)
        least = min(least, float(cheap[meets, 6].prod()))
    return least


@callee
def zones_density(density: Density, x: float, y: float) -> float:
    """Return what a metre costs at a place, nearness to obstacles left out."""
    factor, speed = 1.0, density.speed
    for z in range(len(density.zones)):
        zone = density.zones[z]
        if not (zone[2] <= x <= zone[4] and zone[3] <= y <= zone[5]):
            continue
        inside = False
        for e in range(int(zone[0]), int(zone[1])):
            ax, ay, bx, by = density.edges[e]
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                inside = not inside
        if inside:
            factor *= zone[6]
            speed = min(speed, zone[7])
    return float(density.length * factor + density.time / speed)


@callee
def density_at(density: Density, field: ClearanceField, x: float, y: float) -> float:
    """Return about what a metre costs at a place, the distance to obstacles taken from the field."""
    result = zones_density(density, x, y)
    if density.clearance > 0.0:
        result += density.clearance * exp(-field_value(field, x, y) / density.decay)
    return float(result)


@njit(nogil=True)
def densities(
    density: Density, field: ClearanceField, x0: float, y0: float, size: float, rows: int, columns: int
) -> NDArray[np.float32]:
    """Return about what a metre costs in the middle of each cell of a grid, shape (rows, columns)."""
    found = np.empty((rows, columns), np.float32)
    for row in range(rows):
        for column in range(columns):
            found[row, column] = density_at(density, field, x0 + (column + 0.5) * size, y0 + (row + 0.5) * size)
    return found


@njit(numbers=True)
def line_cost(
    density: Density,
    grid: ObstacleGrid,
    field: ClearanceField,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    tolerance: float,
) -> tuple[float, float]:
    """Return the cost of the straight line from a to b, and a bound on its error.

    Args:
        density: what a metre costs.
        grid: the obstacles.
        field: their clearance field.
        ax: metres.
        ay: metres.
        bx: metres.
        by: metres.
        tolerance: share of the cost that the error may come to; infinite: places as far apart as for planning.
    """
    length = hypot(bx - ax, by - ay)
    if length == 0.0:
        return 0.0, 0.0
    cost, error = _zones_cost(density, ax, ay, bx, by, length), 0.0
    if density.clearance == 0.0:
        return cost, 1e-12 * cost
    pieces = max(1, int(np.ceil(length / (STEP * density.decay))))
    for piece in range(pieces):
        near, off = _nearness(
            density, grid, field, ax, ay, bx, by, piece / pieces, 1.0 / pieces, length, tolerance * cost / length
        )
        cost += density.clearance * near
        error += density.clearance * off
    return cost, error + 1e-12 * cost


@callee
def _nearness(
    density: Density,
    grid: ObstacleGrid,
    field: ClearanceField,
    ax: float,
    ay: float,
    bx: float,
    by: float,
    begin: float,
    share: float,
    length: float,
    allowed: float,
) -> tuple[float, float]:
    """Return the integral of exp(−d/decay) over a share of a line, and a bound on its error.

    ``allowed`` is the error that a metre may have, in units of cost; the piece is halved until it is kept.
    """
    r, decay = 0.5 * share * length, density.decay
    t = begin + 0.5 * share
    x, y = ax + t * (bx - ax), ay + t * (by - ay)
    value = field_value(field, x, y)
    if value - field.slack > FAR * decay and allowed == np.inf:
        return 2.0 * r * exp(-value / decay), 0.0
    near = exp(-point_clearance(grid, x, y, value + field.slack) / decay)
    error = near * 2.0 * (decay * expm1(r / decay) - r)
    if density.clearance * error <= allowed * 2.0 * r or r < 1e-4 * decay:
        return 2.0 * r * near, error
    # As many parts as bring the error down, which falls with the square of their length.
    parts = int(np.ceil(np.sqrt(density.clearance * error / (allowed * 2.0 * r)))) + 1
    total, error = 0.0, 0.0
    part = r / parts
    for k in range(parts):
        t = begin + share * (k + 0.5) / parts
        x, y = ax + t * (bx - ax), ay + t * (by - ay)
        near = exp(-point_clearance(grid, x, y, field_value(field, x, y) + field.slack) / decay)
        total += 2.0 * part * near
        error += near * 2.0 * (decay * expm1(part / decay) - part)
    return total, error


@callee
def near_border(density: Density, ax: float, ay: float, bx: float, by: float, reach: float) -> bool:
    """Return whether a zone's border may come within ``reach`` (metres) of the line from a to b; never False if so."""
    dx, dy = bx - ax, by - ay
    x1, x2, y1, y2 = min(ax, bx) - reach, max(ax, bx) + reach, min(ay, by) - reach, max(ay, by) + reach
    off = reach * hypot(dx, dy)
    for e in range(len(density.edges)):
        px, py, qx, qy = density.edges[e]
        if max(px, qx) < x1 or min(px, qx) > x2 or max(py, qy) < y1 or min(py, qy) > y2:
            continue
        p, q = dx * (py - ay) - dy * (px - ax), dx * (qy - ay) - dy * (qx - ax)
        a, b = (qx - px) * (ay - py) - (qy - py) * (ax - px), (qx - px) * (by - py) - (qy - py) * (bx - px)
        wide = reach * hypot(qx - px, qy - py)
        if min(p, q) <= off and max(p, q) >= -off and min(a, b) <= wide and max(a, b) >= -wide:
            return True
    return False


@array_callee
def _zones_cost(density: Density, ax: float, ay: float, bx: float, by: float, length: float) -> float:
    """Return the cost of a straight line, nearness to obstacles left out: exact but for rounding."""
    x1, x2, y1, y2 = min(ax, bx), max(ax, bx), min(ay, by), max(ay, by)
    possible = 0
    for z in range(len(density.zones)):
        zone = density.zones[z]
        if zone[2] <= x2 and zone[4] >= x1 and zone[3] <= y2 and zone[5] >= y1:
            possible += int(zone[1] - zone[0])
    if possible == 0:
        return length * (density.length + density.time / density.speed)
    crossings = np.empty(possible + 2)
    crossings[0], crossings[1], count = 0.0, 1.0, 2
    dx, dy = bx - ax, by - ay
    for z in range(len(density.zones)):
        zone = density.zones[z]
        if not (zone[2] <= x2 and zone[4] >= x1 and zone[3] <= y2 and zone[5] >= y1):
            continue
        for e in range(int(zone[0]), int(zone[1])):
            px, py, qx, qy = density.edges[e]
            # Signed areas of the edge's ends beside the line, and of the line's ends beside the edge.
            p, q = dx * (py - ay) - dy * (px - ax), dx * (qy - ay) - dy * (qx - ax)
            if (p > 0.0) == (q > 0.0):
                continue
            a, b = (qx - px) * (ay - py) - (qy - py) * (ax - px), (qx - px) * (by - py) - (qy - py) * (bx - px)
            if (a > 0.0) != (b > 0.0):
                crossings[count] = a / (a - b)
                count += 1
    sort_in_place(crossings, count)
    cost = 0.0
    for k in range(count - 1):
        t = 0.5 * (crossings[k] + crossings[k + 1])
        cost += (crossings[k + 1] - crossings[k]) * zones_density(density, ax + t * dx, ay + t * dy)
    return cost * length


@njit(numbers=True)
def sort_in_place(values: FloatArray, count: int) -> None:
    """Sort the first ``count`` values, shape (n,), none NaN (Shell 1959, Knuth's gaps).

    numba's own sort takes ten times as long to compile.
    """
    gap = 1
    while 3 * gap < count:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, count):
            value, j = values[i], i
            while j >= gap and values[j - gap] > value:
                values[j] = values[j - gap]
                j -= gap
            values[j] = value
        gap //= 3
