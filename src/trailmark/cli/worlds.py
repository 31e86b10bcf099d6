"""``trailmark worlds``: list the shipped worlds; show, draw and convert any world."""

from __future__ import annotations

import json
from collections import Counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options

if TYPE_CHECKING:
    from trailmark.world import World

__all__ = ["app"]

app = typer.Typer(invoke_without_command=True)


@app.callback()
def list_worlds(context: typer.Context, as_json: options.JsonOption = False) -> None:
    """List the shipped worlds; show and convert any world."""
    if context.invoked_subcommand is not None:
        return
    from trailmark.world import World, library

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
    world: options.WorldArgument,
    robot: options.RobotOption = None,
    keepout: options.KeepoutOption = None,
    speed_mask: options.SpeedMaskOption = None,
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Show what a world contains; --plot draws it."""
    picture = options.output_file(plot, options.PICTURE_SUFFIXES)
    with console.progress("loading") as progress:
        loaded = _load(world, robot, keepout, speed_mask)
        options.protect_inputs((*loaded.sources, *options.robot_file(robot)), picture)
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
        str, typer.Argument(metavar="IN", help="World file in any format that plan reads.", show_default=False)
    ],
    output: Annotated[str, typer.Argument(metavar="OUT", help="trailmark YAML file to write.", show_default=False)],
    robot: options.RobotOption = None,
    keepout: options.KeepoutOption = None,
    speed_mask: options.SpeedMaskOption = None,
) -> None:
    """Convert a world of any format to trailmark YAML."""
    file = options.output_file(output, (".yaml", ".yml"))
    assert file is not None  # noqa: S101  # only an option that is not given has none
    with console.progress("converting"):
        loaded = _load(world, robot, keepout, speed_mask)
        options.protect_inputs((*loaded.sources, *options.robot_file(robot)), file)
        loaded.save(file)
    console.note(f"{file}: {len(loaded.obstacles):,} obstacles, {len(loaded.queries):,} queries")


@app.command("schema")
def schema() -> None:
    """Print the JSON Schema of world files, for editors."""
    from trailmark.formats import world_json_schema

    console.say(json.dumps(world_json_schema(), indent=2))


def _load(text: str, robot: str | None, keepout: str | None, speed_mask: str | None) -> World:
    given = options.read_robot(robot)
    world = options.load_world(text, keepout, speed_mask)
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
