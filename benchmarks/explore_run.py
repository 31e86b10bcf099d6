"""One exploration of a benchmark, and what it is measured by; benchmarks.explore gives each a process of its own."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.explore_oracle import Truth, boundary_errors, overlaps, seen_share, tour_length, truth_of
from benchmarks.explore_worlds import KINDS, ROBOTS, SENSOR_RANGE, explore_world
from benchmarks.suite import data_folder
from trailmark import LandmarkPlanner, Robot, World
from trailmark.audit import check_path
from trailmark.collision import StateChecker
from trailmark.estimation import spend_risk
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.explorer import Explorer
from trailmark.exploration.outlook import Outlook
from trailmark.exploration.result import ExplorationResult
from trailmark.exploration.tour import tour
from trailmark.exploration.warmup import warm_up_exploration
from trailmark.library import shipped_worlds
from trailmark.world import Query

__all__ = ["CONFIDENCE", "DRIVES", "WITHOUT_LOOPS", "Job", "hidden_world", "run_job", "sensor_range_of"]

FloatArray = NDArray[np.float64]

CONFIDENCE = 0.99
"""Of the runs with noise."""

PAIRS = 6
"""Pairs of places between which paths are planned in the map that was made and in the true one."""

PLANNING = 0.5
"""Seconds for each of these."""

ANCHOR = "tour with the map known"
"""Takes the place of a strategy: the lower anchor."""


IMAGE_RANGE = 80.0
"""Metres, one for each pixel: what the sensor sees in images, by the source of them (ARiADNE, env.py)."""

DRIVES = {
    "differential": lambda robot: robot.differential(),
    "forward": lambda robot: robot.differential(reverse=False),
    "car": lambda robot: robot.steered(0.5),
}
"""How the world's robot drives where a world's name ends in one of these: ``office 3 as car``."""

WITHOUT_LOOPS = "tour-without-loops"
"""The strategy of that name, for the ablation."""


def tour_without_loops(outlook: Outlook) -> int:
    """Choose as the tour does where nothing makes the robot surer of its place."""
    return tour(outlook._replace(certainty=np.zeros_like(outlook.certainty)))


class Job(NamedTuple):
    """What to measure."""

    world: str
    seed: int
    noise: float
    strategy: str


def hidden_world(name: str) -> World:
    """Return a generated world (``office 3``), a shipped one (``office``), or a map of the real data.

    Maps (``room.yaml``) get a round robot that starts where it fits nearest to the middle; images (``maze.png``), in
    which the start is marked, one of two pixels. The robot moves in every direction unless the name ends in a drive.
    """
    name, _, drive = name.partition(" as ")
    if drive:
        world = hidden_world(name)
        assert world.robot is not None
        return replace(world, robot=DRIVES[drive](world.robot))
    if name.endswith(".png"):
        return replace(World.load(data_folder() / "explore" / name), robot=Robot.disc(2.0))
    if name.endswith(".yaml"):
        world, robot = World.load(data_folder() / "explore" / name), ROBOTS[0]
        xmin, ymin, xmax, ymax = world.bounds
        grid = np.stack(np.meshgrid(np.arange(xmin, xmax, 0.5), np.arange(ymin, ymax, 0.5)), axis=-1).reshape(-1, 2)
        grid = grid[np.argsort(np.hypot(*(grid - [0.5 * (xmin + xmax), 0.5 * (ymin + ymax)]).T), kind="stable")]
        places = np.column_stack([grid, np.zeros(len(grid))])
        fits = np.asarray(StateChecker(world, robot.keeping(0.1)).valid(places), dtype=bool)
        x, y, theta = places[fits][0].tolist()
        return replace(world, robot=robot, queries=(Query("start", (x, y, theta), (x, y, theta)),))
    kind, _, seed = name.partition(" ")
    return explore_world(kind, int(seed)) if seed and kind in KINDS else World.load(shipped_worlds()[name])


def sensor_range_of(name: str) -> float:
    """Return the sensor's range, metres: a quarter of the longer side, but in images that of their source."""
    if " " in name:
        return SENSOR_RANGE
    if name.endswith(".png"):
        return IMAGE_RANGE
    xmin, ymin, xmax, ymax = hidden_world(name).bounds
    return 0.25 * max(xmax - xmin, ymax - ymin)


