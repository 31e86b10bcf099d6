"""``trailmark explore``: a simulated robot explores a world that is hidden from it, and keeps the map that it makes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trailmark.cli import console, options
from trailmark.cli.options import Kind, Pose, UsageError, argument, flag

if TYPE_CHECKING:
    from trailmark.exploration.explorer import Explorer
    from trailmark.exploration.result import ExplorationProgress, ExplorationResult, SavedExploration
    from trailmark.world import World

__all__ = ["explore"]

EXIT_STATUS = {"complete": 0, "complete-at-confidence": 0, "time": 0, "distance": 0, "stuck": 3, "silent": 3}
"""By status; an interrupted exploration ends as every command does."""

KINDS: dict[str, Kind] = {
    "robot": options.ROBOT,
    "start": options.POSE,
    "sensor": options.Choice("laser", "detections"),
    "sensor-range": options.METRES,
    "cell": options.METRES,
    "strategy": options.Choice("tour", "gain-per-cost", "nearest-frontier"),  # those of trailmark.exploration
    "confidence": options.PROBABILITY,
    "noise": options.FACTOR,
    "seed": options.SEED,
    "drive": options.DRIVE,
    "turning-radius": options.RADIUS,
    "clearance": options.CLEARANCE,
}
"""Of the options that are kept, as they were written, for the exploration to go on with."""

RANGE = 0.2
"""Of the sensor by default, as a share of the world's longer side: so that a map takes some landmarks."""

Text = str | None


def _kept(name: str, help: str) -> Any:  # noqa: A002  # typer's name
    return typer.Option(f"--{name}", metavar=KINDS[name].metavar, help=help)


