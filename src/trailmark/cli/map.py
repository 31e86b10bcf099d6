"""``trailmark map``: a robot's log becomes a world file that can be planned in."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from trailmark.cli import console
from trailmark.cli.map_settings import read_probability, settings_of
from trailmark.cli.map_summary import plural, print_summary
from trailmark.cli.options import (
    PICTURE_SUFFIXES,
    JsonOption,
    PlotOption,
    UsageError,
    output_file,
    protect_inputs,
    read_count,
    read_robot,
    robot_file,
)

__all__ = ["map_log"]

WORLD_SUFFIXES = (".yaml", ".yml")
TRAJECTORY_SUFFIXES = (".tum", ".txt")
ROBOT = "disc:0.2"

NOT_CERTIFIED = 3
"""Exit status: --confidence for a map whose estimates are not to be relied on."""

_NOISE = "Noise and mapping"
_LOG = "Log"


def _option(name: str, metavar: str, text: str, panel: str | None = None) -> Any:
    return typer.Option(name, metavar=metavar, help=text, show_default=False, rich_help_panel=panel)


def map_log(
    log: Annotated[
        str,
        typer.Argument(
            metavar="LOG",
            show_default=False,
            help="trailmark JSON Lines, an MRCLAM folder (FOLDER:N for robot N), a CARMEN log, victoria_park.txt, a "
            "g2o graph, or a ROS bag; text may be gzipped.",
        ),
    ],
    output: Annotated[str, _option("--output", "WORLD.yaml", "The world file to write.")],
    form: Annotated[
        str | None,
        _option("--format", "NAME", "jsonl, mrclam, carmen, victoria, g2o or rosbag; default: by the content."),
    ] = None,
    confidence: Annotated[
        str | None,
        _option(
            "--confidence",
            "P",
            "Grow the obstacles so that a valid path meets none with probability P; default: as measured.",
        ),
    ] = None,
    even_if_uncertain: Annotated[
        bool, typer.Option("--even-if-uncertain", help="Grow them by --confidence though the map is not certified.")
    ] = False,
    robot: Annotated[
        str,
        typer.Option(
            "--robot", metavar="SHAPE", help="Stored in the world: disc:RADIUS, rectangle:LENGTHxWIDTH or polygon:x,y;…"
        ),
    ] = ROBOT,
    plot: PlotOption = None,
    trajectory: Annotated[
        str | None, _option("--trajectory", "FILE.tum", "Write where the robot was: rows t x y 0 0 0 qz qw, for evo.")
    ] = None,
    nav2: Annotated[
        str | None, _option("--nav2", "MAP.yaml", "Write the map for nav2 too: MAP.yaml and MAP.pgm beside it.")
    ] = None,
    graph: Annotated[
        str | None, _option("--graph", "FILE.g2o", "Write the graph of matched scans (--poses match).")
    ] = None,
    as_json: JsonOption = False,
    skip_bad: Annotated[
        bool, typer.Option("--skip-bad", help="Leave out bad records, and say how many.", rich_help_panel=_LOG)
    ] = False,
    mrclam_robot: Annotated[
        str | None, _option("--mrclam-robot", "N", "Which robot of an MRCLAM folder.", _LOG)
    ] = None,
    corrected: Annotated[
        bool,
        typer.Option(
            "--corrected", help="A CARMEN log's poses are corrected, though it does not look so.", rich_help_panel=_LOG
        ),
    ] = False,
    scan_topic: Annotated[str | None, _option("--scan-topic", "NAME", "Of a bag with several.", _LOG)] = None,
    odometry_topic: Annotated[str | None, _option("--odometry-topic", "NAME", "Of a bag with several.", _LOG)] = None,
    obstacles: Annotated[
        str, typer.Option("--obstacles", metavar="FROM", help="auto, detections or scans (preferred).")
    ] = "auto",
    poses: Annotated[
        str,
        typer.Option(
            "--poses",
            metavar="FROM",
            help="auto, match (scans), slam (EKF), log (as it states them), or odometry (it drifts).",
        ),
    ] = "auto",
    association: Annotated[
        str,
        typer.Option(
            "--association", metavar="NAME", help="auto, known (identities), nearest, or joint (compatibility)."
        ),
    ] = "auto",
    radius: Annotated[
        str,
        typer.Option(
            "--radius", metavar="R[,SIGMA]", help="Radius of what was detected and its standard deviation, metres."
        ),
    ] = "0.1",
    start: Annotated[
        str | None, _option("--start", "X,Y,T", "Where the robot stood first; default: as the log says, or 0,0,0.")
    ] = None,
    frame: Annotated[
        str | None,
        _option(
            "--frame",
            "NAME",
            "What covariances of detected obstacles are relative to: start (default with --start), or map, for a robot "
            "that localises on them.",
        ),
    ] = None,
    sensor_noise: Annotated[
        str | None,
        _option(
            "--sensor-noise",
            "A,B",
            "Standard deviations of detections, in place of those in the log: range and bearing (m, rad), or x and y.",
            _NOISE,
        ),
    ] = None,
    odometry_noise: Annotated[
        str | None,
        _option(
            "--odometry-noise",
            "A,B",
            "Standard deviations of odometry, in place of those in the log: of velocities over a second (m/s, rad/s), "
            "of increments over a metre (m, rad).",
            _NOISE,
        ),
    ] = None,
    pose_noise: Annotated[
        str | None,
        _option("--pose-noise", "XY,THETA", "Standard deviations of the log's poses; default: 0.02,0.005.", _NOISE),
    ] = None,
    scan_noise: Annotated[
        str | None,
        _option("--scan-noise", "RANGE,BEARING", "Standard deviations of beams; default: 0.02,0.003.", _NOISE),
    ] = None,
    robot_noise: Annotated[
        str | None,
        _option(
            "--robot-noise",
            "XY,THETA",
            "Standard deviations of the pose of the robot that will drive; --confidence makes room for them.",
            _NOISE,
        ),
    ] = None,
    confirm: Annotated[
        str | None,
        _option("--confirm", "N", "Readings (scans) that confirm a feature; default: 5 (3).", _NOISE),
    ] = None,
    outlier_gate: Annotated[
        str,
        typer.Option(
            "--outlier-gate",
            metavar="P",
            help="Probability that a good reading of known identity passes; none; or auto.",
            rich_help_panel=_NOISE,
        ),
    ] = "auto",
    fit_noise: Annotated[
        str,
        typer.Option(
            "--fit-noise",
            metavar="WHEN",
            help="Estimate the noise and systematic errors of odometry and detections: auto (where what is stated does "
            "not fit), on, or off.",
            rich_help_panel=_NOISE,
        ),
    ] = "auto",
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth/--no-smooth",
            help="Whether a batch over the whole log follows the filter of detections.",
            rich_help_panel=_NOISE,
        ),
    ] = True,
    unknown: Annotated[
        str,
        typer.Option(
            "--unknown", metavar="HOW", help="What no beam looked into: blocked or free.", rich_help_panel=_NOISE
        ),
    ] = "blocked",
    cell: Annotated[
        str | None,
        typer.Option(
            "--cell",
            metavar="METRES",
            help="Side of a scan map's cells; by default 0.05, or what the log of an exploration says if that is more.",
            rich_help_panel=_NOISE,
        ),
    ] = None,
    shapes: Annotated[
        str,
        typer.Option(
            "--shapes",
            metavar="KIND",
            help="What scans become: fitted (walls, discs, heaps), hulls, or boxes (plain ones).",
        ),
    ] = "fitted",
    pose_memory: Annotated[
        str | None,
        _option(
            "--pose-memory",
            "METRES",
            "Way after which errors of the log's poses are others, so that they average out; default: never.",
            _NOISE,
        ),
    ] = None,
    scan_range: Annotated[
        str | None,
        _option("--scan-range", "METRES", "Leave out what beams met farther away; default: nothing.", _NOISE),
    ] = None,
) -> None:
    """Turn a sensor log into a world: what was detected becomes discs, what lasers scanned walls, discs and heaps.

    The obstacles keep their covariances. The file goes straight into 'trailmark plan'.
    """
    probability = None if confidence is None else read_probability(confidence, "--confidence")
    number = None if mrclam_robot is None else read_count(mrclam_robot, "--mrclam-robot", 0)
    body = read_robot(robot)
    world_file = output_file(output, WORLD_SUFFIXES)
    picture = output_file(plot, PICTURE_SUFFIXES)
    tum_file, g2o_file = output_file(trajectory, TRAJECTORY_SUFFIXES), output_file(graph, (".g2o",))
    nav2_file = output_file(nav2, WORLD_SUFFIXES)
    image_file = None if nav2_file is None else output_file(str(nav2_file.with_suffix(".pgm")), (".pgm",))

    with console.progress("reading") as progress:
        from trailmark.errors import FormatError, TrailmarkError
        from trailmark.estimation.errors import NotCertifiedError
        from trailmark.estimation.graph.g2o import write_g2o
        from trailmark.estimation.logs import load_log, log_files
        from trailmark.estimation.maps.log_map import map_log as map_records
        from trailmark.formats.nav2_map import save_nav2_map
        from trailmark.formats.path_files import write_tum

        protect_inputs(
            (*log_files(log), *robot_file(robot)), world_file, picture, tum_file, g2o_file, nav2_file, image_file
        )
        if nav2_file is not None and nav2_file == world_file:
            raise UsageError(f"expected another file than --output for --nav2, got {nav2!r} twice")
        settings = settings_of(
            obstacles=obstacles,
            poses=poses,
            association=association,
            radius=radius,
            start=start,
            frame=frame,
            sensor_noise=sensor_noise,
            odometry_noise=odometry_noise,
            pose_noise=pose_noise,
            scan_noise=scan_noise,
            robot_noise=robot_noise,
            confirm=confirm,
            outlier_gate=outlier_gate,
            fit_noise=fit_noise,
            smooth=smooth,
            unknown=unknown,
            cell=cell,
            shapes=shapes,
            pose_memory=pose_memory,
            scan_range=scan_range,
        )
        if settings.robot_sigma is not None and probability is None:
            raise UsageError(f"--robot-noise {robot_noise!r} given without --confidence, allowed: both")
        read = load_log(
            log,
            form,
            skip_bad,
            robot=number,
            corrected=corrected or None,
            scan_topic=scan_topic,
            odometry_topic=odometry_topic,
        )
        progress.stage("mapping")

        def follow(what: str, done: int, total: int) -> None:
            progress.details = (_bar(done, total), f"{done:,} of {total:,} {what}")

        refused = None
        try:
            mapped = map_records(
                read,
                settings,
                robot=body,
                confidence=probability,
                even_if_uncertain=even_if_uncertain,
                on_progress=follow,
            )
        except NotCertifiedError as error:
            refused = str(error)
        except TrailmarkError as error:
            raise FormatError(log, str(error)) from None
        if refused is not None:
            typer.echo(f"trailmark: {refused}; --even-if-uncertain grows the obstacles all the same", err=True)
            raise typer.Exit(NOT_CERTIFIED)
        progress.stage("writing")
        written = [world_file] if world_file is not None else []
        if picture is not None:
            from trailmark.plotting.mapped import save_map_figure

            progress.stage("drawing")
            save_map_figure(picture, mapped)
            written.append(picture)
        if world_file is not None:
            mapped.world.save(world_file)
        if tum_file is not None:
            write_tum(tum_file, mapped.trajectory)
            written.append(tum_file)
        if nav2_file is not None:
            side = settings.mapping.cell_side(read.cell) if mapped.scans is None else mapped.scans.grid.cell
            written += save_nav2_map(mapped.world, nav2_file, side)
        if g2o_file is not None:
            if mapped.matched is None:
                raise UsageError(f"--graph {graph!r} given with poses by {mapped.poses}, allowed: --poses match")
            write_g2o(g2o_file, mapped.trajectory[mapped.matched.keys, 1:], mapped.matched.relations)
            written.append(g2o_file)

    if read.dropped:
        typer.echo(f"trailmark: {plural(read.dropped, 'bad record')} left out of {log}", err=True)
    for warning in mapped.warnings:
        console.warn(warning)
    if as_json:
        files = {"world": output, "plot": plot, "trajectory": trajectory, "nav2": nav2, "graph": graph}
        record = {"log": log, **mapped.figures(), "robot": body and body.describe(), "written": files}
        console.say(console.json_text(record))
    else:
        print_summary(mapped, read, skip_bad, written)


def _bar(done: int, total: int, width: int = 24) -> str:
    full = width * done // max(1, total)
    return f"{'━' * full}{'╌' * (width - full)} {100 * done // max(1, total)} %"
