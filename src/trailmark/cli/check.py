"""``trailmark check``: whether a path of any planner is free."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.options import option

if TYPE_CHECKING:
    from trailmark.formats.any_path import PathFile
    from trailmark.path import Path as RobotPath
    from trailmark.verify import PathAudit, PathAuditor
    from trailmark.world import Robot

__all__ = ["check"]

WRONG = 5
"""Exit status if the path collides, or holds motions that the robot's drive cannot make."""

ZONES = ("keep-out zone ", "one-way zone ")
"""Prefixes of the names of zones."""

SHOWN = 12
"""Collisions, and motions that the robot cannot make, that the summary lists at most."""

SLACK = 1e-3
"""Share by which a path's curvature may exceed the robot's: that of circles through states with few digits."""


SMALLEST_RADIUS = 1e-6
"""Metres: who follows a smaller turning radius turns in place, and its arcs would be more than can be audited."""


def check(
    world: options.WorldArgument,
    path: Annotated[
        str,
        typer.Argument(
            metavar="PATH",
            show_default=False,
            help="Path to check: JSON, CSV, rows 'x y theta', or nav_msgs/Path as YAML or JSON.",
        ),
    ],
    robot: options.RobotOption = None,
    keepout: options.KeepoutOption = None,
    speed_mask: options.SpeedMaskOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    drive: options.DriveOption = None,
    repair: Annotated[
        str | None,
        option(
            "--repair",
            "OUT",
            "Write the path with its colliding parts replanned, in a format of plan's --output.",
        ),
    ] = None,
    time_limit: Annotated[
        str, option("--time-limit", "SECONDS", "Planning time for each part replanned by --repair.", default=True)
    ] = "1.0",
    seed: options.SeedOption = "0",
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Check a path of any planner for collisions, clearance and drivability.

    The whole motion is checked continuously, not at samples. Exit status: 0 collision-free, or repaired; 5 the path
    collides or the robot cannot drive it; 2 bad input.
    """
    from trailmark.formats import path_files
    from trailmark.formats.any_path import read_any_path

    limit = options.read_duration(time_limit, "--time-limit")
    number = options.read_count(seed, "--seed", 0)
    given = options.RobotOptions.read(robot, turning_radius, forward_only, drive)
    picture, output = (
        options.output_file(plot, options.PICTURE_SUFFIXES),
        options.output_file(repair, path_files.SUFFIXES),
    )
    with console.progress("loading") as progress:
        loaded, file = options.load_world(world, keepout, speed_mask), Path(path)
        options.protect_inputs((*loaded.sources, *given.files, file), picture, output)
        body = given.robot_in(loaded)
        loaded = options.grown_for(loaded, body)
        found = read_any_path(file)
        if found.headings > 2.0 * math.pi:
            console.warn(f"{file}: headings of up to {found.headings:g} are taken as radians; are they in degrees?")

        from trailmark.collision import StateChecker
        from trailmark.errors import ConfigurationError, FormatError
        from trailmark.verify import PathAuditor

        progress.stage("checking (compiles on first use)")
        auditor = PathAuditor(StateChecker(loaded, body))
        recorded = recorded_path(found, file)
        try:
            audit = auditor.audit(recorded)
        except ConfigurationError as error:
            raise FormatError(file, str(error)) from None
        # What another drive does may cost less than this robot's bound.
        lower_bound = None if audit.undrivable else _lower_bound(auditor, audit)
        record = audit.to_dict(loaded.name) | {"lower_bound": lower_bound}
        written = []
        fixed, final = None, audit
        if output is not None:
            progress.stage("repairing")
            fixed = _repaired(auditor, audit, number, limit)
            if fixed is not None:
                path_files.write_path(output, fixed)
                written.append(output)
                final = auditor.audit(fixed)
        if picture is not None:
            from trailmark.plotting import save_audit_figure

            progress.stage("drawing")
            save_audit_figure(picture, loaded, body, audit, fixed)
            written.append(picture)

    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, audit, body, written)
    raise typer.Exit(0 if final.free and not final.undrivable else WRONG)


def recorded_path(found: PathFile, file: Path) -> RobotPath:
    """Return what a path file describes: a :class:`~trailmark.curves.CurvePath` if it records curves, else its states.

    Curves count as long as the states beside them are theirs: who edits the states wants those.

    Raises:
        FormatError: curves that are none.
    """
    import numpy as np

    from trailmark.arguments import brief, real
    from trailmark.curves import CurvePath, Steering
    from trailmark.errors import FormatError, TrailmarkError
    from trailmark.path import Path as RobotPath
    from trailmark.robot import TURNING_LIMIT

    if found.curve is None:
        return RobotPath(found.states)
    curve = found.curve if isinstance(found.curve, dict) else {}
    kind, radius, knots, places = (curve.get(key) for key in ("kind", "turning_radius", "knots", "places"))
    if kind not in ("dubins", "reeds-shepp"):
        raise FormatError(file, f"curve: kind: expected dubins or reeds-shepp, got {brief(kind)}")
    if not SMALLEST_RADIUS <= real(radius) <= TURNING_LIMIT:
        allowed = f"expected metres from {SMALLEST_RADIUS:g} to {TURNING_LIMIT:g}"
        raise FormatError(file, f"curve: turning radius: {allowed}, got {brief(radius)}")
    try:
        curves = CurvePath(knots, Steering(real(radius), reverse=kind == "reeds-shepp"), places)  # type: ignore[arg-type]  # checked
    except TrailmarkError as error:
        raise FormatError(file, f"curve: {error}") from None
    same = len(curves) == len(found.states) and np.allclose(curves.states, found.states, rtol=0.0, atol=1e-6)
    return curves if same else RobotPath(found.states)


def _lower_bound(auditor: PathAuditor, audit: PathAudit) -> float | None:
    """Return a proven lower bound on the cost of any path between the same ends; None where an end is not valid."""
    from trailmark.planning.proofs.bound import LowerBound

    ends = audit.path.states[[0, -1]]
    if not auditor.checker.valid(ends).all():
        return None
    bound = LowerBound(auditor.checker.world, auditor.checker.robot).of(ends[0], ends[1], limit=audit.cost).cost
    return bound if bound < math.inf else None


def _repaired(auditor: PathAuditor, audit: PathAudit, seed: int, limit: float) -> RobotPath | None:
    """Return the repaired path; say in one line on stderr why there is none."""
    from trailmark.errors import ConfigurationError
    from trailmark.planning import LandmarkPlanner
    from trailmark.verify import repaired

    planner: Any = None

    def plan(start: Any, goal: Any) -> RobotPath | None:
        nonlocal planner
        planner = planner or LandmarkPlanner(auditor.checker.world, auditor.checker.robot, seed=seed)
        found: RobotPath | None = planner.plan(start, goal, time_limit=limit).path
        return found

    try:
        path = repaired(auditor, audit, plan)
    except ConfigurationError as error:
        console.fail(f"not repaired: {error}")
        return None
    if path is None:
        console.fail(f"not repaired: no way past a collision was found within {limit:g} s for each part (--time-limit)")
    return path


def _print_summary(record: dict[str, Any], audit: PathAudit, robot: Robot, written: list[Path]) -> None:
    undrivable = audit.undrivable or ()
    verdict, colour = ("free", "green") if audit.free else ("the path collides", "red")
    if undrivable:
        verdict, colour = f"{verdict}, but not drivable" if audit.free else f"{verdict}, and is not drivable", "red"
    console.say(f"{record['world']}: {verdict}", fg=colour, bold=True)
    rows = []
    for hit in audit.collisions[:SHOWN]:
        name = str(hit.obstacle)
        if name not in ("bounds", "boundary") and not name.startswith(ZONES):
            name = f"obstacle {name}"
        rows.append(("collision", f"{hit.begin:.4f} to {hit.end:.4f} m along: {name}, {hit.depth:.4g} m deep"))
    if len(audit.collisions) > SHOWN:
        rows.append(("", f"and {len(audit.collisions) - SHOWN:,} more"))
    for motion in undrivable[:SHOWN]:
        place = f"motion {motion.motion}, {motion.begin:.4f} to {motion.end:.4f} m along"
        rows.append(("undrivable", f"{place}: {motion.why}"))
    if len(undrivable) > SHOWN:
        rows.append(("", f"and {len(undrivable) - SHOWN:,} more"))
    if audit.free:
        rows.append(("clearance", f"minimum {audit.min_clearance:.6f} m, {audit.min_clearance_at:.4f} m along"))
    bound = record["lower_bound"]
    # A polygon through states on a car's curve is shorter than that.
    above = bool(bound) and audit.free and audit.cost >= bound
    gap = f" ({100.0 * (audit.cost / bound - 1.0):.1f} % above the lower bound {bound:.4f})" if above else ""
    rows += [
        ("cost", f"{audit.cost:.4f}{gap}"),
        ("length", f"{audit.length:.4f} m"),
        ("rotation", f"{audit.rotation:.4f} rad ({math.degrees(audit.rotation):.0f}°)"),
        ("curvature", _curvature(audit.max_curvature, robot.turning_radius)),
        *(("written", str(file)) for file in written),
    ]
    if audit.direction_changes is not None:
        rows.append(
            ("driving", f"{audit.direction_changes} changes of direction, {audit.reverse_length:.4f} m in reverse")
        )
    console.print_table(rows, indent="  ")


def _curvature(largest: float, radius: float | None) -> str:
    """Return the path's largest curvature, compared to the robot's turning radius."""
    text = f"{largest:.4g} 1/m at most" if largest < math.inf else "turns in place"
    if 0.0 < largest < math.inf:
        text += f" (radius {1.0 / largest:.4g} m)"
    if radius is not None:
        fits = largest * radius <= 1.0 + SLACK
        text += f"; the robot's turning radius is {radius:g} m: {'it can follow' if fits else 'too tight for it'}"
    return text
