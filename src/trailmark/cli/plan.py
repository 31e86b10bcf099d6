"""``trailmark plan``: one path for one query."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options, plan_options
from trailmark.cli.options import option

if TYPE_CHECKING:
    from trailmark.planning import PlanProgress, PlanResult
    from trailmark.trajectories import Path as TrailPath

__all__ = ["plan"]

EXIT_STATUS = {"solved": 0, "timeout": 3, "infeasible": 4}
MAX_LANDMARKS = 200_000  # half a minute


def plan(
    world: options.WorldArgument,
    robot: options.RobotOption = None,
    keepout: options.KeepoutOption = None,
    speed_mask: options.SpeedMaskOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    drive: options.DriveOption = None,
    query: Annotated[str | None, option("--query", "NAME", "Name of a query of the world; default: the first.")] = None,
    start: options.StartOption = None,
    goal: plan_options.GoalOption = None,
    goal_tolerance: plan_options.GoalToleranceOption = None,
    time_limit: options.TimeLimitOption = "1.0",
    objective: plan_options.ObjectiveOption = None,
    reverse_cost: plan_options.ReverseCostOption = None,
    direction_change_cost: plan_options.DirectionChangeCostOption = None,
    clearance: plan_options.ClearanceOption = None,
    relax: plan_options.RelaxOption = False,
    seed: options.SeedOption = "0",
    landmarks: Annotated[str | None, option("--landmarks", "K", "Number of landmarks; default: by world.")] = None,
    gap: Annotated[
        str,
        option(
            "--gap", "SHARE", "Stop once the cost is proven within this share of the optimum (0.01: 1 %).", default=True
        ),
    ] = "0.0001",
    max_iterations: Annotated[
        str | None,
        option(
            "--max-iterations",
            "N",
            "Maximum number of planning rounds; with time enough for them, the same seed gives the same path.",
        ),
    ] = None,
    settings: Annotated[str | None, option("--settings", "FILE.yaml", "Planner settings, lines 'name: value'.")] = None,
    output: Annotated[
        str | None,
        option(
            "--output",
            "FILE",
            "Write the path: .json (the full result), .csv, .path or .txt (rows 'x y theta'), .yaml or .nav2.json "
            "(nav_msgs/Path), or .geojson.",
        ),
    ] = None,
    frame_id: options.FrameOption = "map",
    plot: options.PlotOption = None,
    layers: plan_options.LayersOption = None,
    smooth: plan_options.SmoothOption = False,
    step: plan_options.StepOption = None,
    trajectory: plan_options.TrajectoryOption = None,
    animate: plan_options.AnimateOption = None,
    max_speed: plan_options.MaxSpeedOption = None,
    max_acceleration: plan_options.MaxAccelerationOption = None,
    max_turn_rate: plan_options.MaxTurnRateOption = None,
    max_turn_acceleration: plan_options.MaxTurnAccelerationOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Plan a path in a world.

    Exit status: 0 path found, 2 bad input, 3 no path found within the time limit, 4 proven infeasible, 130 stopped by
    Ctrl-C, which writes and prints the best path so far.
    """
    # Planning multiplies no matrices that would be worth sharing out: starting the threads takes longer, a tenth of a
    # second. OpenBLAS asks once, when numpy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from trailmark.formats import path_files

    limit = options.read_duration(time_limit, "--time-limit")
    number = options.read_count(seed, "--seed", 0)
    count = None if landmarks is None else options.read_count(landmarks, "--landmarks", 1, MAX_LANDMARKS)
    rounds = None if max_iterations is None else options.read_count(max_iterations, "--max-iterations", 1)
    share = options.read_number(gap, "--gap", "a finite number of 0 or more", low=0.0)
    margin = plan_options.read_clearance(clearance, relax)
    given = options.RobotOptions.read(robot, turning_radius, forward_only, drive)
    given_ends = plan_options.EndOptions.read(query, start, goal, goal_tolerance)
    path_file, frame = options.output_file(output, path_files.SUFFIXES), options.read_frame(frame_id)
    picture = options.output_file(plot, options.PICTURE_SUFFIXES)
    spacing = plan_options.read_step(step, path_file)
    timing = plan_options.read_timing(
        trajectory,
        animate,
        max_speed,
        max_acceleration,
        max_turn_rate,
        max_turn_acceleration,
        needed=speed_mask is not None or objective not in (None, "length"),
    )
    charges = plan_options.read_objective(objective, timing, reverse_cost, direction_change_cost)
    outputs = (path_file, picture, timing.table, timing.animation)
    shown, asked = plan_options.read_layers(layers, plot), Event()

    with console.progress("loading") as progress:
        begun = time.perf_counter()
        loaded = options.load_world(world, keepout, speed_mask, timing.limits[0])
        options.protect_inputs((*loaded.sources, *given.files), *outputs)
        body = given.robot_in(loaded)
        loaded = options.grown_for(loaded, body)
        name, a, b = given_ends.ends(loaded)
        loading = time.perf_counter() - begun

        from trailmark import LandmarkPlanner
        from trailmark.planning import PlannerSettings

        chosen = PlannerSettings() if settings is None else PlannerSettings.load(settings)
        if settings is not None:
            options.protect_inputs((Path(settings),), *outputs)

        def follow(state: PlanProgress) -> None:
            progress.phase = state.phase
            cost = "no path yet" if state.cost is None else f"cost {state.cost:.4g}"
            progress.details = (f"{state.landmarks:,} landmarks", cost)

        progress.stage("preparing (compiles on first use)")
        planner = LandmarkPlanner(
            loaded,
            body,
            seed=number,
            landmarks=count,
            clearance=margin,
            relax=relax,
            settings=chosen,
            objective=charges(body),
        )
        progress.stage("planning", limit)
        with _stopping(asked):
            result = planner.plan(
                a, b, time_limit=limit, on_progress=follow, max_iterations=rounds, gap=share, stop=asked.is_set
            )

        extras: dict[str, Any] = {}
        if smooth:
            result, extras = plan_options.smoothed(result, loaded, body)
        record = result.to_dict(world=loaded.name, query=name) | extras
        record["settings"] = chosen.to_dict()
        record["time"]["load"] = loading
        record["time"]["total"] += loading
        progress.stage("writing")
        written, found = timing.write(result, loaded, body, frame)
        record |= found
        shaped = plan_options.with_step(result.path, spacing, loaded, body)
        if path_file is not None and _write_path(path_file, shaped, record, frame):
            written.append(path_file)
        if picture is not None:
            from trailmark.plotting import save_plan_figure

            save_plan_figure(picture, loaded, body, result, planner.roadmap, start=a, goal=b, query=name, layers=shown)
            written.append(picture)

    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, result, written)
    if asked.is_set():
        raise KeyboardInterrupt
    raise typer.Exit(EXIT_STATUS[result.status])


