"""What may stand in a line of trailmark's own log, as pydantic models, and one-line messages about the rest.

Strict: a number is not given as text or boolean, NaN and infinity are refused (but for the word ``"inf"`` where a range
may be infinite), and so are unknown fields.
"""

from __future__ import annotations

import reprlib
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from trailmark.errors import did_you_mean
from trailmark.estimation.logs.records import Detection, Increment, Odometry, Pose, Record, Scan
from trailmark.se2 import FloatArray

__all__ = ["Header", "Landmark", "header", "log_json_schema", "parse"]

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Range = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0)] | Literal["inf"] | None
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]
Covariance2 = Annotated[list[Pair], Field(min_length=2, max_length=2)]
Covariance3 = Annotated[list[Triple], Field(min_length=3, max_length=3)]

_NUMBER = "a finite number"
_POSE = "[x, y, theta] of finite numbers"
_RANGES = 'a list of numbers of 0 or more, "inf" and null'


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Header(_Strict):
    """The first line."""

    trailmark_log: Annotated[int, Field(strict=True, ge=1, le=1)] = Field(description="1 (the schema version)")
    name: Annotated[str, Field(strict=True)] | None = Field(default=None, description="a text")


class Landmark(_Strict):
    """A surveyed feature, for evaluation."""

    type: Literal["landmark"]
    identity: Whole = Field(description="a whole number")
    x: Number = Field(description=_NUMBER)
    y: Number = Field(description=_NUMBER)


class OdometryLine(_Strict):
    """Velocities that hold until the next odometry record."""

    type: Literal["odometry"]
    t: Number = Field(description=_NUMBER)
    v: Number = Field(description=_NUMBER)
    omega: Number = Field(description=_NUMBER)

    def record(self) -> Odometry:
        """Return the record."""
        return Odometry(self.t, self.v, self.omega)


class IncrementLine(_Strict):
    """A motion since the last increment, in the robot's frame before it."""

    type: Literal["increment"]
    t: Number = Field(description=_NUMBER)
    dx: Number = Field(description=_NUMBER)
    dy: Number = Field(description=_NUMBER)
    dtheta: Number = Field(description=_NUMBER)
    covariance: Covariance3 | None = Field(default=None, description="three rows of three finite numbers")

    def record(self) -> Increment:
        """Return the record; ValueError if the covariance is none."""
        return Increment(self.t, self.dx, self.dy, self.dtheta, _covariance(self.covariance))


class DetectionLine(_Strict):
    """One feature seen from the robot."""

    type: Literal["detection"]
    t: Number = Field(description=_NUMBER)
    z: Pair = Field(description="two finite numbers")
    kind: Literal["range-bearing", "cartesian"] = Field(default="range-bearing", description="range-bearing, cartesian")
    identity: Whole | None = Field(default=None, description="a whole number")
    covariance: Covariance2 | None = Field(default=None, description="two rows of two finite numbers")

    def record(self) -> Detection:
        """Return the record; ValueError for a negative range or if the covariance is none."""
        if self.kind == "range-bearing" and self.z[0] < 0.0:
            raise ValueError(f"detection: range {self.z[0]:g} given, allowed: 0 or more")
        return Detection(self.t, np.array(self.z), self.kind, self.identity, _covariance(self.covariance))


class ScanLine(_Strict):
    """One sweep of a laser scanner."""

    type: Literal["scan"]
    t: Number = Field(description=_NUMBER)
    ranges: list[Range] = Field(description=_RANGES)
    angle_min: Number = Field(description=_NUMBER)
    angle_increment: Number = Field(description=_NUMBER)
    range_max: Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0)] | Literal["inf"] = Field(
        description='a number above 0 or "inf"'
    )
    mount: Triple | None = Field(default=None, description=_POSE)
    pose: Triple | None = Field(default=None, description=_POSE)

    def record(self) -> Scan:
        """Return the record."""
        # numpy reads None as NaN and the word inf as what it says.
        ranges = np.array(self.ranges, dtype=np.float64)
        geometry = (self.angle_min, self.angle_increment, float(self.range_max))
        mount = (0.0, 0.0, 0.0) if self.mount is None else _triple(self.mount)
        return Scan(self.t, ranges, *geometry, mount, None if self.pose is None else _triple(self.pose))


