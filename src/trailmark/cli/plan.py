"""``trailmark plan``: one path for one query."""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options, plan_files
from trailmark.cli.options import Pose, Position, SpeedLimits, Tolerance, UsageError, flag, option

if TYPE_CHECKING:
    import networkx as nx

    from trailmark.planning import LandmarkPlanner, PlannerSettings, PlanProgress, PlanResult
    from trailmark.world import World
    from trailmark.world.goals import Goal

__all__ = ["plan"]

EXIT_STATUS = {"solved": 0, "timeout": 3, "infeasible": 4}
CLOSE, CLOSE_SHARE = 0.01, 0.02
"""Metres, and share of the footprint: below this clearance a path planned without --clearance gets a warning."""

PLAN_SETTINGS = {"gap": options.FACTOR, "max_iterations": options.Count(low=1), "frame_id": options.FRAME}
PLAN_SETTINGS |= {"landmarks": options.LANDMARKS, "step": options.METRES, "limits": options.LIMITS}
"""What a settings file may say of one plan, beside the planner's settings; the last three have options too."""


def plan(
    world: options.WorldArgument,
    robot: options.RobotOption = None,
    query: Annotated[str | None, option(options.NAME, "Query of the world; default: the first.")] = None,
    start: options.StartOption = None,
    goal: Annotated[
        list[Any] | None,
        option(options.GOAL, "Goal pose, or position with any heading. Repeat it to allow any of several."),
    ] = None,
    via: Annotated[
        list[Any] | None,
        option(options.GOAL, "Via point, which the path passes; repeat it for several, in their order.", group="Query"),
    ] = None,
    time_limit: options.TimeLimitOption = 1.0,
    output: Annotated[
        Path | None,
        option(
            options.OutputFile(*options.PATH_SUFFIXES, stdout=True),
            "Write the path: .json (the full result), .csv, .path or .txt (rows 'x y theta'), .yaml or .nav2.json "
            "(nav_msgs/Path), or .geojson; - prints the full result, as --json.",
        ),
    ] = None,
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
    seed: options.SeedOption = 0,
    landmarks: Annotated[int | None, option(options.LANDMARKS, "As in --settings.", hidden=True)] = None,
    goal_tolerance: Annotated[
        Tolerance | None, option(options.TOLERANCE, "Tolerance of the goal's position and heading.", group="Query")
    ] = None,
    bidirectional: Annotated[
        bool, flag("--bidirectional", "Also accept the opposite heading at the goal.", "Query")
    ] = False,
    escape: Annotated[
        bool,
        flag("--escape", "If the robot starts in collision, lead it out first, never deeper in.", "Query"),
    ] = False,
    route_graph: Annotated[
        Path | None,
        option(
            options.InputFile("FILE.geojson"),
            "Plan along the collision-free edges of a route graph (nav2's GeoJSON).",
            group="Query",
        ),
    ] = None,
    keepout: options.KeepoutOption = None,
    unknown: options.UnknownOption = None,
    nav2_params: Annotated[
        Path | None,
        option(
            options.SETTINGS,
            "Parameter file of nav2, for footprint, padding, drive, allow_unknown and tolerance; other options "
            "override it.",
            group="Robot",
        ),
    ] = None,
    drive: options.DriveOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    limits: Annotated[SpeedLimits | None, option(options.LIMITS, "As in --settings.", hidden=True)] = None,
    objective: Annotated[
        str | None,
        option(
            options.NAME,
            "Cost to minimise: length (default), time, clearance (length, costlier near obstacles), or weights such as "
            "length=1,clearance=3,decay=0.4. By default a car that reverses also pays 3 m for a change of direction "
            "and 1.5 m for a metre in reverse: length=1,direction_change=3,reverse=1.5.",
            group="Objective",
        ),
    ] = None,
    clearance: options.ClearanceOption = None,
    relax: Annotated[
        bool, flag("--relax", "If no path keeps --clearance, plan with the largest feasible one.", "Objective")
    ] = False,
    settings: Annotated[
        Path | None,
        option(
            options.SETTINGS,
            "Settings, in lines 'name: value': gap (stop once the cost is proven within this share of the optimum), "
            "max_iterations (with enough time for them, the same seed gives the same path), frame_id (in messages), "
            "landmarks (of the roadmap), step (metres: maximum spacing of written waypoints), limits (m/s, m/s², "
            "rad/s, rad/s², for trajectories and the objective time; default: 1,0.5,1 and no limit), "
            "and the fields of PlannerSettings.",
            group="Limits",
        ),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--round-corners",
            "--smooth",
            help="Round the path's corners where a certified curve fits; at other corners the robot stops.",
            rich_help_panel="Output",
        ),
    ] = False,
    step: Annotated[float | None, option(options.METRES, "As in --settings.", hidden=True)] = None,
    trajectory: Annotated[
        Path | None,
        option(
            options.OutputFile(".csv", ".yaml", ".yml", ".nav2.json"),
            "Write the time-optimal trajectory along the path: .csv (time, pose, velocity), or nav_msgs/Trajectory "
            "(.yaml, .nav2.json).",
            "--timed",
            "--trajectory",
            group="Output",
        ),
    ] = None,
    animate: Annotated[
        Path | None, option(options.OutputFile(".gif"), "Write an animation of the trajectory: .gif.", group="Output")
    ] = None,
) -> None:
    """Plan a path in a world.

    Exit status: 0 path found, 2 bad input, 3 no path found within the time limit, 4 proven infeasible, 130 stopped by
    Ctrl-C, which writes and prints the best path so far.
    """
    # Planning multiplies no matrices that would be worth sharing out: starting the threads takes longer, a tenth of a
    # second. OpenBLAS asks once, when numpy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if relax and clearance is None:
        raise UsageError("--relax given without --clearance; expected both or neither")
    if step is not None and output is None:
        raise UsageError(f"--step {step:g} given without a path to write; expected --output too")
    if limits is not None and trajectory is animate is None and objective in (None, "length"):
        raise UsageError("--limits given without a use; expected --timed, --animate or --objective time too")
    if route_graph is not None and (via or escape or bidirectional or (clearance is not None and relax)):
        raise UsageError("--route-graph given with --via, --escape, --bidirectional or --relax; expected it alone")
    if output == Path("-"):
        output, as_json = None, True
    stopped = Event()

    with console.progress("loading") as progress:
        begun = time.perf_counter()
        from trailmark.world.goals import Goal, goals_of

        given = options.RobotOptions(robot, turning_radius, forward_only, drive)
        taken, nav2_tolerance = list[str](), 0.0
        if nav2_params is not None:
            from trailmark.world.nav2 import Nav2Parameters

            found = Nav2Parameters.load(nav2_params)
            given = given._replace(spec=robot or options.RobotSpec(found.robot.keeping(0.0), (nav2_params,)))
            clearance = found.robot.clearance or None if clearance is None else clearance
            unknown = found.unknown if unknown is None and options.is_nav2_map(world) else unknown
            nav2_tolerance = found.tolerance
            taken.extend(found.taken)
        inputs = [file for file in (settings, route_graph, keepout) if file is not None]
        loaded, body = given.load(world, (output, plot, trajectory, animate), inputs, keepout, unknown)
        name, a, b = _ends(loaded, query, start, goal or [], goal_tolerance)
        if bidirectional:
            found_goals = goals_of(b) or (Goal(b),)  # type: ignore[arg-type]  # no goals: three numbers
            b = tuple(each for one in found_goals for each in one.either_way())
        loading = time.perf_counter() - begun

        from trailmark import LandmarkPlanner
        from trailmark.world.objective import Objective

        chosen, asked = _read_settings(settings)
        in_file = {name: asked.pop(name, None) for name in ("landmarks", "step", "limits")}
        landmarks, step = landmarks or in_file["landmarks"], step or in_file["step"]
        speeds = limits or in_file["limits"] or SpeedLimits()
        progress.stage("preparing (compiles on first use)")
        planner = LandmarkPlanner(
            loaded,
            body,
            seed=seed,
            landmarks=landmarks,
            clearance=clearance,
            relax=relax,
            settings=chosen,
            objective=Objective.of(objective, body, max_speed=speeds.speed, max_turn_rate=speeds.turn_rate),
        )

        if nav2_tolerance > 0.0 and goals_of(b) is None:
            near = Goal(b, position_tolerance=nav2_tolerance)  # type: ignore[arg-type]  # no goals: three numbers
            free = planner.checker.valid(b)  # type: ignore[arg-type]  # as above
            b = b if free else (near,)  # as nav2 does

        def follow(state: PlanProgress) -> None:
            progress.phase = state.phase
            cost = "no path yet" if state.cost is None else f"cost {state.cost:.4g}"
            progress.details = (f"{state.landmarks:,} landmarks", cost)

        progress.stage("planning", time_limit)
        frame, route = asked.pop("frame_id", "map"), None
        with _stopping(stopped):
            if route_graph is not None:
                route, result = _planned_on_route(planner, route_graph, a, b, time_limit)
            else:
                asked |= {"on_progress": follow, "stop": stopped.is_set, "escape": escape}
                places = [each if isinstance(each, Pose) else Goal(each) for each in via or ()]
                if places:
                    result = planner.plan_through(a, [*places, b], time_limit=time_limit, **asked)
                else:
                    result = planner.plan(a, b, time_limit=time_limit, **asked)
        result, extras = plan_files.smoothed(result, loaded, body) if smooth else (result, {})
        record = result.to_dict(world=loaded.name, query=name) | extras
        record["settings"] = chosen.to_dict()
        record |= {"nav2_params": taken} if taken else {}
        record["time"]["load"] = loading
        record["time"]["total"] += loading
        progress.stage("writing")
        path, files = result.path, [trajectory, animate, output]
        if path is None:
            # A record of the full result says that there is no path; other files cannot.
            for file in filter(None, files):
                if not plan_files.is_record(file):
                    console.not_written(file, "there is no path")
            trajectory, animate, output = (file if file and plan_files.is_record(file) else None for file in files)
        elif trajectory is not None or animate is not None:
            record["trajectory"] = plan_files.write_timed(path, speeds, loaded, body, trajectory, animate, frame)
        if output is not None:
            plan_files.write_result(output, path, record, step, loaded, body, frame)
        if plot is not None:
            from trailmark.plotting import save_plan_figure

            save_plan_figure(plot, loaded, body, result, planner.roadmap, start=a, goal=b, query=name, route=route)

    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, result, [trajectory, animate, output, plot])
    if stopped.is_set():
        raise KeyboardInterrupt
    raise typer.Exit(EXIT_STATUS[result.status])


