"""Replanning against the usual baselines: D* Lite on a grid with the inscribed disc, and planning anew each time."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.changing.checker import Scene, scenes
from benchmarks.changing.d_star_lite import DStarLite
from benchmarks.changing.planner import refused, walk
from benchmarks.machine import markdown_table
from trailmark import LandmarkPlanner, Path, World
from trailmark.collision import StateChecker
from trailmark.landmarks import Relaxation
from trailmark.se2 import FloatArray
from trailmark.world import Robot

CHOSEN = ("200 polygons", "warehouse", "depot")
"""Scenes."""

FRESH_LIMIT = 0.05
"""Seconds that planning anew has for its path."""


def measure(quick: bool) -> dict[str, Any]:
    """Return times (milliseconds), costs (metres) and collisions of the three."""
    changes = 10 if quick else 100
    return {"scenes": [_measure(scene, changes) for scene in scenes() if scene.name in CHOSEN]}


def _measure(scene: Scene, changes: int) -> dict[str, Any]:
    planner = LandmarkPlanner(scene.world, scene.robot, seed=0)
    grid = _Grid(scene.world, scene.robot)
    lite: DStarLite | None = None
    found: dict[str, dict[str, list[float]]] = {
        name: {"ms": [], "cost": [], "refused": []} for name in ("replan", "anew", "d_star_lite")
    }
    for row in walk(scene, planner, changes, seed=1):
        world, start, goal = row["world"], row["start"], row["goal"]
        if row["status"] != "solved":
            continue
        _note(found["replan"], row["update"] + row["replan"], row["path"], world, scene)
        begin = perf_counter()
        fresh = LandmarkPlanner(world, scene.robot, seed=0).plan(start, goal, time_limit=FRESH_LIMIT)
        _note(found["anew"], 1e3 * (perf_counter() - begin), fresh.path, world, scene)
        open_ = grid.open(world)
        begin = perf_counter()
        cells = grid.cell(start), grid.cell(goal)
        if lite is None:
            lite = DStarLite(open_, *cells)
        else:
            lite.change(open_, cells[0])
        path = grid.path(lite.path(), start, goal)
        _note(found["d_star_lite"], 1e3 * (perf_counter() - begin), path, world, scene)
    return {"name": scene.name, "methods": {name: _summary(rows) for name, rows in found.items()}}


class _Grid:
    """Cells of the relaxed problem's size; open where the inscribed disc fits at the cell's centre."""

    def __init__(self, world: World, robot: Robot) -> None:
        self.robot = robot
        self.relaxation = Relaxation(StateChecker(world, robot))

    def open(self, world: World) -> NDArray[np.bool_]:
        relaxation = Relaxation(StateChecker(world, self.robot))
        every = np.arange(relaxation.rows * relaxation.columns)
        free = relaxation.clearance(every) >= relaxation.radius
        return free.reshape(relaxation.rows, relaxation.columns)

    def cell(self, q: FloatArray) -> tuple[int, int]:
        cell = int(self.relaxation.cells(self.relaxation.disc_centers(q)))
        return divmod(cell, self.relaxation.columns)

    def path(self, cells: list[tuple[int, int]], start: FloatArray, goal: FloatArray) -> Path | None:
        """Return the disc's path with the robot's heading along it, as a controller would drive it."""
        if len(cells) < 2:
            return None
        numbers = np.array([row * self.relaxation.columns + column for row, column in cells])
        centers = self.relaxation.cell_centers(numbers)
        steps = np.diff(centers, axis=0)
        headings = np.arctan2(steps[:, 1], steps[:, 0])
        states = self.relaxation.references(centers[1:-1], headings[:-1]) if len(cells) > 2 else np.empty((0, 3))
        return Path(np.vstack([start, states, goal]))


def _note(rows: dict[str, list[float]], milliseconds: float, path: Path | None, world: World, scene: Scene) -> None:
    rows["ms"].append(milliseconds)
    if path is not None:
        rows["cost"].append(path.cost)
        rows["refused"].append(refused(world, scene, path))
    else:
        rows["cost"].append(np.nan)
        rows["refused"].append(np.nan)


def _summary(rows: dict[str, list[float]]) -> dict[str, Any]:
    return {
        "median": float(np.median(rows["ms"])),
        "p95": float(np.percentile(rows["ms"], 95)),
        "cost": float(np.nanmean(rows["cost"])),
        "paths": int(np.isfinite(rows["cost"]).sum()),
        "collide": int(np.nansum(rows["refused"])),
        "changes": len(rows["ms"]),
    }


def report(found: dict[str, Any]) -> str:
    """Return the section of the report."""
    names = {"replan": "update and replan", "anew": "a new planner", "d_star_lite": "D* Lite, inscribed disc"}
    rows = [
        [
            scene["name"],
            names[method],
            f"{row['median']:.1f}",
            f"{row['p95']:.1f}",
            f"{row['cost']:.1f}",
            f"{row['paths']} of {row['changes']}",
            f"{row['collide']}",
        ]
        for scene in found["scenes"]
        for method, row in scene["methods"].items()
    ]
    header = ["world", "method", "median ms", "95 % ms", "mean cost m", "paths", "collide"]
    return (
        "## Baselines\n\nOne change at a time, half of them near the path. A new planner: its making and a path within "
        f"{1e3 * FRESH_LIMIT:g} ms, of which it uses all. D* Lite is written in Python, 8-connected, on the relaxed "
        "problem's cells; which of them opened or closed is given to it, not timed; the robot heads along its path. "
        f"Collide: paths along which the footprint meets an obstacle, by shapely.\n\n{markdown_table(header, rows)}"
    )
