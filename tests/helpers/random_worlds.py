"""Random worlds and robots from a seed, for benchmarks and tests: the same seed gives the same world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.public.graded import random_world, star_polygon
from trailmark.world import Robot, World

__all__ = [
    "ROBOTS",
    "random_states",
    "random_world",
    "short_motions",
    "star_polygon",
]

FloatArray = NDArray[np.float64]

L_SHAPE = ((-0.5, -0.5), (1.5, -0.5), (1.5, 0.1), (0.1, 0.1), (0.1, 1.5), (-0.5, 1.5))

ROBOTS = {
    "disc": Robot.disc(0.6),
    "rectangle": Robot.rectangle(2.0, 1.0),
    "L": Robot.polygon(L_SHAPE),
    "thin": Robot.rectangle(4.0, 0.05),
    "offset": Robot.polygon([(1.0, -0.4), (3.0, -0.4), (3.0, 0.4), (1.0, 0.4)]),
    "star": Robot.polygon([(1.2, 0.0), (0.3, 0.3), (0.0, 1.2), (-0.3, 0.3), (-1.2, 0.0), (0.0, -0.25)]),
}
"""Robots by name: round, rectangular, non-convex, very thin, reference point outside, reflex vertices (metres)."""


def random_states(world: World, n: int, rng: np.random.Generator, margin: float = 0.0) -> FloatArray:
    """Return n uniform configurations, shape (n, 3), positions in the bounds grown by ``margin`` metres."""
    xmin, ymin, xmax, ymax = world.bounds
    low = (xmin - margin, ymin - margin, -math.pi)
    high = (xmax + margin, ymax + margin, math.pi)
    return rng.uniform(low, high, (n, 3))


def short_motions(world: World, n: int, rng: np.random.Generator, reach: float) -> tuple[FloatArray, FloatArray]:
    """Return starts and ends, each of shape (n, 3): the ends at most ``reach`` metres away, at any heading."""
    a = random_states(world, n, rng)
    b = random_states(world, n, rng)
    angle, way = rng.uniform(-math.pi, math.pi, n), reach * np.sqrt(rng.random(n))
    b[:, 0] = a[:, 0] + way * np.cos(angle)
    b[:, 1] = a[:, 1] + way * np.sin(angle)
    return a, b
