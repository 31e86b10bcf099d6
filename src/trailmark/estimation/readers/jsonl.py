"""trailmark's own log: JSON Lines, one object a line, gzipped if the file's name ends in ``.gz``.

The first line is the header, records follow in the order of time, landmarks stand anywhere among them:

- ``{"trailmark_log": 1, "name": "yard", "cell": 0.1, "whole": true}``: the schema version, what reports call the log,
  the side of the cells of the map by which a robot explored as it took the scans, and whether each increment holds all
  that was driven since the one before, as differences of poses do (all optional but the first);
- ``{"type": "odometry", "t": 0.0, "v": 0.5, "omega": 0.1}``: velocities that hold until the next odometry record;
- ``{"type": "increment", "t", "dx", "dy", "dtheta", "covariance"}``: covariance 3 x 3 (optional);
- ``{"type": "detection", "t", "z", "kind", "identity", "covariance"}``: z two numbers, range and bearing, or x and y
  where kind is ``"cartesian"`` (kind left out is ``"range-bearing"``); identity a whole number (optional); covariance
  2 x 2 (optional);
- ``{"type": "scan", "t", "ranges", "angle_min", "angle_increment", "range_max", "mount", "pose"}``: each range is a
  number of 0 or more, ``"inf"`` where nothing was met, null where the reading was lost; range_max above 0 or
  ``"inf"``; mount and pose [x, y, theta] (optional);
- ``{"type": "pose", "t", "x", "y", "theta", "truth"}``: truth is true or false (left out: false);
- ``{"type": "landmark", "identity", "x", "y"}``: a surveyed feature, for evaluation.

Metres, radians, seconds; the meaning of the fields is that of :mod:`trailmark.estimation.records`. What is
optional may be left out or null. Times may repeat but not go back. Numbers are written with all their digits, so that
reading gives back what was written.
"""

from __future__ import annotations

import gzip
import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import Finite, Positive, Rule, brief, checked, shaped
from trailmark.errors import FormatError, OutputError, expected_name
from trailmark.estimation.covariance import is_covariance
from trailmark.estimation.errors import RecordError
from trailmark.estimation.readers.source import BadRecords, name_of, read_lines
from trailmark.estimation.records import Detection, Increment, Log, Odometry, Pose, Record, Scan
from trailmark.formats.files import write_atomically

__all__ = ["read_jsonl", "write_jsonl"]

_Triple = tuple[Finite, Finite, Finite]

_POSE = {"x": Finite, "y": Finite, "theta": Finite}
_HEADER = {
    "trailmark_log": Annotated[int, Rule("1 (the schema version)", lambda version: version == 1)],
    "name": str,
    "cell": Positive,
    "whole": bool,
}


class Header(NamedTuple):
    """The first line."""

    trailmark_log: int
    name: str | None = None
    cell: Positive | None = None
    whole: bool = False


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


_Ranges = Annotated[list[Any], Rule('a list of numbers of 0 or more, "inf" and null', _are_ranges)]


_BEAMS = {"ranges": _Ranges, "angle_min": Finite, "angle_increment": Finite, "range_max": Positive | Literal["inf"]}
_SEEN = {"z": Annotated[ArrayLike, shaped(2)], "kind": Literal["range-bearing", "cartesian"]}
# For each kind of line what it becomes, and what its fields may hold.
_FORMS: dict[str, tuple[Any, dict[str, Any]]] = {
    "odometry": (Odometry, {"t": Finite, "v": Finite, "omega": Finite}),
    "increment": (Increment, {"t": Finite, "dx": Finite, "dy": Finite, "dtheta": Finite, "covariance": _covariance(3)}),
    "detection": (Detection, {"t": Finite, **_SEEN, "identity": int, "covariance": _covariance(2)}),
    "scan": (Scan, {"t": Finite, **_BEAMS, "mount": _Triple, "pose": _Triple}),
    "pose": (Pose, {"t": Finite, **_POSE, "truth": bool}),
    "landmark": (Landmark, {"identity": int, "x": Finite, "y": Finite}),
}


def _parse(line: str) -> Record | Landmark:
    """Return what a line after the first one holds."""
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


def read_jsonl(path: Path, bad: BadRecords) -> Log:
    """Return the log in a JSON Lines file, gzipped or not; ``bad`` says what becomes of bad lines."""
    lines = read_lines(path, bad)
    try:
        header = Header(**_checked(_object(next(lines, "")), "header", Header, _HEADER))
    except RecordError as error:
        raise FormatError(path, str(error), 1) from None
    records: list[Record] = []
    landmarks: list[tuple[float, float, float]] = []
    latest = -math.inf
    for number, line in enumerate(lines, start=2):
        if not line.strip():
            continue
        try:
            found = _parse(line)
        except RecordError as error:
            bad.report(path, str(error), number)
            continue
        if isinstance(found, Landmark):
            landmarks.append((found.identity, found.x, found.y))
        elif found.t < latest:
            bad.report_late(path, found.t, latest, number)
        else:
            latest = found.t
            records.append(found)
    rows = np.array(landmarks, dtype=np.float64).reshape(-1, 3)
    name = name_of(path) if header.name is None else header.name
    return Log(name, tuple(records), rows, cell=header.cell, whole=bool(header.whole))


def write_jsonl(path: Path, log: Log) -> None:
    """Write a log as JSON Lines, whole or not at all; gzipped if the path ends in ``.gz``.

    ``dropped`` and ``notes``, which tell of another file, are not written.
    """
    header = {"trailmark_log": 1, "name": log.name} | ({} if log.cell is None else {"cell": log.cell})
    header |= {"whole": True} if log.whole else {}
    lines = [json.dumps(header, ensure_ascii=False)]
    lines += (
        json.dumps({"type": "landmark", "identity": int(i), "x": x, "y": y}) for i, x, y in log.landmarks.tolist()
    )
    encode = json.JSONEncoder(default=_plain).encode
    latest = -math.inf
    for i, record in enumerate(log.records):
        line = encode(_data(record))
        try:
            _parse(line)  # what cannot be read back is not written
        except RecordError as error:
            raise OutputError(f"{path}: cannot be written: records[{i}]: {error}") from None
        if record.t < latest:
            raise OutputError(
                f"{path}: cannot be written: records[{i}]: time: expected {latest!r} or later, got {record.t!r}"
            )
        latest = record.t
        lines.append(line)
    data = ("\n".join(lines) + "\n").encode()
    # Without a time of writing in it, the same log gives the same file.
    write_atomically(path, gzip.compress(data, 6, mtime=0) if path.suffix == ".gz" else data)


def _data(record: Record) -> dict[str, Any]:
    """Return a record as the line's object, without what is optional and not there."""
    data = {"type": type(record).__name__.lower(), **record._asdict()}
    if isinstance(record, Scan):
        data |= {"ranges": _words(record.ranges), "range_max": _words([record.range_max])[0]}
    return {key: value for key, value in data.items() if value is not None}


def _words(ranges: ArrayLike) -> list[float | str | None]:
    """Return ranges for JSON, which has no word for infinite and NaN."""
    return [
        None if math.isnan(value) else "inf" if value == math.inf else value
        for value in np.asarray(ranges, dtype=np.float64).tolist()
    ]


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"expected numbers, lists and arrays, got {type(value).__name__}")
