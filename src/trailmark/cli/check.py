"""``trailmark check``: whether a path of any planner is free."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.options import argument, option

if TYPE_CHECKING:
    from trailmark.formats.any_path import PathFile
    from trailmark.trajectories import Path as RobotPath
    from trailmark.verify import PathAudit, PathAuditor
    from trailmark.verify.auditor import Collision
    from trailmark.world import Robot

__all__ = ["check"]

WRONG = 5
"""Exit status if the path collides, comes nearer than asked, or holds motions that the robot's drive cannot make."""

SHOWN = 12
"""Collisions, and motions that the robot cannot make, that the summary lists at most."""

SLACK = 1e-3
"""Share by which a path's curvature may exceed the robot's: that of circles through states with few digits."""

SMALLEST_RADIUS = 1e-6
"""Metres: who follows a smaller turning radius turns in place, and its arcs would be more than can be audited."""


def check(
    world: options.WorldArgument,
    path: Annotated[
        Path,
        argument(
            "PATH",
            "Path to check: JSON, CSV, rows 'x y theta', TUM's rows, or nav_msgs/Path as YAML or JSON; a disc's may be "
            "x, y alone.",
            options.InputFile(),
        ),
    ],
    robot: options.RobotOption = None,
    repair: Annotated[
        Path | None,
        option(options.PATH_FILE, "Write the path with its colliding parts replanned, in a format of plan's --output."),
    ] = None,
    time_limit: Annotated[float, option(options.SECONDS, "Planning time for each part replanned by --repair.")] = 1.0,
    seed: options.SeedOption = 0,
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
    drive: options.DriveOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    clearance: options.ClearanceOption = None,
    unknown: options.UnknownOption = None,
    keepout: options.KeepoutOption = None,
) -> None:
    """Check a path of any planner for collisions, clearance and drivability.

    The whole motion is checked continuously, not at samples. Exit status: 0 collision-free, or repaired; 5 the path
    collides or the robot cannot drive it; 2 bad input.
    """
    from trailmark.formats.any_path import read_any_path
    from trailmark.formats.path_files import write_path

    with console.progress("loading") as progress:
        given = options.RobotOptions(robot, turning_radius, forward_only, drive)
        inputs = [path] if keepout is None else [path, keepout]
        loaded, body = given.load(world, (plot, repair), inputs, keepout, unknown)
        found = read_any_path(path)
        if found.headings > 2.0 * math.pi:
            console.warn(f"{path}: headings of up to {found.headings:g} are taken as radians; are they in degrees?")

        from trailmark.collision import StateChecker
        from trailmark.errors import ConfigurationError, FormatError
        from trailmark.shapes import Disc
        from trailmark.verify import PathAuditor

        progress.stage("checking (compiles on first use)")
        if found.positions_only and not isinstance(body.footprint, Disc):
            raise FormatError(path, f"expected headings, for the robot ({body.describe()}) is no disc; got x, y alone")
        auditor = PathAuditor(StateChecker(loaded, body))
        recorded = recorded_path(found, path)
        try:
            audit = auditor.audit(recorded)
        except ConfigurationError as error:
            raise FormatError(path, str(error)) from None
        # What another drive does may cost less than this robot's bound.
        lower_bound = None if audit.undrivable else _lower_bound(auditor, audit)
        record = audit.to_dict(loaded.name) | {"lower_bound": lower_bound}
        if clearance is not None:
            record |= {"clearance": clearance, "keeps_clearance": audit.min_clearance >= clearance}
        fixed, final = None, audit
        if repair is not None:
            progress.stage("repairing")
            fixed, problem = _repaired(auditor, audit, seed, time_limit)
            if fixed is None:
                console.not_written(repair, problem)
                repair = None
            else:
                write_path(repair, fixed)
                final = auditor.audit(fixed)
        if plot is not None:
            from trailmark.plotting import save_audit_figure

            progress.stage("drawing")
            save_audit_figure(plot, loaded, body, audit, fixed)

    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, audit, body, [repair, plot])
    near = clearance is not None and final.min_clearance < clearance
    raise typer.Exit(WRONG if near or not final.free or final.undrivable else 0)


