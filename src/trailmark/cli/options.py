"""Arguments and options that several commands share, and how their words are read."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trailmark.cli import console

if TYPE_CHECKING:
    from trailmark.layers import Layers
    from trailmark.world import Robot, World

__all__ = [
    "PICTURE_SUFFIXES",
    "ClearanceOption",
    "Configuration",
    "DriveOption",
    "ForwardOnlyOption",
    "FrameOption",
    "JsonOption",
    "LayersOption",
    "PlotOption",
    "RelaxOption",
    "RobotOption",
    "SeedOption",
    "TimeLimitOption",
    "TurningRadiusOption",
    "UsageError",
    "WorldArgument",
    "grown_for",
    "load_world",
    "option",
    "output_file",
    "protect_inputs",
    "read_clearance",
    "read_configuration",
    "read_count",
    "read_duration",
    "read_frame",
    "read_layers",
    "read_length",
    "read_number",
    "read_robot",
    "read_turning_radius",
    "robot_file",
    "robot_of",
    "steered",
]

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")  # those of trailmark.plotting, which is heavy to import
Configuration = tuple[float, float, float]

MAX_TURNING_RADIUS = 1e4  # trailmark.robot.TURNING_LIMIT, whose module takes numpy along

# Newer typer carries click inside, older depends on it; a public exception leads to its base class in both.
UsageError: Any = typer.BadParameter.__mro__[1]


def option(name: str, metavar: str, help: str, *aliases: str, default: bool = False) -> Any:  # noqa: A002  # typer's name
    """Return an option that takes a text, for ``Annotated``; ``default`` says whether the help shows its default."""
    help = re.sub(r"(?=\[[a-z])", r"\\", help)  # noqa: A001  # to rich, a bracket and a letter begin a style
    return typer.Option(*aliases, name, metavar=metavar, help=help, show_default=default)


# Numbers come as words and are read below, for typer's own messages do not say what was given.
WorldArgument = Annotated[
    str,
    typer.Argument(
        metavar="WORLD",
        show_default=False,
        help="A world file (trailmark YAML, nav2 map YAML, MovingAI .map, OMPL.app .cfg) or a shipped world's name.",
    ),
]
RobotOption = Annotated[
    str | None,
    option(
        "--robot",
        "SHAPE",
        "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y or '[[x, y], ...]' in metres, or a .yaml file "
        "(a robot's, a world's, nav2's parameters), instead of the world's.",
    ),
]
TimeLimitOption = Annotated[str, option("--time-limit", "SECONDS", "Time for one query.", default=True)]
SeedOption = Annotated[str, option("--seed", "N", "Seed of all random choices.", default=True)]
TurningRadiusOption = Annotated[
    str | None,
    option(
        "--turning-radius",
        "METRES",
        "The robot is a car that turns on circles of this radius, instead of moving in every direction.",
    ),
]
DriveOption = Annotated[
    str | None,
    option("--drive", "NAME", "omnidirectional, differential (turns in place, drives ahead) or car."),
]
ForwardOnlyOption = Annotated[
    bool, typer.Option("--forward-only", help="The car, or differential drive, does not drive backwards.")
]
FrameOption = Annotated[
    str, option("--frame-id", "NAME", "The coordinate frame that messages and GeoJSON name.", default=True)
]
ClearanceOption = Annotated[
    str | None, option("--clearance", "METRES", "Keep so far from obstacles and bounds, all along the path.")
]
RelaxOption = Annotated[
    bool, typer.Option("--relax", help="Where no path keeps the --clearance: as much of it as there is.")
]
PlotOption = Annotated[str | None, option("--plot", "FILE", "Write a picture: .png, .svg or .pdf.")]
LayersOption = Annotated[
    str | None,
    option("--layers", "NAMES", "What the picture shows, such as obstacles,path,ends; default: all but clearance."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object, and nothing else, on stdout.")]


def read_configuration(text: str, option: str) -> Configuration:
    """Return the configuration that an option gives as ``X,Y,T``; T is in radians, or in degrees as in ``90deg``.

    A heading in radians beyond a full turn is warned of.

    Raises:
        UsageError: anything but three finite numbers.
    """
    from trailmark.arguments import angle

    try:
        first, second, heading = text.split(",")
        x, y, theta = float(first), float(second), angle(heading)
    except ValueError:
        x = y = theta = math.nan
    if not all(map(math.isfinite, (x, y, theta))):
        allowed = "finite numbers (metres, metres, radians, or degrees such as 90deg)"
        raise UsageError(f"expected X,Y,T, {allowed}, got {option} {text!r}")
    if abs(theta) > 2.0 * math.pi and "deg" not in heading:
        console.warn(
            f"{option} {text!r}: the heading {theta:g} is taken as radians; if it is in degrees, give {heading}deg"
        )
    return x, y, theta


def read_number(
    text: str, option: str, expected: str, *, above: float = -math.inf, low: float = -math.inf, high: float = math.inf
) -> float:
    """Return the finite number above ``above`` and from ``low`` to ``high`` that an option gives.

    Raises:
        UsageError: anything else; ``expected`` says what is.
    """
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > above and low <= number <= high):
        raise UsageError(f"expected {expected}, got {option} {text!r}")
    return number


def read_layers(text: str | None, plot: str | None) -> Layers:
    """Return what a picture is to show.

    Raises:
        TrailmarkError: an unknown layer, or layers without a picture.
    """
    from trailmark.layers import ALL, Layers

    if text is not None and plot is None:
        raise UsageError(f"--layers {text!r} given without --plot; expected both or neither")
    return ALL if text is None else Layers.parse(text)


def read_duration(text: str, option: str) -> float:
    """Return the seconds that an option gives; :func:`read_number` says what it raises."""
    return read_number(text, option, "a finite number of seconds above 0", above=0.0)


def read_length(text: str, option: str) -> float:
    """Return the metres that an option gives; :func:`read_number` says what it raises."""
    return read_number(text, option, "a finite number of metres above 0", above=0.0)


def read_clearance(text: str | None, relax: bool) -> float | None:
    """Return the metres that ``--clearance`` gives; None for None.

    Raises:
        UsageError: no number of 0 or more, or ``--relax`` without it.
    """
    if text is not None:
        return read_number(text, "--clearance", "metres, from 0 to 1e7", low=0.0, high=1e7)
    if relax:
        raise UsageError("--relax given without --clearance; expected both or neither")
    return None


def read_count(text: str, option: str, low: int, high: int = 2**32 - 1) -> int:
    """Return the integer from ``low`` to ``high`` that an option gives; by default the range of numpy's seeds.

    Raises:
        UsageError: anything else.
    """
    try:
        count = int(text)
    except ValueError:
        count = low - 1
    if not low <= count <= high:
        raise UsageError(f"expected an integer from {low} to {high}, got {option} {text!r}")
    return count


def read_frame(text: str) -> str:
    """Return the name of a coordinate frame.

    Raises:
        UsageError: an empty one, or one with blanks or control characters.
    """
    if not text or any(c.isspace() or not c.isprintable() for c in text):
        raise UsageError(f"expected a name without blanks, such as map, got --frame-id {text!r}")
    return text


def read_robot(text: str | None) -> Robot | None:
    """Return the robot that ``--robot`` describes, or that the YAML file it names holds; None for None.

    Raises:
        ShapeError: a description that cannot be read.
        FormatError: a file that cannot be read, or that holds no robot.
    """
    if text is None:
        return None
    from trailmark.robot import Robot

    return Robot.load(text) if robot_file(text) else Robot.parse(text)


def robot_file(text: str | None) -> tuple[Path, ...]:
    """Return the file that ``--robot`` names, if it names one."""
    return (Path(text),) if text is not None and text.lower().endswith((".yaml", ".yml")) else ()


def read_turning_radius(text: str | None) -> float | None:
    """Return the turning radius (metres) that ``--turning-radius`` gives; None for None."""
    if text is None:
        return None
    expected = f"a number above 0 and at most {MAX_TURNING_RADIUS:g} (metres)"
    return read_number(text, "--turning-radius", expected, above=0.0, high=MAX_TURNING_RADIUS)


def steered(robot: Robot, turning_radius: float | None, forward_only: bool, drive: str | None = None) -> Robot:
    """Return the robot with what ``--turning-radius``, ``--forward-only`` and ``--drive`` say.

    Raises:
        UsageError: ``--forward-only`` for a robot without turning radius.
        ShapeError: no such drive, or one that does not go with the turning radius.
    """
    radius = robot.turning_radius if turning_radius is None else turning_radius
    if drive is not None:
        # A car's radius is nothing to another drive, unless it is given.
        kept = radius if drive == "car" else turning_radius
        reverse = robot.reverse if drive == robot.drive else None
        given: Any = {"turning_radius": kept, "reverse": reverse, "drive": drive}
        robot, radius = replace(robot, **given), kept
    if forward_only and robot.drive == "differential" and radius is None:
        return robot.differential()
    if forward_only and radius is None:
        raise UsageError("--forward-only given for a robot without turning radius; expected --turning-radius too")
    if radius is None:
        return robot
    return robot.steered(radius, (robot.reverse or robot.drive != "car") and not forward_only)


def output_file(text: str | None, suffixes: tuple[str, ...]) -> Path | None:
    """Return the file to be written, once its suffix is known and it can be written; None for None.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    if text is None:
        return None
    from trailmark.formats.files import check_writable

    file = Path(text)
    check_writable(file, suffixes)
    return file


