"""``trailmark worlds``: list the shipped worlds; show, draw and convert any world."""

from __future__ import annotations

import json
from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console
from trailmark.cli.masks import KeepoutOption, SpeedMaskOption, with_masks
from trailmark.cli.options import (
    PICTURE_SUFFIXES,
    JsonOption,
    PlotOption,
    RobotOption,
    WorldArgument,
    load_world,
    output_file,
    protect_inputs,
    read_robot,
    robot_file,
)

if TYPE_CHECKING:
    from trailmark.world import World

__all__ = ["app"]

app = typer.Typer(help="List the shipped worlds; show, draw and convert any world.", invoke_without_command=True)


@app.callback()
def list_worlds(context: typer.Context, as_json: JsonOption = False) -> None:
    """List the worlds that ship; show, draw and convert any world."""
    if context.invoked_subcommand is not None:
        return
    from trailmark import library
    from trailmark.world import World

    with console.progress("loading the worlds"):
        facts = [_facts(World.load(file)) | {"name": name} for name, file in sorted(library.shipped_worlds().items())]
    if as_json:
        console.say(console.json_text({"worlds": facts}))
        return
    rows = [["NAME", "SIZE", "OBSTACLES", "QUERIES", "ROBOT"]]
    rows += [[f["name"], _size(f), f"{f['obstacles']}", f"{len(f['queries'])}", f["robot"] or "-"] for f in facts]
    console.print_table(rows)


@app.command("show")
def show(
    world: WorldArgument,
    robot: RobotOption = None,
    keepout: KeepoutOption = None,
    speed_mask: SpeedMaskOption = None,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Say what a world holds; --plot draws it."""
    picture = output_file(plot, PICTURE_SUFFIXES)
    with console.progress("loading") as progress:
        loaded = with_masks(_load(world, robot), keepout, speed_mask)
        protect_inputs((*loaded.sources, *robot_file(robot)), picture)
        if picture is not None:
            from trailmark.plotting import save_world_figure

            progress.stage("drawing")
            save_world_figure(picture, loaded)
    facts = _facts(loaded)
    if as_json:
        console.say(console.json_text(facts))
        return
    console.say(loaded.name, bold=True)
    kinds = ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in sorted(facts["kinds"].items()))
    names = [query["name"] for query in facts["queries"]]
    xmin, ymin, xmax, ymax = loaded.bounds
    rows = [
        ("bounds", f"x {xmin:g} to {xmax:g}, y {ymin:g} to {ymax:g} ({_size(facts)})"),
        ("boundary", f"polygon of {len(loaded.boundary.vertices)} vertices" if loaded.boundary else "none"),
        ("obstacles", f"{facts['obstacles']:,}" + (f" ({kinds})" if kinds else "")),
        ("robot", facts["robot"] or "none"),
        (
            "queries",
            f"{len(names):,}" + (f" ({', '.join(names[:8])}{', …' if len(names) > 8 else ''})" if names else ""),
        ),
    ]
    if loaded.zones:
        zones = ", ".join(f"{n} {kind}" for kind, n in sorted(facts["zones"].items()))
        rows.insert(3, ("zones", f"{len(loaded.zones):,} ({zones})"))
    if picture is not None:
        rows.append(("written", str(picture)))
    console.print_table(rows, indent="  ")


@app.command("convert")
def convert(
    world: Annotated[
        str, typer.Argument(metavar="IN", help="A world in any format that plan reads.", show_default=False)
    ],
    output: Annotated[str, typer.Argument(metavar="OUT", help="The trailmark YAML file to write.", show_default=False)],
    robot: RobotOption = None,
    keepout: KeepoutOption = None,
    speed_mask: SpeedMaskOption = None,
) -> None:
    """Write a world of any format as trailmark YAML."""
    file = output_file(output, (".yaml", ".yml"))
    assert file is not None  # noqa: S101  # only an option that is not given has none
    with console.progress("converting"):
        loaded = with_masks(_load(world, robot), keepout, speed_mask)
        protect_inputs((*loaded.sources, *robot_file(robot)), file)
        loaded.save(file)
    console.note(f"{file}: {len(loaded.obstacles):,} obstacles, {len(loaded.queries):,} queries")


@app.command("schema")
def schema() -> None:
    """Print the JSON Schema of world files, by which editors complete and check them."""
    from trailmark.formats import world_json_schema

    console.say(json.dumps(world_json_schema(), indent=2))


def _load(text: str, robot: str | None) -> World:
    given = read_robot(robot)
    world = load_world(text)
    return world if given is None else world.with_robot(given)


def _facts(world: World) -> dict[str, Any]:
    return {
        "name": world.name,
        "bounds": list(world.bounds),
        "boundary": world.boundary is not None,
        "obstacles": len(world.obstacles),
        "kinds": dict(Counter(type(shape).__name__.lower() for shape in world.obstacles)),
        "zones": dict(Counter(zone.kind for zone in world.zones)),
        "robot": world.robot.describe() if world.robot else None,
        "queries": [query.to_dict() for query in world.queries],
    }


def _size(facts: dict[str, Any]) -> str:
    xmin, ymin, xmax, ymax = facts["bounds"]
    return f"{xmax - xmin:g} x {ymax - ymin:g} m"
