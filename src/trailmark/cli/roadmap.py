"""``trailmark roadmap``: landmarks over all free space and the certified motions between them, as a file."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.options import option

__all__ = ["roadmap"]

MAX_LANDMARKS = 200_000  # trailmark.planning.planner.MAX_LANDMARKS, which is heavy to import
SUFFIXES = (".geojson", ".graphml", ".npz")  # those of trailmark.roadmap.files


def roadmap(
    world: options.WorldArgument,
    output: Annotated[
        str,
        typer.Option(
            "--output",
            metavar="FILE",
            show_default=False,
            help="The file to write: .geojson (nav2's route server), .graphml (networkx) or .npz (Roadmap.load).",
        ),
    ],
    robot: options.RobotOption = None,
    keepout: options.KeepoutOption = None,
    speed_mask: options.SpeedMaskOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    drive: options.DriveOption = None,
    count: Annotated[str, option("-k", "K", "Number of landmarks.", default=True)] = "200",
    seed: options.SeedOption = "0",
    frame_id: options.FrameOption = "map",
    as_json: options.JsonOption = False,
) -> None:
    """Write a roadmap of landmarks and certified motions over all free space.

    GeoJSON, for nav2's route server, holds the certified motions only, in each direction that may be driven.
    """
    k, number = options.read_count(count, "-k", 1, MAX_LANDMARKS), options.read_count(seed, "--seed", 0)
    given, frame = options.RobotOptions.read(robot, turning_radius, forward_only, drive), options.read_frame(frame_id)
    file = options.output_file(output, SUFFIXES)
    assert file is not None  # noqa: S101  # only an option that is not given has none
    with console.progress("loading") as progress:
        begun = perf_counter()
        loaded = options.load_world(world, keepout, speed_mask)
        options.protect_inputs((*loaded.sources, *given.files), file)
        body = given.robot_in(loaded)
        loaded = options.grown_for(loaded, body)

        from trailmark import LandmarkPlanner

        progress.stage("preparing (compiles on first use)")
        planner = LandmarkPlanner(loaded, body, seed=number)
        progress.stage("placing landmarks")
        built = planner.build(k)
        progress.stage("certifying")
        built.certify_all()
        progress.stage("writing")
        built.save(file, frame)
    record: dict[str, Any] = {"world": loaded.name, "robot": body.describe(), "landmarks": len(built)}
    record |= {"edges": int(built.certified.sum()), "seed": number, "time": perf_counter() - begun}
    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, file)


def _print_summary(record: dict[str, Any], file: Path) -> None:
    console.say(f"{record['world']}: {record['landmarks']:,} landmarks, {record['edges']:,} certified edges", bold=True)
    rows = [("robot", record["robot"]), ("seed", str(record["seed"])), ("time", f"{record['time']:.3f} s")]
    console.print_table([*rows, ("written", str(file))], indent="  ")
