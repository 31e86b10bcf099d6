"""Random worlds and robots from a seed, for benchmarks and tests: the same seed gives the same world."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trailmark.shapes import Disc, Polygon, Shape
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


def star_polygon(rng: np.random.Generator, center: tuple[float, float], radius: float) -> Polygon:
    """Return a star-shaped polygon of 3 to 7 vertices, 0.4 to 1 times ``radius`` (metres) from ``center``."""
    n = int(rng.integers(3, 8))
    # One vertex in each of n equal sectors: no gap reaches half a turn, so that the centre lies inside (n > 3).
    angles = (np.arange(n) + rng.uniform(0.05, 0.95, n)) * (2.0 * math.pi / n)
    reach = radius * rng.uniform(0.4, 1.0, n)
    return Polygon(np.asarray(center) + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


def random_world(
    seed: int,
    obstacles: int = 200,
    *,
    size: float = 100.0,
    radii: tuple[float, float] = (0.5, 4.0),
    discs: float = 0.0,
    holes: float = 0.0,
    boundary: bool = False,
    origin: tuple[float, float] = (0.0, 0.0),
) -> World:
    """Return a square world with random obstacles, which may overlap one another and the bounds.

    Args:
        seed: of numpy's default generator.
        obstacles: how many.
        size: edge of the bounds in metres.
        radii: smallest and largest circumradius of an obstacle, metres.
        discs: fraction of the obstacles that are discs.
        holes: fraction of the polygons that get a hole of half their size.
        boundary: whether a non-convex boundary of 24 vertices lies within the bounds.
        origin: lower left corner of the bounds, metres.
    """
    rng = np.random.default_rng(seed)
    shapes: list[Shape] = []
    for _ in range(obstacles):
        x, y = rng.uniform(0.0, size, 2) + origin
        radius = float(rng.uniform(*radii))
        if rng.random() < discs:
            shapes.append(Disc((float(x), float(y)), 0.6 * radius))
            continue
        polygon = star_polygon(rng, (float(x), float(y)), radius)
        # A triangle need not hold its centre, about which the hole is scaled.
        if rng.random() < holes and len(polygon.vertices) > 3:
            hole = 0.5 * (polygon.vertices + np.array([x, y]))
            polygon = Polygon(polygon.vertices, (hole,))
        shapes.append(polygon)
    outline = None
    if boundary:
        angles = 2.0 * math.pi * np.arange(24) / 24
        reach = 0.5 * size * rng.uniform(0.7, 0.99, 24)
        centre = np.asarray(origin) + 0.5 * size
        outline = Polygon(centre + reach[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))
    bounds = (origin[0], origin[1], origin[0] + size, origin[1] + size)
    return World(f"random-{obstacles}-{seed}", bounds, tuple(shapes), boundary=outline)


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