def recorded_path(found: PathFile, file: Path) -> RobotPath:
    """Return what a path file describes: a :class:`~trailmark.CurvePath` if it records curves, else its states.

    Curves count as long as the states beside them are theirs: who edits the states wants those.

    Raises:
        FormatError: curves that are none.
    """
    import numpy as np

    from trailmark.arguments import brief, real
    from trailmark.curves import Steering
    from trailmark.errors import FormatError, TrailmarkError
    from trailmark.trajectories import CurvePath
    from trailmark.trajectories import Path as RobotPath
    from trailmark.world.robot import TURNING_LIMIT

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
    from trailmark.proofs.bound import LowerBound

    ends = audit.path.states[[0, -1]]
    if not auditor.checker.valid(ends).all():
        return None
    bound = LowerBound(auditor.checker.world, auditor.checker.robot).of(ends[0], ends[1], limit=audit.cost).cost
    return bound if bound < math.inf else None


def _repaired(auditor: PathAuditor, audit: PathAudit, seed: int, limit: float) -> tuple[RobotPath | None, str]:
    """Return the repaired path, or None and why there is none."""
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
        return None, f"{error}"
    return path, f"no way past a collision was found within {limit:g} s for each part (--time-limit)"


def _print_summary(record: dict[str, Any], audit: PathAudit, robot: Robot, written: list[Path | None]) -> None:
    undrivable, bound = audit.undrivable or (), record["lower_bound"]
    verdict = "free" if audit.free else "the path collides"
    if undrivable:
        verdict += ", but not drivable" if audit.free else ", and is not drivable"
    if record.get("keeps_clearance") is False and audit.free:
        verdict += f", but nearer than {record['clearance']:g} m"
    facts = [("collision", _collision(hit)) for hit in audit.collisions[:SHOWN]]
    facts += [("", f"and {len(audit.collisions) - SHOWN:,} more")] * (len(audit.collisions) > SHOWN)
    for m in undrivable[:SHOWN]:
        facts.append(("undrivable", f"motion {m.motion}, {m.begin:.4f} to {m.end:.4f} m along: {m.why}"))
    facts += [("", f"and {len(undrivable) - SHOWN:,} more")] * (len(undrivable) > SHOWN)
    if audit.free:
        facts.append(("clearance", f"minimum {audit.min_clearance:.6f} m, {audit.min_clearance_at:.4f} m along"))
    # A polygon through states on a car's curve is shorter than that.
    above = bool(bound) and audit.free and audit.cost >= bound
    gap = f" ({100.0 * (audit.cost / bound - 1.0):.1f} % above the lower bound {bound:.4f})" if above else ""
    facts += [
        ("cost", f"{audit.cost:.4f}{gap}"),
        ("length", f"{audit.length:.4f} m"),
        ("rotation", f"{audit.rotation:.4f} rad ({math.degrees(audit.rotation):.0f}°)"),
        ("curvature", _curvature(audit.max_curvature, robot.turning_radius)),
    ]
    if audit.direction_changes is not None:
        reverse = f"{audit.reverse_length:.4f} m in reverse"
        facts.append(("driving", f"{console.plural(audit.direction_changes, 'change')} of direction, {reverse}"))
    colour = "green" if audit.free and not undrivable else "red"
    console.show(f"{record['world']}: {verdict}", facts, written, colour)


def _collision(hit: Collision) -> str:
    name = str(hit.obstacle)
    if name not in ("bounds", "boundary") and not name.startswith(("keep-out zone ", "one-way zone ")):
        name = f"obstacle {name}"
    return f"{hit.begin:.4f} to {hit.end:.4f} m along: {name}, {hit.depth:.4g} m deep"


def _curvature(largest: float, radius: float | None) -> str:
    """Return the path's largest curvature, compared to the robot's turning radius."""
    text = f"{largest:.4g} 1/m at most" if largest < math.inf else "turns in place"
    if 0.0 < largest < math.inf:
        text += f" (radius {1.0 / largest:.4g} m)"
    if radius is not None:
        fits = largest * radius <= 1.0 + SLACK
        text += f"; the robot's turning radius is {radius:g} m: {'it can follow' if fits else 'too tight for it'}"
    return text
