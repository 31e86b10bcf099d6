"""What a path costs under an objective, by shapely and dense sampling alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import shapely

from trailmark import Objective, World
from trailmark.se2 import FloatArray
from trailmark.world.zones import CostZone, SpeedZone

__all__ = ["sampled_cost", "sampled_density"]


def sampled_density(world: World, objective: Objective, xy: FloatArray) -> FloatArray:
    """Return what a metre costs at places (n, 2), shape (n,)."""
    factor, speed = np.ones(len(xy)), np.full(len(xy), objective.max_speed)
    for zone in world.zones:
        # Along an outline the cheaper side counts.
        cheap = isinstance(zone, CostZone) and zone.factor < 1.0
        inside = (shapely.intersects_xy if cheap else shapely.contains_xy)(zone.region.shapely(), xy)
        if isinstance(zone, CostZone):
            factor[inside] *= zone.factor
        if isinstance(zone, SpeedZone):
            speed[inside] = np.minimum(speed[inside], zone.limit)
    density = objective.length * factor + objective.time / speed
    if objective.clearance:
        blocked = [shapely.box(*world.bounds).exterior, *(shape.polygon().shapely() for shape in world.obstacles)]
        distance = shapely.distance(shapely.union_all(blocked), shapely.points(xy))
        density += objective.clearance * np.exp(-distance / objective.decay)
    return np.asarray(density)


def sampled_cost(world: World, objective: Objective, states: FloatArray, step: float = 1e-3) -> float:
    """Return the cost of a path of straight motions, shape (n, 3), by the midpoint rule on pieces of a millimetre."""
    total = 0.0
    for a, b in pairwise(states):
        length = float(np.hypot(*(b - a)[:2]))
        count = max(1, int(np.ceil(length / step)))
        places = a[:2] + (np.arange(count)[:, None] + 0.5) / count * (b - a)[:2]
        turned = abs((b[2] - a[2] + np.pi) % (2.0 * np.pi) - np.pi)
        total += length * float(sampled_density(world, objective, places).mean()) + objective.rotation * turned
    return total
