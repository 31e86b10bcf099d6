"""The shortest path of a disc robot, exact but for the chords that stand for round corners."""

from __future__ import annotations

import numpy as np
import shapely

from trailmark.motion import TranslationMotion
from trailmark.planning.proofs.mesh import shortest_point_path, triangulated
from trailmark.planning.proofs.prover import Prover, in_time
from trailmark.planning.proofs.region import Stop, ellipse, free_region
from trailmark.planning.query import Query
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["disc_path", "shortest_disc_path"]

TIME = 0.5
"""Share of the time left that it may take."""

SPARE = 3e-3
"""Share of its radius by which the disc is made larger: a motion along contact itself would take forever to certify."""


def shortest_disc_path(query: Query, proofs: Prover) -> bool:
    """Offer the shortest path of a disc; return False if there is no time for it, or none is found."""
    incumbent = query.incumbent
    if not isinstance(query.motion, TranslationMotion) or proofs.bound is None or query.close_enough:
        return False
    if not query.settings.uses("disc-path"):
        return False
    query.report("cutting free space into triangles")
    radius, (start, goal) = query.checker.robot.inscribed_disc.radius, query.ends[:, :2]
    world, most = query.checker.world, incumbent.cost
    bends = in_time(TIME * query.seconds_left(), lambda stop: disc_path(world, radius, start, goal, most, stop))
    if bends is None:
        return False
    states = np.column_stack([bends, np.zeros(len(bends))])
    if len(bends) == 0 or not query.motion.motions_between_valid(states[:-1], states[1:]).all():
        return False
    query.offer(states)
    query.offer(query.shortened(states))
    return True


def disc_path(
    world: World,
    radius: float,
    start: FloatArray,
    goal: FloatArray,
    most: float,
    stop: Stop | None = None,
) -> FloatArray:
    """Return the bends of a disc's shortest path, shape (k, 2), metres; (0, 2) if none is found.

    The obstacles are grown by the radius, with corners cut from outside, so that the disc is free all along. It errs on
    the safe side: a way through a gap hardly wider than the disc, or from a place in contact, may be missed.

    Source: Cui, Harabor & Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017.

    Args:
        world: obstacles, bounds, boundary.
        radius: of the disc, metres.
        start: its centre, shape (2,).
        goal: its centre, shape (2,).
        most: metres; longer ways are of no interest. The fewer obstacles lie near them, the sooner it is done.
        stop: asked now and then whether to stop, and find none.
    """
    within = ellipse(start, goal, most) if np.isfinite(most) else shapely.box(*world.bounds)
    try:
        region = free_region(world, (1.0 + SPARE) * radius, within, inner=True, stop=stop)
    except (shapely.errors.GEOSException, TimeoutError):
        return np.empty((0, 2))
    for part in shapely.get_parts(region):
        if shapely.intersects_xy(part, [start[0], goal[0]], [start[1], goal[1]]).all():
            mesh = triangulated(part)
            length, path = (np.inf, np.empty((0, 2))) if mesh is None else shortest_point_path(mesh, start, goal)
            return path if np.isfinite(length) else np.empty((0, 2))
    return np.empty((0, 2))
