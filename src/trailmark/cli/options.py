"""The options of all commands: each kind of value says how a text is read, what is allowed, and how help shows it."""

from __future__ import annotations

import math
from collections.abc import Iterable
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
    """

    metavar: str = "TEXT"
    allowed: str = "text"
    __name__ = "value"  # older typer asks for it

    def _read(self, text: str) -> Any:
        return text

    def __call__(self, given: Any, option: str | None = None) -> Any:
        """Return the value of a text, or a default as it is; ``option`` names it in messages, if typer does not."""
        if not isinstance(given, str):
            return given
        try:
            return self._read(given)
        except TrailmarkError as error:
            problem = str(error)
        except ValueError:
            problem = f"expected {self.allowed}, got {given!r}"
        raise typer.BadParameter(problem) if option is None else UsageError(f"{option}: {problem}")


@dataclass(frozen=True)
class Number(Kind):
    """A finite number above ``above`` and from ``low`` to ``high``."""

    above: float = -math.inf
    low: float = -math.inf
    high: float = math.inf

    def _read(self, text: str) -> float:
        value = float(text)
        if not (math.isfinite(value) and value > self.above and self.low <= value <= self.high):
            raise ValueError
        return value


@dataclass(frozen=True)
class Count(Kind):
    """An integer from ``low`` to ``high``; by default the range of numpy's seeds."""

    metavar: str = "N"
    low: int = 0
    high: int = 2**32 - 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "allowed", f"an integer from {self.low} to {self.high}")

    def _read(self, text: str) -> int:
        if not self.low <= (value := int(text)) <= self.high:
            raise ValueError
        return value


class Choice(Kind):
    """One of several names."""

    def __init__(self, *names: str) -> None:
        super().__init__("|".join(names), ", ".join(names))

    def _read(self, text: str) -> str:
        names = self.allowed.split(", ")
        if text not in names:
            raise TrailmarkError(expected_name(text, names))
        return text


class OutputFile(Kind):
    """A file to be written, with one of some suffixes (any if there are none); it must be possible to write it."""

    def __init__(self, *suffixes: str, metavar: str = "FILE") -> None:
        super().__init__(metavar, ", ".join(suffixes))

    def _read(self, text: str) -> Path:
        from trailmark.formats.files import check_writable

        check_writable(file := Path(text), tuple(self.allowed.split(", ")) if self.allowed else ())
        return file


class InputFile(Kind):
    """A file to be read, which is looked at by what reads it."""

    def _read(self, text: str) -> Path:
        return Path(text)


class FrameName(Kind):
    """The name of a coordinate frame."""

    def _read(self, text: str) -> str:
        if not text or any(c.isspace() or not c.isprintable() for c in text):
            raise ValueError
        return text


class Pose(NamedTuple):
    """A configuration: metres, metres, radians."""

    x: float
    y: float
    theta: float


class PoseKind(Kind):
    """``X,Y,T``; T in radians, or in degrees as in ``90deg``; it is warned of a number that looks like degrees."""

    def _read(self, text: str) -> Pose | Position:
        from trailmark.arguments import angle, warn_of_degrees

        x, y, heading = text.split(",")
        pose = Pose(float(x), float(y), angle(heading))
        if not all(map(math.isfinite, pose)):
            raise ValueError
        if "deg" not in heading:
            warn_of_degrees(pose.theta, repr(text))
        turns = abs(pose.theta) > 2.0 * math.pi  # else it is warned of again where it is used
        return pose._replace(theta=math.remainder(pose.theta, 2.0 * math.pi)) if turns else pose


class Position(NamedTuple):
    """A place of the reference point, with any heading: metres."""

    x: float
    y: float


class GoalKind(PoseKind):
    """``X,Y,T``, or ``X,Y`` for any heading."""

    def _read(self, text: str) -> Pose | Position:
        if text.count(",") != 1:
            return super()._read(text)
        position = Position(*map(float, text.split(",")))
        if not all(map(math.isfinite, position)):
            raise ValueError
        return position


class Tolerance(NamedTuple):
    """How far from a goal a path may end: metres, radians."""

    position: float = 0.0
    heading: float = 0.0


class ToleranceKind(Kind):
    """``METRES[,RADIANS]``."""

    def _read(self, text: str) -> Tolerance:
        from trailmark.arguments import angle

        metres, comma, heading = text.partition(",")
        tolerance = Tolerance(float(metres), angle(heading) if comma else 0.0)
        if not all(0.0 <= value < math.inf for value in tolerance):
            raise ValueError
        return tolerance


class SpeedLimits(NamedTuple):
    """What a robot's motors allow; the defaults are those of a small mobile robot indoors.

    Attributes:
        speed: m/s.
        acceleration: m/s².
        turn_rate: rad/s.
        turn_acceleration: rad/s²; None for no limit.
    """

    speed: float = 1.0
    acceleration: float = 0.5
    turn_rate: float = 1.0
    turn_acceleration: float | None = None


