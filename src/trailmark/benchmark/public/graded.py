"""Worlds made from a seed, in grades: more and more obstacles, and passages less and less wider than the robot.

The same seed gives the same world.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from trailmark import se2
from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite
from trailmark.shapes import Disc, Polygon, Shape
from trailmark.world import Query, Robot, World

__all__ = ["CLUTTERED", "PASSAGES", "corner_ends", "passage_world", "random_world", "star_polygon"]

LENGTH, WIDTH = 1.2, 0.6
"""Of the robot, metres."""

ROOM = 3.0
"""Metres between two walls: twice what the robot takes to turn on the spot, and more."""

CORNERS = ((5.0, 5.0), (95.0, 95.0))
TRIES, NEAR, STEP, FAR = 4000, 2.0, 0.02, 12.0
"""An end is drawn around its corner, at first within NEAR metres along each axis, each try STEP wider, up to FAR."""


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


def passage_world(seed: int, walls: int = 3, spare: tuple[float, float] = (0.15, 0.35)) -> World:
    """Return a world of rooms in a row; the robot gets from each to the next by one passage.

    A passage is a straight slit through a wall 0.4 to 1.5 m thick, tilted by up to 0.5 rad, a little wider than the
    robot. Since a room leaves the robot free to turn in front of each slit, there is always a way.

    Args:
        seed: of numpy's default generator.
        walls: how many, >= 1.
        spare: metres by which a passage is wider than the robot, at least and at most.
    """
    rng = np.random.default_rng(seed)
    height = 10.0
    obstacles, x = [], ROOM
    for _ in range(walls):
        thick, tilt = float(rng.uniform(0.4, 1.5)), float(rng.uniform(-0.5, 0.5))
        half = 0.5 * (WIDTH + float(rng.uniform(*spare))) / math.cos(tilt)
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


def corner_ends(
    world: World, rng: np.random.Generator
) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
    """Return random valid configurations near two corners of a world of 100 x 100 m; None if one is not found."""
    from trailmark.collision import StateChecker

    checker = StateChecker(world)
    found: list[tuple[float, float, float]] = []
    for corner in CORNERS:
        for i in range(TRIES):
            xy = np.asarray(corner) + rng.uniform(-1.0, 1.0, 2) * min(FAR, NEAR + STEP * i)
            q = se2.configurations([*xy, rng.uniform(-np.pi, np.pi)])
            if checker.valid(q):
                found.append((float(q[0]), float(q[1]), float(q[2])))
                break
        else:
            return None
    return found[0], found[1]


SEEDS = 10
"""Worlds of each grade."""

CLUTTER = (25, 50, 100, 200, 350, 500)
"""Obstacles on 100 x 100 m."""

SPARE = (1.0, 0.5, 0.25, 0.1, 0.05, 0.02)
"""Metres by which a passage is wider than the robot."""


def _grades(grades: Sequence[float]) -> Found:
    """Return a problem for each world, each under a name of its own: no two are queries of one world."""
    return Found([(Path(str(seed)) / str(grade), seed) for grade in grades for seed in range(SEEDS)])


def _clutter(_: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
    grade, (seed,) = int(file.name), numbers
    made = replace(random_world(1000 * grade + seed, grade), robot=robot or Robot.rectangle(2.0, 1.0))
    ends = corner_ends(made, np.random.default_rng(seed))
    if ends is None:
        raise SuiteError(f"world {made.name!r}: expected room for the robot near two corners, got none")
    return replace(made, queries=(Query("corner", *ends),))


def _passages(_: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
    spare, (seed,) = float(file.name), numbers
    made = passage_world(seed, spare=(spare, spare))
    return replace(made, name=f"passages-{spare:g}-{seed}", robot=robot or made.robot)


CLUTTERED = PublicSuite(
    name="clutter",
    contents=f"random polygons on 100 x 100 m, corner to corner: {', '.join(map(str, CLUTTER))}"
    " of them, 10 worlds each",
    published="",
    robot="rectangle of 2 x 1 m",
    expected="nothing",
    find=lambda _: _grades(CLUTTER),
    world=_clutter,
)
"""Whether there is a path, nobody says."""

PASSAGES = PublicSuite(
    name="passages",
    contents=f"four rooms in a row, slits wider than the robot by {', '.join(map(str, SPARE))} m, 10 worlds each",
    published="",
    robot="rectangle of 1.2 x 0.6 m",
    expected="nothing",
    find=lambda _: _grades(SPARE),
    world=_passages,
)
"""There is always a path for the robot that they are made for."""
