"""Options of ``trailmark plan`` alone: ends, clearance, objective, smoothing and timing of the path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trailmark.cli import console, options
from trailmark.cli.options import Configuration, UsageError, option

if TYPE_CHECKING:
    from trailmark.goals import Goal
    from trailmark.objective import Objective
    from trailmark.path import Path as TrailPath
    from trailmark.planning import PlanResult
    from trailmark.shown import Layers
    from trailmark.world import Robot, World

ANIMATION_SUFFIXES = (".gif",)

MAX_HALVINGS = 8
"""How often a step is halved: the line is off the curve by 65,536 times less then, nanometres."""

DEFAULT_SPEED, DEFAULT_ACCELERATION, DEFAULT_TURN_RATE = 1.0, 0.5, 1.0
"""m/s, m/s² and rad/s: of a small mobile robot indoors."""

LEAST_LIMIT, MAX_LIMIT = 1e-6, 1e6
"""Of speeds and accelerations, in their units, as those of an objective are."""

PERIOD, MAX_ROWS = 0.1, 100_000
"""Seconds between a trajectory's rows at most, unless there would be more than so many."""

CLOSEST = 1e-6
"""Seconds: rows that are no farther apart become one, for messages count whole nanoseconds."""

SPACING = 0.002
"""Metres of cost between the states at which a smooth path's clearance is measured, unless they were too many."""

Text = str | None
GoalOption = Annotated[
    list[str] | None,
    option("--goal", "X,Y[,T]", "Goal pose, or position with any heading. Repeat it for alternatives: one is reached."),
]
GoalToleranceOption = Annotated[
    Text,
    option("--goal-tolerance", "METRES[,RADIANS]", "Tolerance of the goal's position and heading; default: 0,0."),
]
ClearanceOption = Annotated[
    Text, option("--clearance", "METRES", "Minimum clearance to obstacles and bounds along the whole path.")
]
RelaxOption = Annotated[
    bool, typer.Option("--relax", help="If no path keeps --clearance, plan with the largest feasible clearance.")
]
ObjectiveOption = Annotated[
    Text,
    option(
        "--objective",
        "NAME",
        "Cost to minimise: length, time (by --max-speed and --max-turn-rate), clearance (length, costlier near "
        "obstacles), or weights such as length=1,clearance=3,decay=0.4. Default: length; a car's also counts driving "
        "in reverse and changes of direction.",
    ),
]
ReverseCostOption = Annotated[
    Text,
    option(
        "--reverse-cost", "FACTOR", "Cost factor of a car's reverse driving; default: 1.5, with --objective length 1."
    ),
]
DirectionChangeCostOption = Annotated[
    Text,
    option(
        "--direction-change-cost",
        "METRES",
        "Cost of a car's change of direction; default: 3, with --objective length 0.",
    ),
]
LayersOption = Annotated[
    Text,
    option("--layers", "NAMES", "Layers of the picture, such as obstacles,path,ends; default: all but clearance."),
]
SmoothOption = Annotated[
    bool,
    typer.Option("--smooth", help="Round the path's corners where a certified curve fits; the robot stops at others."),
]
StepOption = Annotated[Text, option("--step", "METRES", "Maximum spacing of waypoints in the written path.")]
TrajectoryOption = Annotated[
    Text,
    option(
        "--trajectory",
        "FILE",
        "Write the time-optimal trajectory along the path: .csv (time, pose, velocity), or nav_msgs/Trajectory (.yaml, "
        ".nav2.json).",
    ),
]
AnimateOption = Annotated[Text, option("--animate", "FILE", "Write an animation of the trajectory as a .gif.")]
MaxSpeedOption = Annotated[
    Text, option("--max-speed", "M/S", f"Maximum speed of the reference point; default: {DEFAULT_SPEED:g}.")
]
MaxAccelerationOption = Annotated[
    Text,
    option(
        "--max-acceleration",
        "M/S2",
        f"Maximum acceleration of the reference point; default: {DEFAULT_ACCELERATION:g}.",
    ),
]
MaxTurnRateOption = Annotated[
    Text, option("--max-turn-rate", "RAD/S", f"Maximum turn rate; default: {DEFAULT_TURN_RATE:g}.")
]
MaxTurnAccelerationOption = Annotated[
    Text, option("--max-turn-acceleration", "RAD/S2", "Maximum angular acceleration; default: no limit.")
]


