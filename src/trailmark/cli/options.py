"""Arguments and options that several commands share. What reads them raises a TrailmarkError or UsageError."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trailmark.cli import console

if TYPE_CHECKING:
    from trailmark.world import Robot, World

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")  # those of trailmark.plotting, which is heavy to import
Configuration = tuple[float, float, float]

MAX_TURNING_RADIUS = 1e4  # trailmark.robot.TURNING_LIMIT, whose module takes numpy along

# Newer typer carries click inside, older depends on it; a public exception leads to its base class in both.
UsageError: Any = typer.BadParameter.__mro__[1]


def option(name: str, metavar: str, help: str, *aliases: str, default: bool = False) -> Any:  # noqa: A002  # typer's name
    """Return an option that takes a text, for ``Annotated``; ``default`` says whether the help shows its default."""
    return typer.Option(*aliases, name, metavar=metavar, help=help, show_default=default)


# Numbers come as words and are read below: typer's own messages do not quote them.
WorldArgument = Annotated[
    str,
    typer.Argument(
        metavar="WORLD",
        show_default=False,
        help="World file (trailmark YAML, nav2 map YAML, MovingAI .map, OMPL.app .cfg) or name of a shipped world.",
    ),
]
RobotOption = Annotated[
    str | None,
    option(
        "--robot",
        "SHAPE",
        "Footprint in metres, instead of the world's robot: disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y, "
        "nav2's '[[x, y], ...]', or a .yaml file (of a robot, a world, or nav2's parameters).",
    ),
]
TimeLimitOption = Annotated[str, option("--time-limit", "SECONDS", "Planning time.", default=True)]
SeedOption = Annotated[str, option("--seed", "N", "Random seed.", default=True)]
TurningRadiusOption = Annotated[
    str | None, option("--turning-radius", "METRES", "Minimum turning radius; makes the robot a car.")
]
DriveOption = Annotated[
    str | None,
    option("--drive", "NAME", "omnidirectional, differential (turns in place, drives along its heading) or car."),
]
ForwardOnlyOption = Annotated[
    bool, typer.Option("--forward-only", help="Never drive in reverse (car or differential drive).")
]
KeepoutOption = Annotated[
    str | None, option("--keepout", "MASK.yaml", "nav2 keep-out mask; occupied cells become keep-out zones.")
]
SpeedMaskOption = Annotated[
    str | None,
    option(
        "--speed-mask", "MASK.yaml", "nav2 speed mask; cells become speed limits, percentages of --max-speed or 1 m/s."
    ),
]
FrameOption = Annotated[
    str, option("--frame-id", "NAME", "Coordinate frame named in messages and GeoJSON.", default=True)
]
PlotOption = Annotated[str | None, option("--plot", "FILE", "Write a picture: .png, .svg or .pdf.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the result as one JSON object on stdout.")]
StartOption = Annotated[
    str | None, option("--start", "X,Y,T", "Start pose in metres and radians; degrees as in 1,2,90deg.")
]


class RobotOptions(NamedTuple):
    """The options ``--robot``, ``--turning-radius``, ``--forward-only`` and ``--drive``."""

    robot: Robot | None
    files: tuple[Path, ...]
    turning_radius: float | None
    forward_only: bool
    drive: str | None

    @classmethod
    def read(
        cls,
        robot: str | None,
        turning_radius: str | None = None,
        forward_only: bool = False,
        drive: str | None = None,
    ) -> RobotOptions:
        """Return the options, read before the world is."""
        radius = None
        if turning_radius is not None:
            expected = f"a number above 0 and at most {MAX_TURNING_RADIUS:g} (metres)"
            radius = read_number(turning_radius, "--turning-radius", expected, above=0.0, high=MAX_TURNING_RADIUS)
        return cls(read_robot(robot), robot_file(robot), radius, forward_only, drive)

    def robot_in(self, world: World) -> Robot:
        """Return the robot that was given, else the world's, with the drive and turning radius that were given."""
        return self.steered(robot_of(world, self.robot))

    def steered(self, robot: Robot) -> Robot:
        """Return a robot with the drive and turning radius that were given."""
        radius = robot.turning_radius if self.turning_radius is None else self.turning_radius
        if self.drive is not None:
            # A car's radius means nothing to another drive, unless it is given.
            kept = radius if self.drive == "car" else self.turning_radius
            reverse = robot.reverse if self.drive == robot.drive else None
            given: Any = {"turning_radius": kept, "reverse": reverse, "drive": self.drive}
            robot, radius = replace(robot, **given), kept
        if self.forward_only and robot.drive == "differential" and radius is None:
            return robot.differential()
        if self.forward_only and radius is None:
            raise UsageError("--forward-only given for a robot without turning radius; expected --turning-radius too")
        if radius is None:
            return robot
        return robot.steered(radius, (robot.reverse or robot.drive != "car") and not self.forward_only)


