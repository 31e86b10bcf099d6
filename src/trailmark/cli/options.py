"""The options of all commands: each kind of value says how a text is read, what is allowed, and how help shows it."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from trailmark.cli import console
from trailmark.errors import TrailmarkError, expected_name

if TYPE_CHECKING:
    from trailmark.world import Robot, World

# Newer typer carries click inside, older depends on it; a public exception leads to its base class in both.
UsageError: Any = typer.BadParameter.__mro__[1]


@dataclass(frozen=True)
class Kind:
    """A kind of value, by default any text.

    Attributes:
        metavar: what the help calls it.
        allowed: what follows "expected" in the message about any other text.
        read: makes the value of a text; a ValueError says that the text is another one.
    """

    metavar: str = "TEXT"
    allowed: str = "text"
    read: Callable[[str], Any] = str
    __name__ = "value"  # older typer asks for it

    def __call__(self, given: Any, option: str | None = None) -> Any:
        """Return the value of a text, or a default as it is; ``option`` names it in messages, if typer does not."""
        if not isinstance(given, str):
            return given
        try:
            return self.read(given)
        except TrailmarkError as error:
            problem = str(error)
        except ValueError:
            problem = f"expected {self.allowed}, got {given!r}"
        raise typer.BadParameter(problem) if option is None else UsageError(f"{option}: {problem}")


def _require(allowed: bool) -> None:
    if not allowed:
        raise ValueError


class Number(Kind):
    """A finite number above ``above`` and from ``low`` to ``high``."""

    def __init__(
        self, metavar: str, allowed: str, above: float = -math.inf, low: float = -math.inf, high: float = math.inf
    ) -> None:
        def read(text: str) -> float:
            value = float(text)
            _require(math.isfinite(value) and value > above and low <= value <= high)
            return value

        super().__init__(metavar, allowed, read)


class Count(Kind):
    """An integer from ``low`` to ``high``; by default the range of numpy's seeds."""

    def __init__(self, metavar: str = "N", low: int = 0, high: int = 2**32 - 1) -> None:
        def read(text: str) -> int:
            _require(low <= (value := int(text)) <= high)
            return value

        super().__init__(metavar, f"an integer from {low} to {high}", read)


class Choice(Kind):
    """One of several names."""

    def __init__(self, *names: str) -> None:
        def read(text: str) -> str:
            if text not in names:
                raise TrailmarkError(expected_name(text, names))
            return text

        super().__init__("|".join(names), ", ".join(names), read)


class OutputFile(Kind):
    """A file to be written, with one of some suffixes (any if there are none); it must be possible to write it.

    With ``stdout``, - names no file.
    """

    def __init__(self, *suffixes: str, metavar: str = "FILE", stdout: bool = False) -> None:
        def read(text: str) -> Path:
            from trailmark.formats.files import check_writable

            file = Path(text)
            if not (stdout and text == "-"):
                check_writable(file, suffixes)
            return file

        super().__init__(metavar, ", ".join(suffixes), read)


class InputFile(Kind):
    """A file to be read, which is looked at by what reads it."""

    def __init__(self, metavar: str = "FILE") -> None:
        super().__init__(metavar, "a file", Path)


class Pose(NamedTuple):
    """A configuration: metres, metres, radians."""

    x: float
    y: float
    theta: float


class Position(NamedTuple):
    """A place of the reference point, with any heading: metres."""

    x: float
    y: float


class Tolerance(NamedTuple):
    """How far from a goal a path may end: metres, radians."""

    position: float = 0.0
    heading: float = 0.0


class SpeedLimits(NamedTuple):
    """What a robot's motors allow: m/s, m/s², rad/s, rad/s² (None: no limit). The defaults are a small robot's."""

    speed: float = 1.0
    acceleration: float = 0.5
    turn_rate: float = 1.0
    turn_acceleration: float | None = None


class RobotSpec(NamedTuple):
    """A robot that was described, and the files that it was read from."""

    robot: Robot
    files: tuple[Path, ...] = ()


def _pose(text: str) -> Pose:
    from trailmark.arguments import angle, warn_of_degrees

    x, y, heading = text.split(",")
    pose = Pose(float(x), float(y), angle(heading))
    _require(all(map(math.isfinite, pose)))
    if "deg" not in heading:
        warn_of_degrees(pose.theta, repr(text))
    turns = abs(pose.theta) > 2.0 * math.pi  # else it is warned of again where it is used
    return pose._replace(theta=math.remainder(pose.theta, 2.0 * math.pi)) if turns else pose


def _goal(text: str) -> Pose | Position:
    if text.count(",") != 1:
        return _pose(text)
    position = Position(*map(float, text.split(",")))
    _require(all(map(math.isfinite, position)))
    return position


