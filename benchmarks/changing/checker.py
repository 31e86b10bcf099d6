"""Checker and final check: one obstacle added, removed or moved, against building anew, and the same answers."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from benchmarks.machine import markdown_table
from benchmarks.random_worlds import ROBOTS, random_world, star_polygon
from benchmarks.suite import data_folder
from trailmark import Rectangle, Robot, World
from trailmark.collision import StateChecker
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.library import find_world
from trailmark.planning.final_check import FinalCheck
from trailmark.shapes import Shape

KINDS = ("add", "remove", "move")

COMPARED = 10
"""One in so many edited checkers is compared with one built anew."""


class Scene(NamedTuple):
    """What is changed.

    Attributes:
        name: in the table.
        world: before the first change.
        robot: its footprint.
        pallets: whether what comes is a pallet, and only pallets go and move; otherwise any polygon does.
    """

    name: str
    world: World
    robot: Robot
    pallets: bool = False


def scenes() -> Iterator[Scene]:
    """Yield what is changed."""
    robot = ROBOTS["rectangle"]
    yield Scene("200 polygons", random_world(0, 200), robot)
    # Its cells may be no larger than a small robot, so that there are four times as many.
    yield Scene("200 polygons, robot 0.4 x 0.2 m", random_world(0, 200), Robot.rectangle(0.4, 0.2))
    yield Scene("2,000 polygons on the same field", random_world(0, 2000, radii=(0.2, 1.2)), robot)
    yield Scene("2,000 polygons as dense as the 200", random_world(0, 2000, size=316.0), robot)
    warehouse = World.load(find_world("warehouse"))
    if warehouse.robot is not None:
        yield Scene("warehouse", warehouse, warehouse.robot, pallets=True)
    depot = data_folder() / "nav2" / "depot.yaml"
    if depot.exists():
        yield Scene("depot", World.load(depot), Robot.rectangle(0.9, 0.6), pallets=True)


def changed_worlds(scene: Scene, changes: int, rng: np.random.Generator) -> Iterator[tuple[str, World]]:
    """Yield the worlds after one change each, and the kind of the change."""
    world, fixed = scene.world, len(scene.world.obstacles) if scene.pallets else 0
    for k in range(changes):
        there = len(world.obstacles)
        kind = "add" if there == fixed else KINDS[k % 3]
        i = int(rng.integers(fixed, there)) if there > fixed else 0
        if kind == "add":
            world = world.edited(add=[_new_obstacle(scene, rng)])
        elif kind == "remove":
            world = world.edited(remove=[i])
        else:
            world = world.edited(move={i: (*rng.uniform(-1.0, 1.0, 2), float(rng.normal(0.0, 0.3)))})
        yield kind, world


def _new_obstacle(scene: Scene, rng: np.random.Generator) -> Shape:
    xmin, ymin, xmax, ymax = scene.world.bounds
    center = (float(rng.uniform(xmin, xmax)), float(rng.uniform(ymin, ymax)))
    if scene.pallets:
        return Rectangle(center, 1.2, 0.8, float(rng.uniform(-3.0, 3.0)))
    return star_polygon(rng, center, float(rng.uniform(0.5, 4.0)))


def measure(quick: bool) -> dict[str, Any]:
    """Return the times (milliseconds), and how many checkers were compared with one built anew and differed."""
    changes, repeats = (30, 3) if quick else (600, 15)
    return {"scenes": [_measure_scene(scene, changes, repeats) for scene in scenes()]}


def _measure_scene(scene: Scene, changes: int, repeats: int) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    checker = StateChecker(scene.world, scene.robot)
    final = FinalCheck(scene.world, scene.robot)
    anew = _times(lambda: StateChecker(scene.world, scene.robot), repeats)
    final_anew = _times(lambda: FinalCheck(scene.world, scene.robot), repeats)
    begin = perf_counter()
    # What the first change alone takes: the grid gets room for more.
    checker.edited(scene.world.edited(add=[_new_obstacle(scene, rng)]))
    first = 1e3 * (perf_counter() - begin)
    times: dict[str, list[float]] = {kind: [] for kind in (*KINDS, "final")}
    compared = different = 0
    for k, (kind, world) in enumerate(changed_worlds(scene, changes, rng)):
        begin = perf_counter()
        checker = checker.edited(world)
        middle = perf_counter()
        final = final.edited(world)
        times[kind].append(1e3 * (middle - begin))
        times["final"].append(1e3 * (perf_counter() - middle))
        if k % COMPARED == 0:
            compared += 1
            different += not _alike(checker, StateChecker(world, scene.robot))
    every = [time for kind in KINDS for time in times[kind]]
    return {
        "name": scene.name,
        "obstacles": len(scene.world.obstacles),
        "cells": checker.grid.rows * checker.grid.columns,
        "anew": float(np.median(anew)),
        "first": first,
        **{kind: float(np.median(times[kind])) for kind in KINDS},
        "p95": float(np.percentile(every, 95)),
        "max": max(every),
        "ratio": float(np.median(anew) / np.median(every)),
        "final_anew": float(np.median(final_anew)),
        "final": float(np.median(times["final"])),
        "compared": compared,
        "different": different,
    }


def _times(call: Any, repeats: int) -> list[float]:
    call()
    times = []
    for _ in range(repeats):
        begin = perf_counter()
        call()
        times.append(1e3 * (perf_counter() - begin))
    return times


def _alike(a: StateChecker, b: StateChecker) -> bool:
    """Return whether two checkers have the same grid, up to the order of what its cells list, and the same field."""
    return (
        np.array_equal(a.grid.winding, b.grid.winding)
        and np.array_equal(a.field.distance, b.field.distance)
        and a.field[1:] == b.field[1:]
        and np.array_equal(_listed(a.grid), _listed(b.grid))
    )


def _listed(grid: ObstacleGrid) -> np.ndarray:
    """Return a row for each item of each cell, shape (n, 5): the cell, the item's numbers."""
    counts = np.diff(grid.cell_start, axis=1)
    cells = np.repeat(np.arange(counts.size), counts.ravel())
    items = np.concatenate(
        [grid.items[begin:end] for begin, end in zip(grid.cell_start[:, 0], grid.cell_start[:, -1], strict=True)]
    )
    rows = np.zeros((len(items), 5))
    rows[:, 0] = cells
    rows[items >= 0, 1:] = grid.segments[items[items >= 0]]
    rows[items < 0, 1:4] = grid.discs[-1 - items[items < 0]]
    return rows[np.lexsort(rows.T[::-1])]


def report(found: dict[str, Any]) -> str:
    """Return the section of the report."""
    header = ["world", "obstacles", "cells", "anew ms", "added ms", "removed ms", "moved ms", "p95 ms", "max ms"]
    header += ["anew / change", "first change ms", "final check anew ms", "changed ms", "compared", "different"]
    rows = [
        [
            row["name"],
            f"{row['obstacles']:,}",
            f"{row['cells']:,}",
            f"{row['anew']:.1f}",
            *(f"{row[key]:.2f}" for key in (*KINDS, "p95", "max")),
            f"{row['ratio']:.0f}",
            f"{row['first']:.1f}",
            f"{row['final_anew']:.1f}",
            f"{row['final']:.2f}",
            f"{row['compared']:,}",
            f"{row['different']:,}",
        ]
        for row in found["scenes"]
    ]
    return (
        "## Checker\n\nOne obstacle added, removed or moved (by up to 1 m and some turn): obstacle grid and clearance "
        "field (`StateChecker.edited`), and the edges of the final check (`FinalCheck.edited`); medians. Compared are "
        "all cells' items, the numbers of regions over them, all distances and the slack with those of a checker built "
        f"anew.\n\n{markdown_table(header, rows)}"
    )
