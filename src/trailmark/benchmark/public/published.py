"""Sets that are read as they are published: Moving AI Lab's grids, OMPL.app's problems, BARN, Bhardwaj's families."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.errors import FormatError
from trailmark.formats.files import read_text
from trailmark.formats.gazebo import read_gazebo_shapes
from trailmark.formats.movingai import read_scenarios, scenario_query
from trailmark.world import Query, Robot, World

__all__ = ["Barn", "Families", "MovingAI", "OmplApp"]

CELL_RADIUS = 0.4
"""Metres, of a robot that every cell holds and every step of the octile path lets through; a cell is one metre."""


class MovingAI(PublicSuite):
    """Every row of every ``.scen`` file, named by its bucket and its number; the maps may lie in another folder."""

    name = "movingai"
    contents = "grids of games, cities, rooms, mazes and noise, their scenarios by bucket of optimal length"
    published = "movingai.com/benchmarks; N. Sturtevant, Benchmarks for Grid-Based Pathfinding, 2012"
    robot = f"disc of {CELL_RADIUS:g} m, a cell being 1 m"
    expected = "MovingAI's .map files with their .scen files"

    def find(self, folder: Path) -> Found:
        """Return a problem for each row of each ``.scen`` file whose map is there."""
        problems, left_out = [], []
        maps = {file.name.lower() for file in files_below(folder, ".map")}
        for file in files_below(folder, ".scen"):
            if _map_name(file).lower() in maps:
                problems += [(file, i) for i in range(len(read_scenarios(file)))]
            else:
                left_out.append(f"{file}: no {_map_name(file)} in {folder}")
        return Found(problems, left_out)

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the scenarios' map."""
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


class OmplApp(PublicSuite):
    """Every ``.cfg`` in the plane whose robot moves in every direction."""

    name = "omplapp"
    contents = "Maze, BugTrap, RandomPolygons and others: a robot's mesh amid a world's mesh, one query each"
    published = "github.com/ompl/omplapp, resources/2D"
    robot = "each problem's own"
    expected = ".cfg files of problems in the plane, with their meshes beside them"

    def find(self, folder: Path) -> Found:
        """Return a problem for each ``.cfg`` that is one in the plane."""
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

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the problem under its file's name, for several share one."""
        made = World.load(file)
        if made.robot is None:
            raise FormatError(file, "expected a robot's mesh, got none")
        return replace(made, name=file.stem, robot=robot or made.robot)


LENGTH, WIDTH = 0.508, 0.43
"""Of the Jackal, metres."""

START = (-2.0, 3.0, 1.57)
GOAL = (-2.0, 13.0, 1.57)
"""The challenge's ``run.py``: INIT_POSITION, and GOAL_POSITION 10 m ahead of it."""

MARGIN = 1.0
"""Metres of free space around obstacles and ends: the goal lies beyond the field."""


class Barn(PublicSuite):
    """Every ``.world`` file."""

    name = "barn"
    contents = "300 fields of cylinders of 0.075 m radius in Gazebo worlds, from open to dense; one query each"
    published = "github.com/Daffan/the-barn-challenge, jackal_helper/worlds/BARN; D. Perille et al., SSRR 2020"
    robot = f"the Jackal, {LENGTH:g} x {WIDTH:g} m"
    expected = "BARN's .world files"

    def find(self, folder: Path) -> Found:
        """Return a problem for each ``.world``."""
        return Found([(file, 0) for file in files_below(folder, ".world")])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the field, with room around it."""
        shapes = read_gazebo_shapes(file)
        boxes = np.array([*(shape.bounding_box() for shape in shapes), (*START[:2], *GOAL[:2])])
        low, high = boxes[:, :2].min(axis=0) - MARGIN, boxes[:, 2:].max(axis=0) + MARGIN
        return World(
            name=f"barn-{file.stem}",
            bounds=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
            obstacles=shapes,
            robot=robot or Robot.rectangle(LENGTH, WIDTH),
            queries=(Query("ahead", START, GOAL),),
            sources=(file.absolute(),),
        )


SIZE = 201
"""Pixels a side; a pixel is one metre."""

PIXEL_RADIUS = 0.4
"""Metres: the pictures are planned on from pixel to pixel, and a pixel holds this robot."""

PIXELS: dict[str, Any] = {"resolution": 1.0, "origin": [0.0, 0.0, 0.0], "occupied_thresh": 0.5, "free_thresh": 0.5}
"""Brighter than half is free, as ``planning_python`` reads them."""

LOW_CORNER, HIGH_CORNER = (0.5, 0.5, 0.0), (SIZE - 0.5, SIZE - 0.5, 0.0)
"""The middles of pixels (0, 0) and (200, 200), the ends in the authors' ``SaIL/examples``."""


class Families(PublicSuite):
    """From the lower left pixel of every picture to the upper right one."""

    name = "families"
    contents = "alternating_gaps, forest, mazes, bug traps and others: 201 x 201 pictures, corner to corner"
    published = "github.com/mohakbhardwaj/motion_planning_datasets; M. Bhardwaj et al., CoRL 2017"
    robot = f"disc of {PIXEL_RADIUS:g} m, a pixel being 1 m"
    expected = "pictures of 201 x 201 pixels (.png)"

    def find(self, folder: Path) -> Found:
        """Return a problem for each picture."""
        return Found([(file, 0) for file in files_below(folder, ".png")])

    def world(self, folder: Path, file: Path, numbers: Sequence[int], robot: Robot | None) -> World:
        """Return the picture's world, named by family, part and number."""
        made = World.from_image(file, **PIXELS)
        if made.bounds[2:] != (SIZE, SIZE):
            raise FormatError(file, f"expected {SIZE} x {SIZE} pixels, got {made.bounds[2]:g} x {made.bounds[3]:g}")
        name = "-".join(file.absolute().parts[-3:-1]) + f"-{file.stem}"
        return replace(
            made,
            name=name,
            robot=robot or Robot.disc(PIXEL_RADIUS),
            queries=(Query("across", LOW_CORNER, HIGH_CORNER),),
        )