def _planned_on_route(
    planner: LandmarkPlanner, file: Path, start: Any, goal: Any, time_limit: float
) -> tuple[nx.DiGraph, PlanResult]:
    """Return a route graph and the cheapest path over it, and tell along which of its edges the robot collides."""
    from trailmark.roadmap import read_route_graph
    from trailmark.world.goals import Goal

    if isinstance(goal[0], Goal):
        raise UsageError("--route-graph: expected a goal X,Y,T without tolerance, got another")
    graph = read_route_graph(file)
    result = planner.plan_on_route(graph, start, goal, time_limit)
    if result.colliding:
        console.tell(f"{file}: the robot collides along the edges {', '.join(map(str, result.colliding))}")
    return graph, result


Ends = tuple[str | None, tuple[float, float, float], "tuple[float, float, float] | tuple[Goal, ...]"]
"""A query's name, if it is one of the world's, its start, and its goal or goals."""


def _ends(
    world: World,
    query: str | None,
    start: Pose | None,
    goals: Sequence[Pose | Position],
    tolerance: Tolerance | None,
) -> Ends:
    """Return the ends that the options give, else those of the world's query."""
    from trailmark.world.goals import Goal

    if (start is None) != (not goals):
        given, missing = ("--start", "--goal") if not goals else ("--goal", "--start")
        raise UsageError(f"{given} given without {missing}; expected both or neither")
    if start is None:
        found = world.query(query)
        if tolerance is None:
            return found.name, found.start, found.goal
        if isinstance(found.goal[0], Goal):
            raise UsageError(f"--goal-tolerance: expected --goal, for query {found.name!r} holds tolerances itself")
        return found.name, found.start, (Goal(found.goal, *tolerance),)
    if query is not None:
        raise UsageError(f"expected --query or --start and --goal, got both (--query {query!r})")
    if tolerance is None and len(goals) == 1 and isinstance(goals[0], Pose):
        return None, start, goals[0]
    position, heading = tolerance or Tolerance()
    if heading > 0.0 and not any(isinstance(goal, Pose) for goal in goals):
        raise UsageError("--goal-tolerance: expected a goal X,Y,T for a tolerance of its heading, got X,Y")
    return None, start, tuple(Goal(goal, position, heading if isinstance(goal, Pose) else 0.0) for goal in goals)


