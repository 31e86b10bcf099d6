"""``trailmark roadmap``: landmarks over all free space and the certified motions between them, as a file."""

from __future__ import annotations

from pathlib import Path
from time import perf_counter
from typing import Annotated

from trailmark.cli import console, options
from trailmark.cli.options import option

__all__ = ["roadmap"]

ROADMAP_FILE = options.OutputFile(".geojson", ".graphml", ".npz")


def roadmap(
    world: options.WorldArgument,
    output: Annotated[
        Path,
        option(
            ROADMAP_FILE,
            "The file to write: .geojson (nav2's route server), .graphml (networkx) or .npz (Roadmap.load).",
        ),
    ],
    count: Annotated[int, option(options.LANDMARKS, "Number of landmarks.", "-k")] = 200,
    robot: options.RobotOption = None,
    seed: options.SeedOption = 0,
    frame_id: Annotated[str, option(options.FRAME, "Coordinate frame named in GeoJSON.")] = "map",
    as_json: options.JsonOption = False,
    drive: options.DriveOption = None,
    turning_radius: options.TurningRadiusOption = None,
    forward_only: options.ForwardOnlyOption = False,
    clearance: options.ClearanceOption = None,
    unknown: options.UnknownOption = None,
    keepout: options.KeepoutOption = None,
) -> None:
    """Write a roadmap of landmarks and certified motions over all free space.

    GeoJSON, for nav2's route server, holds the certified motions only, in each direction that may be driven.
    """
    begun = perf_counter()
    with console.progress("loading") as progress:
        given = options.RobotOptions(robot, turning_radius, forward_only, drive)
        loaded, body = given.load(world, [output], [keepout] if keepout else [], keepout, unknown)

        from trailmark import LandmarkPlanner

        progress.stage("preparing (compiles on first use)")
        planner = LandmarkPlanner(loaded, body, seed=seed, clearance=clearance)
        progress.stage("placing landmarks")
        built = planner.build(count)
        progress.stage("certifying")
        built.certify_all()
        progress.stage("writing")
        built.save(output, frame_id)
    edges, seconds = int(built.certified.sum()), perf_counter() - begun
    if as_json:
        record = {"world": loaded.name, "robot": body.describe(), "landmarks": len(built), "edges": edges}
        console.say(console.json_text(record | {"seed": seed, "time": seconds}))
        return
    facts = [("robot", body.describe()), ("seed", f"{seed}"), ("time", f"{seconds:.3f} s")]
    console.show(f"{loaded.name}: {len(built):,} landmarks, {edges:,} certified edges", facts, [output])
