"""Objectives, zones and clearance against the optimum of a fine grid. Writes results/objectives.{json,md}.

Twenty worlds with random obstacles, cost and speed zones: discs among 25 obstacles, rectangles among 8. Each is planned
for one objective (length with cost zones, time, clearance), in turn with 0.1 m of clearance and without, and once more
for plain length without zones, in the same run. The oracle shares no code with the planner: shapely says where the
robot fits and what a metre costs, scipy's Dijkstra searches a grid of cells of 4 cm, for rectangles of 10 cm times 16
headings, whose moves lead in 32 directions. Its paths are longer than need be by 1.3 % at most.

Then the robot of 0.9 x 0.62 m in an aisle of 1.1 m: how far from the middle is it?

    python -m benchmarks.objectives [--worlds 20] [--no-write]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse
import shapely
from scipy.sparse.csgraph import dijkstra

from benchmarks.density_oracle import sampled_cost, sampled_density
from benchmarks.machine import describe_machine, markdown_table
from benchmarks.random_worlds import star_polygon
from trailmark import CostZone, LandmarkPlanner, Objective, PlanResult, Polygon, Rectangle, Robot, SpeedZone, World
from trailmark.formats.files import write_atomically
from trailmark.se2 import FloatArray, transform

RESULTS = Path(__file__).resolve().parent / "results"
OBJECTIVES = {
    "length": Objective(),
    "time": Objective.of("time", max_speed=1.0),
    "clearance": Objective.of("clearance"),
}
LIMIT, SEEDS, MARGIN = 1.0, 3, 0.1
MOVES = [(i, j) for i in range(-3, 4) for j in range(-3, 4) if np.gcd(i, j) == 1 and (i, j) > (0, 0)]
HEADINGS = 16


def random_case(seed: int) -> tuple[World, FloatArray, float]:
    """Return a world with obstacles and zones, start and goal (2, 3), and the cells of the oracle, metres."""
    rng, disc = np.random.default_rng([17, seed]), seed % 4 != 3
    size, count = (16.0, 25) if disc else (8.0, 8)
    robot = Robot.disc(0.25) if disc else Robot.rectangle(0.7, 0.4)
    ends = np.array([[0.8, 0.8, 0.0], [size - 0.8, size - 0.8, 0.0]])
    apart = shapely.buffer(shapely.points(ends[:, :2]), 0.8)
    obstacles: list[Polygon] = []
    while len(obstacles) < count:
        shape = star_polygon(rng, tuple(rng.uniform(0.0, size, 2)), float(rng.uniform(0.4, 1.4)))
        if not shapely.intersects(apart, shape.shapely()).any():
            obstacles.append(shape)
    zones: list[CostZone | SpeedZone] = []
    for k in range(4):
        (x, y), (u, v) = rng.uniform(0.0, 0.7 * size, 2), rng.uniform(0.15, 0.45, 2) * size
        region = Polygon(np.array([(x, y), (x + u, y), (x + u, y + v), (x, y + v)]))
        zones.append(CostZone(region, float(rng.choice([0.4, 2.0, 5.0]))))
        zones.append(SpeedZone(region, float(rng.uniform(0.2, 0.8)))) if k % 2 else None
    world = World(f"objectives {seed}", (0.0, 0.0, size, size), tuple(obstacles), robot, zones=tuple(zones))
    return world, ends, 0.04 if disc else 0.1


def solids(world: World) -> shapely.Geometry:
    """Return obstacles and bounds as one geometry."""
    return shapely.union_all([shapely.box(*world.bounds).exterior, *(s.polygon().shapely() for s in world.obstacles)])


def optimum(world: World, objective: Objective, ends: FloatArray, cell: float, margin: float) -> float:
    """Return the least cost over the grid; infinite if nothing leads there."""
    robot, count = world.robot, round(world.bounds[2] / cell) + 1
    assert robot is not None
    turns = robot.sweep_radius > 0.0
    layers = HEADINGS if turns else 1
    places = np.linspace(0.0, world.bounds[2], count)
    xy = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    blocked, headings = solids(world), 2.0 * np.pi / layers * np.arange(layers)
    shapely.prepare(blocked)
    free = np.zeros((layers, count * count), np.bool_)
    away = shapely.distance(blocked, shapely.points(xy))
    inside = shapely.intersects_xy(shapely.union_all([s.polygon().shapely() for s in world.obstacles]), xy)
    for k, heading in enumerate(headings):
        if not turns:
            free[k] = (away >= robot.circumradius + margin) & ~inside
            continue
        # The outline is looked at where the distance of its reference point does not tell.
        free[k] = (away >= robot.circumradius + margin) & ~inside
        close = np.flatnonzero(~free[k] & ~inside & (away >= robot.inscribed_disc.radius + margin))
        rows = np.column_stack([xy[close], np.full(len(close), heading)])
        bodies = shapely.polygons(transform(rows, robot.outline.rings()[0]))
        free[k, close] = shapely.distance(blocked, bodies) >= max(margin, 1e-9)
    metre = sampled_density(world, objective, xy)
    index = np.arange(count * count).reshape(count, count)
    rows_, columns_, costs = [], [], []
    for i, j in MOVES:
        a = index[max(0, -i) : count - max(0, i), max(0, -j) : count - max(0, j)].ravel()
        b = index[max(0, i) : count + min(0, i), max(0, j) : count + min(0, j)].ravel()
        for k in range(layers):
            both = free[k, a] & free[k, b]
            rows_.append(a[both] + k * count * count)
            columns_.append(b[both] + k * count * count)
            costs.append(0.5 * (metre[a[both]] + metre[b[both]]) * cell_width(world, count) * np.hypot(i, j))
    for k in range(layers if turns else 0):
        both = np.flatnonzero(free[k] & free[(k + 1) % layers])
        rows_.append(both + k * count * count)
        columns_.append(both + (k + 1) % layers * count * count)
        costs.append(np.full(len(both), objective.rotation * 2.0 * np.pi / layers))
    size = layers * count * count
    graph = scipy.sparse.coo_matrix(
        (np.concatenate(costs), (np.concatenate(rows_), np.concatenate(columns_))), shape=(size, size)
    ).tocsr()
    start, goal = (int(np.argmin(np.hypot(*(xy - q[:2]).T))) for q in ends)
    found: Any = dijkstra(graph, directed=False, indices=[start], return_predecessors=True)
    cost, before = found[0][0], found[1][0]
    if not np.isfinite(cost[goal]):
        return np.inf
    path = [goal]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    # Charged anew, for a move across a zone's border was charged by its ends.
    cells = np.array(path)
    states = np.column_stack([xy[cells % (count * count)], headings[cells // (count * count)]])
    return sampled_cost(world, objective, states, 5e-3)


def cell_width(world: World, count: int) -> float:
    """Return the distance between neighbouring places of the oracle, metres."""
    return (world.bounds[2] - world.bounds[0]) / (count - 1)


def planned(world: World, ends: FloatArray, objective: Objective, margin: float) -> list[PlanResult]:
    """Return the answers of planners with several seeds."""
    results = []
    for seed in range(SEEDS):
        planner = LandmarkPlanner(world, seed=seed, objective=objective, clearance=margin)
        results.append(planner.plan(ends[0], ends[1], time_limit=LIMIT))
    return results


def first_seconds(results: list[PlanResult]) -> float:
    """Return the mean time to a first path, seconds, as logarithms have it."""
    return float(np.exp(np.mean([np.log(result.time["first_solution"] or LIMIT) for result in results])))


def compare(count: int) -> list[dict[str, Any]]:
    """Return a row for each world."""
    rows = []
    for seed in range(count):
        world, ends, cell = random_case(seed)
        name = list(OBJECTIVES)[seed % 3]
        margin, objective = MARGIN * (seed // 3 % 2), OBJECTIVES[name]
        best = optimum(world, objective, ends, cell, margin)
        planned(world, ends, objective, margin)  # compiles
        results = planned(world, ends, objective, margin)
        plain = planned(replace(world, zones=()), ends, Objective(), 0.0)
        row: dict[str, Any] = {"world": seed, "robot": "disc" if seed % 4 != 3 else "rectangle", "objective": name}
        row |= {"clearance": margin, "optimum": best, "solved": sum(r.status == "solved" for r in results)}
        costs = [r.cost for r in results if r.cost is not None]
        row["cost"] = float(np.mean(costs)) if costs else None
        row["ratio"] = row["cost"] / best if costs and np.isfinite(best) else None
        row["bounds_hold"] = all((r.lower_bound or 0.0) <= r.cost for r in results if r.cost is not None)
        bounds = [(r.lower_bound or 0.0) / r.cost for r in results if r.cost]
        row["bound"] = float(np.mean(bounds)) if bounds else None
        row["first"], row["first_plain"] = first_seconds(results), first_seconds(plain)
        rows.append(row)
        print(row, flush=True)
    return rows


def aisle() -> dict[str, Any]:
    """Return how far from the middle of an aisle the robot drives, metres, and when it had a first path, seconds."""
    blocks = (Rectangle((6.0, 0.725), 8.0, 1.45), Rectangle((6.0, 3.275), 8.0, 1.45))
    world = World("aisle", (0.0, 0.0, 12.0, 4.0), blocks, Robot.rectangle(0.9, 0.62))
    off, first = [], []
    for seed in range(10):
        planner = LandmarkPlanner(world, seed=seed, objective="clearance")
        result = planner.plan((1.0, 2.4, 0.0), (11.0, 1.6, 0.0), time_limit=LIMIT)
        assert result.path is not None
        dense = np.array(result.path.resample(0.02).states)
        within = dense[(dense[:, 0] > 2.6) & (dense[:, 0] < 9.4)]
        off.append(float(np.abs(within[:, 1] - 2.0).max()))
        first.append(float(result.time["first_solution"] or LIMIT))
    return {"off_middle": max(off), "first": max(first), "first_median": float(np.median(first))}


def main() -> int:
    """Compare and write; 0 if all that is wanted was reached."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=20)
    parser.add_argument("--no-write", action="store_true", help="print only")
    options = parser.parse_args()
    rows, middle = compare(options.worlds), aisle()
    ratios = [row["ratio"] for row in rows if row["ratio"] is not None]
    slower = float(np.exp(np.mean([np.log(row["first"] / row["first_plain"]) for row in rows])))
    header = [
        "world",
        "robot",
        "objective",
        "clearance",
        "solved",
        "cost",
        "of the grid's",
        "bound / cost",
        "first path",
    ]
    header += ["of plain length's"]
    table = [
        [
            *(str(row["world"]), row["robot"], row["objective"], f"{row['clearance']:g} m", f"{row['solved']}/{SEEDS}"),
            *(
                f"{row[key]:.{digits}f}" if row[key] else ""
                for key, digits in (("cost", 2), ("ratio", 3), ("bound", 3))
            ),
            *(f"{1e3 * row['first']:.1f} ms", f"{row['first'] / row['first_plain']:.2f}"),
        ]
        for row in rows
    ]
    facts = [
        f"Cost at {LIMIT:g} s over the grid's optimum: {max(ratios):.3f} at most (wanted 1.02), "
        f"{np.exp(np.mean(np.log(ratios))):.3f} on the mean.",
        f"Lower bounds never above costs: {all(row['bounds_hold'] for row in rows)}.",
        f"First path over plain length's, geometric mean: {slower:.2f} (wanted 2).",
        f"Aisle: {1e3 * middle['off_middle']:.1f} mm off the middle at most (wanted 10), first path "
        f"{1e3 * middle['first']:.1f} ms at most, {1e3 * middle['first_median']:.1f} ms median (wanted 20), 10 seeds.",
    ]
    text = "\n\n".join([markdown_table(header, table), *facts])
    print(text)
    if not options.no_write:
        machine = describe_machine()
        record = {"machine": machine, "rows": rows, "aisle": middle, "first_ratio": slower}
        write_atomically(RESULTS / "objectives.json", json.dumps(record, indent=1) + "\n")
        about = "# Objectives, zones and clearance\n\nWritten by `python -m benchmarks.objectives`, which says how.\n\n"
        write_atomically(RESULTS / "objectives.md", f"{about}{text}\n\n{machine}\n")
    reached = max(ratios) <= 1.02 and slower <= 2.0 and middle["off_middle"] <= 0.01 and middle["first"] <= 0.02
    return 0 if reached and all(row["bounds_hold"] for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
