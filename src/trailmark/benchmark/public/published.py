"""Sets read as published: Moving AI Lab's grids, OMPL.app's problems, BARN, Bench-MR, Bhardwaj's pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.errors import FormatError, ShapeError
from trailmark.formats.files import read_text
from trailmark.formats.gazebo import read_gazebo_shapes
from trailmark.formats.movingai import read_scenarios, scenario_query
from trailmark.formats.svg_polygons import read_svg_polygons
from trailmark.shapes import Polygon
from trailmark.world import Query, Robot, World

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["BARN", "BENCH_MR", "FAMILIES", "MOVINGAI", "OMPLAPP"]

Pose = tuple[float, float, float]

CELL_RADIUS = 0.4
"""Metres, of a robot that every cell (one metre) of a grid or picture holds, and every octile step lets through."""


def _movingai_found(folder: Path) -> Found:
    problems, left_out = [], []
    maps = {file.name.lower() for file in files_below(folder, ".map")}
    for file in files_below(folder, ".scen"):
        if _map_name(file).lower() in maps:
            problems += [(file, i) for i in range(len(read_scenarios(file)))]
        else:
            left_out.append(f"{file}: no {_map_name(file)} in {folder}")
    return Found(problems, left_out)


def _movingai(folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
    wanted = _map_name(file).lower()
    beside = file.with_name(_map_name(file))
    grid = beside if beside.is_file() else next(f for f in files_below(folder, ".map") if f.name.lower() == wanted)
    rows = read_scenarios(file)
    made = World.load(grid)
    if any((row.width, row.height) != made.bounds[2:] for row in rows):
        raise SuiteError(f"{file}: expected rows for {grid.name}, {made.bounds[2]:g} x {made.bounds[3]:g} cells")
    queries = tuple(Query(*scenario_query(rows[i], f"bucket-{rows[i].bucket}-row-{i}")) for i in numbers)
    sources = tuple(dict.fromkeys((*made.sources, file.absolute())))
    return replace(made, robot=robot or Robot.disc(CELL_RADIUS), queries=queries, sources=sources)


def _map_name(scenarios: Path) -> str:
    """Return the name of the map that scenarios belong to: ``NAME.map.scen`` and ``NAME.scen`` to ``NAME.map``."""
    return scenarios.name[: -len(".scen")].removesuffix(".map") + ".map"


MOVINGAI = PublicSuite(
    name="movingai",
    contents="grids of games, cities, rooms, mazes and noise, their scenarios by bucket of optimal length",
    published="movingai.com/benchmarks; N. Sturtevant, Benchmarks for Grid-Based Pathfinding, 2012",
    robot=f"disc of {CELL_RADIUS:g} m, a cell being 1 m",
    expected="MovingAI's .map files with their .scen files",
    find=_movingai_found,
    world=_movingai,
)
"""Every row of every ``.scen`` file, named by its bucket and its number; the maps may lie in another folder."""


def _omplapp_found(folder: Path) -> Found:
    problems, left_out = [], []
    for file in files_below(folder, ".cfg"):
        keys = {line.partition("=")[0].strip().lower() for line in read_text(file).splitlines()}
        if "start.theta" not in keys or "start.z" in keys:
            left_out.append(f"{file}: a problem in space")
        elif "control" in keys:
            left_out.append(f"{file}: a problem for planners with controls")
        else:
            problems.append((file, 0))
    return Found(problems, left_out)


def _omplapp(_: Path, file: Path, __: Sequence[int], robot: Robot | None) -> World:
    made = World.load(file)
    if made.robot is None:
        raise FormatError(file, "expected a robot's mesh, got none")
    return replace(made, name=file.stem, robot=robot or made.robot)  # several share a name of their own


OMPLAPP = PublicSuite(
    name="omplapp",
    contents="Maze, BugTrap, RandomPolygons and others: a robot's mesh amid a world's mesh, one query each",
    published="github.com/ompl/omplapp, resources/2D",
    robot="each problem's own",
    expected=".cfg files of problems in the plane, with their meshes beside them",
    find=_omplapp_found,
    world=_omplapp,
)
"""Every ``.cfg`` in the plane whose robot moves in every direction."""

LENGTH, WIDTH = 0.508, 0.43
"""Of the Jackal, metres."""

JACKAL_START: Pose = (-2.0, 3.0, 1.57)
JACKAL_GOAL: Pose = (-2.0, 13.0, 1.57)
"""The challenge's ``run.py``: INIT_POSITION, and GOAL_POSITION 10 m ahead of it."""