class EndOptions(NamedTuple):
    """The options ``--query``, ``--start``, ``--goal`` and ``--goal-tolerance``, read before the world is."""

    query: str | None
    start: Configuration | None
    goals: list[tuple[float, ...]]
    tolerance: tuple[float, float] | None

    @classmethod
    def read(cls, query: str | None, start: str | None, goals: list[str] | None, tolerance: str | None) -> EndOptions:
        """Return the options, checked."""
        within = None if tolerance is None else _read_tolerance(tolerance)
        if start is None and not goals:
            return cls(query, None, [], within)
        if query is not None:
            raise UsageError(f"expected --query or --start and --goal, got both (--query {query!r})")
        if start is None or not goals:
            given, missing = (f"--start {start!r}", "--goal") if not goals else (f"--goal {goals[0]!r}", "--start")
            raise UsageError(f"{given} given without {missing}; expected both or neither")
        poses = [_read_goal(goal) for goal in goals]
        if within is not None and within[1] > 0.0 and all(len(pose) == 2 for pose in poses):
            raise UsageError(f"--goal-tolerance {tolerance!r}: expected a goal X,Y,T, got --goal {goals[0]!r}")
        return cls(None, options.read_configuration(start, "--start"), poses, within)

    def ends(self, world: World) -> tuple[str | None, Configuration, Configuration | tuple[Goal, ...]]:
        """Return the query's name if it is one of the world's, the start, and the goal or goals."""
        from trailmark.goals import Goal

        if self.start is not None:
            start, poses, name = self.start, self.goals, None
        else:
            query = world.query(self.query)
            start, poses, name = query.start, [query.goal], query.name
            if isinstance(query.goal[0], Goal):
                if self.tolerance is not None:
                    raise UsageError(f"--goal-tolerance: expected --goal, for query {name!r} holds tolerances itself")
                return name, start, query.goal
        if len(poses) == 1 and len(poses[0]) == 3 and self.tolerance is None:
            x, y, theta = poses[0]
            return name, start, (x, y, theta)
        position, heading = self.tolerance or (0.0, 0.0)
        headings = (heading if len(pose) == 3 else 0.0 for pose in poses)
        goals = (
            Goal(q, position_tolerance=position, heading_tolerance=h) for q, h in zip(poses, headings, strict=True)
        )
        return name, start, tuple(goals)


def _read_goal(text: str) -> tuple[float, ...]:
    """Return the numbers of ``X,Y,T`` or ``X,Y``."""
    if text.count(",") != 1:
        return options.read_configuration(text, "--goal")
    x, y = (
        options.read_number(word, "--goal", "X,Y or X,Y,T, finite numbers (metres, radians)")
        for word in text.split(",")
    )
    return x, y


def _read_tolerance(text: str) -> tuple[float, float]:
    """Return the metres and radians, 0 by default, of ``METRES[,RADIANS]``."""
    from trailmark.arguments import angle

    metres, comma, heading = text.partition(",")
    try:
        radians = angle(heading) if comma else 0.0
    except ValueError:
        radians = math.nan
    expected = "METRES or METRES,RADIANS, numbers of 0 or more (degrees as in 10deg)"
    if not 0.0 <= radians < math.inf:
        raise UsageError(f"expected {expected}, got --goal-tolerance {text!r}")
    return options.read_number(metres, "--goal-tolerance", expected, low=0.0), radians


def read_clearance(text: Text, relax: bool) -> float | None:
    """Return the metres that ``--clearance`` gives; None for None."""
    if text is not None:
        return options.read_number(text, "--clearance", "metres, from 0 to 1e7", low=0.0, high=1e7)
    if relax:
        raise UsageError("--relax given without --clearance; expected both or neither")
    return None


