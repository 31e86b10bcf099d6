"""The planner in the map that is known, and what changes with the map's cells."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.mapper import Draw
from trailmark.exploration.survey import Memory
from trailmark.planning import LandmarkPlanner
from trailmark.world import Robot, World

__all__ = ["Divided", "divided", "planner_in"]


class Divided(NamedTuple):
    """A map, its cells divided, and what goes with it."""

    known: KnownMap
    planner: LandmarkPlanner
    memory: Memory


def planner_in(known: KnownMap, name: str, robot: Robot, seed: int, clearance: float) -> LandmarkPlanner:
    """Return a planner in a map as it is.

    Args:
        known: the map.
        name: of the planner's world.
        robot: that it plans for.
        seed: of what is drawn.
        clearance: metres that paths keep.
    """
    world = known.follow(World(name, known.bounds, robot=robot))
    return LandmarkPlanner(world, robot, seed=seed, clearance=clearance)


def divided(
    draw: Draw,
    stopped: Callable[[], bool],
    planner: LandmarkPlanner,
    robot: Robot,
    memory: Memory,
    state: NDArray[np.uint8],
) -> Divided:
    """Draw a map of smaller cells, and what goes with it; in any thread, as long as the robot stands.

    Args:
        draw: draws it.
        stopped: asked between scans whether to end early, with part of a map.
        planner: in the map before.
        robot: that it plans for, without the clearance that it keeps.
        memory: of the exploration.
        state: of the cells before, UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
    """
    known = draw(stopped)
    finer = planner_in(known, planner.world.name, robot, planner.seed, planner.robot.clearance)
    remembered = memory.divided(state, known)
    remembered.find_levels(known, finer.robot)
    return Divided(known, finer, remembered)
