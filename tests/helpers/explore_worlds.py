"""Hidden worlds to explore, from a seed: offices, caves, clutter and loops; the same seed gives the same world.

Each has a robot and a query ``start``. All that a disc around the robot (of its circumradius) can get to from there is
connected, though not all free space is: caves have pockets, clutter has gaps that are too narrow. Even seeds have a
round robot, odd ones a rectangular one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from tests.helpers.worlds import star_polygon

from trailmark.formats.grid import grid_polygons
from trailmark.shapes import Disc, Rectangle, Shape
from trailmark.world import Query, Robot, World

__all__ = ["KINDS", "ROBOTS", "SENSOR_RANGE", "explore_world"]

SENSOR_RANGE = 5.0
"""Metres: what the sensor of a robot in these worlds sees."""

ROBOTS = (Robot.disc(0.25), Robot.rectangle(0.6, 0.4))

WALL = 0.2
"""Metres: thickness of walls."""


def explore_world(kind: str, seed: int) -> World:
    """Return a world of a kind, :data:`KINDS`."""
    rng = np.random.default_rng([seed, *kind.encode()])
    bounds, shapes = KINDS[kind](rng)
    robot = ROBOTS[seed % 2]
    world = World(f"{kind} {seed}", bounds, tuple(shapes), robot)
    x, y = _start(world, rng)
    start = (x, y, float(rng.uniform(-math.pi, math.pi)))
    return World(world.name, bounds, world.obstacles, robot, queries=(Query("start", start, start),))


def _office(rng: np.random.Generator) -> tuple[tuple[float, float, float, float], list[Shape]]:
    """Return rooms on both sides of a corridor, with doors to it and some between them, and furniture."""
    width, depth, hall = (float(v) for v in rng.uniform((18.0, 4.0, 1.8), (26.0, 6.0, 2.4)))
    bounds = (0.0, 0.0, width, 2.0 * depth + hall)
    shapes: list[Shape] = []
    for low, high, door_y in ((0.0, depth, depth), (depth + hall, bounds[3], depth + hall)):
        walls = _cuts(rng, width, 3.0, 6.0)
        doors = []
        for left, right in itertools.pairwise(walls):
            doors.append(_door(rng, left + 0.3, right - 0.3))
            shapes += _furniture(rng, (left + WALL, low + WALL, right - WALL, high - WALL), doors[-1], door_y)
        shapes += _wall_x(0.0, width, door_y, doors)
        for x in walls[1:-1]:
            gaps = [_door(rng, low + 0.5, high - 0.5)] if rng.random() < 0.3 else []
            shapes += _wall_y(low, high, x, gaps)
    for _ in range(int(rng.integers(0, 4))):  # what stands in the corridor leaves 1.2 m
        shapes.append(Disc((float(rng.uniform(1.0, width - 1.0)), depth + 0.35), float(rng.uniform(0.1, 0.25))))
    return bounds, shapes


def _cave(rng: np.random.Generator) -> tuple[tuple[float, float, float, float], list[Shape]]:
    """Return what a cellular automaton makes of noise, in cells of 0.4 m."""
    cell, rows, columns = 0.4, int(rng.integers(36, 46)), int(rng.integers(46, 60))
    rock = rng.random((rows, columns)) < 0.44
    neighbours = np.ones((3, 3), dtype=int)
    for _ in range(5):
        rock = ndimage.convolve(rock.astype(int), neighbours, mode="constant", cval=1) >= 5
    rock[[0, -1]] = rock[:, [0, -1]] = True
    # Caverns that are not joined are, by tunnels from one to the next.
    labels, count = ndimage.label(~rock)
    sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
    large = [i + 1 for i in np.argsort(-sizes) if sizes[i] >= 60]
    middles = [np.argwhere(labels == i)[rng.integers(int(sizes[i - 1]))] for i in large]
    for a, b in itertools.pairwise(middles):
        for t in np.linspace(0.0, 1.0, 200):
            row, column = np.rint(a + t * (b - a)).astype(int)
            rock[max(1, row - 1) : min(rows - 1, row + 2), max(1, column - 1) : min(columns - 1, column + 2)] = False
    return (0.0, 0.0, columns * cell, rows * cell), list(grid_polygons(rock, cell))


def _clutter(rng: np.random.Generator) -> tuple[tuple[float, float, float, float], list[Shape]]:
    """Return polygons and discs strewn over a field."""
    width, height = (float(v) for v in rng.uniform((16.0, 12.0), (22.0, 16.0)))
    shapes: list[Shape] = []
    for _ in range(int(width * height / 6.0)):
        place = float(rng.uniform(0.0, width)), float(rng.uniform(0.0, height))
        radius = float(rng.uniform(0.2, 1.1))
        shapes.append(Disc(place, 0.6 * radius) if rng.random() < 0.4 else star_polygon(rng, place, radius))
    return (0.0, 0.0, width, height), shapes


def _loops(rng: np.random.Generator) -> tuple[tuple[float, float, float, float], list[Shape]]:
    """Return streets around blocks, some of them closed."""
    street = float(rng.uniform(1.4, 2.0))
    xs, ys = (_cuts(rng, float(rng.uniform(*span)), 3.0, 5.5) for span in ((17.0, 23.0), (13.0, 18.0)))
    half = 0.5 * street
    bounds = (-half, -half, xs[-1] + half, ys[-1] + half)
    shapes: list[Shape] = [
        _box(x0 + half, y0 + half, x1 - half, y1 - half)
        for x0, x1 in itertools.pairwise(xs)
        for y0, y1 in itertools.pairwise(ys)
    ]
    # A street may be closed as long as its crossings stay joined: those of a spanning tree never are.
    nodes = [(i, j) for i in range(len(xs)) for j in range(len(ys))]
    edges = [((i, j), (i + 1, j)) for i, j in nodes if i + 1 < len(xs)]
    edges += [((i, j), (i, j + 1)) for i, j in nodes if j + 1 < len(ys)]
    joined = {node: {node} for node in nodes}
    for k in rng.permutation(len(edges)):
        a, b = edges[k]
        if joined[a] is not joined[b]:
            joined[a] |= joined[b]
            for node in joined[b]:
                joined[node] = joined[a]
        elif rng.random() < 0.35:
            x, y = 0.5 * (xs[a[0]] + xs[b[0]]), 0.5 * (ys[a[1]] + ys[b[1]])
            across = a[1] == b[1]
            dx, dy = (0.5 * WALL, half) if across else (half, 0.5 * WALL)
            shapes.append(_box(x - dx, y - dy, x + dx, y + dy))
    return bounds, shapes


KINDS: dict[str, Callable[[np.random.Generator], tuple[tuple[float, float, float, float], list[Shape]]]] = {
    "office": _office,
    "cave": _cave,
    "clutter": _clutter,
    "loops": _loops,
}


def _start(world: World, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return a place in the largest part of where a disc around the robot fits."""
    reach = 1.05 * world.robot.circumradius + 0.05
    solids = shapely.union_all([shape.polygon(1e-3).shapely() for shape in world.obstacles])
    free: Any = shapely.box(*world.bounds).buffer(-reach).difference(solids.buffer(reach))
    part = max(getattr(free, "geoms", [free]), key=lambda geometry: geometry.area)
    low, high = np.array(part.bounds).reshape(2, 2)
    while True:
        place = rng.uniform(low, high)
        if part.contains(shapely.Point(place)):
            return np.asarray(place.round(3))