@contextmanager
def _stopping(asked: Event) -> Iterator[None]:
    """Have Ctrl-C ask for an end, instead of being one; pressed again, it is."""
    before = signal.getsignal(signal.SIGINT)

    def ask(number: int, frame: object) -> None:
        asked.set()
        signal.signal(signal.SIGINT, before)

    if not callable(before):  # nohup: it stays ignored
        yield
        return
    signal.signal(signal.SIGINT, ask)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _write_path(file: Path, path: TrailPath | None, record: dict[str, Any], frame: str) -> bool:
    """Write the path, or without one the JSON record that says so; return whether a file was written."""
    from trailmark.formats.files import write_atomically
    from trailmark.formats.path_files import write_path

    if path is not None:
        write_path(file, path, record, frame)
    elif file.suffix.lower() == ".json" and not file.name.lower().endswith(".nav2.json"):
        write_atomically(file, console.json_text(record) + "\n")
    else:
        console.not_written(file)
        return False
    return True


def _print_summary(record: dict[str, Any], result: PlanResult, written: list[Path]) -> None:
    kept = result.clearance
    title = record["world"] if record["query"] is None else f"{record['world']} · {record['query']}"
    verdict, colour = {
        "solved": ("path found", "green"),
        "timeout": ("no path found", "yellow"),
        "infeasible": (f"infeasible: no path {f'keeps {kept:g} m' if kept else 'exists'}", "red"),
    }[record["status"]]
    reason = f": {result.reason}" if result.reason else ""
    console.say(f"{title}: {verdict}{reason}", fg=colour, bold=True)
    seconds = record["time"]
    rows = []
    if result.path is not None:
        if result.goal is not None:
            rows.append(("goal", f"number {result.goal.index + 1}, reached at ({_numbers(result.goal.pose)})"))
        rows += [
            ("cost", f"{record['cost']:.4f}{_gap(record['cost'], record['lower_bound'])}"),
            ("length", f"{record['length']:.4f} m"),
            ("rotation", f"{record['rotation']:.4f} rad ({math.degrees(record['rotation']):.0f}°)"),
            *plan_options.objective_rows(record),
            *_curve_rows(result),
            *plan_options.trajectory_rows(record),
            ("clearance", f"minimum {record['min_clearance']:.4f} m{_kept(result)}"),
            ("first path", f"cost {record['first_cost']:.4f} after {seconds['first_solution']:.3f} s"),
        ]
    rows += [
        ("roadmap", f"{record['landmarks']:,} landmarks, {record['edges']:,} edges"),
        ("time", f"{seconds['total']:.3f} s (load {seconds['load']:.3f}, build {seconds['build']:.3f})"),
        ("seed", str(record["seed"])),
        *(("written", str(file)) for file in written),
    ]
    console.print_table(rows, indent="  ")


def _numbers(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _kept(result: PlanResult) -> str:
    """Return the certified clearance, and the bound on that of any path, if they were asked for."""
    if result.clearance_bound is not None:
        return f"; certified {result.clearance:.4f} m, and no path keeps more than {result.clearance_bound:.4f} m"
    return f"; certified {result.clearance:g} m" if result.clearance > 0.0 else ""


def _curve_rows(result: PlanResult) -> list[tuple[str, str]]:
    from trailmark.trajectories import CurvePath

    path = result.path
    if not isinstance(path, CurvePath):
        return []
    kind = "Reeds-Shepp" if path.steering.reverse else "Dubins"
    turns = f"{path.cusps} changes of direction, {path.reverse_length:.4g} m in reverse"
    return [("curves", f"{kind}, turning radius {path.steering.radius:g} m, {turns}")]


def _gap(cost: float, bound: float | None) -> str:
    if not bound:
        return ""
    return f" (at most {100.0 * (cost / bound - 1.0):.1f} % above the optimum: lower bound {bound:.4f})"
