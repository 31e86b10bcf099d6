"""``trailmark map``: a robot's log becomes a world file that can be planned in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.map_settings import read_map_settings
from trailmark.cli.options import JsonOption, OutputFile, PlotOption, Pose, RobotSpec, UsageError, flag, option

if TYPE_CHECKING:
    from trailmark.estimation.mapped_log import MappedLog
    from trailmark.estimation.records import Log

__all__ = ["map_log"]

ROBOT: Any = "disc:0.2"

NOT_CERTIFIED = 3
"""Exit status: --confidence for a map whose estimates are not to be relied on."""


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
            "Grow the obstacles so that a valid path meets none with probability P; default: as measured.",
        ),
    ] = None,
    even_if_uncertain: Annotated[
        bool, flag("--even-if-uncertain", "Grow them by --confidence though the map is not certified.")
    ] = False,
    robot: Annotated[
        RobotSpec, option(options.ROBOT, "Stored in the world: disc:RADIUS, rectangle:LENGTHxWIDTH or polygon:x,y;…")
    ] = ROBOT,
    plot: PlotOption = None,
    trajectory: Annotated[
        Path | None,
        option(
            OutputFile(".tum", ".txt", metavar="FILE.tum"),
            "Write where the robot was: rows t x y 0 0 0 qz qw, for evo.",
        ),
    ] = None,
    nav2: Annotated[
        Path | None,
        option(
            OutputFile(".yaml", ".yml", metavar="MAP.yaml"),
            "Write the map for nav2 too: MAP.yaml and MAP.pgm beside it.",
        ),
    ] = None,
    as_json: JsonOption = False,
    skip_bad: Annotated[bool, flag("--skip-bad", "Leave out bad records, and say how many.")] = False,
    poses: Annotated[
        str | None,
        option(
            options.Kind("FROM"),
            "match (scans), slam (EKF), log (as it states them), or odometry (it drifts); default: auto, by the log.",
        ),
    ] = None,
    start: Annotated[
        Pose | None, option(options.POSE, "Where the robot stood first; default: as the log says, or 0,0,0.")
    ] = None,
    frame: Annotated[
        str | None,
        option(
            options.NAME,
            "What covariances of detected obstacles are relative to: start (default with --start), or map, for a robot "
            "that localises on them.",
        ),
    ] = None,
    settings: Annotated[
        str | None,
        option(options.Kind("FILE.yaml"), "Noise, association, radius, cells, …: lines 'name: value' of MapSettings."),
    ] = None,
) -> None:
    """Turn a sensor log into a world: what was detected becomes discs, what lasers scanned walls, discs and heaps.

    The obstacles keep their covariances. The file goes straight into 'trailmark plan'.
    """
    image = None if nav2 is None else options.OutputFile(".pgm")(str(nav2.with_suffix(".pgm")), "--nav2")

    with console.progress("reading") as progress:
        from trailmark.errors import FormatError, TrailmarkError
        from trailmark.estimation.errors import NotCertifiedError
        from trailmark.estimation.mapping import map_log as map_records
        from trailmark.estimation.readers import load_log, log_files
        from trailmark.formats.nav2_map import save_nav2_map
        from trailmark.formats.path_files import write_tum

        inputs = (*log_files(log), *robot.files, *(() if settings is None else (Path(settings),)))
        options.protect_inputs(inputs, output, plot, trajectory, nav2, image)
        chosen, reading = read_map_settings(settings)
        given: dict[str, Any] = {"poses": poses, "start": start, "frame": frame}
        chosen = replace(chosen, **{name: value for name, value in given.items() if value is not None})
        if chosen.robot_sigma is not None and confidence is None:
            raise UsageError("settings: robot_sigma given without --confidence, allowed: both")
        read = load_log(log, form, skip_bad, **reading)
        progress.stage("mapping")

        def follow(what: str, done: int, total: int) -> None:
            progress.done, progress.unit = (done, total), f" {what}"

        refused = None
        try:
            mapped = map_records(
                read,
                chosen,
                robot=robot.robot,
                confidence=confidence,
                even_if_uncertain=even_if_uncertain,
                on_progress=follow,
            )
        except NotCertifiedError as error:
            refused = str(error)
        except TrailmarkError as error:
            raise FormatError(log, str(error)) from None
        if refused is not None:
            console.not_written(output, f"{refused}; --even-if-uncertain grows the obstacles all the same")
            raise typer.Exit(NOT_CERTIFIED)
        progress.stage("writing")
        written = [output]
        if plot is not None:
            from trailmark.plotting.mapped import save_map_figure

            progress.stage("drawing")
            save_map_figure(plot, mapped)
            written.append(plot)
        mapped.world.save(output)
        if trajectory is not None:
            write_tum(trajectory, mapped.trajectory)
            written.append(trajectory)
        if nav2 is not None:
            side = chosen.mapping.cell_side(read.cell) if mapped.scans is None else mapped.scans.grid.cell
            written += save_nav2_map(mapped.world, nav2, side)

    if read.dropped:
        typer.echo(f"trailmark: {console.plural(read.dropped, 'bad record')} left out of {log}", err=True)
    for warning in mapped.warnings:
        console.warn(warning)
    if as_json:
        named = {"world": output, "plot": plot, "trajectory": trajectory, "nav2": nav2}
        files = {name: None if file is None else str(file) for name, file in named.items()}
        record = {"log": log, **mapped.figures(), "robot": robot.robot.describe(), "written": files}
        console.say(console.json_text(record))
    else:
        _print_summary(mapped, read, skip_bad, written)


_FRAMES = {
    "start": "relative to the start: errors of where the map lies count",
    "map": "relative to the map itself: for a robot that localises on it",
}


def _print_summary(mapped: MappedLog, log: Log, skip_bad: bool, written: list[Path]) -> None:
    """Print the map's figures as a table."""
    found = mapped.figures()
    obstacles, features, nis = found["obstacles"], found["features"], found["nis"]
    kinds = [f"{obstacles[name]:,} {name}" for name in ("discs", "walls", "heaps", "unknown") if obstacles[name]]
    console.say(f"{found['name']}: {console.plural(obstacles['all'], 'obstacle')}", fg="green", bold=True)
    records = [f"{n:,} {name}" for name, n in found["records"].items() if n and name != "all"]
    left_out = f"; {console.plural(log.dropped, 'bad record')} left out" if skip_bad else ""
    confirmed = f"{features['confirmed']:,} confirmed, {features['dropped']:,} dropped"
    confirmed += f", {features['tentative']:,} tentative" if features["tentative"] else ""
    rows = [
        ("records", f"{found['records']['all']:,} ({', '.join(records)}){left_out}"),
        ("poses", _poses_text(mapped, found)),
        ("features", confirmed),
    ]
    if nis is not None:
        where = "in" if nis["inside"] else "below" if nis["mean"] < nis["low"] else "above"
        band = f"expected {nis['expected']:.3f}, {where} its 95 % χ² band {nis['low']:.3f}..{nis['high']:.3f}"
        rows.append(("NIS", f"{nis['mean']:.3f} over {console.plural(nis['updates'], 'update')} ({band})"))
    if found["batch"] is not None:
        rows.append(("batch", _batch_text(found["batch"])))
    seconds = found["time"]
    each = "-" if seconds["per_update"] is None else f"{1e3 * seconds['per_update']:.3g} ms"
    if found["matching"] and found["matching"]["revisits"]:
        rows.append(("revisits", _revisits_text(found["matching"]["revisits"])))
    rows += [
        ("time", f"{each} per {'update' if mapped.scans is None else 'scan'}, {seconds['total']:.2f} s in all"),
        ("obstacles", ", ".join(kinds)),
        ("bounds", " ".join(f"{value:g}" for value in found["bounds"])),
        ("queries", ", ".join(found["queries"]) or "none"),
        ("risk", _risk_text(found)),
        *((("covariances", _FRAMES[obstacles["frame"]]),) if "frame" in obstacles else ()),
        *([] if found["not_certified"] is None else [("not certified", found["not_certified"])]),
        *(("note", note) for note in found["notes"]),
        *(("written", str(file)) for file in written),
    ]
    console.print_table(rows, indent="  ")


