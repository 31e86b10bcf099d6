"""Planner: from a change of the world to a certified path, where it touched the path and where it did not."""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.changing.checker import Scene, scenes
from benchmarks.machine import markdown_table
from benchmarks.oracle import Oracle, motion_states
from benchmarks.random_worlds import star_polygon
from trailmark import LandmarkPlanner, Path, Rectangle, World
from trailmark.landmarks import free_samples
from trailmark.se2 import FloatArray
from trailmark.shapes import Shape

FRESH_EVERY = 10
"""One in so many replaced paths is compared with what a new planner finds in the same time, and refereed."""

NEAR = 0.5
"""Share of the changes that are made near the path, where they are likely to touch it."""


def measure(quick: bool) -> dict[str, Any]:
    """Return the times (milliseconds) of updates and replans, costs against fresh plans, and refused paths."""
    changes = 100 if quick else 400
    return {"scenes": [_measure_scene(scene, changes) for scene in scenes()]}


def ends_of(planner: LandmarkPlanner) -> tuple[FloatArray, FloatArray]:
    """Return a start and a goal in opposite corners that a path joins."""
    q = free_samples(planner.checker, 400, random_state=1)
    reached = planner.relaxation.component(q[np.argmin(q[:, 0] + q[:, 1])])
    q = q[reached[planner.relaxation.cells(planner.relaxation.disc_centers(q))]]
    order = np.argsort(q[:, 0] + q[:, 1])
    return q[order[0]], q[order[-1]]


def changes_along(scene: Scene, path: Path, world: World, rng: np.random.Generator) -> World:
    """Return the world after one change, as often as not one near the path."""
    fixed = len(scene.world.obstacles) if scene.pallets else 0
    there = len(world.obstacles)
    kind = int(rng.integers(3)) if there > fixed else 0
    if kind == 0:
        return world.edited(add=[_obstacle(scene, path, rng)])
    if kind == 1:
        return world.edited(remove=[int(rng.integers(fixed, there))])
    return world.edited(replace={int(rng.integers(fixed, there)): _obstacle(scene, path, rng)})


def _obstacle(scene: Scene, path: Path, rng: np.random.Generator) -> Shape:
    xmin, ymin, xmax, ymax = scene.world.bounds
    center = rng.uniform((xmin, ymin), (xmax, ymax))
    if rng.random() < NEAR:
        center = path.at(rng.uniform(0.05, 0.95))[:2] + rng.normal(0.0, scene.robot.circumradius, 2)
    where = (float(center[0]), float(center[1]))
    if scene.pallets:
        return Rectangle(where, 1.2, 0.8, float(rng.uniform(-3.0, 3.0)))
    return star_polygon(rng, where, float(rng.uniform(0.5, 3.0)))


def walk(scene: Scene, planner: LandmarkPlanner, changes: int, seed: int) -> Iterator[dict[str, Any]]:
    """Yield what became of each of so many changes, all of them with start and goal free.

    A change that leaves no path, which the planner must prove or find none within a second, is taken back.
    """
    rng = np.random.default_rng(seed)
    start, goal = ends_of(planner)
    found = planner.plan(start, goal, time_limit=2.0)
    while found.path is None:
        start, goal = ends_of(planner)
        found = planner.plan(start, goal, time_limit=10.0)
    path, world = found.path, planner.world
    for _ in range(changes):
        changed = changes_along(scene, path, world, rng)
        begin = perf_counter()
        planner.update(changed)
        middle = perf_counter()
        result = planner.replan(start, goal, path)
        end = perf_counter()
        row: dict[str, Any] = {"update": 1e3 * (middle - begin), "replan": 1e3 * (end - middle), "kept": result.kept}
        row |= {"touched": "blocked" in result.reason, "status": result.status, "result": result}
        if result.path is None:
            planner.update(world)
        else:
            path, world = result.path, changed
        yield row | {"world": world, "start": start, "goal": goal, "path": path}


def refused(world: World, scene: Scene, path: Path) -> bool:
    """Return whether the referee, shapely alone, finds a collision along a path, each 2 cm."""
    states = path.states
    lengths = np.hypot(*np.diff(states[:, :2], axis=0).T) + scene.robot.circumradius * np.abs(np.diff(states[:, 2]))
    oracle = Oracle(world, scene.robot)
    for a, b, length in zip(states[:-1], states[1:], lengths, strict=True):
        if oracle.collides(motion_states(a[None], b[None], 2 + int(length / 0.02))[0]).any():
            return True
    return False


def _measure_scene(scene: Scene, changes: int) -> dict[str, Any]:
    planner = LandmarkPlanner(scene.world, scene.robot, seed=0)
    begin = perf_counter()
    for _ in range(3):
        LandmarkPlanner(scene.world, scene.robot, seed=0)
    anew = 1e3 * (perf_counter() - begin) / 3
    rows, ratios, judged, bad = [], [], 0, 0
    for k, row in enumerate(walk(scene, planner, changes, seed=0)):
        rows.append(row)
        if row["touched"] and row["result"].path is not None and k % FRESH_EVERY == 0:
            fresh = LandmarkPlanner(row["world"], scene.robot, seed=k)
            found = fresh.plan(row["start"], row["goal"], time_limit=1e-3 * (row["update"] + row["replan"]))
            if found.cost is not None:
                ratios.append(row["result"].cost / found.cost)
            judged += 1
            bad += refused(row["world"], scene, row["path"])
    total = {
        touched: [r["update"] + r["replan"] for r in rows if r["touched"] == touched and r["status"] == "solved"]
        for touched in (True, False)
    }
    return {
        "name": scene.name,
        "obstacles": len(scene.world.obstacles),
        "anew": anew,
        "update": float(np.median([r["update"] for r in rows])),
        "touched": _quantiles(total[True]),
        "untouched": _quantiles(total[False]),
        "no_path": sum(r["status"] != "solved" for r in rows),
        "cost_ratio": float(np.exp(np.mean(np.log(ratios)))) if ratios else None,
        "compared": len(ratios),
        "judged": judged,
        "refused": bad,
    }


def _quantiles(times: list[float]) -> list[float]:
    """Return number, median and 95th percentile."""
    return [len(times), *(float(v) for v in np.percentile(times, [50, 95]))] if times else [0, np.nan, np.nan]


def report(found: dict[str, Any]) -> str:
    """Return the section of the report."""
    header = ["world", "obstacles", "anew ms", "update ms", "anew / update", "touched", "median ms", "95 % ms"]
    header += ["untouched", "median ms", "95 % ms", "no path", "cost / fresh", "of", "refused", "of"]
    rows = [
        [
            row["name"],
            f"{row['obstacles']:,}",
            f"{row['anew']:.1f}",
            f"{row['update']:.2f}",
            f"{row['anew'] / row['update']:.0f}",
            *(f"{v:.2f}" if i else f"{v:.0f}" for key in ("touched", "untouched") for i, v in enumerate(row[key])),
            f"{row['no_path']}",
            "-" if row["cost_ratio"] is None else f"{row['cost_ratio']:.3f}",
            f"{row['compared']}",
            f"{row['refused']}",
            f"{row['judged']}",
        ]
        for row in found["scenes"]
    ]
    return (
        "## Planner\n\nOne obstacle added, removed or moved, half of them near the path; then `update` and `replan`: "
        "from the change to a certified path, where the change blocked the path and where it did not. Anew: a new "
        "planner without roadmap. Fresh: the path that a new planner finds in the time that update and replan took, "
        f"its own making not counted. Refused: by shapely, every 2 cm.\n\n{markdown_table(header, rows)}"
    )