def explore(
    world: Annotated[Text, argument("WORLD", "The simulated world, as for plan; not needed with --resume.")] = None,
    output: Annotated[Text, options.option(Kind("DIR"), "Folder for the results; created if missing.")] = None,
    resume: Annotated[Text, options.option(Kind("DIR"), "Continue the exploration in this folder.")] = None,
    robot: Annotated[Text, _kept("robot", "Footprint in metres, instead of the world's robot; as for plan.")] = None,
    start: Annotated[Text, _kept("start", "Start pose in metres and radians; degrees as in 1,2,90deg.")] = None,
    sensor: Annotated[Text, _kept("sensor", "Laser, or detections of discs; default: laser.")] = None,
    sensor_range: Annotated[
        Text, _kept("sensor-range", "Range of the sensor; default: a fifth of the world's longer side.")
    ] = None,
    strategy: Annotated[Text, _kept("strategy", "How the next landmark is chosen; default: tour.")] = None,
    cell: Annotated[
        Text,
        _kept(
            "cell",
            "Side of the map's cells; passages narrower than the robot and two cells are not entered; default: a "
            "fifth of the robot's inscribed radius.",
        ),
    ] = None,
    confidence: Annotated[
        Text, _kept("confidence", "Keep paths free of unseen obstacles with probability P, given the sensor's noise.")
    ] = None,
    noise: Annotated[Text, _kept("noise", "Factor on the noise of odometry and sensor; 0 is none; default: 1.")] = None,
    seed: Annotated[Text, _kept("seed", "Random seed; default: 0.")] = None,
    drive: Annotated[Text, _kept("drive", "How the robot moves; as for plan.")] = None,
    turning_radius: Annotated[Text, _kept("turning-radius", "Minimum turning radius; makes the robot a car.")] = None,
    clearance: Annotated[Text, _kept("clearance", "Minimum clearance to mapped obstacles.")] = None,
    time_limit: Annotated[
        float, options.option(options.SECONDS, "Time limit on the simulated robot's clock.")
    ] = math.inf,
    max_distance: Annotated[float, options.option(options.METRES, "Maximum distance to drive.")] = math.inf,
    return_home: Annotated[bool, flag("--return-home", "Drive back to the start at the end.")] = False,
    as_json: options.JsonOption = False,
) -> None:
    """Simulate a robot that explores an unknown world and maps it.

    Writes into DIR the map (as a world, for nav2, as a roadmap), the log, a summary, a picture and a GIF. Ctrl-C keeps
    the map so far; --resume continues.

    Exit status: 0 explored, or a limit reached; 2 bad input; 3 the robot cannot move or its sensor gives no readings;
    130 stopped by Ctrl-C.
    """
    begun = {"robot": robot, "start": start, "sensor": sensor, "sensor-range": sensor_range, "cell": cell}
    begun |= {"confidence": confidence, "noise": noise, "seed": seed}
    begun |= {"drive": drive, "turning-radius": turning_radius, "clearance": clearance}
    folder = _folder(output, resume, begun)
    limits = {"time_limit": time_limit, "distance_limit": max_distance}
    words = {name: text for name, text in (begun | {"world": world, "strategy": strategy}).items() if text is not None}
    beginning = Beginning.read(words) if resume is None else None
    from trailmark.exploration.result import (
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
        hidden = options.load_world(beginning.world)
        options.protect_inputs((*hidden.sources, *beginning.robot_file), *(folder / name for name in FILES))
        explorer, words = beginning.explorer(hidden, saved, limits, return_home), beginning.kept()

        def keep() -> None:
            keep_exploration(replace(explorer.saved(), options=words), folder)

        def follow(state: ExplorationProgress) -> None:
            progress.details = (
                f"{state.area:,.1f} m² known",
                f"{state.distance:,.1f} m driven",
                console.plural(state.landmarks, "landmark"),
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
        save_exploration(result, folder, words)
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
    """Return the folder that is written."""
    if resume is None:
        if output is None:
            raise UsageError("--output is missing; expected --output DIR, or --resume DIR")
        if not output:
            raise UsageError(f"--output {output!r}: expected a folder's name; '.' is the present one")
        return Path(output)
    for name, text in begun.items():
        if text is not None:
            raise UsageError(f"--{name} {text!r} given with --resume, which keeps the options that it began with")
    if output is not None and Path(output) != Path(resume):
        raise UsageError(f"expected --output or --resume, got both (--output {output!r}, --resume {resume!r})")
    return Path(resume)


def _draw(result: ExplorationResult, folder: Path) -> None:
    from trailmark.plotting import save_exploration_animation, save_exploration_figure

    save_exploration_figure(folder / "exploration.png", result)
    save_exploration_animation(folder / "exploration.gif", result)


def _print_summary(record: dict[str, Any], result: ExplorationResult, folder: Path) -> None:
    last, times = result.history[-1], record["time"]
    colour = "green" if result.status.startswith("complete") else "yellow"
    outcome = ", ".join(dict.fromkeys([record["status"], record["reason"]]))  # "interrupted" is both
    console.say(f"{record['world']}: {outcome}", fg=colour, bold=True)
    decisions = f"{console.plural(len(result.decisions), 'decision')}, median {1e3 * times['decision_median']:.0f} ms"
    rows = [
        ("known", f"{record['area']:,.2f} m²"),
        ("driven", f"{record['distance']:,.2f} m in {record['duration']:,.1f} s of the robot's clock"),
        ("landmarks", f"{record['landmarks']:,} driven to, strategy {record['strategy']}, seed {record['seed']}"),
        ("pose", f"σ {100.0 * last.sigma:.2f} cm"),
        ("time", f"{times['total']:.2f} s; {decisions}, at most {1e3 * times['decision_max']:.0f} ms"),
    ]
    if result.evaluation is not None:
        told = f"{record['seen']:.2%} of the visible area seen, {console.plural(record['collisions'], 'collision')}"
        nees = "" if record["nees"] is None else f", NEES {record['nees']:.2f} of 3"
        rows.insert(0, ("seen", f"{told}{nees}"))
    console.print_table([*rows, ("written", str(folder))], indent="  ")


class Beginning(NamedTuple):
    """The options with which an exploration begins."""

    words: dict[str, str]
    """The options that were given, by their names without dashes, and the world."""
    world: str
    robot: options.RobotSpec | None
    start: Pose | None
    sensor: str
    sensor_range: float | None
    cell: float | None
    strategy: str
    confidence: float | None
    noise: float
    seed: int
    drive: str | None
    turning_radius: float | None
    clearance: float | None

    @classmethod
    def read(cls, given: Mapping[str, object]) -> Beginning:
        """Return what options say that are looked at before the world is read."""
        words = {name: str(text) for name, text in given.items()}
        if "world" not in words:
            raise UsageError("WORLD is missing; expected a file, a shipped world's name, or --resume DIR")
        defaults = {"sensor": "laser", "strategy": "tour", "noise": "1", "seed": "0"} | words
        found = {name: KINDS[name](defaults.get(name), f"--{name}") for name in KINDS}
        return cls(words, words["world"], *found.values())

    @property
    def robot_file(self) -> tuple[Path, ...]:
        """The file that the robot was read from, if it was."""
        return () if self.robot is None else self.robot.files

    def kept(self) -> dict[str, str]:
        """Return the words by which the same exploration goes on, from whatever folder."""
        names = ("world", "robot") if self.robot_file else ("world",)
        files = {name: Path(self.words[name]) for name in names}
        return self.words | {name: str(file.absolute()) for name, file in files.items() if file.exists()}

    def explorer(
        self, world: World, saved: SavedExploration | None, limits: dict[str, Any], return_home: bool
    ) -> Explorer:
        """Return the explorer of the world, until a limit of time (seconds) or distance (metres)."""
        from trailmark.exploration.explorer import Explorer
        from trailmark.exploration.result import ExplorationSettings
        from trailmark.exploration.simulated_robot import disc_detector, laser_scanner

        given = options.RobotOptions(self.robot, self.turning_radius, False, self.drive)
        body = given.steered(options.robot_of(world, self.robot)).keeping(self.clearance or 0.0)
        if self.start is None and not world.queries:
            raise UsageError(f"world {world.name!r} holds no query to start from; expected --start X,Y,T")
        settings = ExplorationSettings(cell=self.cell, confidence=self.confidence, return_home=return_home, **limits)
        xmin, ymin, xmax, ymax = world.bounds
        reach = RANGE * max(xmax - xmin, ymax - ymin) if self.sensor_range is None else self.sensor_range
        laser = self.sensor == "laser"
        sensor = laser_scanner(reach, settings.cell_side(body, world.bounds)) if laser else disc_detector(reach)
        return Explorer(
            world,
            body,
            sensor,
            strategy=self.strategy,
            start=self.start or world.query().start,
            settings=settings,
            seed=self.seed,
            noise=self.noise,
            resumed=saved,
        )
