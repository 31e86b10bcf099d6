"""``trailmark landmarks``: the source method's landmarks, or trailmark's own, and how much they vary over runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.options import UsageError, option

if TYPE_CHECKING:
    from trailmark.collision import StateChecker
    from trailmark.landmarks import Spread
    from trailmark.landmarks.executions import Execution
    from trailmark.path import Path as RobotPath
    from trailmark.roadmap import Roadmap
    from trailmark.se2 import FloatArray
    from trailmark.world import Query, Robot, World

__all__ = ["landmarks"]

METHODS = ("paper", "se2")
INITIALISATIONS = ("forgy", "random-partition", "k-means++")  # those of trailmark.landmarks.paper, heavy to import
MAX_SAMPLES = 10_000_000  # 160 MB of points
MAX_LANDMARKS = 20_000
MAX_RUNS = 10_000
SENSOR_RANGE = 12.0  # metres, as in trailmark.landmarks.executions

PATHS = 4  # queries that paths over the landmarks are sought for, at most


def landmarks(
    world: options.WorldArgument,
    method: Annotated[
        str, option("--method", "NAME", "paper (Algorithm 2 as published) or se2 (trailmark's own).", default=True)
    ] = "paper",
    count: Annotated[
        str | None, option("-k", "K", "Number of landmarks; default: chosen from the sensor's range.")
    ] = None,
    samples: Annotated[str, option("-n", "N", "Number of sampled points.", default=True)] = "1000",
    init: Annotated[
        str,
        option("--init", "NAME", "Initial K-means centres: forgy, random-partition or k-means++.", default=True),
    ] = "forgy",
    runs: Annotated[str, option("--runs", "N", "Number of executions, with independent noise.", default=True)] = "3",
    seed: options.SeedOption = "0",
    sensor_range: Annotated[
        str, option("--sensor-range", "METRES", "Range of the robot's sensor.", default=True)
    ] = f"{SENSOR_RANGE:g}",
    grow_boxes: Annotated[
        bool, typer.Option("--grow-boxes", help="Grow the obstacles' boxes by the robot's inscribed radius.")
    ] = False,
    robot: options.RobotOption = None,
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Place landmarks by K-means and show how they vary from run to run.

    Also plans over the first run's landmarks for the world's first queries. --plot draws each step.
    """
    if method not in METHODS:
        raise UsageError(f"expected {', '.join(METHODS)}, got --method {method!r}")
    if init not in INITIALISATIONS:
        raise UsageError(f"expected {', '.join(INITIALISATIONS)}, got --init {init!r}")
    if method == "se2" and init != "forgy":
        raise UsageError(f"--init {init!r} given with --method se2; expected forgy")
    if method == "se2" and grow_boxes:
        raise UsageError("--grow-boxes given with --method se2, which has no boxes")
    n = options.read_count(samples, "-n", 1, MAX_SAMPLES)
    k = None if count is None else options.read_count(count, "-k", 1, MAX_LANDMARKS)
    number, repeats = options.read_count(seed, "--seed", 0), options.read_count(runs, "--runs", 1, MAX_RUNS)
    reach = options.read_length(sensor_range, "--sensor-range")
    given = options.read_robot(robot)
    picture = options.output_file(plot, options.PICTURE_SUFFIXES)

    with console.progress("loading") as progress:
        begun = perf_counter()
        loaded = options.load_world(world)
        options.protect_inputs((*loaded.sources, *options.robot_file(robot)), picture)
        body = options.robot_of(loaded, given)
        loaded = options.grown_for(loaded, body)

        import numpy as np

        from trailmark.collision import StateChecker
        from trailmark.landmarks import spread_of_runs
        from trailmark.landmarks.executions import execute_paper, execute_se2

        progress.stage("preparing (compiles on first use)")
        checker = StateChecker(loaded, body)
        start = np.array(loaded.queries[0].start) if loaded.queries else None
        if k is None:
            progress.stage("choosing the number of landmarks")
            k = _count_for(checker, reach, start, headings=method == "se2", seed=number)

        executions: list[Execution] = []
        for run in range(repeats):
            progress.stage(f"execution {run + 1} of {repeats}")
            rng = np.random.default_rng([number, run])
            if method == "paper":
                found = execute_paper(
                    *(checker, n, k, init, rng),  # type: ignore[arg-type]  # init is one of INITIALISATIONS
                    start=start,
                    sensor_range=reach,
                    grown=grow_boxes,
                )
                executions.append(found)
            else:
                executions.append(execute_se2(checker, n, k, rng, start=start))
        spread = spread_of_runs([execution.centres[:, :2] for execution in executions])
        record = _record(loaded, body, executions, spread)
        record |= {"method": method, "init": init, "n": n, "k": k, "seed": number, "sensor_range": reach}
        record["grown"] = grow_boxes
        planned = _paths(checker, executions[0].repaired, loaded.queries[:PATHS], number, progress)
        record["paths"] = [
            {"query": query.name, "cost": None if path is None else path.cost} for query, _, path in planned
        ]
        record["time"] = perf_counter() - begun
        if picture is not None:
            from trailmark.plotting import save_landmarks_figure

            progress.stage("drawing")
            save_landmarks_figure(picture, loaded, body, executions[:3], planned)

    if as_json:
        console.say(console.json_text(record))
    else:
        _print_table(record, picture)