def read_layers(text: Text, plot: Text) -> Layers:
    """Return the layers of the picture."""
    from trailmark.shown import ALL, Layers

    if text is not None and plot is None:
        raise UsageError(f"--layers {text!r} given without --plot; expected both or neither")
    return ALL if text is None else Layers.parse(text)


def read_objective(
    text: str | None, timing: Timing, reverse_cost: str | None, direction_change_cost: str | None
) -> Callable[[Robot], Objective]:
    """Return what makes the objective that ``--objective`` names for a robot; speeds are those of the time law."""
    from trailmark.errors import ConfigurationError
    from trailmark.objective import Objective

    speed, _, turn_rate, _ = timing.limits
    given: dict[str, float] = {}
    if reverse_cost is not None:
        given["reverse"] = options.read_number(
            reverse_cost, "--reverse-cost", "a factor from 1 to 1e6", low=1.0, high=1e6
        )
    if direction_change_cost is not None:
        flag = "--direction-change-cost"
        given["direction_change"] = options.read_number(
            direction_change_cost, flag, "metres, from 0 to 1e6", low=0.0, high=1e6
        )

    def objective(robot: Robot | None) -> Objective:
        return Objective.of(text, robot, max_speed=speed, max_turn_rate=turn_rate, **given)

    try:
        objective(None)
    except ConfigurationError as error:
        raise UsageError(f"--objective {text!r}: {str(error).removeprefix('objective: ')}") from None

    def objective_of(robot: Robot) -> Objective:
        if given and (robot.turning_radius is None or not robot.reverse):
            flag = "--reverse-cost" if "reverse" in given else "--direction-change-cost"
            raise UsageError(f"{flag}: expected a car that reverses (--turning-radius), got {robot.describe()}")
        return objective(robot)

    return objective_of