def _read_settings(file: Path | None) -> tuple[PlannerSettings, dict[str, Any]]:
    """Return the planner's settings in a file, and what it says of a plan: gap, max_iterations and frame_id."""
    from trailmark.formats.settings_yaml import read_settings
    from trailmark.planning import PlannerSettings

    if file is None:
        return PlannerSettings(), {}
    chosen, asked = read_settings(file, PlannerSettings(), dict.fromkeys(PLAN_SETTINGS, ()))
    return chosen, {name: PLAN_SETTINGS[name](str(value), f"{file}: {name}") for name, value in asked.items()}


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


def _print_summary(record: dict[str, Any], result: PlanResult, written: list[Path | None]) -> None:
    kept = result.clearance
    if result.legs:
        costs = ", ".join("none" if leg.cost is None else f"{leg.cost:.4f}" for leg in result.legs)
    title = record["world"] if record["query"] is None else f"{record['world']} · {record['query']}"
    verdict, colour = {
        "solved": ("path found", "green"),
        "timeout": ("no path found", "yellow"),
        "infeasible": (f"infeasible: no path {f'keeps {kept:g} m' if kept else 'exists'}", "red"),
    }[record["status"]]
    reason = f": {result.reason}" if result.reason else ""
    seconds = record["time"]
    facts = [
        *([] if result.path is None else _path_facts(record, result)),
        *([("legs", costs)] if result.legs else []),
        *([("escape", f"{console.plural(result.escape, 'motion')} to get out first")] if result.escape else []),
        *([("route", " - ".join(map(str, record["route"]["nodes"])))] if "route" in record and result.path else []),
        *([("nav2", text) for text in record.get("nav2_params", ())]),
        *([] if "route" in record else [("roadmap", f"{record['landmarks']:,} landmarks, {record['edges']:,} edges")]),
        ("time", f"{seconds['total']:.3f} s (load {seconds['load']:.3f}, build {seconds['build']:.3f})"),
        ("seed", str(record["seed"])),
    ]
    console.show(f"{title}: {verdict}{reason}", facts, written, colour)


