"""What may stand in a world file, a robot file and a nav2 map file, as pydantic models.

Strict: a number is not given as text or boolean, NaN and infinity are refused, and so are unknown keys (in the
world file; nav2 itself ignores them). A type's description says what is allowed, for the JSON Schema.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Sequence
from difflib import get_close_matches
from os.path import expanduser
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Tag, ValidationError

from trailmark.arguments import angle
from trailmark.errors import FormatError

__all__ = ["Angle", "MapFile", "ObstacleList", "Pose", "RobotFile", "WorldFile", "validate"]


def _in_radians(value: Any) -> Any:
    """Return an angle such as ``90deg``, or the last number of a pose, in radians; what is neither as it is."""
    if isinstance(value, list) and len(value) == 3:
        return [*value[:2], _in_radians(value[2])]
    degrees = isinstance(value, str) and value.rstrip().endswith("deg")
    return angle(value) if degrees and math.isfinite(angle(value)) else value


def _in_lower_case(value: Any) -> Any:
    return value.lower() if isinstance(value, str) else value


def _as_flag(value: Any) -> Any:
    """Return 0 or 1 for the words that YAML 1.1, which nav2 reads, has for false and true; others as they are."""
    word = str(value).lower() if isinstance(value, str | bool) else ""
    return 0 if word in ("0", "n", "no", "false", "off") else 1 if word in ("1", "y", "yes", "true", "on") else value


def _number(description: str, **limits: float) -> Any:
    return Field(strict=True, allow_inf_nan=False, description=description, **limits)  # type: ignore[call-overload]  # limits are its own


def _size(smallest: int, largest: int | None = None, description: str | None = None) -> Any:
    return Field(min_length=smallest, max_length=largest, description=description)


Number = Annotated[float, _number("a finite number")]
Positive = Annotated[float, _number("a finite number above 0", gt=0.0)]
Length = Annotated[float, _number("a finite number above 0 (metres)", gt=0.0)]
NotNegative = Annotated[float, _number("a finite number, 0 or more", ge=0.0)]
Fraction = Annotated[float, _number("a number from 0 to 1", ge=0.0, le=1.0)]
Count = Annotated[int, Field(strict=True, ge=1, description="a whole number, 1 or more")]
Text = Annotated[str, Field(strict=True, description="a text (quote it if it looks like a number)")]
Flag = Annotated[bool, Field(strict=True)]
Point = Annotated[list[Number], _size(2, 2, "a point [x, y] of finite numbers (metres)")]
Ring = Annotated[list[Point], _size(3, None, "three or more points [x, y] of finite numbers (metres)")]
Placement = Annotated[list[Number], _size(3, 3, "[x, y, yaw] of finite numbers (metres, radians)")]
Matrix = Annotated[list[Annotated[list[Number], _size(2, 5)]], _size(2, 5, "2 to 5 rows of a symmetric matrix")]
_Degrees = Annotated[str, Field(pattern=r"^[-+0-9.eE]+ *deg$")]
Angle = Annotated[
    float,
    _number("a finite number (radians, counter-clockwise) or degrees such as 90deg"),
    BeforeValidator(_in_radians, json_schema_input_type=float | _Degrees),
]
Pose = Annotated[
    list[Number],
    _size(3, 3, "a configuration [x, y, theta] of finite numbers (metres, radians or degrees such as 90deg)"),
    BeforeValidator(_in_radians, json_schema_input_type=tuple[float, float, float | _Degrees]),
]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class _Robot(_Strict):
    turning_radius: Length | None = None
    reverse: Flag | None = Field(default=None, description="true or false (whether it drives backwards too)")
    drive: Literal["omnidirectional", "differential", "car"] | None = None


class DiscRobot(_Robot):
    """A round robot about its reference point."""

    shape: Literal["disc"]
    radius: Length


class RectangleRobot(_Robot):
    """A rectangular robot centred on its reference point."""

    shape: Literal["rectangle"]
    length: Length
    width: Length


class PolygonRobot(_Robot):
    """A robot with any simple outline, in its own frame."""

    shape: Literal["polygon"]
    vertices: Ring


RobotEntry = Annotated[DiscRobot | RectangleRobot | PolygonRobot, Field(discriminator="shape")]


class DiscShape(_Strict):
    """A disc."""

    shape: Literal["disc"]
    center: Point
    radius: Length


class RectangleShape(_Strict):
    """A rectangle, its length along its heading."""

    shape: Literal["rectangle"]
    center: Point
    length: Length
    width: Length
    heading: Angle = 0.0


class PolygonShape(_Strict):
    """A simple polygon, convex or not."""

    shape: Literal["polygon"]
    vertices: Ring
    holes: list[Ring] = []


class EstimateEntry(_Strict):
    """What readings say of an obstacle; the obstacle itself is this, grown for the world's risk."""

    mean: Annotated[DiscShape | RectangleShape | PolygonShape, Field(discriminator="shape")]
    covariance: Matrix = Field(
        description="2 to 5 rows of a symmetric matrix (of x, y and radius, of x, y, heading, length and width, or of "
        "x, y and heading; metres and radians)"
    )
    share: Annotated[float, _number("a number above 0 and at most 1 (of the risk)", gt=0.0, le=1.0)] | None = None
    frame: Literal["start", "map"] | None = Field(default=None, description="what the covariance is relative to")


