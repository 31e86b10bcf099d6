"""Differential test: after each of many random changes, a planner that was updated knows what one built anew knows."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.changing.checker import Scene
from benchmarks.changing.planner import refused, walk
from benchmarks.machine import markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from trailmark import LandmarkPlanner
from trailmark.roadmap import EdgeStatus

WORLDS, CHANGES = 50, 200
"""Worlds, and changes of each."""

LANDMARKS, STATES = 100, 200
"""Landmarks spread over free space beforehand, and random configurations compared after each change."""


def measure(quick: bool) -> dict[str, Any]:
    """Return how many comparisons there were after how many changes, and how many differed."""
    worlds, changes = (6, 20) if quick else (WORLDS, CHANGES)
    total = dict.fromkeys(("changes", "states", "edges", "cells", "paths"), 0)
    wrong = dict.fromkeys(("valid", "clearance", "field", "certified", "blocked", "bounds", "refused"), 0)
    names = list(ROBOTS)
    for number in range(worlds):
        robot = ROBOTS[names[number % len(names)]]
        world = random_world(number, 60, size=50.0, discs=0.3, holes=0.2, boundary=number % 3 == 0)
        scene = Scene(f"world {number}", world, robot)
        planner = LandmarkPlanner(world, robot, seed=0, landmarks=LANDMARKS)
        rng = np.random.default_rng(number)
        for row in walk(scene, planner, changes, seed=number):
            _compare(planner, row, rng, scene, total, wrong)
        print(f"\r{number + 1} of {worlds} worlds: {wrong}", end="", flush=True)
    print()
    return {"worlds": worlds, "compared": total, "different": wrong}


def _compare(
    planner: LandmarkPlanner,
    row: dict[str, Any],
    rng: np.random.Generator,
    scene: Scene,
    total: dict[str, int],
    wrong: dict[str, int],
) -> None:
    world, (xmin, ymin, xmax, ymax) = row["world"], scene.world.bounds
    anew = LandmarkPlanner(world, scene.robot, seed=0)
    q = np.column_stack([rng.uniform((xmin, ymin), (xmax, ymax), (STATES, 2)), rng.uniform(-np.pi, np.pi, STATES)])
    mine, theirs = planner.checker, anew.checker
    valid = theirs.valid(q)
    wrong["valid"] += int(np.count_nonzero(mine.valid(q) != valid))
    wrong["clearance"] += int(np.count_nonzero(np.asarray(mine.clearance(q)) != np.asarray(theirs.clearance(q))))
    wrong["field"] += int(np.count_nonzero(mine.field.distance != theirs.field.distance))
    wrong["field"] += mine.field[1:] != theirs.field[1:]
    nodes, edges, _, status = planner.roadmap.rows()
    free = anew.motion.motions_between_valid(nodes[edges[:, 0]], nodes[edges[:, 1]])
    free &= theirs.valid(nodes)[edges].all(axis=1)
    wrong["certified"] += int(np.count_nonzero((status == EdgeStatus.FREE) & ~free))
    wrong["blocked"] += int(np.count_nonzero((status == EdgeStatus.BLOCKED) & free))
    if row["path"] is not None:
        total["paths"] += 1
        wrong["refused"] += refused(world, scene, row["path"])
        start, goal = row["start"], row["goal"]
        wrong["bounds"] += planner.bound.known(start, goal) > row["path"].cost * (1.0 + 1e-9)
    total["changes"] += 1
    total["states"] += STATES
    total["cells"] += mine.field.distance.size
    total["edges"] += len(edges)


def report(found: dict[str, Any]) -> str:
    """Return the section of the report."""
    compared, different = found["compared"], found["different"]
    rows = [
        ["`valid`", f"{compared['states']:,}", f"{different['valid']:,}"],
        ["`clearance`", f"{compared['states']:,}", f"{different['clearance']:,}"],
        ["cells of the clearance field", f"{compared['cells']:,}", f"{different['field']:,}"],
        ["edges certified, not by one built anew", f"{compared['edges']:,}", f"{different['certified']:,}"],
        ["edges blocked, not by one built anew", f"{compared['edges']:,}", f"{different['blocked']:,}"],
        ["lower bounds above the cost of a path", f"{compared['paths']:,}", f"{different['bounds']:,}"],
        ["paths refused by shapely, every 2 cm", f"{compared['paths']:,}", f"{different['refused']:,}"],
    ]
    return (
        f"## Differential test\n\n{compared['changes']:,} random changes over {found['worlds']} worlds (six robots; "
        "discs, polygons, holes, boundaries), half of them near the path; after each, what the updated planner knows "
        f"against one built anew.\n\n{markdown_table(['what', 'compared', 'different'], rows)}"
    )