def read_configuration(text: str, option: str) -> Configuration:
    """Return the configuration that an option gives as ``X,Y,T``; T is in radians, or in degrees as in ``90deg``.

    A heading in radians beyond a full turn is warned of.
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
    if abs(theta) > 2.0 * math.pi:
        if "deg" not in heading:
            console.warn(
                f"{option} {text!r}: the heading {theta:g} is taken as radians; if it is in degrees, give {heading}deg"
            )
        theta = math.remainder(theta, 2.0 * math.pi)  # else it is warned of again where it is used
    return x, y, theta


def read_number(
    text: str, option: str, expected: str, *, above: float = -math.inf, low: float = -math.inf, high: float = math.inf
) -> float:
    """Return the finite number above ``above`` and from ``low`` to ``high`` that an option gives."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > above and low <= number <= high):
        raise UsageError(f"expected {expected}, got {option} {text!r}")
    return number


def read_duration(text: str, option: str) -> float:
    """Return the seconds that an option gives."""
    return read_number(text, option, "a finite number of seconds above 0", above=0.0)


def read_length(text: str, option: str) -> float:
    """Return the metres that an option gives."""
    return read_number(text, option, "a finite number of metres above 0", above=0.0)


def read_count(text: str, option: str, low: int, high: int = 2**32 - 1) -> int:
    """Return the integer from ``low`` to ``high`` that an option gives; by default the range of numpy's seeds."""
    try:
        count = int(text)
    except ValueError:
        count = low - 1
    if not low <= count <= high:
        raise UsageError(f"expected an integer from {low} to {high}, got {option} {text!r}")
    return count


def read_probability(text: str, option: str) -> float:
    """Return the probability, above 0 and below 1, that an option gives."""
    below = math.nextafter(1.0, 0.0)
    return read_number(text, option, "a probability above 0 and below 1", above=0.0, high=below)


def read_frame(text: str) -> str:
    """Return the name of a coordinate frame."""
    if not text or any(c.isspace() or not c.isprintable() for c in text):
        raise UsageError(f"expected a name without blanks, such as map, got --frame-id {text!r}")
    return text


def read_robot(text: str | None) -> Robot | None:
    """Return the robot that ``--robot`` describes, or that the YAML file it names holds; None for None."""
    if text is None:
        return None
    from trailmark.robot import Robot

    return Robot.load(text) if robot_file(text) else Robot.parse(text)


def robot_file(text: str | None) -> tuple[Path, ...]:
    """Return the file that ``--robot`` names, if it names one."""
    return (Path(text),) if text is not None and text.lower().endswith((".yaml", ".yml")) else ()


def output_file(text: str | None, suffixes: tuple[str, ...]) -> Path | None:
    """Return the file to be written, once its suffix is known and it can be written; None for None."""
    if text is None:
        return None
    from trailmark.formats.files import check_writable

    file = Path(text)
    check_writable(file, suffixes)
    return file


def protect_inputs(inputs: Iterable[Path], *outputs: Path | None) -> None:
    """Raise if an output is one of the files read, or another output; to be asked before long work."""
    from trailmark.formats.files import require_not_an_input

    read, written = tuple(inputs), set[Path]()
    for file in filter(None, outputs):
        require_not_an_input(file, read)
        if file.resolve() in written:
            raise UsageError(f"two outputs name the file {str(file)!r}; expected a file for each")
        written.add(file.resolve())


def load_world(text: str, keepout: str | None = None, speed: str | None = None, max_speed: float = 1.0) -> World:
    """Return the world of that file, or the shipped world of that name, with the zones of nav2's masks.

    Args:
        text: file or name.
        keepout: file of a keep-out mask.
        speed: file of a speed mask.
        max_speed: metres per second that the speed mask's percentages refer to.
    """
    from trailmark.formats.nav2_map import unknown_taken_for_free
    from trailmark.world import World

    world = World.load(text)
    if problem := unknown_taken_for_free(world.sources):
        console.warn(problem)
    if keepout is not None:
        world = world.with_mask(keepout, "keep-out")
    return world if speed is None else world.with_mask(speed, "speed", max_speed=max_speed)


def grown_for(world: World, robot: Robot) -> World:
    """Return the world; if its obstacles were grown for a smaller robot, they are grown anew, with a warning."""
    if world.risk is None or world.risk.covers(robot):
        return world
    from trailmark.estimation.risk import regrow

    console.warn(
        f"world {world.name!r} was grown for a robot that reaches {world.risk.reach:g} m: its obstacles are grown "
        f"anew for this one ({robot.describe()}), with confidence {world.risk.confidence:g}"
    )
    return regrow(world.with_robot(robot), world.risk.confidence)


def robot_of(world: World, given: Robot | None) -> Robot:
    """Return the robot that was given, else the world's own."""
    robot = given or world.robot
    if robot is None:
        shapes = "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y (metres)"
        raise UsageError(f"world {world.name!r} names no robot and --robot is not given; expected {shapes}")
    return robot
