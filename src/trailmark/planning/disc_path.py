"""The shortest path of a disc robot, exact but for the chords that stand for round corners."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
import shapely

from trailmark.motion import TranslationMotion
from trailmark.planning.proofs.bound import CUTTING, SLOWER, region_work
from trailmark.planning.proofs.mesh import triangulated
from trailmark.planning.proofs.polyanya import shortest_point_path
from trailmark.planning.proofs.prover import Prover
from trailmark.planning.proofs.region import ellipse, free_region
from trailmark.planning.query import Query
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["disc_path", "shortest_disc_path"]

SPARE = 3e-3
"""Share of its radius by which the disc is made larger: a motion along contact itself would take forever to certify."""


def shortest_disc_path(query: Query, proofs: Prover) -> bool:
    """Offer the shortest path of a disc; return False if there is no time for it, or none is found."""
    incumbent = query.incumbent
    if (
        not isinstance(query.motion, TranslationMotion)
        or query.motion.weighted
        or proofs.bound is None
        or query.close_enough
    ):
        return False
    if not query.settings.uses("disc-path"):
        return False
    # Its region takes longer to make than the bound's, which has fewer corners.
    if 1.2 * proofs.seconds() > query.seconds_left():
        return False
    query.report("cutting free space into triangles")
    radius, (start, goal) = query.checker.robot.inscribed_disc.radius, query.ends[:, :2]
    bends = disc_path(query.checker.world, radius, start, goal, incumbent.cost, query.seconds_left)
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
    seconds_left: Callable[[], float] = lambda: np.inf,
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
        seconds_left: until when it is to be done, or none is found; asked for what may take long, too.
    """
    by = perf_counter() + seconds_left()
    within = ellipse(start, goal, most) if np.isfinite(most) else shapely.box(*world.bounds)
    try:
        region = free_region(world, (1.0 + SPARE) * radius, within, inner=True, by=by)
    except (shapely.errors.GEOSException, TimeoutError):
        return np.empty((0, 2))
    for part in shapely.get_parts(region):
        if shapely.intersects_xy(part, [start[0], goal[0]], [start[1], goal[1]]).all():
            if SLOWER * CUTTING * region_work(int(shapely.get_num_coordinates(part))) > seconds_left():
                break
            mesh = triangulated(part)
            length, path = (np.inf, np.empty((0, 2))) if mesh is None else shortest_point_path(mesh, start, goal)
            return path if np.isfinite(length) else np.empty((0, 2))
    return np.empty((0, 2))