class PoseLine(_Strict):
    """Where the robot was, by the log."""

    type: Literal["pose"]
    t: Number = Field(description=_NUMBER)
    x: Number = Field(description=_NUMBER)
    y: Number = Field(description=_NUMBER)
    theta: Number = Field(description=_NUMBER)
    truth: Annotated[bool, Field(strict=True)] = Field(default=False, description="true or false")

    def record(self) -> Pose:
        """Return the record."""
        return Pose(self.t, self.x, self.y, self.theta, self.truth)


Line = OdometryLine | IncrementLine | DetectionLine | ScanLine | PoseLine | Landmark
_MODELS: dict[str, type[BaseModel]] = {
    "odometry": OdometryLine,
    "increment": IncrementLine,
    "detection": DetectionLine,
    "scan": ScanLine,
    "pose": PoseLine,
    "landmark": Landmark,
}
_LINE: TypeAdapter[Line] = TypeAdapter(Annotated[Line, Field(discriminator="type")])

_short = reprlib.Repr()
_short.maxstring = 60
_short.maxlist = _short.maxdict = 5
_short.maxlevel = 3


def header(line: str) -> Header:
    """Return the first line of a log.

    Raises:
        ValueError: it is not the header; the message says what was given and what is allowed.
    """
    try:
        return Header.model_validate_json(line)
    except ValidationError as error:
        raise ValueError(_problem(error, Header)) from None


def parse(line: str) -> Record | Landmark:
    """Return what a line after the first one holds.

    Raises:
        ValueError: no record; the message says what was given and what is allowed.
    """
    try:
        found = _LINE.validate_json(line)
    except ValidationError as error:
        raise ValueError(_problem(error)) from None
    return found if isinstance(found, Landmark) else found.record()


def log_json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of one line of a log."""
    schema = TypeAdapter(Header | Line).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "trailmark log line", **schema}


def _problem(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """Return the first problem of a header (``model``) or of another line as one line."""
    # An unknown field goes first: a field that is missing is often the same one, misspelt.
    problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
    first = problems[0]
    kind, loc = "header", list(first["loc"])
    if first["type"] == "json_invalid":
        return f"not valid JSON: {first['ctx']['error']}"
    if model is None and loc:
        kind = str(loc.pop(0))
        model = _MODELS[kind]
    if model is None or not loc:
        if not isinstance(first["input"], dict):
            return f"{_short.repr(first['input'])} given, allowed: a JSON object"
        given = first["input"].get("type")
        return f"type {_short.repr(given)} given, {did_you_mean(str(given), _MODELS)}"
    field = str(loc[0])
    if first["type"] == "extra_forbidden":
        return f"{kind}: unknown field {field!r} given, {did_you_mean(field, model.model_fields)}"
    allowed = model.model_fields[field].description
    if first["type"] == "missing":
        return f"{kind}: no field {field!r} given, allowed: {allowed}"
    place = field + "".join(f"[{i}]" for i in loc[1:] if isinstance(i, int))
    return f"{kind}: {place} {' '.join(_short.repr(first['input']).split())} given, allowed: {allowed}"


def _covariance(rows: list[list[float]] | None) -> FloatArray | None:
    if rows is None:
        return None
    matrix = np.array(rows)
    spread = np.linalg.eigvalsh(matrix)
    if not np.array_equal(matrix, matrix.T) or spread[0] < -1e-9 * abs(spread[-1]):
        raise ValueError(f"covariance {_short.repr(rows)} given, allowed: symmetric, not negative")
    return matrix


def _triple(values: list[float]) -> tuple[float, float, float]:
    x, y, theta = values
    return x, y, theta
