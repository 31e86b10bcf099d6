"""Moving AI Lab's grids with their scenarios."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import Found, PublicSuite, files_below
from trailmark.formats.files import read_text
from trailmark.formats.movingai import read_movingai, read_scenarios, scenario_query
from trailmark.world import Robot, World

__all__ = ["MovingAI"]

RADIUS = 0.4
"""Metres, of a robot that every cell holds and every step of the octile path lets through; a cell is one metre."""


class MovingAI(PublicSuite):
    """Every row of every ``.scen`` file, named by its bucket and its number; the maps may lie in another folder."""

    name = "movingai"
    contents = "grids of games, cities, rooms, mazes and noise, their scenarios by bucket of optimal length"
    published = "movingai.com/benchmarks; N. Sturtevant, Benchmarks for Grid-Based Pathfinding, 2012"
    robot = f"disc of {RADIUS:g} m, a cell being 1 m"
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
        made = read_movingai(read_text(grid), grid)
        if any((row.width, row.height) != made.bounds[2:] for row in rows):
            raise SuiteError(f"{file}: expected rows for {grid.name}, {made.bounds[2]:g} x {made.bounds[3]:g} cells")
        queries = tuple(scenario_query(rows[i], f"bucket-{rows[i].bucket}-row-{i}") for i in numbers)
        sources = tuple(dict.fromkeys((*made.sources, file.absolute())))
        return replace(made, robot=robot or Robot.disc(RADIUS), queries=queries, sources=sources)


def _map_name(scenarios: Path) -> str:
    """Return the name of the map that scenarios belong to: ``NAME.map.scen`` and ``NAME.scen`` to ``NAME.map``."""
    return scenarios.name[: -len(".scen")].removesuffix(".map") + ".map"