def _tolerance(text: str) -> Tolerance:
    from trailmark.arguments import angle

    metres, comma, heading = text.partition(",")
    tolerance = Tolerance(float(metres), angle(heading) if comma else 0.0)
    _require(all(0.0 <= value < math.inf for value in tolerance))
    return tolerance


def _limits(text: str) -> SpeedLimits:
    values = [float(word) for word in text.split(",")]
    _require(len(values) <= 4 and all(1e-6 <= value <= 1e6 for value in values))
    return SpeedLimits(*values)


def _robot(text: str) -> RobotSpec:
    from trailmark.world.robot import Robot

    file = Path(text)
    is_file = file.suffix.lower() in (".yaml", ".yml")
    return RobotSpec(Robot.load(file), (file,)) if is_file else RobotSpec(Robot.parse(text))


def _unknown(text: str) -> str | float:
    if text in ("blocked", "free"):
        return text
    factor = float(text)
    _require(0.1 <= factor <= 1e6)
    return factor


def _frame(text: str) -> str:
    _require(bool(text) and all(c.isprintable() and not c.isspace() for c in text))
    return text


ROBOT = Kind("SHAPE", "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y (metres)", _robot)
SECONDS = Number("SECONDS", "a finite number of seconds above 0", above=0.0)
METRES = Number("METRES", "a finite number of metres above 0", above=0.0)
CLEARANCE = Number("METRES", "metres, from 0 to 1e7", low=0.0, high=1e7)
RADIUS = Number("METRES", "a number above 0 and at most 10000 (metres)", above=0.0, high=1e4)  # robot.TURNING_LIMIT
SPEED = Number("M/S", "a number from 1e-06 to 1e+06 (m/s)", low=1e-6, high=1e6)
FACTOR = Number("FACTOR", "a finite number of 0 or more", low=0.0)
PROBABILITY = Number("P", "a probability above 0 and below 1", above=0.0, high=math.nextafter(1.0, 0.0))
SEED = Count()
LANDMARKS = Count("K", low=1, high=200_000)  # half a minute
NAME, TEXT = Kind("NAME"), Kind("TEXT")
POSE = Kind("X,Y,T", "X,Y,T, finite numbers (metres, metres, radians, or degrees such as 90deg)", _pose)
GOAL = Kind("X,Y[,T]", "X,Y or X,Y,T, finite numbers (metres, radians, or degrees such as 90deg)", _goal)
TOLERANCE = Kind("METRES[,RADIANS]", "METRES or METRES,RADIANS, numbers of 0 or more (degrees as in 10deg)", _tolerance)
LIMITS = Kind("V[,A[,W[,ALPHA]]]", "up to four numbers from 1e-06 to 1e+06 (m/s, m/s², rad/s, rad/s²)", _limits)
DRIVE = Choice("omnidirectional", "differential", "car")
UNKNOWN = Kind("blocked|free|FACTOR", "blocked, free, or a factor from 0.1 to 1e6", _unknown)
FRAME = Kind("NAME", "a name without blanks, such as map", _frame)
PICTURE = OutputFile(".png", ".svg", ".pdf")  # those of trailmark.plotting, which is heavy to import
PATH_SUFFIXES = ".json", ".csv", ".path", ".txt", ".yaml", ".yml", ".nav2.json", ".geojson"
PATH_FILE = OutputFile(*PATH_SUFFIXES)
SETTINGS, ZONES = InputFile("FILE.yaml"), InputFile()


def option(
    kind: Kind,
    help: str,  # noqa: A002  # typer's name
    *names: str,
    group: str | None = None,
    hidden: bool = False,
) -> Any:
    """Return an option of a kind, for ``Annotated``; it has the parameter's name, or those given.

    ``group`` is its heading in the help, where a ``hidden`` one is not.
    """
    shown: Any = {"rich_help_panel": group, "hidden": hidden}
    return typer.Option(*names, parser=kind, metavar=kind.metavar, help=help, **shown)


def flag(name: str, help: str, group: str | None = None) -> Any:  # noqa: A002  # typer's name
    """Return an option without a value, for ``Annotated``."""
    return typer.Option(name, help=help, rich_help_panel=group)


def argument(metavar: str, help: str, kind: Kind = TEXT) -> Any:  # noqa: A002  # typer's name
    """Return an argument of a kind, for ``Annotated``."""
    return typer.Argument(metavar=metavar, parser=kind, help=help)


