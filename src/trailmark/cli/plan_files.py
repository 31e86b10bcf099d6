"""What ``trailmark plan`` makes of a path before it is written: smoothed, in small steps, timed, animated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trailmark.cli import console
from trailmark.cli.options import SpeedLimits

if TYPE_CHECKING:
    from trailmark.planning import PlanResult
    from trailmark.trajectories.path import Path as TrailPath
    from trailmark.world import Robot, World

MAX_HALVINGS = 8
"""How often a step is halved: the line is off the curve by 65,536 times less then, nanometres."""

PERIOD, CLOSEST = 0.1, 1e-6
"""Seconds between a trajectory's rows at most, and at least, for messages count whole nanoseconds."""

MAX_ROWS = 100_000
"""Beyond so many rows they may be farther apart."""

SPACING = 0.002
"""Metres of cost between the states at which a smooth path's clearance is measured."""


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
    result = replace(result, path=path, min_clearance=clearance)
    # An objective charges a car for its shortest curves alone: its cost stays that of the path before.
    if result.objective is None:
        result = replace(result, charged=path.cost, cost_error=0.0)
    elif robot.turning_radius is None:
        charged, within = motion_of(checker, objective=result.objective).cost_within(path.states)
        result = replace(result, charged=charged, cost_error=within)
    return result, {"smooth": {"stops": path.stops.tolist(), "max_curvature": path.max_curvature}}


def is_record(file: Path) -> bool:
    """Return whether a file of this name holds the full result, so that it can say that there is no path."""
    return file.suffix.lower() == ".json" and not file.name.lower().endswith(".nav2.json")


def write_result(
    file: Path,
    path: TrailPath | None,
    record: dict[str, Any],
    step: float | None,
    world: World,
    robot: Robot,
    frame: str,
) -> None:
    """Write a path, with rows at most a step (metres) apart if there is one, or a record that there is none."""
    from trailmark.formats.files import write_atomically
    from trailmark.formats.path_files import write_path

    if path is None:
        write_atomically(file, console.json_text(record) + "\n")
    else:
        write_path(file, path if step is None else with_step(path, step, world, robot), record, frame)


def with_step(path: TrailPath, step: float, world: World, robot: Robot) -> TrailPath:
    """Return a path with rows at most a step (metres) apart; the straight lines between them are free too.

    Where such a line would hit an obstacle that the curve passes, rows are closer; motions out of a
    keep-out zone stay as they are.
    """
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


def write_timed(
    path: TrailPath,
    limits: SpeedLimits,
    world: World,
    robot: Robot,
    table: Path | None,
    animation: Path | None,
    frame: str,
) -> dict[str, Any]:
    """Write the fastest trajectory along a path as rows and as an animation, where asked; return its figures."""
    import numpy as np

    trajectory = path.timed(*limits, zones=world.zones)
    if table is not None:
        from trailmark.formats.path_files import write_trajectory

        # Between the rows of the law, evenly spaced ones, for programs that join rows by straight lines.
        count = min(MAX_ROWS, int(np.ceil(trajectory.duration / PERIOD)))
        t = np.union1d(trajectory.t, np.linspace(0.0, trajectory.duration, count + 1))
        t = t[np.append(True, np.diff(t) > CLOSEST)]
        t[-1] = trajectory.duration
        write_trajectory(table, t, trajectory.at(t), trajectory.velocity(t), frame)
    if animation is not None:
        from trailmark.plotting import save_trajectory_animation

        save_trajectory_animation(animation, trajectory, world, robot)
    return {"duration": trajectory.duration, "rows": len(trajectory.t)}
