"""``trailmark explore``: a simulated robot explores a world that is hidden from it, and keeps the map that it makes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console
from trailmark.cli.ends import StartOption
from trailmark.cli.explore_options import Beginning, Limits
from trailmark.cli.map_summary import plural
from trailmark.cli.options import (
    JsonOption,
    RobotOption,
    UsageError,
    load_world,
    option,
    protect_inputs,
    read_duration,
    read_length,
)

if TYPE_CHECKING:
    from trailmark.exploration.result import ExplorationProgress, ExplorationResult

__all__ = ["explore"]

EXIT_STATUS = {"complete": 0, "time": 0, "distance": 0, "stuck": 3, "silent": 3}
"""By status; what is interrupted ends as every command does."""

Text = str | None


def explore(
    world: Annotated[
        Text,
        typer.Argument(
            metavar="WORLD",
            show_default=False,
            help="The hidden world: any file that plan reads, or a shipped world's name. --resume knows its own.",
        ),
    ] = None,
    output: Annotated[Text, option("--output", "DIR", "The folder to write; made if it is not there.")] = None,
    resume: Annotated[Text, option("--resume", "DIR", "Go on with the exploration in this folder.")] = None,
    robot: RobotOption = None,
    start: StartOption = None,
    sensor: Annotated[Text, option("--sensor", "NAME", "laser, or detections (of discs); default: laser.")] = None,
    sensor_range: Annotated[
        Text, option("--sensor-range", "METRES", "Default: a fifth of the world's longer side; at most its diagonal.")
    ] = None,
    strategy: Annotated[
        Text, option("--strategy", "NAME", "tour, gain-per-cost or nearest-frontier; default: tour.")
    ] = None,
    confidence: Annotated[
        Text,
        option("--confidence", "P", "A path is to meet nothing that the noise hides, with probability P."),
    ] = None,
    noise: Annotated[
        Text, option("--noise", "F", "Factor on the noise of odometry and sensor; default: 1; 0 is none.")
    ] = None,
    seed: Annotated[Text, option("--seed", "N", "Seed of all random choices; default: 0.")] = None,
    time_limit: Annotated[Text, option("--time-limit", "SECONDS", "Of the robot's clock; default: no limit.")] = None,
    max_distance: Annotated[Text, option("--max-distance", "METRES", "To be driven; default: no limit.")] = None,
    return_home: Annotated[bool, typer.Option("--return-home", help="Drive back to the start at the end.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Explore an unknown world from landmark to landmark, until it is proven that nothing more can be seen.

    Writes the map as a world, for nav2 and as a roadmap, the log, a summary, a picture, a GIF and a page. Ctrl-C keeps
    what was mapped so far; --resume goes on.

    Exit status: 0 explored, or a limit reached; 2 bad input; 3 the robot cannot move, or its sensor is silent.
    """
    begun = {"robot": robot, "start": start, "sensor": sensor, "sensor-range": sensor_range}
    begun |= {"confidence": confidence, "noise": noise, "seed": seed}
    folder = _folder(output, resume, begun)
    limits = Limits(
        math.inf if time_limit is None else read_duration(time_limit, "--time-limit"),
        math.inf if max_distance is None else read_length(max_distance, "--max-distance"),
        return_home,
    )
    words = {name: text for name, text in (begun | {"world": world, "strategy": strategy}).items() if text is not None}
    beginning = Beginning.read(words) if resume is None else None
    from trailmark.exploration.exploration_folder import (
        FILES,
        check_folder,
        keep_exploration,
        load_exploration,
        save_exploration,
        summary_of,
    )

    check_folder(folder)
    with console.progress("loading") as progress:
        saved = None if resume is None else load_exploration(folder)
        if beginning is None:
            beginning = Beginning.read((saved.options if saved else {}) | words)
        hidden = load_world(beginning.world)
        protect_inputs((*hidden.sources, *beginning.robot_file), *(folder / name for name in FILES))
        explorer, options = beginning.explorer(hidden, limits, saved), beginning.kept()

        def keep() -> None:
            keep_exploration(explorer.saved()._replace(options=options), folder)

        def follow(state: ExplorationProgress) -> None:
            progress.details = (
                f"{state.area:,.1f} m² known",
                f"{state.distance:,.1f} m driven",
                plural(state.landmarks, "landmark"),
                f"pose σ {100.0 * state.sigma:.1f} cm",
                *filter(None, [state.event]),
            )
            if explorer.ended is not None:
                progress.stage("mapping")
                keep()

        progress.stage("exploring")
        try:
            result = explorer.run(on_progress=follow)
        except Exception:
            # Whatever goes wrong hours after it began: --resume goes on from there.
            if explorer.history and explorer.ended is None:
                keep()
            raise
        if not result.history:
            raise KeyboardInterrupt  # before anything was sensed: there is nothing to keep
        progress.stage("writing")
        save_exploration(result, folder, options)
        progress.stage("drawing")
        _draw(result, folder)
    record = summary_of(result)
    if as_json:
        console.say(console.json_text(record))
    else:
        _print_summary(record, result, folder)
    if result.status == "interrupted":
        raise KeyboardInterrupt
    raise typer.Exit(EXIT_STATUS[result.status])


def _folder(output: Text, resume: Text, begun: dict[str, Text]) -> Path:
    """Return the folder that is written.

    Raises:
        UsageError: there is none, there are two, or an exploration that goes on is to be begun otherwise.
    """
    if resume is None:
        if output is None:
            raise UsageError("--output is missing; expected --output DIR, or --resume DIR")
        if not output:
            raise UsageError(f"--output {output!r}: expected a folder's name; '.' is the present one")
        return Path(output)
    for name, text in begun.items():
        if text is not None:
            raise UsageError(
                f"--{name} {text!r} given with --resume, which goes on as it was begun; expected it without"
            )
    if output is not None and Path(output) != Path(resume):
        raise UsageError(f"expected --output or --resume, got both (--output {output!r}, --resume {resume!r})")
    return Path(resume)


def _draw(result: ExplorationResult, folder: Path) -> None:
    from trailmark.plotting import save_exploration_animation, save_exploration_figure

    save_exploration_figure(folder / "exploration.png", result)
    save_exploration_animation(folder / "exploration.gif", result)


def _print_summary(record: dict[str, Any], result: ExplorationResult, folder: Path) -> None:
    last, times = result.history[-1], record["time"]
    colour = "green" if result.status == "complete" else "yellow"
    console.say(f"{record['world']}: {record['status']}, {record['reason']}", fg=colour, bold=True)
    decisions = f"{plural(len(result.decisions), 'decision')}, median {1e3 * times['decision_median']:.0f} ms"
    rows = [
        ("known", f"{record['area']:,.2f} m²"),
        ("driven", f"{record['distance']:,.2f} m in {record['duration']:,.1f} s of the robot's clock"),
        ("landmarks", f"{record['landmarks']:,} driven to, strategy {record['strategy']}, seed {record['seed']}"),
        ("pose", f"σ {100.0 * last.sigma:.2f} cm"),
        ("time", f"{times['total']:.2f} s; {decisions}, at most {1e3 * times['decision_max']:.0f} ms"),
    ]
    if result.evaluation is not None:
        told = f"{record['seen']:.2%} of what can be seen, {plural(record['collisions'], 'collision')}"
        nees = "" if record["nees"] is None else f", NEES {record['nees']:.2f} of 3"
        rows.insert(0, ("seen", f"{told}{nees}"))
    console.print_table([*rows, ("written", str(folder))], indent="  ")
