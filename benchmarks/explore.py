"""Exploration of hidden worlds by each strategy: what is seen, driven and hit, and how well the map lies.

    python -m benchmarks.explore [--worlds 40] [--shipped] [--maps NAME]... [--drives differential forward car]
                                 [--seeds 1] [--noise 0 1] [--strategies ...] [--workers 1] [--runs FILE.jsonl]

Each run has a process of its own. The same command goes on where it was stopped: FILE keeps the runs. What is true of a
world is found by shapely (tests/helpers/explore_oracle.py); the lower anchor of the distance is a tour that knows it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from tests.helpers.explore_oracle import boundary_errors, overlaps, seen_share, tour_length, truth_of
from tests.helpers.explore_worlds import KINDS, ROBOTS, SENSOR_RANGE, explore_world

from benchmarks.problems import data_folder
from benchmarks.report import FOLDER, ROOT, Claim, keep
from trailmark import Robot, World
from trailmark.collision import StateChecker
from trailmark.exploration.explorer import Explorer
from trailmark.exploration.result import ExplorationSettings
from trailmark.exploration.warmup import warm_up_exploration
from trailmark.world import Query
from trailmark.world.library import shipped_worlds

Row = dict[str, Any]

STRATEGIES = ("nearest-frontier", "gain-per-cost", "tour")
ANCHOR = "tour with the map known"

CONFIDENCE = 0.99
"""Of the runs with noise."""

IMAGE_RANGE = 80.0
"""Metres, one for each pixel: what the sensor sees in images, by the source of them (ARiADNE, env.py)."""

DRIVES = {
    "differential": lambda robot: robot.differential(),
    "forward": lambda robot: robot.differential(reverse=False),
    "car": lambda robot: robot.steered(0.5),
}
"""How the world's robot drives where a world's name ends in one of these: ``office 3 as car``."""

CLOSED = ("enclosed",)
"""Shipped worlds whose free space is not connected."""


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
    if " " in name.partition(" as ")[0]:
        return SENSOR_RANGE
    if name.partition(" as ")[0].endswith(".png"):
        return IMAGE_RANGE
    xmin, ymin, xmax, ymax = hidden_world(name).bounds
    return 0.25 * max(xmax - xmin, ymax - ymin)


def run_job(name: str, seed: int, noise: float, strategy: str) -> Row:
    """Return what one run gave, as JSON has it."""
    world, reach = hidden_world(name), sensor_range_of(name)
    truth = truth_of(world, reach)
    if strategy == ANCHOR:
        return {"distance": tour_length(truth)}
    settings = ExplorationSettings(confidence=CONFIDENCE if noise > 0.0 else None)
    warm_up_exploration()
    begin, work = perf_counter(), process_time()
    result = Explorer(
        world, world.robot, "laser", strategy=strategy, sensor_range=reach, settings=settings, seed=seed, noise=noise
    ).run()
    assert result.evaluation is not None
    assert result.robot_state is not None
    driven = np.array(result.robot_state["truth"])
    return {
        "wall": perf_counter() - begin,
        "cpu": process_time() - work,
        "status": result.status,
        "reason": result.reason,
        **result.evaluation._asdict(),
        "seen_by_oracle": seen_share(truth, result.known.state, result.known.origin, result.known.cell),
        "overlaps": overlaps(truth, world, driven[:, 1:]),
        "distance": float(np.hypot(*np.diff(driven[:, 1:3], axis=0).T).sum()),
        "decisions": np.round(result.decisions, 5).tolist(),
        "boundary": boundary_errors(truth, result.world),
    }


def measure(jobs: list[tuple[Any, ...]], file: Path, workers: int, limit: float) -> list[Row]:
    """Return a row for each job, those of the file included; new ones are appended to it."""
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {tuple(row["job"]) for row in rows}

    def run(job: tuple[Any, ...]) -> Row:
        words = [sys.executable, "-m", "benchmarks.explore", "--job", json.dumps(job)]
        try:
            ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=limit)
        except subprocess.TimeoutExpired:
            return {"job": job, "status": "hang", "reason": f"no end within {limit:g} s"}
        if ended.returncode:
            lines = ended.stderr.splitlines()[-1:]
            return {"job": job, "status": "died", "reason": f"exit status {ended.returncode}: {' '.join(lines)}"}
        return {"job": job, **json.loads(ended.stdout.splitlines()[-1])}

    with ThreadPoolExecutor(workers) as pool, file.open("a") as out:
        for row in pool.map(run, [job for job in jobs if job not in done]):
            rows.append(row)
            out.write(json.dumps(row) + "\n")
            out.flush()
            told = {key: row.get(key) for key in ("status", "reason", "seen", "distance", "collisions")}
            print(*row["job"], told, file=sys.stderr, flush=True)
    return [row for row in rows if tuple(row["job"]) in set(jobs)]


def claims(rows: list[Row]) -> list[Claim]:
    """Return a row for each noise and strategy."""
    anchors = {row["job"][0]: row["distance"] for row in rows if row["job"][3] == ANCHOR and "distance" in row}
    runs = [row for row in rows if row["job"][3] != ANCHOR]
    found = []
    for noise, strategy in sorted({(row["job"][2], row["job"][3]) for row in runs}):
        own = [row for row in runs if (row["job"][2], row["job"][3]) == (noise, strategy)]
        ended = [row for row in own if "seen" in row]
        if not ended:
            continue
        ends = Counter(row["status"] for row in own)
        logs = [np.log(row["distance"] / anchors[row["job"][0]]) for row in ended if anchors.get(row["job"][0])]
        decisions = np.concatenate([row["decisions"] for row in ended])
        rms = float(np.sqrt(np.nanmean([row["boundary"]["rms"] ** 2 for row in ended])))
        figure = (
            f"seen at least {100 * min(row['seen'] for row in ended):.1f} %, "
            f"{sum(row['collisions'] for row in ended)} collisions, "
            f"NEES {np.mean([row['nees'] for row in ended]):.2f}, "
            f"surfaces {rms:.3f} m, decisions {1e3 * np.median(decisions):.0f} ms"
        )
        beside = f"driven x {np.exp(np.mean(logs)):.2f} of a tour that knows the map" if logs else ""
        short = sum(count for end, count in ends.items() if not end.startswith("complete"))
        missed = f"{short} of {len(own)} not complete" if short else ""
        found.append(Claim(f"exploration by {strategy}, noise {noise:g}, {len(own)} runs", figure, beside, missed))
    return found


def main() -> int:
    """Measure what is missing, and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=40, help="generated worlds, of the four kinds in turn")
    parser.add_argument("--shipped", action="store_true", help="the shipped worlds that are connected, too")
    parser.add_argument("--maps", nargs="+", default=[], help="NAME.yaml or NAME.png of the real data, too")
    parser.add_argument("--drives", nargs="+", choices=list(DRIVES), help="instead of robots that move every way")
    parser.add_argument("--seeds", type=int, default=1, help="runs of each kind in each world")
    parser.add_argument("--noise", type=float, nargs="+", default=[0.0, 1.0], help="times the noise by default")
    parser.add_argument("--strategies", nargs="+", default=list(STRATEGIES))
    parser.add_argument("--workers", type=int, default=1, help="processes at a time")
    parser.add_argument("--limit", type=float, default=1800.0, help="seconds after which a run hangs")
    parser.add_argument("--runs", type=Path, default=FOLDER / "explore.jsonl", help="where runs are kept")
    parser.add_argument("--job", type=json.loads, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.job is not None:
        print(json.dumps(run_job(*options.job)))
        return 0
    worlds = [f"{list(KINDS)[i % 4]} {i // 4}" for i in range(options.worlds)]
    worlds += [name for name in shipped_worlds() if name not in CLOSED] if options.shipped else []
    worlds += options.maps
    worlds = [f"{world} as {drive}" for world in worlds for drive in options.drives] if options.drives else worlds
    jobs: list[tuple[Any, ...]] = [(world, 0, 0.0, ANCHOR) for world in worlds]
    jobs += itertools.product(worlds, range(options.seeds), options.noise, options.strategies)
    options.runs.parent.mkdir(parents=True, exist_ok=True)
    keep("explore", claims(measure(jobs, options.runs, options.workers, options.limit)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
