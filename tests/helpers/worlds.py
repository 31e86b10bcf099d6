"""Worlds and robots from a seed, for benchmarks and tests: the same seed gives the same world."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from trailmark import LandmarkPlanner
from trailmark.benchmark.public.graded import random_world, star_polygon
from trailmark.collision.field import distance_transform
from trailmark.estimation import regrow
from trailmark.landmarks import free_samples
from trailmark.shapes import Polygon, Shape
from trailmark.world import ObstacleEstimate, Robot, World

__all__ = [
    "GRID_KINDS",
    "L_SHAPE",
    "ROBOTS",
    "box",
    "far_pairs",
    "grown_world",
    "joined_pairs",
    "random_pairs",
    "random_states",
    "random_world",
    "short_motions",
    "star_polygon",
    "write_map",
]

FloatArray = NDArray[np.float64]
Cells = NDArray[np.bool_]

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


def box(xmin: float, ymin: float, xmax: float, ymax: float) -> Polygon:
    """Return an upright rectangle as a polygon."""
    return Polygon(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]], dtype=np.float64))


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


def random_pairs(planner: LandmarkPlanner, n: int, seed: int) -> FloatArray:
    """Return n starts and goals, shape (n, 2, 3), that the relaxed problem may join, and no straight motion does."""
    pairs, have, rng = [np.empty((0, 2, 3))], 0, np.random.default_rng(seed)
    relaxation = planner.relaxation
    while have < n:
        q = free_samples(planner.checker, 4 * (n - have) + 64, random_state=rng)
        reached = relaxation.component(q[0])
        q = q[reached[relaxation.cells(relaxation.disc_centers(q))]]
        q = q[: len(q) // 2 * 2].reshape(-1, 2, 3)
        found = q[~planner.checker.motions_between_valid(q[:, 0], q[:, 1])]
        pairs.append(found)
        have += len(found)
    return np.concatenate(pairs)[:n]


def joined_pairs(planner: LandmarkPlanner, n: int, seed: int = 8) -> FloatArray:
    """Return n starts and goals, shape (n, 2, 3), in one part of a world."""
    ends = free_samples(planner.checker, 4 * n, random_state=seed)
    reached = planner.relaxation.component(ends[0])
    return ends[reached[planner.relaxation.cells(planner.relaxation.disc_centers(ends))]][: 2 * n].reshape(-1, 2, 3)


def grown_world(
    estimates: Sequence[ObstacleEstimate],
    bounds: tuple[float, float, float, float],
    confidence: float,
    *,
    fixed: Sequence[Shape] = (),
    weights: Any = None,
    pose_covariance: Any = None,
    **parts: Any,
) -> World:
    """Return a world of these obstacles in which a valid path meets none with at least the stated probability.

    Args:
        estimates: the obstacles.
        bounds: of the world.
        confidence: above 0 and below 1.
        fixed: further obstacles, which count as known.
        weights: how the risk is shared out.
        pose_covariance: of the robot's own pose.
        parts: further arguments of World.
    """
    obstacles = (*(estimate.mean for estimate in estimates), *fixed)
    plain = World("map", bounds, obstacles, estimates=(*estimates, *(None for _ in fixed)), **parts)
    return regrow(plain, confidence, weights=weights, pose_covariance=pose_covariance)


# --- Grid maps of the kinds that MovingAI's sets hold.


def maze(rng: np.random.Generator, size: int, corridor: int) -> Cells:
    """Return the blocked cells of a maze without loops, (size, size): corridors, and walls one cell thick."""
    step = corridor + 1
    n = (size - 1) // step
    blocked = np.ones((size, size), np.bool_)
    seen = np.zeros((n, n), np.bool_)
    stack = [(0, 0)]
    seen[0, 0] = True
    blocked[1 : 1 + corridor, 1 : 1 + corridor] = False
    while stack:
        i, j = stack[-1]
        ways = [
            (i + di, j + dj)
            for di, dj in ((1, 0), (-1, 0), (0, 1), (0, -1))
            if 0 <= i + di < n and 0 <= j + dj < n and not seen[i + di, j + dj]
        ]
        if not ways:
            stack.pop()
            continue
        k, m = ways[int(rng.integers(len(ways)))]
        seen[k, m] = True
        low, high = (min(i, k) * step + 1, min(j, m) * step + 1), (max(i, k) * step, max(j, m) * step)
        blocked[low[0] : high[0] + corridor + 1, low[1] : high[1] + corridor + 1] = False
        stack.append((k, m))
    return blocked


def rooms(rng: np.random.Generator, size: int, room: int) -> Cells:
    """Return the blocked cells of square rooms with doors one cell wide, a tenth of them missing."""
    step = room + 1
    blocked = np.zeros((size, size), np.bool_)
    blocked[::step] = blocked[:, ::step] = True
    for wall in range(step, size, step):
        for begin in range(1, size - room, step):
            if rng.random() < 0.9:
                blocked[wall, begin + rng.integers(room)] = False
            if rng.random() < 0.9:
                blocked[begin + rng.integers(room), wall] = False
    return blocked


def scattered(rng: np.random.Generator, size: int, share: float) -> Cells:
    """Return cells each of which is blocked with the same probability."""
    return np.asarray(rng.random((size, size)) < share)


def city(rng: np.random.Generator, size: int) -> Cells:
    """Return the blocked cells of houses: slanting blocks along crooked streets."""
    y, x = np.mgrid[:size, :size] + 0.5
    blocked = np.zeros((size, size), np.bool_)
    for _ in range(size // 3):
        cx, cy, angle = *(rng.uniform(0, size, 2)), rng.normal(0.4, 0.2) + rng.integers(2) * np.pi / 2
        half = rng.uniform(0.008, 0.035, 2) * size
        u, v = (x - cx) * np.cos(angle) + (y - cy) * np.sin(angle), (y - cy) * np.cos(angle) - (x - cx) * np.sin(angle)
        court = rng.random() < 0.3
        inside = (abs(u) < half[0]) & (abs(v) < half[1])
        blocked |= inside & ~((abs(u) < 0.6 * half[0]) & (abs(v) < 0.6 * half[1])) if court else inside
    return blocked


GRID_KINDS: dict[str, Callable[[np.random.Generator, int], Cells]] = {
    "maze-1": partial(maze, corridor=1),
    "maze-8": partial(maze, corridor=8),
    "maze-32": partial(maze, corridor=32),
    "room-16": partial(rooms, room=16),
    "room-32": partial(rooms, room=32),
    "random-10": partial(scattered, share=0.10),
    "random-25": partial(scattered, share=0.25),
    "city": city,
}
"""Blocked cells by a source of randomness and the cells along a side."""


def far_pairs(blocked: Cells, rng: np.random.Generator, count: int) -> list[tuple[int, int, int, int]]:
    """Return starts and goals (column, row, column, row) far apart, joined by ways of free cells without cut corners.

    Args:
        blocked: shape (rows, columns).
        rng: source of randomness.
        count: how many.
    """
    labels, parts = ndimage.label(~blocked)
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:])) if parts else 0
    cells = np.argwhere((labels == largest) & (distance_transform(blocked, 1.0) >= 1.0))
    pairs = []
    for _ in range(count):
        ends = cells[rng.integers(len(cells), size=(64, 2))]
        (a, b) = ends[np.argmax(np.abs(ends[:, 0] - ends[:, 1]).sum(axis=1))]
        pairs.append((int(a[1]), int(a[0]), int(b[1]), int(b[0])))
    return pairs


def write_map(path: Path, blocked: Cells, pairs: list[tuple[int, int, int, int]]) -> None:
    """Write a ``.map`` and its ``.scen``; row 0 is on top."""
    rows, columns = blocked.shape
    lines = ["".join("@" if cell else "." for cell in row) for row in blocked]
    path.write_text("\n".join(["type octile", f"height {rows}", f"width {columns}", "map", *lines, ""]))
    scen = ["version 1", *("\t".join(map(str, (0, path.name, columns, rows, *pair, 0.0))) for pair in pairs), ""]
    path.with_name(path.name + ".scen").write_text("\n".join(scen))