class LimitsKind(Kind):
    """The first few numbers of :class:`SpeedLimits`."""

    def _read(self, text: str) -> SpeedLimits:
        values = [float(word) for word in text.split(",")]
        if len(values) > 4 or not all(1e-6 <= value <= 1e6 for value in values):
            raise ValueError
        return SpeedLimits(*values)


class RobotSpec(NamedTuple):
    """A robot that was described, and the files that it was read from."""

    robot: Robot
    files: tuple[Path, ...] = ()


class RobotKind(Kind):
    """A footprint, or a YAML file that holds one."""

    def _read(self, text: str) -> RobotSpec:
        from trailmark.world.robot import Robot

        file = Path(text)
        is_file = file.suffix.lower() in (".yaml", ".yml")
        return RobotSpec(Robot.load(file), (file,)) if is_file else RobotSpec(Robot.parse(text))


ROBOT = RobotKind("SHAPE", "disc:RADIUS, rectangle:LENGTHxWIDTH, polygon:x,y;x,y;x,y (metres)")
SECONDS = Number("SECONDS", "a finite number of seconds above 0", above=0.0)
METRES = Number("METRES", "a finite number of metres above 0", above=0.0)
CLEARANCE = Number("METRES", "metres, from 0 to 1e7", low=0.0, high=1e7)
RADIUS = Number("METRES", "a number above 0 and at most 10000 (metres)", above=0.0, high=1e4)  # robot.TURNING_LIMIT
SPEED = Number("M/S", "a number from 1e-06 to 1e+06 (m/s)", low=1e-6, high=1e6)
FACTOR = Number("FACTOR", "a finite number of 0 or more", low=0.0)
PROBABILITY = Number("P", "a probability above 0 and below 1", above=0.0, high=math.nextafter(1.0, 0.0))
SEED = Count()
NAME, TEXT = Kind("NAME"), Kind("TEXT")
POSE = PoseKind("X,Y,T", "X,Y,T, finite numbers (metres, metres, radians, or degrees such as 90deg)")
GOAL = GoalKind("X,Y[,T]", "X,Y or X,Y,T, finite numbers (metres, radians, or degrees such as 90deg)")
TOLERANCE = ToleranceKind("METRES[,RADIANS]", "METRES or METRES,RADIANS, numbers of 0 or more (degrees as in 10deg)")
LIMITS = LimitsKind("V[,A[,W[,ALPHA]]]", "up to four numbers from 1e-06 to 1e+06 (m/s, m/s², rad/s, rad/s²)")
DRIVE = Choice("omnidirectional", "differential", "car")
FRAME = FrameName("NAME", "a name without blanks, such as map")
PICTURE = OutputFile(".png", ".svg", ".pdf")  # those of trailmark.plotting, which is heavy to import
PATH_FILE = OutputFile(".json", ".csv", ".path", ".txt", ".yaml", ".yml", ".nav2.json", ".geojson")
SETTINGS, MASK = InputFile("FILE.yaml"), InputFile("MASK.yaml")


def option(kind: Kind, help: str, *names: str, group: str | None = None) -> Any:  # noqa: A002  # typer's name
    """Return an option of a kind, for ``Annotated``; it has the parameter's name, or those given.

    ``group`` is its heading in the help.
    """
    return typer.Option(*names, parser=kind, metavar=kind.metavar, help=help, rich_help_panel=group)


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
    str | None, option(DRIVE, "How it moves; differential turns in place and drives along its heading.", group="Robot")
]
TurningRadiusOption = Annotated[
    float | None, option(RADIUS, "Minimum turning radius; makes the robot a car.", group="Robot")
]
ForwardOnlyOption = Annotated[
    bool, flag("--forward-only", "Never drive in reverse (car or differential drive).", "Robot")
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
    ) -> tuple[World, Robot]:
        """Return a world by file or name, with the zones of a keep-out mask, and the robot: its own if none was given.

        Raises:
            TrailmarkError: an output would replace the world, the robot or another of the inputs.
        """
        world = load_world(text)
        world = world if keepout is None else world.with_mask(keepout, "keep-out")
        protect_inputs((*world.sources, *(self.spec.files if self.spec else ()), *inputs), *outputs)
        robot = self.steered(robot_of(world, self.spec))
        return grown_for(world, robot), robot

    def steered(self, robot: Robot) -> Robot:
        """Return a robot with the drive and turning radius that were given."""
        radius = robot.turning_radius if self.turning_radius is None else self.turning_radius
        if self.drive is not None:
            # A car's radius means nothing to another drive, unless it is given.
            kept = radius if self.drive == "car" else self.turning_radius
            reverse = robot.reverse if self.drive == robot.drive else None
            given: Any = {"turning_radius": kept, "reverse": reverse, "drive": self.drive}
            robot, radius = replace(robot, **given), kept
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


def load_world(text: str) -> World:
    """Return the world of a file, or the shipped world of a name."""
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
