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

from trailmark.cli import console
from trailmark.cli.ends import EndOptions, GoalOption, GoalToleranceOption, StartOption
from trailmark.cli.masks import KeepoutOption, SpeedMaskOption, with_masks
from trailmark.cli.options import (
    PICTURE_SUFFIXES,
    ClearanceOption,
    DriveOption,
    ForwardOnlyOption,
    FrameOption,
    JsonOption,
    LayersOption,
    PlotOption,
    RelaxOption,
    RobotOption,
    SeedOption,
    TimeLimitOption,
    TurningRadiusOption,
    WorldArgument,
    grown_for,
    load_world,
    option,
    output_file,
    protect_inputs,
    read_clearance,
    read_count,
    read_duration,
    read_frame,
    read_layers,
    read_number,
    read_robot,
    read_turning_radius,
    robot_file,
    robot_of,
    steered,
)
from trailmark.cli.plan_objective import (
    DirectionChangeCostOption,
    ObjectiveOption,
    ReverseCostOption,
    objective_rows,
    read_objective,
)
from trailmark.cli.plan_trajectory import (
    AnimateOption,
    MaxAccelerationOption,
    MaxSpeedOption,
    MaxTurnAccelerationOption,
    MaxTurnRateOption,
    SmoothOption,
    StepOption,
    TrajectoryOption,
    read_step,
    read_timing,
    smoothed,
    trajectory_rows,
    with_step,
)

if TYPE_CHECKING:
    from trailmark.path import Path as TrailPath
    from trailmark.planning import PlanProgress, PlanResult
    from trailmark.world import Robot, World

__all__ = ["plan"]

EXIT_STATUS = {"solved": 0, "timeout": 3, "infeasible": 4}
MAX_LANDMARKS = 200_000  # half a minute


def plan(
    world: WorldArgument,
    robot: RobotOption = None,
    keepout: KeepoutOption = None,
    speed_mask: SpeedMaskOption = None,
    turning_radius: TurningRadiusOption = None,
    forward_only: ForwardOnlyOption = False,
    drive: DriveOption = None,
    query: Annotated[str | None, option("--query", "NAME", "A query of the world; default: its first.")] = None,
    start: StartOption = None,
    goal: GoalOption = None,
    goal_tolerance: GoalToleranceOption = None,
    time_limit: TimeLimitOption = "1.0",
    objective: ObjectiveOption = None,
    reverse_cost: ReverseCostOption = None,
    direction_change_cost: DirectionChangeCostOption = None,
    clearance: ClearanceOption = None,
    relax: RelaxOption = False,
    seed: SeedOption = "0",
    landmarks: Annotated[str | None, option("--landmarks", "K", "Number of landmarks; default: by the world.")] = None,
    gap: Annotated[
        str,
        option("--gap", "SHARE", "End once the path is proven to be this near the optimum: 0.01 is 1 %.", default=True),
    ] = "0.0001",
    max_iterations: Annotated[
        str | None,
        option(
            "--max-iterations",
            "N",
            "Rounds of landmarks at most; with a generous time limit the seed alone then decides the path.",
        ),
    ] = None,
    settings: Annotated[
        str | None, option("--settings", "FILE.yaml", "Lines 'name: value' of the planner's settings.")
    ] = None,
    output: Annotated[
        str | None,
        option(
            "--output",
            "FILE",
            "Write the path: .json (the whole record), .csv, rows 'x y theta' (.path, .txt), nav_msgs/Path (.yaml, "
            ".nav2.json), or .geojson.",
        ),
    ] = None,
    frame_id: FrameOption = "map",
    plot: PlotOption = None,
    layers: LayersOption = None,
    smooth: SmoothOption = False,
    step: StepOption = None,
    trajectory: TrajectoryOption = None,
    animate: AnimateOption = None,
    max_speed: MaxSpeedOption = None,
    max_acceleration: MaxAccelerationOption = None,
    max_turn_rate: MaxTurnRateOption = None,
    max_turn_acceleration: MaxTurnAccelerationOption = None,
    as_json: JsonOption = False,
) -> None:
    """Plan a path, and write, draw or print it.

    Exit status: 0 path found, 2 bad input, 3 no path within the time limit, 4 proven that there is none, 130 Ctrl-C,
    after which the best path so far is written and printed.
    """
    # Planning multiplies no matrices that would be worth sharing out: starting the threads takes longer, a tenth of a
    # second. OpenBLAS asks once, when numpy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from trailmark.formats import path_files

    limit = read_duration(time_limit, "--time-limit")
    number = read_count(seed, "--seed", 0)
    count = None if landmarks is None else read_count(landmarks, "--landmarks", 1, MAX_LANDMARKS)
    rounds = None if max_iterations is None else read_count(max_iterations, "--max-iterations", 1)
    share = read_number(gap, "--gap", "a finite number of 0 or more", low=0.0)
    margin = read_clearance(clearance, relax)
    given = read_robot(robot)
    radius = read_turning_radius(turning_radius)
    given_ends = EndOptions.read(query, start, goal, goal_tolerance)
    path_file, frame = output_file(output, path_files.SUFFIXES), read_frame(frame_id)
    picture = output_file(plot, PICTURE_SUFFIXES)
    spacing = read_step(step, path_file)
    timing = read_timing(
        trajectory,
        animate,
        max_speed,
        max_acceleration,
        max_turn_rate,
        max_turn_acceleration,
        needed=speed_mask is not None or objective not in (None, "length"),
    )
    charges = read_objective(objective, timing, reverse_cost, direction_change_cost)
    outputs = (path_file, picture, timing.table, timing.animation)
    shown, asked = read_layers(layers, plot), Event()

    with console.progress("loading") as progress:
        begun = time.perf_counter()
        loaded = with_masks(load_world(world), keepout, speed_mask, timing.limits[0])
        protect_inputs((*loaded.sources, *robot_file(robot)), *outputs)
        body = steered(robot_of(loaded, given), radius, forward_only, drive)
        loaded = grown_for(loaded, body)
        name, a, b = given_ends.ends(loaded)
        loading = time.perf_counter() - begun

        from trailmark import LandmarkPlanner
        from trailmark.planning import PlannerSettings

        chosen = PlannerSettings() if settings is None else PlannerSettings.load(settings)
        if settings is not None:
            protect_inputs((Path(settings),), *outputs)

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
            result, extras = smoothed(result, loaded, body)
        record = result.to_dict(world=loaded.name, query=name) | extras
        record["settings"] = chosen.to_dict()
        record["time"]["load"] = loading
        record["time"]["total"] += loading
        progress.stage("writing")
        written, found = timing.write(result, loaded, body, frame)
        record |= found
        shaped = with_step(result.path, spacing, loaded, body)
        if path_file is not None and _write_path(path_file, shaped, record, frame, loaded, body):
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


def _write_path(
    file: Path, path: TrailPath | None, record: dict[str, Any], frame: str, world: World, robot: Robot
) -> bool:
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
            *objective_rows(record),
            *_curve_rows(result),
            *trajectory_rows(record),
            ("clearance", f"{record['min_clearance']:.4f} m at its least{_kept(result)}"),
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
    """Return what clearance a path keeps for certain, and what none keeps, as far as it was asked for."""
    if result.clearance_bound is not None:
        return f"; keeps {result.clearance:.4f} m, and no path more than {result.clearance_bound:.4f} m"
    return f"; keeps {result.clearance:g} m" if result.clearance > 0.0 else ""


def _curve_rows(result: PlanResult) -> list[tuple[str, str]]:
    from trailmark.curves import CurvePath

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