def run_job(job: Job) -> dict[str, Any]:
    """Return what a run gave, as JSON has it."""
    world, reach = hidden_world(job.world), sensor_range_of(job.world)
    if job.strategy == ANCHOR:
        return {"distance": tour_length(truth_of(world, reach))}
    confidence = CONFIDENCE if job.noise > 0.0 else None
    settings = ExplorationSettings(confidence=confidence)
    warm_up_exploration()
    begin, work = perf_counter(), process_time()
    explorer = Explorer(
        world,
        world.robot,
        "laser",
        strategy=tour_without_loops if job.strategy == WITHOUT_LOOPS else job.strategy,
        sensor_range=reach,
        settings=settings,
        seed=job.seed,
        noise=job.noise,
    )
    result = explorer.run()
    used = {"wall": perf_counter() - begin, "cpu": process_time() - work}
    return {**used, **_measured(job, world, result, truth_of(world, reach))}


def _measured(job: Job, world: World, result: ExplorationResult, truth: Truth) -> dict[str, Any]:
    assert result.evaluation is not None
    assert result.robot_state is not None
    driven = np.array(result.robot_state["truth"])
    steps = [step.time for step in result.history]
    figures: dict[str, Any] = {
        "status": result.status,
        "reason": result.reason,
        **result.evaluation._asdict(),
        "seen_by_oracle": seen_share(truth, result.known.state, result.known.origin, result.known.cell),
        "overlaps": overlaps(truth, world, driven[:, 1:]),
        "distance": float(np.hypot(*np.diff(driven[:, 1:3], axis=0).T).sum()),
        "clock": steps[-1],
        "readings": len(steps),
        "landmarks": result.history[-1].landmarks,
        "sigma": result.history[-1].sigma,
        "seconds": result.seconds,
        "decisions": np.round(result.decisions, 5).tolist(),
        "obstacles": len(result.world.obstacles),
        "boundary": boundary_errors(truth, result.world),
    }
    if job.strategy == "tour":
        figures["paths"] = _paths(job, world, result, driven[:, 1:])
    return figures


def _paths(job: Job, world: World, result: ExplorationResult, driven: FloatArray) -> list[dict[str, Any]]:
    """Return what paths cost in the map that was made and in the true one, between places where the robot was.

    Places are drawn along what was driven, as the map has them: there the robot fits in both. In a map of noisy
    readings paths are those of ``trailmark plan --confidence``.
    """
    rng, robot = np.random.default_rng([job.seed, 7]), world.robot
    assert robot is not None
    true_planner = LandmarkPlanner(world, robot, seed=job.seed)
    rows = []
    for _ in range(PAIRS):
        start, goal = driven[rng.choice(len(driven), 2)]
        if not true_planner.checker.valid(np.array([start, goal])).all():
            rows.append({"valid": False})
            continue
        row: dict[str, Any] = {"true_cost": true_planner.plan(start, goal, PLANNING).cost}
        rows.append(row | _path_in_map(job, result.world.with_robot(robot), world, start, goal))
    return rows


def _path_in_map(job: Job, made: World, world: World, start: FloatArray, goal: FloatArray) -> dict[str, Any]:
    """Return what a path in the map that was made costs, and whether it is free in the true world."""
    valid = list[bool]()

    def plan(grown: World) -> tuple[FloatArray, float] | None:
        planner = LandmarkPlanner(grown, made.robot, seed=job.seed)
        valid.append(bool(planner.checker.valid(np.array([start, goal])).all()))
        found = planner.plan(start, goal, PLANNING) if valid[-1] else None
        return None if found is None or found.path is None else (found.path.states, found.path.cost)

    if job.noise == 0.0:
        path, growth = plan(made), 0.0
    else:
        spent = spend_risk(made, plan, CONFIDENCE, seed=job.seed)
        path, growth = None if spent.risk is None or spent.states is None else (spent.states, spent.cost), spent.scale
    if path is None:
        # Where the robot stands so near to something that this alone risks too much, there is nothing to compare.
        return {"valid": valid[0], "cost": None}
    return {"valid": True, "cost": path[1], "growth": growth, "free": bool(check_path(world, made.robot, path[0]).free)}


def jobs_for(worlds: list[str], seeds: int, noises: list[float], strategies: list[str]) -> list[Job]:
    """Return all jobs, those of one world together."""
    runs = itertools.product(worlds, range(seeds), noises, strategies)
    found = [Job(*run) for run in runs if not math.isnan(run[2])]
    return [job for world in worlds for job in [Job(world, 0, 0.0, ANCHOR), *(j for j in found if j.world == world)]]