WorldArgument = Annotated[
    str,
    argument(
        "WORLD", "World file (trailmark YAML, nav2 map YAML, MovingAI .map, OMPL.app .cfg) or name of a shipped world."
    ),
]
RobotOption = Annotated[
    RobotSpec | None,
    option(
        ROBOT,
        "Footprint in metres, instead of the world's robot: disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y, "
        "nav2's '[[x, y], ...]', or a .yaml file (of a robot, a world, or nav2's parameters).",
    ),
]
StartOption = Annotated[Pose | None, option(POSE, "Start pose in metres and radians; degrees as in 1,2,90deg.")]
TimeLimitOption = Annotated[float, option(SECONDS, "Planning time.")]
SeedOption = Annotated[int, option(SEED, "Random seed.")]
DriveOption = Annotated[
    str | None,
    option(DRIVE, "How the robot moves; differential turns in place and drives along its heading.", group="Robot"),
]
TurningRadiusOption = Annotated[
    float | None, option(RADIUS, "Minimum turning radius; makes the robot a car.", group="Robot")
]
ForwardOnlyOption = Annotated[
    bool, flag("--forward-only", "Never drive in reverse (car or differential drive).", "Robot")
]
ClearanceOption = Annotated[
    float | None,
    option(CLEARANCE, "Minimum clearance to obstacles and bounds along the whole path.", group="Robot"),
]
UnknownOption = Annotated[
    Any,
    option(
        UNKNOWN,
        "Unknown cells of a nav2 map: blocked (default), free, or a factor on the cost of a metre in them.",
        group="World",
    ),
]
KeepoutOption = Annotated[
    Path | None,
    option(ZONES, "Keep-out zones: polygons as GeoJSON or WKT, or a nav2 mask (.yaml) of the map.", group="World"),
]
PlotOption = Annotated[Path | None, option(PICTURE, "Write a picture: .png, .svg or .pdf.")]
JsonOption = Annotated[bool, flag("--json", "Print the result as one JSON object on stdout.")]


class RobotOptions(NamedTuple):
    """The options ``--robot``, ``--turning-radius``, ``--forward-only`` and ``--drive``."""

    spec: RobotSpec | None = None
    turning_radius: float | None = None
    forward_only: bool = False
    drive: str | None = None

    def load(
        self,
        text: str,
        outputs: Iterable[Path | None] = (),
        inputs: Iterable[Path] = (),
        keepout: Path | None = None,
        unknown: Any = None,
    ) -> tuple[World, Robot]:
        """Return a world by file or name, with the keep-out zones of a file, and the robot: its own if none was given.

        Raises:
            TrailmarkError: an output would replace the world, the robot or another of the inputs.
        """
        world = load_world(text, unknown)
        world = world if keepout is None else world.with_zones(keepout)
        protect_inputs((*world.sources, *(self.spec.files if self.spec else ()), *inputs), *outputs)
        robot = self.steered(robot_of(world, self.spec))
        return grown_for(world, robot), robot

    def steered(self, robot: Robot) -> Robot:
        """Return a robot with the drive and turning radius that were given."""
        radius = robot.turning_radius if self.turning_radius is None else self.turning_radius
        if self.drive is not None:
            # A car's radius means nothing to another drive, unless it is given.
            radius = radius if self.drive == "car" else self.turning_radius
            reverse = robot.reverse if self.drive == robot.drive else None
            given: Any = {"turning_radius": radius, "reverse": reverse, "drive": self.drive}
            robot = replace(robot, **given)
        if radius is not None:
            return robot.steered(radius, (robot.reverse or robot.drive != "car") and not self.forward_only)
        if not self.forward_only:
            return robot
        if robot.drive != "differential":
            raise UsageError("--forward-only given for a robot without turning radius; expected --turning-radius too")
        return robot.differential()


def robot_of(world: World, given: RobotSpec | None) -> Robot:
    """Return the robot that was given, else the world's own."""
    robot = world.robot if given is None else given.robot
    if robot is None:
        raise UsageError(f"world {world.name!r} names no robot and --robot is not given; expected {ROBOT.allowed}")
    return robot


def load_world(text: str, unknown: Any = None) -> World:
    """Return the world of a file, or the shipped world of a name; ``unknown`` says what unknown cells are."""
    from trailmark.world import World

    world = World.load(text, unknown)
    for note in world.notes:
        console.warn(note)
    return world


def is_nav2_map(text: str) -> bool:
    """Return whether a world is a file that names an image, as nav2's maps do."""
    file = Path(text)
    if file.suffix.lower() not in (".yaml", ".yml") or not file.is_file():
        return False
    with file.open("rb") as opened:
        return re.search(rb"^image\s*:", opened.read(2**16), re.MULTILINE) is not None


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


def protect_inputs(inputs: Iterable[Path], *outputs: Path | None) -> None:
    """Raise if an output is one of the files read, or another output; to be asked before long work."""
    from trailmark.formats.files import require_not_an_input

    read, written = tuple(inputs), set[Path]()
    for file in filter(None, outputs):
        require_not_an_input(file, read)
        if file.resolve() in written:
            raise UsageError(f"two outputs name the file {str(file)!r}; expected a file for each")
        written.add(file.resolve())