def protect_inputs(inputs: Iterable[Path], *outputs: Path | None) -> None:
    """Raise if an output is one of the files read, or another output; to be asked before long work.

    Raises:
        OutputError: it is.
    """
    from trailmark.formats.files import require_not_an_input

    read, written = tuple(inputs), set[Path]()
    for file in filter(None, outputs):
        require_not_an_input(file, read)
        if file.resolve() in written:
            raise UsageError(f"two outputs name the file {str(file)!r}; expected a file for each")
        written.add(file.resolve())


def load_world(text: str) -> World:
    """Return the world of that file, or the shipped world of that name.

    Raises:
        TrailmarkError: there is none, or the file does not hold what it should.
    """
    from trailmark.formats.nav2_map import unknown_taken_for_free
    from trailmark.world import World

    world = World.load(text)
    if problem := unknown_taken_for_free(world.sources):
        console.warn(problem)
    return world


def grown_for(world: World, robot: Robot) -> World:
    """Return the world; if its obstacles were grown for a smaller robot, they are grown anew, with a warning."""
    if world.risk is None or world.risk.covers(robot):
        return world
    from trailmark.estimation.risk.allocation import regrow

    console.warn(
        f"world {world.name!r} was grown for a robot that reaches {world.risk.reach:g} m: its obstacles are grown "
        f"anew for this one ({robot.describe()}), with confidence {world.risk.confidence:g}"
    )
    return regrow(world.with_robot(robot), world.risk.confidence)


def robot_of(world: World, given: Robot | None) -> Robot:
    """Return the robot that was given, else the world's own.

    Raises:
        UsageError: there is neither.
    """
    robot = given or world.robot
    if robot is None:
        shapes = "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y (metres)"
        raise UsageError(f"world {world.name!r} names no robot and --robot is not given; expected {shapes}")
    return robot
