"""Worlds of walls with one narrow, tilted passage each, from a seed: feasible by the way they are made."""

from __future__ import annotations

import math

import numpy as np

from trailmark.shapes import Polygon
from trailmark.world import Query, Robot, World

__all__ = ["passage_world"]

LENGTH, WIDTH = 1.2, 0.6
"""Of the robot, metres."""

ROOM = 3.0
"""Metres between two walls: twice what the robot takes to turn on the spot, and more."""


def passage_world(seed: int, walls: int = 3) -> World:
    """Return a world of rooms in a row; the robot gets from each to the next by one passage.

    A passage is a straight slit through a wall 0.4 to 1.5 m thick, tilted by up to 0.5 rad, 0.15 to 0.35 m wider than
    the robot. Since a room leaves the robot free to turn in front of each slit, there is always a way.

    Args:
        seed: of numpy's default generator.
        walls: how many, >= 1.
    """
    rng = np.random.default_rng(seed)
    height = 10.0
    obstacles, x = [], ROOM
    for _ in range(walls):
        thick, tilt = float(rng.uniform(0.4, 1.5)), float(rng.uniform(-0.5, 0.5))
        half = 0.5 * (WIDTH + float(rng.uniform(0.15, 0.35))) / math.cos(tilt)
        y = float(rng.uniform(2.5, height - 2.5))
        rise = 0.5 * thick * math.tan(tilt)
        near, far = y - rise, y + rise
        below = [(x, 0.0), (x + thick, 0.0), (x + thick, far - half), (x, near - half)]
        above = [(x, near + half), (x + thick, far + half), (x + thick, height), (x, height)]
        obstacles += [Polygon(np.array(below)), Polygon(np.array(above))]
        x += thick + ROOM
    start = (1.5, float(rng.uniform(1.5, height - 1.5)), float(rng.uniform(-math.pi, math.pi)))
    goal = (x - 1.5, float(rng.uniform(1.5, height - 1.5)), float(rng.uniform(-math.pi, math.pi)))
    return World(
        f"passages-{seed}",
        (0.0, 0.0, x, height),
        tuple(obstacles),
        robot=Robot.rectangle(LENGTH, WIDTH),
        queries=(Query("through", start, goal),),
    )
