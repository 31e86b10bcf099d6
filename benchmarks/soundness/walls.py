"""Worlds in which a wall's vertices lie nearly on a line and something sticks out of it: hard for shortest ways."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.soundness.scenes import shallow_ring, turned
from trailmark.shapes import Polygon
from trailmark.world import Robot, World

__all__ = ["spiked_world"]

FloatArray = NDArray[np.float64]


def spiked_world(rng: np.random.Generator) -> tuple[World, FloatArray]:
    """Return a world, its robot a disc, and start and goal, shape (2, 3), on either side of a spike below a wall."""
    angle, away = float(rng.uniform(0.0, 2.0 * math.pi)), float(rng.choice([0.0, 1e3, 1e4, 1e5, 1e6]))
    move = away * rng.normal(size=2)
    pieces = int(rng.integers(3, 15))
    if rng.random() < 0.5:
        x = np.linspace(0.0, 10.0, pieces)
        wall = np.concatenate([[[0.0, 0.0], [10.0, 0.0]], np.column_stack([x[::-1], np.ones(pieces)])])
    else:
        wall = shallow_ring(rng, np.array([0.0, 0.0]), np.array([10.0, 1.0]), float(10.0 ** rng.uniform(-12.0, -2.0)))
    half = float(rng.choice([0.1, 10.0 ** rng.uniform(-4.0, 0.0)]))
    at = float(rng.uniform(3.0, 7.0))
    spike = np.array([[at - half, -9.0], [at + half, -9.0], [at + half, 0.5], [at - half, 0.5]])
    radius = float(rng.uniform(0.1, 0.7))
    box = np.array([[-3.0, -12.0], [13.0, -12.0], [13.0, 4.0], [-3.0, 4.0]])
    ends = np.array([[1.0, -1.0], [9.0, -1.0]])
    wall, spike, corners, ends = (turned(points, angle) + move for points in (wall, spike, box, ends))
    low, high = corners.min(axis=0), corners.max(axis=0)
    world = World("spike", (*low, *high), (Polygon(wall), Polygon(spike)), Robot.disc(radius))
    return world, np.column_stack([ends, rng.uniform(-math.pi, math.pi, 2)])
