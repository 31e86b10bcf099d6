"""``trailmark roadmap``: landmarks over all free space and the certified motions between them, as a file."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from trailmark.cli import console
from trailmark.cli.masks import KeepoutOption, SpeedMaskOption, with_masks
from trailmark.cli.options import (
    DriveOption,
    ForwardOnlyOption,
    FrameOption,
    JsonOption,
    RobotOption,
    SeedOption,
    TurningRadiusOption,
    WorldArgument,
    grown_for,
    load_world,
    option,
    output_file,
    protect_inputs,
    read_count,
    read_frame,
    read_robot,
    read_turning_radius,
    robot_file,
    robot_of,
    steered,
)

__all__ = ["roadmap"]

MAX_LANDMARKS = 200_000  # trailmark.planning.planner.MAX_LANDMARKS, which is heavy to import
SUFFIXES = (".geojson", ".graphml", ".npz")  # those of trailmark.roadmap.files


def roadmap(
    world: WorldArgument,
    output: Annotated[
        str,
        typer.Option(
            "--output",
            metavar="FILE",
            show_default=False,
            help=".geojson (for nav2's route server), .graphml (networkx and others) or .npz (numpy; Roadmap.load).",
        ),
    ],
    robot: RobotOption = None,
    keepout: KeepoutOption = None,
    speed_mask: SpeedMaskOption = None,
    turning_radius: TurningRadiusOption = None,
    forward_only: ForwardOnlyOption = False,
    drive: DriveOption = None,
    count: Annotated[str, option("-k", "K", "Number of landmarks.", default=True)] = "200",
    seed: SeedOption = "0",
    frame_id: FrameOption = "map",
    as_json: JsonOption = False,
) -> None:
    """Spread landmarks over all free space, certify the motions between them, and write the roadmap.

    GeoJSON holds certified motions only, in either direction in which they may be driven.
    """
    k, number = read_count(count, "-k", 1, MAX_LANDMARKS), read_count(seed, "--seed", 0)
    given, radius, frame = read_robot(robot), read_turning_radius(turning_radius), read_frame(frame_id)
    file = output_file(output, SUFFIXES)
    assert file is not None  # noqa: S101  # only an option that is not given has none
    with console.progress("loading") as progress:
        begun = perf_counter()
        loaded = with_masks(load_world(world), keepout, speed_mask)
        protect_inputs((*loaded.sources, *robot_file(robot)), file)
        body = steered(robot_of(loaded, given), radius, forward_only, drive)
        loaded = grown_for(loaded, body)

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