class MotionEntry(_Strict):
    """How an obstacle moves: in a straight line, without turning; all that it covers up to the horizon is avoided."""

    velocity: Point = Field(description="two finite numbers [vx, vy] (metres per second)")
    until: Positive = Field(description="a finite number above 0 (seconds from now)")


class _Obstacle(_Strict):
    id: Text | None = Field(default=None, min_length=1, description="a text that names no other obstacle")
    estimate: EstimateEntry | None = None
    motion: MotionEntry | None = None


class DiscObstacle(DiscShape, _Obstacle):
    """A disc."""


class RectangleObstacle(RectangleShape, _Obstacle):
    """A rectangle, its length along its heading."""


class PolygonObstacle(PolygonShape, _Obstacle):
    """A simple polygon, convex or not."""


ObstacleEntry = Annotated[DiscObstacle | RectangleObstacle | PolygonObstacle, Field(discriminator="shape")]


class ObstacleList(_Strict):
    """Obstacles by themselves, as an edit of a world has them."""

    obstacles: list[ObstacleEntry]


class GridEntry(_Strict):
    """The cells of a grid map, instead of obstacles: they are read as a grid again, not as polygons."""

    rows: Count
    columns: Count
    cell: Length
    origin: Placement = Field(description="[x, y, yaw] of finite numbers (metres, radians) of its outer corner")
    occupied: Text = Field(description="base64 of zlib of a bit a cell, row by row, the smallest y first")


class RiskEntry(_Strict):
    """What the obstacles that carry estimates are grown for."""

    confidence: Annotated[float, _number("a number above 0 and below 1", gt=0.0, lt=1.0)]
    pose_covariance: Matrix | None = Field(default=None, description="three rows, of the robot's x, y and theta")
    reach: NotNegative = Field(default=0.0, description="a finite number, 0 or more (metres per radian of heading)")


class _Zone(_Strict):
    vertices: Ring
    holes: list[Ring] = []


class CostZoneEntry(_Zone):
    """Where a metre costs so many metres."""

    kind: Literal["cost"]
    factor: Number = Field(ge=0.1, le=1e6, description="a number from 0.1 to 1e6")


class KeepOutZoneEntry(_Zone):
    """Where no part of the robot may be; a robot that starts inside may leave."""

    kind: Literal["keep-out"]


class OneWayZoneEntry(_Zone):
    """Where the reference point may only travel along a heading, within a tolerance."""

    kind: Literal["one-way"]
    heading: Angle
    tolerance: Angle = Field(ge=0.0, le=math.pi, description="a number from 0 to pi (radians) or degrees such as 45deg")


class SpeedZoneEntry(_Zone):
    """Where the reference point may not travel faster than a limit."""

    kind: Literal["speed"]
    limit: Positive = Field(description="a finite number above 0 (metres per second)")


ZoneEntry = CostZoneEntry | KeepOutZoneEntry | OneWayZoneEntry | SpeedZoneEntry


class GoalEntry(_Strict):
    """Where a path may end: near a pose, whose heading may be left out, or in a region."""

    pose: Annotated[list[Number], _size(2, 3), BeforeValidator(_in_radians)] | None = Field(
        default=None, description="[x, y, theta] or, for any heading, [x, y], finite numbers (metres, radians)"
    )
    region: Ring | None = None
    heading: Angle | None = Field(default=None, description="a finite number (radians; of a region)")
    position_tolerance: NotNegative = 0.0
    heading_tolerance: Angle = Field(default=0.0, ge=0.0, description="a finite number, 0 or more (radians)")
    cost: Number = Field(default=0.0, description="a finite number, 0 or more (metres, added to a path's cost)")


