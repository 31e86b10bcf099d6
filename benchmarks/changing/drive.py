"""A drive of ten minutes with ten changes a second: does memory grow, and does it get slower?"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.changing.planner import ends_of
from benchmarks.machine import markdown_table
from benchmarks.random_worlds import ROBOTS, random_world
from benchmarks.soak import resident
from trailmark import LandmarkPlanner, Rectangle, World

RATE, MINUTES = 10, 10
"""Changes a second, and minutes."""

SPEED = 1.0
"""Metres of the path's cost that the robot goes in a second."""

FIXED, MOST = 200, 40
"""Polygons that stay, and pallets at a time at most."""


def measure(quick: bool) -> dict[str, Any]:
    """Return for each minute the memory in use (MB) and the times of updates and replans (milliseconds)."""
    world, robot = random_world(0, FIXED), ROBOTS["rectangle"]
    planner, rng = LandmarkPlanner(world, robot, seed=0, landmarks=200), np.random.default_rng(0)
    start, goal = ends_of(planner)
    path = planner.plan(start, goal, time_limit=2.0).path
    minutes = []
    for _ in range(2 if quick else MINUTES):
        updates, replans, kept, arrived = [], [], 0, 0
        for _ in range(60 * RATE):
            changed = _changed(world, rng)
            begin = perf_counter()
            planner.update(changed)
            middle = perf_counter()
            here = start if path is None else path.at(min(1.0, SPEED / RATE / max(path.cost, 1e-9)))
            result = None if path is None else planner.replan(here, goal, path)
            end = perf_counter()
            updates.append(1e3 * (middle - begin))
            replans.append(1e3 * (end - middle))
            if result is None or result.path is None:
                # Something stands on the robot, or in its only way: it is taken back.
                planner.update(world)
            else:
                world, path, start, kept = changed, result.path, here, kept + result.kept
            if path is not None and path.cost < SPEED / RATE:
                start, goal, arrived = goal, ends_of(planner)[arrived % 2], arrived + 1
                path = planner.plan(start, goal, time_limit=2.0).path
        minutes.append(
            {
                "memory": resident(),
                "update": float(np.median(updates)),
                "replan": float(np.median(replans)),
                "p95": float(np.percentile(np.add(updates, replans), 95)),
                "kept": kept,
                "nodes": len(planner.roadmap),
            }
        )
        print(f"\r{len(minutes)} minutes", end="", flush=True)
    print()
    return {"minutes": minutes}


def _changed(world: World, rng: np.random.Generator) -> World:
    """Return the world after one pallet came, went or moved."""
    count = len(world.obstacles)
    if count - FIXED < MOST and (count == FIXED or rng.random() < 0.5):
        x, y, heading = rng.uniform((5.0, 5.0, -3.0), (95.0, 95.0, 3.0)).tolist()
        return world.edited(add=[Rectangle((x, y), 1.2, 0.8, heading)])
    pallet = int(rng.integers(FIXED, count))
    if rng.random() < 0.5:
        return world.edited(remove=[pallet])
    return world.edited(move={pallet: (*rng.normal(0.0, 0.5, 2), 0.1)})


def report(found: dict[str, Any]) -> str:
    """Return the section of the report."""
    rows = [
        [
            f"{i + 1}",
            f"{minute['memory']:.1f}",
            f"{minute['update']:.2f}",
            f"{minute['replan']:.2f}",
            f"{minute['p95']:.2f}",
            f"{minute['kept']}",
            f"{minute['nodes']:,}",
        ]
        for i, minute in enumerate(found["minutes"])
    ]
    growth = max(m["memory"] for m in found["minutes"][1:]) - found["minutes"][0]["memory"]
    header = ["minute", "memory MB", "update ms", "replan ms", "95 % of both ms", "paths kept", "nodes"]
    return (
        f"## Drive\n\n{len(found['minutes'])} minutes, {RATE} changes a second (pallets come, go and move among "
        f"{FIXED} polygons), simulated as fast as it goes; the robot drives {SPEED:g} m/s. Memory after the first "
        f"minute: at most {growth:+.1f} MB.\n\n{markdown_table(header, rows)}"
    )