def _poses_text(mapped: MappedLog, found: dict[str, Any]) -> str:
    way = found["trajectory"]
    matching = found["matching"] or {}
    source = {
        "match": "{nodes:,} scans matched, {closures:,} loop closures, {rejected:,} rejected".format_map(
            {"nodes": 0, "closures": 0, "rejected": 0, **matching}
        ),
        "slam": f"EKF-SLAM, association {mapped.association}",
        "log": "as the log states them",
        "odometry": "odometry alone",
    }[mapped.poses]
    counts = found["counts"] or {}
    named = ("outliers", "repeated", "ambiguous", "unidentified", "cut_short")
    ignored = [f"{counts[name]:,} {name.replace('_', ' ')}" for name in named if counts.get(name)]
    return f"{source}; {way['length']:,.1f} m driven" + (f"; {', '.join(ignored)}" if ignored else "")


def _revisits_text(revisits: dict[str, Any]) -> str:
    """Return how scans agree with what was seen of their places long before."""
    if not revisits["scans"]:
        return "none to judge the map by"
    return f"nine scans in ten contradict what was seen there before with {revisits['off']:.0%} of their beams at most"


def _batch_text(batch: dict[str, Any]) -> str:
    """Return what the batch after the filter made of the stated noise, and the systematic errors that it found."""
    text = f"all poses smoothed over {batch['readings']:,} readings"
    if not batch["fitted"]:
        return f"{text}; noise as stated"
    odometry, ranges = batch["odometry"], batch["range"]
    return (
        f"{text}; noise estimated: odometry's distances times {odometry['distance']:.3f}, turns times "
        f"{odometry['turn']:.3f}; ranges' error by the bearing's square "
        f"{ranges['projection']:+.2f}, their scale known to {100 * batch['scale']['sigma']:.1f} %"
    )


def _risk_text(found: dict[str, Any]) -> str:
    if found["risk"] is None:
        return "none stated: the obstacles stand as they were measured (--confidence grows them)"
    risk = found["risk"]
    return f"a valid path meets an obstacle with probability {risk['collision_at_most']:.4g} at most"
