"""Worlds in which a wall's vertices lie nearly on a line and something sticks out of it: hard for shortest paths."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from benchmarks.soundness.carving import Carved
from benchmarks.soundness.reference import Reference
from benchmarks.soundness.scenes import SCALES, scaled, shallow_ring, turned
from trailmark.shapes import Polygon
from trailmark.world import Robot, World

__all__ = ["ceiling_world", "spiked_world"]

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


def ceiling_world(rng: np.random.Generator, scale: str = "plain") -> Carved | None:
    """Return a room with an uneven ceiling that a disc just passes under, over a post; None if no room is left.

    The way follows the ceiling as closely as the margin allows; the post is as high as that way allows. The ceiling is
    one for which GEOS's own buffer is wrong, if one soon comes: it fills hollows as shallow as 1 % of the distance.
    """
    radius, margin = float(rng.uniform(0.5, 1.2)), float(10.0 ** rng.uniform(-5.0, -1.7))
    at = float(rng.uniform(-1.5, 1.5))
    for _ in range(30):
        ceiling = _ceiling(rng)
        coarse = _below(ceiling, radius + 1e-6, np.linspace(-2.0, 2.0, 161))
        grown = shapely.buffer(_room(ceiling), radius)
        points = shapely.points(coarse)
        wrong = np.where(shapely.intersects(grown, points), shapely.distance(points, grown.boundary), 0.0)
        if wrong.max() > 2e-5:
            at, margin = float(coarse[wrong.argmax(), 0]), float(wrong.max() * rng.uniform(0.05, 0.4))
            break
    way = _below(ceiling, radius + margin, np.linspace(-3.0, 3.0, 1201))
    half, under = float(rng.choice([0.02, 10.0 ** rng.uniform(-3.0, -0.5)])), shapely.LineString(way)
    bottom, top = -5.0, 1.0
    for _ in range(50):
        height = 0.5 * (bottom + top)
        clear = shapely.distance(under, shapely.box(at - half, -5.5, at + half, height)) >= radius + margin
        bottom, top = (height, top) if clear else (bottom, height)
    post = np.array([[at - half, -5.5], [at + half, -5.5], [at + half, bottom], [at - half, bottom]])
    factor, origin = SCALES[scale]
    room = Polygon(shapely.get_coordinates(shapely.box(-6.0, -6.0, 6.0, 3.0))[:-1], (_hole(ceiling),))
    shapes = tuple(scaled(shape, factor, origin) for shape in (room, Polygon(post)))
    bounds = tuple(factor * v + o for v, o in zip((-6.0, -6.0, 6.0, 3.0), (*origin, *origin), strict=True))
    robot = Robot.disc(factor * radius)
    world = World("ceiling", (bounds[0], bounds[1], bounds[2], bounds[3]), shapes, robot)
    rows = np.column_stack([factor * way + np.array(origin), np.zeros(len(way))])
    cost = float(np.hypot(*np.diff(rows[:, :2], axis=0).T).sum())
    # Between two places 5 mm apart the line may come nearer to a corner than they do, by less than the margin.
    between = 0.5 * (rows[1:] + rows[:-1])
    least = float(Reference(world, robot).clearance(np.concatenate([rows, between])).min())
    return Carved(world, rows, cost, least) if least > 0.3 * factor * margin else None


def _ceiling(rng: np.random.Generator) -> FloatArray:
    """Return a ceiling's vertices from right to left, shape (n, 2), up to 50 mm above 2 m; some close together."""
    n = int(rng.integers(4, 16))
    x = rng.uniform(-4.8, 4.8, n)
    x = np.sort(np.concatenate([x, x[: n // 3] + 10.0 ** rng.uniform(-4.0, -1.0, n // 3)]))[::-1]
    return np.column_stack([x, 2.0 + 10.0 ** rng.uniform(-2.3, -1.3) * rng.random(len(x)) ** 2])


def _hole(ceiling: FloatArray) -> FloatArray:
    return np.concatenate([[[-5.0, -5.0], [5.0, -5.0], [5.0, 2.0]], ceiling, [[-5.0, 2.0]]])


def _room(ceiling: FloatArray) -> shapely.Polygon:
    return shapely.Polygon(shapely.box(-6.0, -6.0, 6.0, 3.0).exterior, [_hole(ceiling)])


def _below(ceiling: FloatArray, distance: float, along: FloatArray) -> FloatArray:
    """Return the highest points at that distance below a ceiling, shape (n, 2)."""
    line = shapely.LineString(_hole(ceiling)[2:])
    low, high = np.full(len(along), -2.0), np.full(len(along), 2.0)
    for _ in range(50):
        middle = 0.5 * (low + high)
        fits = shapely.distance(shapely.points(along, middle), line) >= distance
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.column_stack([along, low])