def _kind_of_goal(value: Any) -> str:
    """Return which of the forms a query's goal has."""
    if isinstance(value, dict | GoalEntry):
        return "one goal"
    several = isinstance(value, list) and any(isinstance(item, dict | GoalEntry) for item in value)
    return "several goals" if several else "a pose"


QueryGoal = Annotated[
    Annotated[Pose, Tag("a pose")]
    | Annotated[GoalEntry, Tag("one goal")]
    | Annotated[list[GoalEntry], Tag("several goals")],
    Discriminator(_kind_of_goal),
]


class QueryEntry(_Strict):
    """One planning problem; its goal is a pose, a mapping {pose or region, …}, or a list of these."""

    name: Text
    start: Pose
    goal: QueryGoal


class RobotFile(BaseModel):
    """A robot file: the robot as a world file has it, under the key ``robot``; other keys are ignored."""

    robot: RobotEntry


class WorldFile(_Strict):
    """A trailmark world, schema version 1: metres, radians, y up, theta counter-clockwise."""

    model_config = ConfigDict(extra="forbid", title="trailmark world")

    trailmark: Literal[1] = Field(description="1 (the schema version)")
    name: Text | None = None
    bounds: Annotated[list[Number], _size(4, 4, "four finite numbers [xmin, ymin, xmax, ymax] (metres)")]
    robot: RobotEntry | None = None
    boundary: Ring | None = None
    obstacles: list[ObstacleEntry] | None = None
    grid: GridEntry | None = None
    queries: list[QueryEntry] | None = None
    zones: list[Annotated[ZoneEntry, Field(discriminator="kind")]] | None = None
    risk: RiskEntry | None = None
    not_certified: Text | None = Field(default=None, description="why the estimates are not to be relied on")


class MapFile(BaseModel):
    """A nav2 map file; its definitions are those of nav2_map_server."""

    model_config = ConfigDict(extra="ignore")

    image: Annotated[Text, AfterValidator(expanduser)] = Field(min_length=1, description="the path of an image file")
    resolution: Length = Field(description="a finite number above 0 (metres per pixel)")
    origin: Placement = [0.0, 0.0, 0.0]
    negate: Annotated[Literal[0, 1], BeforeValidator(_as_flag)] = 0
    occupied_thresh: Fraction = 0.65
    free_thresh: Fraction = 0.196
    mode: Annotated[Literal["trinary", "scale", "raw"], BeforeValidator(_in_lower_case)] = "trinary"


_GOALS = {"a pose", "one goal", "several goals"}
_TAGS = {"disc", "polygon", "rectangle", "cost", "keep-out", "one-way", "speed"} | _GOALS
"""What pydantic puts into a place beside keys and indices: which kind of an entry it is."""
_KEYS = {
    name
    for model in list(globals().values())
    if isinstance(model, type) and issubclass(model, BaseModel)
    for name in model.model_fields
}

ModelT = TypeVar("ModelT", bound=BaseModel)

_short = reprlib.Repr()
_short.maxstring = 60
_short.maxlist = _short.maxdict = 5
_short.maxlevel = 3


def validate(model: type[ModelT], data: dict[str, Any], path: Path) -> ModelT:
    """Return the data as a model.

    Args:
        model: :class:`WorldFile`, :class:`MapFile` or :class:`RobotFile`.
        data: plain data, as :func:`trailmark.formats.yaml_data.parse_yaml` gives it.
        path: the file it came from, for messages.

    Raises:
        FormatError: the data breaks the model's rules; the message names the first field that does, what pydantic says
            of it and its value, and how many more there are.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        # An unknown key goes first: a key that is missing elsewhere is often the same one, misspelt.
        problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise FormatError(path, _describe(problems[0]) + more) from None


def _describe(problem: Any) -> str:
    *before, last = problem["loc"]
    # Who made up a key may have given it the name of a tag, but for those of goals, which hold a blank.
    where = _where([*(part for part in before if part not in _TAGS), *([] if last in _GOALS else [last])])
    if problem["type"] == "extra_forbidden":
        close = get_close_matches(str(last), _KEYS, n=1)
        return f"{where}: unknown key" + (f" (did you mean {close[0]!r}?)" if close else "")
    message = problem["msg"][0].lower() + problem["msg"][1:]
    return f"{where}: {message}" + ("" if problem["type"] == "missing" else f", got {_short.repr(problem['input'])}")


def _where(location: Sequence[str | int]) -> str:
    # A key that someone made up may hold anything: what is no plain name is quoted and cut.
    named = (part if isinstance(part, int) or part.isidentifier() else _short.repr(part) for part in location)
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in named).removeprefix(".")