MARGIN = 1.0
"""Metres of free space around obstacles and ends: the goal lies beyond the field."""


def _barn(_: Path, file: Path, __: Sequence[int], robot: Robot | None) -> World:
    shapes = read_gazebo_shapes(file)
    boxes = np.array([*(shape.bounding_box() for shape in shapes), (*JACKAL_START[:2], *JACKAL_GOAL[:2])])
    low, high = boxes[:, :2].min(axis=0) - MARGIN, boxes[:, 2:].max(axis=0) + MARGIN
    return World(
        name=f"barn-{file.stem}",
        bounds=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        obstacles=shapes,
        robot=robot or Robot.rectangle(LENGTH, WIDTH),
        queries=(Query("ahead", JACKAL_START, JACKAL_GOAL),),
        sources=(file.absolute(),),
    )


BARN = PublicSuite(
    name="barn",
    contents="300 fields of cylinders of 0.075 m radius in Gazebo worlds, from open to dense; one query each",
    published="github.com/Daffan/the-barn-challenge, jackal_helper/worlds/BARN; D. Perille et al., SSRR 2020",
    robot=f"the Jackal, {LENGTH:g} x {WIDTH:g} m",
    expected="BARN's .world files",
    find=lambda folder: Found([(file, 0) for file in files_below(folder, ".world")]),
    world=_barn,
)

SIZE = 201
"""Pixels a side; a pixel is one metre."""

PIXELS: dict[str, Any] = {"resolution": 1.0, "origin": [0.0, 0.0, 0.0], "occupied_thresh": 0.5, "free_thresh": 0.5}
"""Brighter than half is free, as ``planning_python`` reads them."""

CORNERS: tuple[Pose, Pose] = (0.5, 0.5, 0.0), (SIZE - 0.5, SIZE - 0.5, 0.0)
"""The middles of pixels (0, 0) and (200, 200), the ends in the authors' ``SaIL/examples``."""


def _families(_: Path, file: Path, __: Sequence[int], robot: Robot | None) -> World:
    made = World.from_image(file, **PIXELS)
    if made.bounds[2:] != (SIZE, SIZE):
        raise FormatError(file, f"expected {SIZE} x {SIZE} pixels, got {made.bounds[2]:g} x {made.bounds[3]:g}")
    # Family, part and number.
    name = "-".join(file.absolute().parts[-3:-1]) + f"-{file.stem}"
    return replace(made, name=name, robot=robot or Robot.disc(CELL_RADIUS), queries=(Query("across", *CORNERS),))


FAMILIES = PublicSuite(
    name="families",
    contents="alternating_gaps, forest, mazes, bug traps and others: 201 x 201 pictures, corner to corner",
    published="github.com/mohakbhardwaj/motion_planning_datasets; M. Bhardwaj et al., CoRL 2017",
    robot=f"disc of {CELL_RADIUS:g} m, a pixel being 1 m",
    expected="pictures of 201 x 201 pixels (.png)",
    find=lambda folder: Found([(file, 0) for file in files_below(folder, ".png")]),
    world=_families,
)
"""From the lower left pixel of every picture to the upper right one."""

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

ENDS: dict[str, tuple[Pose, Pose]] = {
    "parking1": ((-1.5777, 6.4589, 0.0), (6.1423, 1.0089, -1.58)),
    "parking3": ((8.4814, 2.8080, 0.0), (-3.1486, 5.4180, 0.0)),
    "warehouse": ((-13.6748, 14.5355, -1.58), (52.2352, 12.2555, 1.58)),
}
"""``env.start`` and ``env.goal`` of ``benchmarks/*.json``, from the drawing's first vertex: later versions moved."""


def _bench_mr(folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
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


BENCH_MR = PublicSuite(
    name="bench-mr",
    contents="polygon mazes for a car: 10 problems each, the published one (but of parking2) and random pairs",
    published="github.com/robot-motion/bench-mr, bin/polygon_mazes; E. Heiden et al., RA-L 2021",
    robot=f"the drawn car.svg or warehouse_robot.svg, turning radius {TURNING_RADIUS:g} m",
    expected="Bench-MR's mazes and robots (.svg)",
    find=lambda folder: Found(
        [(file, i) for file in files_below(folder, ".svg") if not _is_robot(file) for i in range(PAIRS)]
    ),
    world=_bench_mr,
)
