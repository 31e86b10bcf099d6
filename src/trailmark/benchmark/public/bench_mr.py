"""Bench-MR's polygon mazes: car parks and warehouses, for a car."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.errors import FormatError, ShapeError
from trailmark.formats.svg_polygons import read_svg_polygons
from trailmark.shapes import Polygon
from trailmark.world import Query, Robot, World

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["BenchMR"]

UNIT = 22.0
"""Of the drawings to the metre in the first versions (``env.polygon.scaling`` is 1/22); later ones are in metres."""

LARGEST_MAZE, LARGEST_ROBOT = 150.0, 20.0
"""Metres; what is drawn larger is drawn in units."""

TURNING_RADIUS = 4.0
"""Metres: ``steer.car_turning_radius``."""

PAIRS = 10
"""Problems a maze: its published one first, the others between random valid configurations."""

SEED = 1
TRIES = 10_000

Pose = tuple[float, float, float]

ENDS: dict[str, tuple[Pose, Pose]] = {
    "parking1": ((-1.5777, 6.4589, 0.0), (6.1423, 1.0089, -1.58)),
    "parking3": ((8.4814, 2.8080, 0.0), (-3.1486, 5.4180, 0.0)),
    "warehouse": ((-13.6748, 14.5355, -1.58), (52.2352, 12.2555, 1.58)),
}
"""``env.start`` and ``env.goal`` of ``benchmarks/*.json``, from the drawing's first vertex: later versions moved."""


class BenchMR(PublicSuite):
    """Ten problems in every maze."""

    name = "bench-mr"
    contents = "polygon mazes for a car: 10 problems each, the published one (but of parking2) and random pairs"
    published = "github.com/robot-motion/bench-mr, bin/polygon_mazes; E. Heiden et al., RA-L 2021"
    robot = f"the drawn car.svg or warehouse_robot.svg, turning radius {TURNING_RADIUS:g} m"
    expected = "Bench-MR's mazes and robots (.svg)"

    def find(self, folder: Path) -> Found:
        """Return ten problems for each drawing that is no robot."""
        mazes = [file for file in files_below(folder, ".svg") if not _is_robot(file)]
        return Found([(file, i) for file in mazes for i in range(PAIRS)])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the maze with its robot."""
        polygons = read_svg_polygons(file)
        every = np.vstack(polygons)
        scale = 1.0 / UNIT if np.ptp(every, axis=0).max() > LARGEST_MAZE else 1.0
        try:
            shapes = tuple(Polygon(_distinct(scale * vertices)) for vertices in polygons)
        except ShapeError as error:
            raise FormatError(file, str(error)) from None
        robot = robot or _robot(folder, file)
        # Bench-MR's bounds, the drawing's own, hold the reference point; these hold the whole robot.
        low, high = scale * every.min(axis=0) - robot.circumradius, scale * every.max(axis=0) + robot.circumradius
        bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        made = World(file.stem, bounds, shapes, robot, sources=(file.absolute(),))
        pairs = _pairs(made, max(numbers) + 1, scale * polygons[0][0])
        return replace(made, queries=tuple(Query(f"pair-{i}", *pairs[i]) for i in numbers))


def _is_robot(file: Path) -> bool:
    return file.stem == "car" or file.stem.endswith("_robot")


def _robot(folder: Path, maze: Path) -> Robot:
    """Return the robot drawn for a maze, ``NAME_robot.svg`` or else ``car.svg``, its longer side ahead."""
    drawings = {file.stem: file for file in files_below(folder, ".svg") if _is_robot(file)}
    file = drawings.get(f"{maze.stem.rstrip('0123456789')}_robot") or drawings.get("car")
    if file is None:
        raise SuiteError(f"{folder}: expected car.svg beside Bench-MR's mazes, got none (or give --robot)")
    vertices = read_svg_polygons(file)[0]
    # As Bench-MR centres it: by the mean of the vertices as they are drawn, repeated ones too.
    vertices = vertices - vertices.mean(axis=0)
    width, height = np.ptp(vertices, axis=0)
    if max(width, height) > LARGEST_ROBOT:
        vertices = vertices / UNIT
    if height > width:
        vertices = vertices @ np.array([[0.0, -1.0], [1.0, 0.0]])
    try:
        return Robot.polygon(_distinct(vertices)).steered(TURNING_RADIUS)
    except ShapeError as error:
        raise FormatError(file, str(error)) from None


def _distinct(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vertices without those that repeat the one before: drawings end where they begin."""
    before = np.roll(vertices, 1, axis=0)
    return np.asarray(vertices[np.hypot(*(vertices - before).T) > 1e-4])


def _pairs(world: World, count: int, anchor: NDArray[np.float64]) -> list[tuple[Pose, Pose]]:
    """Return the published ends, if they are valid, and random valid ones up to ``count`` pairs."""
    from trailmark.collision import StateChecker

    checker = StateChecker(world)
    rng = np.random.default_rng(SEED)
    xmin, ymin, xmax, ymax = world.bounds
    found: list[tuple[Pose, Pose]] = []
    published = ENDS.get(world.name)
    if published is not None:
        start, goal = ((float(x + anchor[0]), float(y + anchor[1]), heading) for x, y, heading in published)
        if checker.valid(np.array([start, goal])).all():
            found.append((start, goal))
    draws = rng.uniform((xmin, ymin, -math.pi), (xmax, ymax, math.pi), (TRIES, 3))
    valid = draws[checker.valid(draws)].tolist()
    found += [(tuple(a), tuple(b)) for a, b in zip(valid[::2], valid[1::2], strict=False)]
    if len(found) < count:
        raise SuiteError(f"world {world.name!r}: expected room for {count} pairs of ends, got {len(found)}")
    return found[:count]