def _path_facts(record: dict[str, Any], result: PlanResult) -> list[tuple[str, str]]:
    cost, bound, facts = record["cost"], record["lower_bound"], []
    if result.goal is not None:
        pose = ", ".join(f"{value:.4g}" for value in result.goal.pose)
        facts.append(("goal", f"number {result.goal.index + 1}, reached at ({pose})"))
    gap = f" (at most {100.0 * (cost / bound - 1.0):.1f} % above the optimum: lower bound {bound:.4f})" if bound else ""
    facts += [
        ("cost", f"{cost:.4f}{gap}"),
        ("length", f"{record['length']:.4f} m"),
        ("rotation", f"{record['rotation']:.4f} rad ({math.degrees(record['rotation']):.0f}°)"),
    ]
    if (weights := record.get("objective")) is not None:
        shown = [f"{name} {weights[name]:g}" for name in ("length", "time", "clearance") if weights[name]]
        if "direction_changes" in record:
            shown += [f"metres in reverse {weights['reverse']:g} times"] if weights["reverse"] > 1.0 else []
            shown += [f"a change of direction {weights['direction_change']:g} m"] if weights["direction_change"] else []
        error = f"; the cost is known to {record['cost_error']:.2g}" if record["cost_error"] else ""
        facts.append(("objective", ", ".join(shown) + error))
    if (curve := record.get("curve")) is not None:
        kind = {"dubins": "Dubins", "reeds-shepp": "Reeds-Shepp"}[curve["kind"]]
        changes = console.plural(record["direction_changes"], "change")
        turns = f"{changes} of direction, {record['reverse_length']:.4g} m in reverse"
        facts.append(("curves", f"{kind}, turning radius {curve['turning_radius']:g} m, {turns}"))
    if (smooth := record.get("smooth")) is not None:
        stops = f"{len(smooth['stops'])} stops on the way"
        facts.append(("smooth", f"curvature {smooth['max_curvature']:.3g} /m at its most, {stops}"))
    if "trajectory" in record:
        facts.append(("trajectory", f"{record['trajectory']['duration']:.2f} s"))
    certified = f"; certified {result.clearance:.4g} m" if result.clearance > 0.0 or result.clearance_bound else ""
    if result.clearance_bound is not None:
        certified += f", and no path keeps more than {result.clearance_bound:.4f} m"
    enough = max(CLOSE, CLOSE_SHARE * 2.0 * result.robot.circumradius) if result.robot is not None else CLOSE
    if not result.escape and result.clearance == 0.0 and record["min_clearance"] < enough:
        certified = f"; too near to drive? --clearance {2.0 * enough:.2g} keeps away"
    first = f"cost {record['first_cost']:.4f} after {record['time']['first_solution']:.3f} s"
    return [*facts, ("clearance", f"minimum {record['min_clearance']:.4f} m{certified}"), ("first path", first)]
