"""What ``trailmark plan`` does with a path beyond writing it: smooth it, time it, and show the robot along it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console
from trailmark.cli.options import UsageError, option, output_file, read_length, read_number

if TYPE_CHECKING:
    from trailmark.path import Path as TrailPath
    from trailmark.planning import PlanResult
    from trailmark.world import Robot, World

__all__ = [
    "AnimateOption",
    "MaxAccelerationOption",
    "MaxSpeedOption",
    "MaxTurnAccelerationOption",
    "MaxTurnRateOption",
    "SmoothOption",
    "StepOption",
    "Timing",
    "TrajectoryOption",
    "read_step",
    "read_timing",
    "smoothed",
    "trajectory_rows",
    "with_step",
]

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
SmoothOption = Annotated[
    bool, typer.Option("--smooth", help="Round the path's corners where there is room, certified; the rest are stops.")
]
StepOption = Annotated[Text, option("--step", "METRES", "Rows of the path that is written at most so far apart.")]
TrajectoryOption = Annotated[
    Text,
    option(
        "--trajectory",
        "FILE",
        "Write the fastest trajectory: .csv (time, configuration, velocity), nav_msgs/Trajectory (.yaml, .nav2.json).",
    ),
]
AnimateOption = Annotated[Text, option("--animate", "FILE", "Write the robot along the trajectory as a .gif.")]
MaxSpeedOption = Annotated[
    Text, option("--max-speed", "M/S", f"Of the trajectory's reference point; default: {DEFAULT_SPEED:g}.")
]
MaxAccelerationOption = Annotated[
    Text, option("--max-acceleration", "M/S2", f"Likewise, in every direction; default: {DEFAULT_ACCELERATION:g}.")
]
MaxTurnRateOption = Annotated[
    Text, option("--max-turn-rate", "RAD/S", f"Of the trajectory; default: {DEFAULT_TURN_RATE:g}.")
]
MaxTurnAccelerationOption = Annotated[
    Text, option("--max-turn-acceleration", "RAD/S2", "Of the trajectory; default: turn rates change at once.")
]


@dataclass(frozen=True)
class Timing:
    """What the options on trajectories say.

    Attributes:
        limits: maximum speed, acceleration, turn rate and, if limited, turn acceleration.
        table: where the trajectory goes; None for nowhere.
        animation: where the animation goes; None for nowhere.
    """

    limits: tuple[float, float, float, float | None]
    table: Path | None
    animation: Path | None

    def write(self, result: PlanResult, world: World, robot: Robot, frame: str) -> tuple[list[Path], dict[str, Any]]:
        """Write what was asked for; return the files, and what the record says of the trajectory."""
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
    """Return what the options say; ``needed`` says whether limits are of use without a trajectory.

    Raises:
        UsageError: limits that are out of range, or that nothing needs.
        OutputError: files that cannot be written.
    """
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
        limits.append(default if text is None else read_number(text, name, expected, low=LEAST_LIMIT, high=MAX_LIMIT))
    from trailmark.formats.path_files import TRAJECTORY_SUFFIXES

    files = output_file(table, TRAJECTORY_SUFFIXES), output_file(animation, ANIMATION_SUFFIXES)
    return Timing((limits[0], limits[1], limits[2], limits[3]), *files)


def read_step(text: Text, output: Path | None) -> float | None:
    """Return the metres that ``--step`` gives; None for None.

    Raises:
        UsageError: no number above 0, or no file to which it applies.
    """
    if text is None:
        return None
    if output is None:
        raise UsageError(f"--step {text!r} given without a path to write; expected --output too")
    return read_length(text, "--step")


def smoothed(result: PlanResult, world: World, robot: Robot) -> tuple[PlanResult, dict[str, Any]]:
    """Return a result with its path smoothed, and what the record says of that."""
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
    """Return what the summary says of a smooth path and of a trajectory."""
    rows = []
    if "smooth" in record:
        stops, curvature = len(record["smooth"]["stops"]), record["smooth"]["max_curvature"]
        rows.append(("smooth", f"curvature {curvature:.3g} /m at its most, {stops} stops on the way"))
    if "trajectory" in record:
        rows.append(("trajectory", f"{record['trajectory']['duration']:.2f} s"))
    return rows


def with_step(path: TrailPath | None, step: float | None, world: World, robot: Robot) -> TrailPath | None:
    """Return a path with rows at most a step (metres) apart, for writing; straight lines between them are free too.

    Where such a line would meet what the curve passes, rows are closer; motions from where the robot has to leave
    something first stay as they are.
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
