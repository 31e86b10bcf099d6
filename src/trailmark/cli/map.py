"""``trailmark map``: a robot's log becomes a world file that can be planned in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.options import JsonOption, OutputFile, PlotOption, Pose, RobotSpec, UsageError, flag, option

if TYPE_CHECKING:
    from trailmark.estimation.mapping import MappedLog

__all__ = ["map_log"]

ROBOT: Any = "disc:0.2"

NOT_CERTIFIED = 3
"""Exit status: --confidence for a map whose estimates are not to be relied on."""

LOG_SETTINGS = ("corrected", "scan_topic", "odometry_topic")
"""What a settings file may say under ``log``, for :func:`trailmark.estimation.load_log`."""

FRAMES = {
    "start": "relative to the start: errors of where the map lies count",
    "map": "relative to the map itself: for a robot that localises on it",
}


def map_log(
    log: Annotated[
        str,
        options.argument(
            "LOG",
            "trailmark JSON Lines, an MRCLAM folder (FOLDER:N for robot N), a CARMEN log, victoria_park.txt, a "
            "g2o graph, or a ROS bag; text may be gzipped.",
        ),
    ],
    output: Annotated[Path, option(OutputFile(".yaml", ".yml", metavar="WORLD.yaml"), "The world file to write.")],
    form: Annotated[
        str | None,
        option(options.NAME, "jsonl, mrclam, carmen, victoria, g2o or rosbag; default: by the content.", "--format"),
    ] = None,
    confidence: Annotated[
        float | None,
        option(
            options.PROBABILITY,
            "Grow the obstacles so that a valid path is free of collision with probability P; default: not grown.",
        ),
    ] = None,
    even_if_uncertain: Annotated[
        bool,
        typer.Option(
            "--force", "--even-if-uncertain", help="Grow obstacles for --confidence even if the map is not certified."
        ),
    ] = False,
    robot: Annotated[
        RobotSpec, option(options.ROBOT, "The world's robot: disc:RADIUS, rectangle:LENGTHxWIDTH or polygon:x,y;…")
    ] = ROBOT,
    plot: PlotOption = None,
    trajectory: Annotated[
        Path | None,
        option(
            OutputFile(".tum", ".txt", metavar="FILE.tum"),
            "Write the robot's trajectory: rows t x y 0 0 0 qz qw, as evo reads them.",
        ),
    ] = None,
    nav2: Annotated[
        Path | None,
        option(
            OutputFile(".yaml", ".yml", metavar="MAP.yaml"),
            "Also write the map for nav2: MAP.yaml, and MAP.pgm beside it.",
        ),
    ] = None,
    as_json: JsonOption = False,
    skip_bad: Annotated[bool, flag("--skip-bad", "Skip bad records and count them.")] = False,
    poses: Annotated[
        str | None,
        option(
            options.Kind("FROM"),
            "Source of the poses: match (scan matching), slam (EKF-SLAM), log (poses in the log), odometry (drifts), "
            "or auto (default: chosen by the log's content).",
        ),
    ] = None,
    start: Annotated[
        Pose | None, option(options.POSE, "First pose of the robot; default: from the log, else 0,0,0.")
    ] = None,
    frame: Annotated[
        str | None,
        option(
            options.NAME,
            "Reference of the covariances of detected obstacles: start (the first pose; default with --start), or map "
            "(for a robot that localises on these obstacles).",
        ),
    ] = None,
    settings: Annotated[
        Path | None,
        option(options.SETTINGS, "Settings (noise, association, radius, …), in lines 'name: value': see MapSettings."),
    ] = None,
) -> None:
    """Turn a sensor log into a world: detections become discs, laser scans walls, discs and groups of cells.

    The obstacles keep their covariances. 'trailmark plan' reads the written file.
    """
    image = None if nav2 is None else OutputFile(".pgm")(str(nav2.with_suffix(".pgm")), "--nav2")
    outputs = {"world": output, "plot": plot, "trajectory": trajectory, "nav2": nav2}

    with console.progress("reading") as progress:
        from trailmark.errors import FormatError, TrailmarkError
        from trailmark.estimation.errors import NotCertifiedError
        from trailmark.estimation.map_settings import MapSettings
        from trailmark.estimation.mapping import map_log as map_records
        from trailmark.estimation.readers import load_log, log_files
        from trailmark.formats.nav2_map import save_nav2_map
        from trailmark.formats.path_files import write_tum
        from trailmark.formats.settings_yaml import read_settings

        inputs = (*log_files(log), *robot.files, *(() if settings is None else (settings,)))
        options.protect_inputs(inputs, *outputs.values(), image)
        chosen, more = MapSettings(), dict[str, Any]()
        if settings is not None:
            chosen, more = read_settings(settings, chosen, {"log": LOG_SETTINGS})
        given: dict[str, Any] = {"poses": poses, "start": start, "frame": frame}
        chosen = replace(chosen, **{name: value for name, value in given.items() if value is not None})
        if chosen.robot_sigma is not None and confidence is None:
            raise UsageError("settings: robot_sigma given without --confidence, allowed: both")
        read = load_log(log, form, skip_bad, **more.get("log", {}))

        def follow(what: str, done: int, total: int) -> None:
            progress.done, progress.unit = (done, total), f" {what}"

        progress.stage("mapping")
        try:
            asked: Any = {"robot": robot.robot, "confidence": confidence, "even_if_uncertain": even_if_uncertain}
            mapped = map_records(read, chosen, on_progress=follow, **asked)
        except NotCertifiedError as error:
            for file in filter(None, outputs.values()):
                console.not_written(file, f"{error}; --force grows the obstacles all the same")
            raise typer.Exit(NOT_CERTIFIED) from None
        except TrailmarkError as error:
            raise FormatError(log, str(error)) from None
        progress.stage("writing")
        if plot is not None:
            from trailmark.plotting.mapped import save_map_figure

            save_map_figure(plot, mapped)
        mapped.world.save(output)
        if trajectory is not None:
            write_tum(trajectory, mapped.trajectory)
        if nav2 is not None:
            side = chosen.mapping.cell_side(read.cell) if mapped.scans is None else mapped.scans.grid.cell
            save_nav2_map(mapped.world, nav2, side)

    if read.dropped:
        console.tell(f"{console.plural(read.dropped, 'bad record')} left out of {log}")
    for warning in mapped.warnings:
        console.warn(warning)
    if as_json:
        files = {name: None if file is None else str(file) for name, file in outputs.items()}
        record = {"log": log, **mapped.figures(), "robot": robot.robot.describe(), "written": files}
        console.say(console.json_text(record))
    else:
        _print_summary(mapped, mapped.figures(), [output, plot, trajectory, nav2, image])


def _print_summary(mapped: MappedLog, found: dict[str, Any], written: list[Path | None]) -> None:
    """Print the map's figures as a table."""
    obstacles, features, nis, batch, seconds = (found[x] for x in ("obstacles", "features", "nis", "batch", "time"))
    risk, dropped = found["risk"], found["dropped"]
    records = _counted(found["records"], *(name for name in found["records"] if name != "all"))
    left_out = f"; {console.plural(dropped, 'bad record')} left out" if dropped else ""
    tentative = f", {features['tentative']:,} tentative" if features["tentative"] else ""
    facts = [
        ("records", f"{found['records']['all']:,} ({records}){left_out}"),
        ("poses", _poses_text(mapped, found)),
        ("features", f"{features['confirmed']:,} confirmed, {features['dropped']:,} dropped{tentative}"),
    ]
    if nis is not None:
        where = "in" if nis["inside"] else "below" if nis["mean"] < nis["low"] else "above"
        band = f"expected {nis['expected']:.3f}, {where} its 95 % χ² band {nis['low']:.3f}..{nis['high']:.3f}"
        facts.append(("NIS", f"{nis['mean']:.3f} over {console.plural(nis['updates'], 'update')} ({band})"))
    if batch is not None:
        noise = "estimated from the log" if batch["fitted"] else "as stated"
        facts.append(("batch", f"all poses smoothed over {batch['readings']:,} readings; noise {noise}"))
    each = "-" if seconds["per_update"] is None else f"{1e3 * seconds['per_update']:.3g} ms"
    if found["matching"] and found["matching"]["revisits"]:
        facts.append(("revisits", _revisits_text(found["matching"]["revisits"])))
    facts += [
        ("time", f"{each} per {'update' if mapped.scans is None else 'scan'}, {seconds['total']:.2f} s in all"),
        ("obstacles", _counted(obstacles, "discs", "walls", "heaps", "unknown")),
        ("bounds", " ".join(f"{value:g}" for value in found["bounds"])),
        ("queries", ", ".join(found["queries"]) or "none"),
        (
            "risk",
            "none stated: the obstacles stand as they were measured (--confidence grows them)"
            if risk is None
            else f"a valid path meets an obstacle with probability {risk['collision_at_most']:.4g} at most",
        ),
    ]
    facts += [("covariances", FRAMES[obstacles["frame"]])] if "frame" in obstacles else []
    facts += [("not certified", found["not_certified"])] if found["not_certified"] else []
    facts += [("note", text) for text in found["notes"]]
    console.show(f"{found['name']}: {console.plural(obstacles['all'], 'obstacle')}", facts, written, "green")


def _counted(counts: dict[str, Any], *names: str) -> str:
    """Return those counts that are not zero, with their names."""
    return ", ".join(f"{counts[name]:,} {name.replace('_', ' ')}" for name in names if counts.get(name))


def _poses_text(mapped: MappedLog, found: dict[str, Any]) -> str:
    matching = {"nodes": 0, "closures": 0, "rejected": 0, **(found["matching"] or {})}
    source = {
        "match": "{nodes:,} scans matched, {closures:,} loop closures, {rejected:,} rejected".format_map(matching),
        "slam": f"EKF-SLAM, association {mapped.association}",
        "log": "as the log states them",
        "odometry": "odometry alone",
    }[mapped.poses]
    names = ("outliers", "repeated", "ambiguous", "unidentified", "cut_short")
    ignored = _counted(found["counts"] or {}, *names)
    return f"{source}; {found['trajectory']['length']:,.1f} m driven" + (f"; {ignored}" if ignored else "")


def _revisits_text(revisits: dict[str, Any]) -> str:
    """Return how scans agree with what was seen of their places long before."""
    if not revisits["scans"]:
        return "none to judge the map by"
    return f"nine scans in ten contradict what was seen there before with {revisits['off']:.0%} of their beams at most"
