"""Paths as anybody writes them: JSON, CSV, rows of numbers, and nav2's messages as YAML or JSON, GeoJSON."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from trailmark.arguments import brief, real
from trailmark.errors import ConfigurationError, FormatError
from trailmark.formats import files
from trailmark.formats.yaml_data import parse_yaml
from trailmark.se2 import FloatArray, configurations

__all__ = ["PathFile", "read_any_path"]

_HEADINGS = ("theta", "yaw", "heading")
_TIMES = ("t", "time", "stamp", "timestamp")
_QUATERNION = ("qx", "qy", "qz", "qw")
_UNIT = re.compile(r"[ \t]*[\[(](?:m|rad)[\])]")
_NAME = re.compile(r"\s*[\"']?[\w./-]+(?: ?[\[(][^\[(]*[\])])?[\"']?\s*")
_DEPTH = 6
"""Levels of mappings in which a message's poses are sought: they may be wrapped by an action's result or a bridge."""

_ALLOWED = (
    "expected JSON or YAML with states or poses of a nav_msgs/Path, or rows x, y, theta set off by commas or blanks"
)


class PathFile(NamedTuple):
    """What a path file holds.

    Attributes:
        states: shape (n, 3), n >= 1, metres and radians, headings in (-pi, pi].
        headings: the largest heading as it was written, |theta| in radians: more than a full turn looks like degrees.
        positions_only: whether it holds no headings (they are 0 here), which is enough for a disc.
        curve: of a car's path that trailmark planned: ``kind``, ``turning_radius``, ``knots`` and ``places``
            (:meth:`trailmark.CurvePath.record`); None without.
    """

    states: FloatArray
    headings: float
    curve: dict[str, Any] | None = None
    positions_only: bool = False


def read_any_path(path: FilePath) -> PathFile:
    """Read a path file, whose format is recognised by its content.

    - JSON: the record of ``trailmark plan``, an object with ``states`` or a list [[x, y, theta], ...], or a message
      nav_msgs/Path or Trajectory: ``poses`` or ``points`` with positions and quaternions, also inside other objects.
    - GeoJSON: the first line, with its headings as ``properties.theta``, as trailmark writes it.
    - YAML: the same message, as ``ros2 topic echo`` prints it; of several, set off by ``---``, the last complete one.
    - CSV: columns x, y and theta (or yaw, or heading), or a quaternion qx, qy, qz, qw, or x and y alone, by their
      header, in which ``[m]`` and ``[rad]`` may follow, as in trajectories that trailmark writes; or columns without a
      header: three, or two for x and y alone.
    - Rows ``x y theta``, as OMPL's ``printAsMatrix`` writes them, or of TUM's eight ``t x y z qx qy qz qw``.
    - In both, empty lines and comments (#) are skipped, but for one above the rows that names their columns, such as
      numpy.savetxt's ``# theta,x,y``: it is the header.

    Raises:
        FormatError: a missing or unreadable file, no states, or what is none of these; the message says where.
    """
    text = files.read_text(path, _ALLOWED)
    curve = None
    if text.lstrip()[:1] in ("{", "["):
        data = _parse_json(text, path)
        if isinstance(data, dict) and data.get("states") == [] and "status" in data:
            raise FormatError(path, f"expected a path, got a plan without one (status {data['status']!r:.60})")
        states, curve = _states_of_data(data, path), data.get("curve") if isinstance(data, dict) else None
    elif re.search(r"^\s*(poses|points)\s*:", text, re.MULTILINE):
        states = _states_of_documents(text, path)
    else:
        states = _states_of_table(text, path)
    if not states:
        raise FormatError(path, "expected one or more states, got an empty path")
    try:
        rows = np.array(states, dtype=np.float64)
        alone = rows.shape[1:] == (2,)
        rows = np.column_stack([rows, np.zeros(len(rows))]) if alone else rows
        return PathFile(configurations(rows[:, :3], name="path"), float(np.abs(rows[:, 2]).max()), curve, alone)
    except (ConfigurationError, ValueError, OverflowError) as error:
        raise FormatError(path, str(error)) from None


def _states_of_data(data: Any, path: FilePath) -> list[list[float]]:
    """Return the states of a JSON text: a list of rows, an object with ``states``, or a message."""
    if isinstance(data, dict) and "states" in data:
        data = data["states"]
    elif isinstance(data, dict) and isinstance(data.get("features"), list):
        data = _line(data["features"], path)
    if isinstance(data, list):
        return _state_rows(data, path)
    poses = _poses(data)
    if poses is None:
        raise FormatError(path, "expected states [[x, y, theta], ...], or poses of a nav_msgs/Path, got neither")
    return [_state_of_pose(entry, i, path) for i, entry in enumerate(poses)]


def _parse_json(text: str, path: FilePath) -> Any:
    """Return what a JSON text says."""
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise FormatError(path, f"not valid JSON: {error.msg}", error.lineno) from None
    except (RecursionError, ValueError):
        raise FormatError(path, "not valid JSON: nested too deeply or a number too long") from None


def _state_rows(states: list[Any], path: FilePath) -> list[list[float]]:
    """Return a list of states as it is if each is three numbers, or each two: x and y alone."""
    count = 2 if all(isinstance(row, list) and len(row) == 2 for row in states) else 3
    for i, row in enumerate(states):
        if not (isinstance(row, list) and len(row) == count and all(type(v) in (int, float) for v in row)):
            raise FormatError(path, f"states[{i}]: expected three numbers [x, y, theta], got {str(row)[:60]}")
    return states


def _states_of_documents(text: str, path: FilePath) -> list[list[float]]:
    """Return the states of the last complete one of some YAML documents that each hold a message."""
    documents, line = [], 0
    for part in re.split(r"^---[ \t]*\r?$", text, flags=re.MULTILINE):
        if "poses" in part or "points" in part:
            # Empty lines before it, so that messages name the file's lines.
            documents.append("\n" * line + part)
        line += part.count("\n")
    problem: FormatError | None = None
    for document in reversed(documents):
        try:
            return _states_of_data(parse_yaml(document, path), path)
        except FormatError as error:
            # The last one may be cut off where the recording ended; the first one found is the one to be told of.
            problem = problem or error
    raise problem or FormatError(path, "expected poses of a nav_msgs/Path, got none in any document")


def _line(features: list[Any], path: FilePath) -> list[Any]:
    """Return rows x, y, theta of the first line of GeoJSON's features."""
    for i, feature in enumerate(features):
        geometry, properties = (_member(feature, name) for name in ("geometry", "properties"))
        if geometry.get("type") != "LineString":
            continue
        positions, headings = geometry.get("coordinates"), properties.get("theta")
        if isinstance(positions, list) and headings is None:
            return [at[:2] if isinstance(at, list) else at for at in positions]
        if not (isinstance(positions, list) and isinstance(headings, list) and len(positions) == len(headings)):
            allowed = "coordinates with as many headings properties.theta"
            raise FormatError(path, f"features[{i}]: expected {allowed}, got {brief(headings)}")
        pairs = zip(positions, headings, strict=True)
        return [[*at, theta] if isinstance(at, list) else at for at, theta in pairs]
    raise FormatError(path, "expected a LineString among the features, got none")


def _member(data: Any, name: str) -> dict[str, Any]:
    value = data.get(name) if isinstance(data, dict) else None
    return value if isinstance(value, dict) else {}


def _poses(data: Any, depth: int = _DEPTH) -> list[Any] | None:
    """Return the list ``poses`` or ``points`` of a message, wherever in other objects it is; None if there is none."""
    if not isinstance(data, dict) or depth == 0:
        return None
    for key in ("poses", "points"):
        if isinstance(data.get(key), list):
            return list(data[key])
    found = (_poses(value, depth - 1) for value in data.values())
    return next((poses for poses in found if poses is not None), None)


def _state_of_pose(entry: Any, i: int, path: FilePath) -> list[float]:
    """Return x, y and heading of a PoseStamped or a Pose."""
    if entry == "...":
        raise FormatError(path, f"poses[{i}]: the message was cut where it was printed; print it with --full-length")
    pose = entry.get("pose", entry) if isinstance(entry, dict) else None
    parts = [pose.get(name) if isinstance(pose, dict) else None for name in ("position", "orientation")]
    wanted = (("x", "y"), ("x", "y", "z", "w"))
    values = [
        real(part.get(key)) if isinstance(part, dict) else math.nan
        for part, keys in zip(parts, wanted, strict=True)
        for key in keys
    ]
    if not all(map(math.isfinite, values)):
        allowed = "finite numbers position {x, y} and orientation {x, y, z, w}"
        raise FormatError(path, f"poses[{i}]: expected {allowed}, got {brief(entry)}")
    if not any(values[2:]):
        raise FormatError(path, f"poses[{i}].orientation: expected a quaternion, got all zeros")
    return [*values[:2], _heading(*values[2:])]


def _heading(*quaternion: float) -> float:
    """Return the heading of a quaternion x, y, z, w of any length but 0."""
    # Only its direction counts: squares of the largest and smallest numbers are none.
    x, y, z, w = (v / max(map(abs, quaternion)) for v in quaternion)
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def _states_of_table(text: str, path: FilePath) -> list[list[float]]:
    """Return the states of rows, whose columns are set off by commas, semicolons or blanks."""
    lines = [(n, line) for n, line in enumerate(map(str.strip, text.splitlines()), start=1) if line]
    rows = [(n, line) for n, line in lines if not line.startswith("#")]
    if not rows:
        return []
    number, first = rows[0]
    separator = next((mark for mark in ",;" if mark in first), None)
    names = _names(first, separator)
    count, columns = 3, [0, 1, 2]
    if any(map(_is_number, names)):
        count, columns = {2: (2, [0, 1]), 8: (8, [1, 2, 4, 5, 6, 7])}.get(len(names), (count, columns))
        comments = [(n, line) for n, line in lines if n < number]
        if (commented := _commented_columns(comments, separator, len(names), path)) is not None:
            count, columns = len(names), commented
    elif (named := _columns(names)) is not None:
        count, columns, rows = len(names), named, rows[1:]
    else:
        allowed = f"{_ALLOWED} and columns x, y, theta (or yaw, heading)"
        raise FormatError(path, f"no path; {allowed}, got {brief(first)}", number)
    states = []
    for n, line in rows:
        fields = line.split(separator)
        row = [float(fields[k]) if _is_number(fields[k]) else math.nan for k in columns] if len(fields) == count else []
        what = {2: "x, y", 3: "x, y, theta"}.get(len(columns), "x, y and a quaternion, not all 0,")
        if not row or not all(map(math.isfinite, row)) or (len(row) == 6 and not any(row[2:])):
            raise FormatError(path, f"expected {count} columns, {what} finite numbers, got row {brief(line)}", n)
        states.append([*row[:2], _heading(*row[2:])] if len(row) == 6 else row)
    return states


def _names(line: str, separator: str | None) -> list[str]:
    """Return a line's fields as names of columns: without quotes, and without the units that are expected."""
    words = (_UNIT.sub("", line) if separator is None else line).split(separator)
    names = [_UNIT.sub("", word.strip().strip("\"'").lower()) for word in words]
    return [{"tx": "x", "ty": "y"}.get(name, name) for name in names]  # as TUM's tools call them


def _columns(names: list[str]) -> list[int] | None:
    """Return which columns are x, y and the heading, or a quaternion, or x and y alone; None if not both are named."""
    if not {"x", "y"} <= set(names):
        return None
    heading = next((name for name in _HEADINGS if name in names), None)
    turned = [heading] if heading else list(_QUATERNION) if set(_QUATERNION) <= set(names) else []
    if not turned and set(names) - {"x", "y", *_TIMES}:
        return None  # one of the others may be the heading
    return [names.index(name) for name in ("x", "y", *turned)]


def _commented_columns(
    comments: list[tuple[int, str]], separator: str | None, count: int, path: FilePath
) -> list[int] | None:
    """Return the columns that comments above the first row name, as numpy.savetxt writes a header; None without names.

    Raises:
        FormatError: a comment that names columns, but not so that they could be told.
    """
    problem: FormatError | None = None
    for number, line in reversed(comments):
        text = line.lstrip("# ")
        for mark in dict.fromkeys((separator, ",", ";", None)):
            names = _names(text, mark)
            if len(names) == count and (columns := _columns(names)) is not None:
                return columns
        known = [word for word in re.findall(r"\w+", text.lower()) if word in ("x", "y", *_HEADINGS, *_QUATERNION)]
        fields = text.split(separator)
        alike = separator is not None and len(fields) == count and all(map(_NAME.fullmatch, fields))
        # Words of a sentence may name them in the order that rows without a header have.
        in_order = count == 3 and known[:2] == ["x", "y"]
        if alike or (len(known) > 1 and (len(text.split()) == count or not in_order)):
            named = f"{count} columns with x, y, theta (or yaw, heading) among them"
            problem = FormatError(path, f"a comment that names columns: expected {named}, got {brief(line)}", number)
    if problem is not None:
        raise problem
    return None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
