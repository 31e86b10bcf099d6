"""``trailmark landmarks``: the source method's landmarks, or trailmark's own, and how much they vary over runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

from trailmark.cli import console, options
from trailmark.cli.options import UsageError, flag, option

if TYPE_CHECKING:
    from trailmark.collision import StateChecker
    from trailmark.landmarks import Spread
    from trailmark.landmarks.executions import Execution
    from trailmark.roadmap import Roadmap
    from trailmark.se2 import FloatArray
    from trailmark.trajectories import Path as RobotPath
    from trailmark.world import Query, Robot, World

__all__ = ["landmarks"]

METHOD, INIT = options.Choice("paper", "se2"), options.Choice("forgy", "random-partition", "k-means++")
COUNT, RUNS = options.Count("K", low=1, high=20_000), options.Count(low=1, high=10_000)
SAMPLES = options.Count(low=1, high=10_000_000)  # 160 MB of points
SENSOR_RANGE = 12.0  # metres, as in trailmark.landmarks.executions
PATHS = 4  # queries that paths over the landmarks are sought for, at most


def landmarks(
    world: options.WorldArgument,
    method: Annotated[Any, option(METHOD, "Algorithm 2 as published, or trailmark's own.")] = "paper",
    k: Annotated[
        int | None, option(COUNT, "Number of landmarks; default: chosen from the sensor's range.", "-k")
    ] = None,
    n: Annotated[int, option(SAMPLES, "Number of sampled points.", "-n")] = 1000,
    init: Annotated[Any, option(INIT, "Initial K-means centres.")] = "forgy",
    runs: Annotated[int, option(RUNS, "Number of executions, with independent noise.")] = 3,
    seed: options.SeedOption = 0,
    sensor_range: Annotated[float, option(options.METRES, "Range of the robot's sensor.")] = SENSOR_RANGE,
    grow_boxes: Annotated[
        bool, flag("--grow-boxes", "Grow the obstacles' boxes by the robot's inscribed radius.")
    ] = False,
    robot: options.RobotOption = None,
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Place landmarks by K-means and show how they vary from run to run.

    Also plans over the first run's landmarks for the world's first queries. --plot draws each step.
    """
    if method == "se2" and init != "forgy":
        raise UsageError(f"--init {init!r} given with --method se2; expected forgy")
    if method == "se2" and grow_boxes:
        raise UsageError("--grow-boxes given with --method se2, which has no boxes")

    with console.progress("loading") as progress:
        begun = perf_counter()
        loaded, body = options.RobotOptions(robot).load(world, [plot])

        import numpy as np

        from trailmark.collision import StateChecker
        from trailmark.landmarks import spread_of_runs
        from trailmark.landmarks.executions import execute_paper, execute_se2

        progress.stage("preparing (compiles on first use)")
        checker = StateChecker(loaded, body)
        start = np.array(loaded.queries[0].start) if loaded.queries else None
        if k is None:
            progress.stage("choosing the number of landmarks")
            k = _count_for(checker, sensor_range, start, headings=method == "se2", seed=seed)

        executions: list[Execution] = []
        for run in range(runs):
            progress.stage(f"execution {run + 1} of {runs}")
            rng = np.random.default_rng([seed, run])
            if method == "paper":
                more: Any = {"start": start, "sensor_range": sensor_range, "grown": grow_boxes}
                executions.append(execute_paper(checker, n, k, init, rng, **more))
            else:
                executions.append(execute_se2(checker, n, k, rng, start=start))
        spread = spread_of_runs([execution.centres[:, :2] for execution in executions])
        record = _record(loaded, body, executions, spread)
        record |= {"method": method, "init": init, "n": n, "k": k, "seed": seed, "sensor_range": sensor_range}
        record["grown"] = grow_boxes
        planned = _paths(checker, executions[0].repaired, loaded.queries[:PATHS], seed, progress)
        record["paths"] = [
            {"query": query.name, "cost": None if path is None else path.cost} for query, _, path in planned
        ]
        record["time"] = perf_counter() - begun
        if plot is not None:
            from trailmark.plotting import save_landmarks_figure

            progress.stage("drawing")
            save_landmarks_figure(plot, loaded, body, executions[:3], planned)

    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, plot)


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
    rows = [
        {
            "run": run,
            "forbidden": int(execution.forbidden.sum()),
            "enclosed": int(execution.enclosed.sum()),
            "valid": int((~execution.forbidden).sum()),
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
        for run, execution in enumerate(executions)
    ]
    share = 1.0 - sum(row["forbidden"] for row in rows) / sum(len(e.samples) for e in executions)
    most = max(len(execution.centres) for execution in executions)
    pairs = [{"runs": pair, "rms": rms} for pair, rms in zip(spread.pairs.tolist(), spread.rms.tolist(), strict=True)]
    spacing = math.sqrt(share * (xmax - xmin) * (ymax - ymin) / most)
    return {
        "world": world.name,
        "robot": robot.describe(),
        "rectangle": list(world.bounds),
        "runs": rows,
        "spread": {"pairs": pairs, "mean": spread.mean, "worst": spread.worst, "spacing": spacing},
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


def _print_summary(record: dict[str, Any], picture: Path | None) -> None:
    title = f"{record['world']} · {record['method']}: {record['k']:,} landmarks from {record['n']:,} points"
    console.say(title, bold=True)
    rows = [["RUN", "FORBIDDEN", "VALID", "INERTIA", "ITERATIONS", "IN OBSTACLE", "INVALID", "REPAIRED", "TIME"]]
    for run in record["runs"]:
        iterations = "-" if run["iterations"] is None else f"{run['iterations']:,}"
        iterations += " batches" if run["mini_batches"] else ""
        sampled = [f"{run['run'] + 1}", f"{run['forbidden']:,}", f"{run['valid']:,}", f"{run['inertia']:.6g} m²"]
        centres = [f"{run['in_obstacle']}", f"{run['invalid']}", f"{run['repaired_valid']} valid"]
        rows.append([*sampled, iterations, *centres, f"{1e3 * run['time']:.1f} ms"])
    console.print_table(rows, indent="  ")
    spread = record["spread"]
    mean = f"{spread['mean']:.2f} m RMS between runs, at most {spread['worst']:.2f} m (centres matched)"
    facts = [("spread", mean)] if len(record["runs"]) > 1 else []
    facts += [
        ("spacing", f"{spread['spacing']:.2f} m, the side of a square as large as a landmark's share of free space"),
        ("robot", record["robot"]),
        ("seed", str(record["seed"])),
    ]
    for path in record["paths"]:
        cost = path["cost"]
        answer = "the landmarks do not connect it" if cost is None else f"cost {cost:.4g} over the landmarks"
        facts.append((path["query"], answer))
    facts += [] if picture is None else [("written", str(picture))]
    console.print_table(facts, indent="  ")
