"""What may stand in a line of trailmark's own log, and one-line messages about the rest.

Strict: a number is not given as text or boolean, NaN and infinity are refused (but for the word ``"inf"`` where a range
may be infinite), and so are unknown fields. What may be left out may be null, too.
"""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief
from trailmark.checked import Finite, Positive, Rule, checked, shaped
from trailmark.errors import expected_name
from trailmark.estimation.errors import RecordError
from trailmark.estimation.filter.covariance import is_covariance
from trailmark.estimation.logs.records import Detection, Increment, Odometry, Pose, Record, Scan

__all__ = ["Header", "Landmark", "parse", "parse_header"]


class Header(NamedTuple):
    """The first line."""

    trailmark_log: int
    """The schema version."""
    name: str | None = None
    """What reports call the log."""
    cell: Positive | None = None
    """Metres: side of the cells of the map by which a robot explored as it took the scans."""


class Landmark(NamedTuple):
    """A surveyed feature, for evaluation."""

    identity: int
    x: float
    y: float


def _covariance(size: int) -> Any:
    text = f"{size} rows of {size} finite numbers, symmetric and not negative"
    return Annotated[ArrayLike, Rule(text, lambda matrix: is_covariance(matrix, size))]


def _are_ranges(values: list[Any]) -> bool:
    found = [value for value in values if value is not None and value != "inf"]
    return {type(value) for value in found} <= {int, float} and all(0.0 <= value < np.inf for value in found)


_Triple = tuple[Finite, Finite, Finite]
_Ranges = Annotated[list[Any], Rule('a list of numbers of 0 or more, "inf" and null', _are_ranges)]
_POSE = {"x": Finite, "y": Finite, "theta": Finite}
_BEAMS = {"ranges": _Ranges, "angle_min": Finite, "angle_increment": Finite, "range_max": Positive | Literal["inf"]}
_HEADER = {
    "trailmark_log": Annotated[int, Rule("1 (the schema version)", lambda version: version == 1)],
    "name": str,
    "cell": Positive,
}

_FORMS: dict[str, tuple[Any, dict[str, Any]]] = {
    "odometry": (Odometry, {"t": Finite, "v": Finite, "omega": Finite}),
    "increment": (Increment, {"t": Finite, "dx": Finite, "dy": Finite, "dtheta": Finite, "covariance": _covariance(3)}),
    "detection": (
        Detection,
        {
            "t": Finite,
            "z": Annotated[ArrayLike, shaped(2)],
            "kind": Literal["range-bearing", "cartesian"],
            "identity": int,
            "covariance": _covariance(2),
        },
    ),
    "scan": (Scan, {"t": Finite, **_BEAMS, "mount": _Triple, "pose": _Triple}),
    "pose": (Pose, {"t": Finite, **_POSE, "truth": bool}),
    "landmark": (Landmark, {"identity": int, "x": Finite, "y": Finite}),
}
"""For each kind of line what it becomes, and what its fields may hold."""


def parse_header(line: str) -> Header:
    """Return the first line of a log.

    Raises:
        RecordError: it is not the header; the message says what was expected and what was given.
    """
    return Header(**_checked(_object(line), "header", Header, _HEADER))


def parse(line: str) -> Record | Landmark:
    """Return what a line after the first one holds.

    Raises:
        RecordError: no record; the message says what was expected and what was given.
    """
    data = _object(line)
    kind = data.pop("type", None)
    if not isinstance(kind, str) or kind not in _FORMS:
        raise RecordError(f"type: {expected_name(str(kind), _FORMS)}")
    becomes, form = _FORMS[kind]
    values = _checked(data, kind, becomes, form)
    if becomes is Scan:
        # None is NaN, and the word inf what it says.
        values |= {"ranges": np.array(values["ranges"], dtype=np.float64), "range_max": float(values["range_max"])}
    if values.get("z") is not None and data.get("kind") != "cartesian" and values["z"][0] < 0.0:
        raise RecordError(f"detection: range: expected 0 or more, got {values['z'][0]:g}")
    record: Record | Landmark = becomes(**values)
    return record


def _object(line: str) -> dict[str, Any]:
    try:
        data = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise RecordError(f"not valid JSON: {error}") from None
    if not isinstance(data, dict):
        raise RecordError(f"expected a JSON object, got {brief(data)}")
    return data


def _checked(data: dict[str, Any], kind: str, becomes: Any, form: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of an object, those left out that are null and may be."""
    # An unknown field goes first: a field that is missing is often the same one, misspelt.
    for name in data:
        if name not in form:
            raise RecordError(f"{kind}: field: {expected_name(name, form)}")
    optional = becomes._field_defaults
    data = {name: value for name, value in data.items() if value is not None or name not in optional}
    for name in form:
        if name not in data and name not in optional:
            raise RecordError(f"{kind}: expected a field {name!r}, got none")
    return {name: checked(value, form[name], f"{kind}: {name}", RecordError) for name, value in data.items()}
