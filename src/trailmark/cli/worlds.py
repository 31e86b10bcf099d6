"""``trailmark worlds``: list the shipped worlds; show, draw and convert any world."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console, options
from trailmark.cli.options import argument, option

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


def show(
    world: options.WorldArgument,
    robot: options.RobotOption = None,
    plot: options.PlotOption = None,
    as_json: options.JsonOption = False,
) -> None:
    """Show what a world contains; --plot draws it."""
    with console.progress("loading") as progress:
        loaded = _load(world, robot)
        options.protect_inputs((*loaded.sources, *(robot.files if robot else ())), plot)
        if plot is not None:
            from trailmark.plotting import save_world_figure

            progress.stage("drawing")
            save_world_figure(plot, loaded)
    facts = _facts(loaded)
    if as_json:
        console.say(console.json_text(facts))
        return
    names = [query["name"] for query in facts["queries"]]
    listed = f" ({', '.join(names[:8])}{', …' if len(names) > 8 else ''})" if names else ""
    xmin, ymin, xmax, ymax = loaded.bounds
    rows = [
        ("bounds", f"x {xmin:g} to {xmax:g}, y {ymin:g} to {ymax:g} ({_size(facts)})"),
        ("boundary", f"polygon of {len(loaded.boundary.vertices)} vertices" if loaded.boundary else "none"),
        ("obstacles", _counted({f"{kind}{'s' * (n > 1)}": n for kind, n in facts["kinds"].items()})),
        *([("zones", _counted(facts["zones"]))] if facts["zones"] else []),
        ("robot", facts["robot"] or "none"),
        ("queries", f"{len(names):,}{listed}"),
    ]
    console.show(loaded.name, rows, [plot])


def convert(
    world: Annotated[str, argument("IN", "World file in any format that plan reads.")],
    output: Annotated[Path, argument("OUT", "trailmark YAML file to write.", options.OutputFile(".yaml", ".yml"))],
    robot: options.RobotOption = None,
    keepout: Annotated[
        Path | None, option(options.ZONES, "Keep-out zones: polygons as GeoJSON or WKT, or a nav2 mask (.yaml).")
    ] = None,
    speed_mask: Annotated[
        Path | None, option(options.ZONES, "nav2 speed mask: cells become speed limits, in per cent of --max-speed.")
    ] = None,
    max_speed: Annotated[float, option(options.SPEED, "Speed that 100 % stands for.")] = 1.0,
) -> None:
    """Convert a world of any format to trailmark YAML.

    nav2's masks become zones of the world, for plan, check and all other commands.
    """
    with console.progress("converting"):
        loaded = _load(world, robot)
        if keepout is not None:
            loaded = loaded.with_mask(keepout, "keep-out")
        if speed_mask is not None:
            loaded = loaded.with_mask(speed_mask, "speed", max_speed=max_speed)
        options.protect_inputs((*loaded.sources, *(robot.files if robot else ())), output)
        loaded.save(output)
    console.note(f"{output}: {len(loaded.obstacles):,} obstacles, {len(loaded.queries):,} queries")


def schema() -> None:
    """Print the JSON Schema of world files, for editors."""
    from trailmark.formats import world_json_schema

    console.say(json.dumps(world_json_schema(), indent=2))


def _load(text: str, robot: options.RobotSpec | None) -> World:
    world = options.load_world(text)
    return world if robot is None else world.with_robot(robot.robot)


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


def _counted(kinds: dict[str, int]) -> str:
    """Return a total with its parts."""
    parts = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
    return f"{sum(kinds.values()):,}" + (f" ({parts})" if parts else "")


def _size(facts: dict[str, Any]) -> str:
    xmin, ymin, xmax, ymax = facts["bounds"]
    return f"{xmax - xmin:g} x {ymax - ymin:g} m"