def _cuts(rng: np.random.Generator, length: float, least: float, most: float) -> list[float]:
    """Return where to cut a length, its ends included, into parts of ``least`` to about ``most`` metres."""
    count = max(1, round(length / float(rng.uniform(least, most))))
    weights = rng.uniform(0.7, 1.3, count)
    return [0.0, *(length * np.cumsum(weights / weights.sum())).tolist()]


def _door(rng: np.random.Generator, low: float, high: float) -> tuple[float, float]:
    """Return the two ends of a door, 1.0 to 1.4 m wide, between two places on a wall."""
    width = float(rng.uniform(1.0, 1.4))
    left = float(rng.uniform(low, max(low, high - width)))
    return left, left + width


def _furniture(
    rng: np.random.Generator, room: tuple[float, float, float, float], door: tuple[float, float], door_y: float
) -> list[Shape]:
    """Return boxes and round things in a room, none of them near its door."""
    x0, y0, x1, y1 = room
    found: list[Shape] = []
    for _ in range(int(rng.integers(0, 5))):
        x, y = float(rng.uniform(x0 + 0.3, x1 - 0.3)), float(rng.uniform(y0 + 0.3, y1 - 0.3))
        length, depth = (float(v) for v in rng.uniform((0.4, 0.3), (1.4, 0.8)))
        if math.hypot(x - 0.5 * sum(door), y - door_y) < 1.2 + 0.5 * math.hypot(length, depth):
            continue
        round_one = rng.random() < 0.3
        found.append(Disc((x, y), 0.5 * depth) if round_one else _rectangle(rng, x, y, length, depth))
    return found


def _rectangle(rng: np.random.Generator, x: float, y: float, length: float, depth: float) -> Rectangle:
    return Rectangle((x, y), length, depth, float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0.0, math.pi)])))


def _wall_x(x0: float, x1: float, y: float, doors: list[tuple[float, float]]) -> list[Shape]:
    """Return a wall along x with doors."""
    stops = [x0, *(end for door in sorted(doors) for end in door), x1]
    pairs = zip(stops[::2], stops[1::2], strict=True)
    return [_box(a, y - 0.5 * WALL, b, y + 0.5 * WALL) for a, b in pairs if b > a]


def _wall_y(y0: float, y1: float, x: float, doors: list[tuple[float, float]]) -> list[Shape]:
    """Return a wall along y with doors."""
    stops = [y0, *(end for door in sorted(doors) for end in door), y1]
    pairs = zip(stops[::2], stops[1::2], strict=True)
    return [_box(x - 0.5 * WALL, a, x + 0.5 * WALL, b) for a, b in pairs if b > a]


def _box(x0: float, y0: float, x1: float, y1: float) -> Rectangle:
    return Rectangle((0.5 * (x0 + x1), 0.5 * (y0 + y1)), x1 - x0, y1 - y0)