def _count_for(
    checker: StateChecker, sensor_range: float, start: FloatArray | None, *, headings: bool, seed: int
) -> int:
    """Return how many landmarks the sensor's range asks for."""
    from trailmark.landmarks.executions import landmarks_for_range

    home = start if start is not None and checker.valid(start) else None
    radius = checker.footprint.sweep_radius if headings else 0.0
    return landmarks_for_range(checker, sensor_range, radius=radius, reachable_from=home, random_state=seed)


def _record(world: World, robot: Robot, executions: list[Execution], spread: Spread) -> dict[str, Any]:
    xmin, ymin, xmax, ymax = world.bounds
    rows = []
    for run, execution in enumerate(executions):
        forbidden = int(execution.forbidden.sum())
        rows.append(
            {
                "run": run,
                "forbidden": forbidden,
                "enclosed": int(execution.enclosed.sum()),
                "valid": len(execution.samples) - forbidden,
                "boxes": len(execution.boxes),
                "inertia": execution.inertia,
                "iterations": execution.iterations,
                "mini_batches": execution.mini_batches,
                "in_obstacle": int(execution.in_obstacle.sum()),
                "invalid": int(execution.invalid.sum()),
                "repaired_valid": len(execution.repaired),
                "centres": execution.centres.tolist(),
                "centre_in_obstacle": execution.in_obstacle.tolist(),
                "centre_invalid": execution.invalid.tolist(),
                "repaired": execution.repaired.tolist(),
                "time": execution.seconds,
            }
        )
    share = 1.0 - sum(row["forbidden"] for row in rows) / sum(len(e.samples) for e in executions)
    counts = [len(execution.centres) for execution in executions]
    pairs = [{"runs": pair, "rms": rms} for pair, rms in zip(spread.pairs.tolist(), spread.rms.tolist(), strict=True)]
    return {
        "world": world.name,
        "robot": robot.describe(),
        "rectangle": list(world.bounds),
        "runs": rows,
        "spread": {
            "pairs": pairs,
            "mean": spread.mean,
            "worst": spread.worst,
            "spacing": math.sqrt(share * (xmax - xmin) * (ymax - ymin) / max(counts)),
        },
    }


def _paths(
    checker: StateChecker, nodes: FloatArray, queries: Sequence[Query], seed: int, progress: console.Progress
) -> list[tuple[Query, Roadmap, RobotPath | None]]:
    """Return queries with their paths over the landmarks, shape (k, 3), as far as the robot fits the queries' ends."""
    from trailmark.errors import ConfigurationError, WorldError
    from trailmark.planning.placement import path_over_landmarks

    found: list[tuple[Query, Roadmap, RobotPath | None]] = []
    for query in queries:
        progress.stage(f"path for {query.name}")
        try:
            found.append((query, *path_over_landmarks(checker, nodes, query.start, query.pose(), seed=seed)))
        except (ConfigurationError, WorldError) as error:
            console.note(f"{query.name}: no path: {error}")
    return found


def _print_table(record: dict[str, Any], picture: Path | None) -> None:
    console.say(
        f"{record['world']} · {record['method']}: {record['k']:,} landmarks from {record['n']:,} points", bold=True
    )
    head = ["RUN", "FORBIDDEN", "VALID", "INERTIA", "ITERATIONS", "IN OBSTACLE", "INVALID", "REPAIRED", "TIME"]
    rows = [head]
    for run in record["runs"]:
        iterations = "-" if run["iterations"] is None else f"{run['iterations']:,}"
        row = [f"{run['run'] + 1}", f"{run['forbidden']:,}", f"{run['valid']:,}", f"{run['inertia']:.6g} m²"]
        row += [f"{iterations} batches" if run["mini_batches"] else iterations]
        row += [f"{run['in_obstacle']}", f"{run['invalid']}", f"{run['repaired_valid']} valid"]
        row.append(f"{1e3 * run['time']:.1f} ms")
        rows.append(row)
    console.print_table(rows, indent="  ")
    spread = record["spread"]
    facts = [
        ("spread", f"{spread['mean']:.2f} m RMS between runs, at most {spread['worst']:.2f} m (centres matched)"),
        ("spacing", f"{spread['spacing']:.2f} m, the side of a square as large as a landmark's share of free space"),
        ("robot", record["robot"]),
        ("seed", str(record["seed"])),
    ]
    if len(record["runs"]) < 2:
        facts = facts[1:]
    for path in record["paths"]:
        cost = path["cost"]
        answer = "the landmarks do not connect it" if cost is None else f"cost {cost:.4g} over the landmarks"
        facts.append((path["query"], answer))
    if picture is not None:
        facts.append(("written", str(picture)))
    console.print_table(facts, indent="  ")