def objective_rows(record: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the summary's row about an objective other than length."""
    objective = record.get("objective")
    if objective is None:
        return []
    weights = [f"{name} {objective[name]:g}" for name in ("length", "time", "clearance") if objective[name]]
    if "direction_changes" in record:
        weights += [f"metres in reverse {objective['reverse']:g} times"] if objective["reverse"] > 1.0 else []
        weights += (
            [f"a change of direction {objective['direction_change']:g} m"] if objective["direction_change"] else []
        )
    error = f"; the cost is known to {record['cost_error']:.2g}" if record["cost_error"] else ""
    return [("objective", ", ".join(weights) + error)]


@dataclass(frozen=True)
class Timing:
    """The options on trajectories.

    Attributes:
        limits: maximum speed, acceleration, turn rate and, if limited, turn acceleration.
        table: where the trajectory goes; None for nowhere.
        animation: where the animation goes; None for nowhere.
    """

    limits: tuple[float, float, float, float | None]
    table: Path | None
    animation: Path | None

    def write(self, result: PlanResult, world: World, robot: Robot, frame: str) -> tuple[list[Path], dict[str, Any]]:
        """Write the requested files; return them, and the trajectory's part of the record."""
        asked = [file for file in (self.table, self.animation) if file is not None]
        if result.path is None:
            for file in asked:
                console.not_written(file)
            return [], {}
        if not asked:
            return [], {}
        import numpy as np

        trajectory = result.path.timed(*self.limits, zones=world.zones)
        if self.table is not None:
            from trailmark.formats.path_files import write_trajectory

            # Between the rows of the law, evenly spaced ones, for programs that join rows by straight lines.
            count = min(MAX_ROWS, int(np.ceil(trajectory.duration / PERIOD)))
            t = np.union1d(trajectory.t, np.linspace(0.0, trajectory.duration, count + 1))
            t = t[np.append(True, np.diff(t) > CLOSEST)]
            t[-1] = trajectory.duration
            write_trajectory(self.table, t, trajectory.at(t), trajectory.velocity(t), frame)
        if self.animation is not None:
            from trailmark.plotting import save_trajectory_animation

            save_trajectory_animation(self.animation, trajectory, world, robot)
        return asked, {"trajectory": {"duration": trajectory.duration, "rows": len(trajectory.t)}}


def read_timing(
    table: Text,
    animation: Text,
    speed: Text,
    acceleration: Text,
    turn_rate: Text,
    turn_acceleration: Text,
    *,
    needed: bool = False,
) -> Timing:
    """Return the options on trajectories; ``needed``: whether limits are of use without one."""
    given = (
        ("--max-speed", speed, DEFAULT_SPEED, "m/s"),
        ("--max-acceleration", acceleration, DEFAULT_ACCELERATION, "m/s²"),
        ("--max-turn-rate", turn_rate, DEFAULT_TURN_RATE, "rad/s"),
        ("--max-turn-acceleration", turn_acceleration, None, "rad/s²"),
    )
    limits: list[Any] = []
    for name, text, default, unit in given:
        if text is not None and table is None and animation is None and not needed:
            raise UsageError(f"{name} {text!r} given without a trajectory; expected --trajectory or --animate too")
        expected = f"a number from {LEAST_LIMIT:g} to {MAX_LIMIT:g} ({unit})"
        limits.append(
            default if text is None else options.read_number(text, name, expected, low=LEAST_LIMIT, high=MAX_LIMIT)
        )
    from trailmark.formats.path_files import TRAJECTORY_SUFFIXES

    files = options.output_file(table, TRAJECTORY_SUFFIXES), options.output_file(animation, ANIMATION_SUFFIXES)
    return Timing((limits[0], limits[1], limits[2], limits[3]), *files)


def read_step(text: Text, output: Path | None) -> float | None:
    """Return the metres that ``--step`` gives; None for None."""
    if text is None:
        return None
    if output is None:
        raise UsageError(f"--step {text!r} given without a path to write; expected --output too")
    return options.read_length(text, "--step")


def smoothed(result: PlanResult, world: World, robot: Robot) -> tuple[PlanResult, dict[str, Any]]:
    """Return a result with its path smoothed, and the smooth path's part of the record."""
    if result.path is None:
        return result, {}
    from trailmark.collision import StateChecker
    from trailmark.errors import ConfigurationError
    from trailmark.motion import motion_of

    checker = StateChecker(world, robot)
    try:
        path = result.path.smooth(StateChecker(world, robot, clearance=result.clearance or None))
    except ConfigurationError as error:
        # It leads out of a keep-out zone, say, that the robot starts in.
        console.warn(f"--smooth: the path stays as it was planned: {error}")
        return result, {}
    clearance = float(checker.clearance(path.resample(max(SPACING, path.cost / MAX_ROWS)).states).min())
    found = {"stops": path.stops.tolist(), "max_curvature": path.max_curvature}
    result = replace(result, path=path, min_clearance=clearance)
    # An objective charges a car for its shortest curves alone: its cost stays that of the path before.
    if result.objective is None:
        result = replace(result, charged=path.cost, cost_error=0.0)
    elif robot.turning_radius is None:
        charged, within = motion_of(checker, objective=result.objective).cost_within(path.states)
        result = replace(result, charged=charged, cost_error=within)
    return result, {"smooth": found}


def trajectory_rows(record: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the summary's rows about a smooth path and a trajectory."""
    rows = []
    if "smooth" in record:
        stops, curvature = len(record["smooth"]["stops"]), record["smooth"]["max_curvature"]
        rows.append(("smooth", f"curvature {curvature:.3g} /m at its most, {stops} stops on the way"))
    if "trajectory" in record:
        rows.append(("trajectory", f"{record['trajectory']['duration']:.2f} s"))
    return rows


def with_step(path: TrailPath | None, step: float | None, world: World, robot: Robot) -> TrailPath | None:
    """Return a path with rows at most a step (metres) apart, for writing; straight lines between them are free too.

    Where such a line would hit an obstacle that the curve passes, rows are closer; motions out of a
    keep-out zone stay as they are.
    """
    if path is None or step is None:
        return path
    from trailmark.collision import StateChecker
    from trailmark.motion.one_way import straight_valid

    checker = StateChecker(world, robot)
    valid = straight_valid(checker)
    for halvings in range(MAX_HALVINGS + 1):
        rows = path.resample(step / 2**halvings)
        a, b = rows.states[:-1], rows.states[1:]
        if (valid(a, b) | ~checker.states_free(a) | ~checker.states_free(b)).all():
            break
    return rows
