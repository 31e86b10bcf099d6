"""Path files: JSON (the record that ``trailmark plan`` prints), CSV, and plain rows as nav2 and OMPL.app use them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.errors import ConfigurationError, FormatError, OutputError, expected_name
from trailmark.formats import files
from trailmark.path import Path

__all__ = ["SUFFIXES", "check_writable", "parse_json", "read_path", "state_rows", "write_path"]

SUFFIXES = (".json", ".csv", ".path", ".txt")
"""What a path file's suffix may be: it tells the format."""

_CSV_HEADER = "x,y,theta"


def check_writable(path: FilePath) -> None:
    """Raise if a path file cannot be written there; to be asked before planning starts.

    Raises:
        OutputError: unknown suffix, missing directory, a path that is a directory, no permission.
    """
    files.check_writable(path, SUFFIXES)


def write_path(path: FilePath, states: ArrayLike | Path, record: Mapping[str, Any] | None = None) -> None:
    """Write a path, whole or not at all; every number is written with all its digits.

    - ``.json``: one object: ``record`` with ``states`` as a list of [x, y, theta]; without a record, the states and
      their cost, length and rotation.
    - ``.csv``: the header ``x,y,theta``, then one row a state.
    - ``.path``, ``.txt``: rows ``x y theta``, as OMPL.app publishes its solutions.

    Args:
        path: where to; its suffix tells the format.
        states: shape (n, 3), metres and radians, or a Path.
        record: what else a JSON file says; other formats hold the states alone.

    Raises:
        ConfigurationError: states of another shape or not finite.
        OutputError: the path cannot be written, or JSON cannot hold the record.
    """
    files_suffix = path.suffix.lower()
    checked = states if isinstance(states, Path) else Path(np.asarray(states, dtype=np.float64))
    if files_suffix not in SUFFIXES:
        raise OutputError(f"{path}: suffix: {expected_name(files_suffix, SUFFIXES)}")
    rows = [[repr(value) for value in row] for row in checked.states.tolist()]
    if files_suffix == ".json":
        text = _json_text(path, checked, rows, record)
    elif files_suffix == ".csv":
        text = "\n".join([_CSV_HEADER, *map(",".join, rows)]) + "\n"
    else:
        text = "\n".join(map(" ".join, rows)) + "\n"
    files.write_atomically(path, text)


def read_path(path: FilePath) -> Path:
    """Read a path file; its suffix tells the format, as in :func:`write_path`.

    Rows of ``.path`` and ``.txt`` are set off by blanks; empty lines and lines that begin with ``#`` are skipped.

    Raises:
        FormatError: unknown suffix, missing or unreadable file, no states, or a row that is not three finite numbers.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FormatError(path, f"suffix: {expected_name(suffix, SUFFIXES)}")
    text = files.read_text(path)
    separator = "," if suffix == ".csv" else None
    states = _json_states(text, path) if suffix == ".json" else _rows(text, path, separator)
    if not states:
        raise FormatError(path, "expected one or more rows x, y, theta, got no states")
    try:
        return Path(np.array(states, dtype=np.float64))
    except (ConfigurationError, ValueError, OverflowError) as error:
        raise FormatError(path, str(error)) from None


def _json_text(path: FilePath, checked: Path, rows: list[list[str]], record: Mapping[str, Any] | None) -> str:
    if record is None:
        record = {"states": None, "cost": checked.cost, "length": checked.length, "rotation": checked.rotation}
    states = "[\n" + ",\n".join(f"    [{', '.join(row)}]" for row in rows) + "\n  ]"
    try:
        members = {
            key: states if key == "states" else json.dumps(value, allow_nan=False, default=_plain)
            for key, value in (record if "states" in record else {"states": None, **record}).items()
        }
    except (TypeError, ValueError) as error:
        raise OutputError(f"{path}: cannot be written: the record holds what JSON cannot: {error}") from None
    return "{\n" + ",\n".join(f"  {json.dumps(key)}: {value}" for key, value in members.items()) + "\n}\n"


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} {value!r}")


def _json_states(text: str, path: FilePath) -> list[list[float]]:
    record = parse_json(text, path)
    states = record.get("states") if isinstance(record, dict) else None
    if not isinstance(states, list):
        raise FormatError(path, "expected an object with states [[x, y, theta], ...], got no list 'states'")
    return state_rows(states, path)


def parse_json(text: str, path: FilePath) -> Any:
    """Return what a JSON text says.

    Raises:
        FormatError: it is none.
    """
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise FormatError(path, f"not valid JSON: {error.msg}", error.lineno) from None
    except (RecursionError, ValueError):
        raise FormatError(path, "not valid JSON: nested too deeply or a number too long") from None


def state_rows(states: list[Any], path: FilePath) -> list[list[float]]:
    """Return a list of states as it is if each is three numbers.

    Raises:
        FormatError: one is not.
    """
    for i, row in enumerate(states):
        if not (isinstance(row, list) and len(row) == 3 and all(type(v) in (int, float) for v in row)):
            raise FormatError(path, f"states[{i}]: expected three numbers [x, y, theta], got {str(row)[:60]}")
    return states


def _rows(text: str, path: FilePath, separator: str | None) -> list[list[float]]:
    lines = text.splitlines()
    skip = 0
    if separator is not None:
        header = [name.strip() for name in lines[0].split(separator)] if lines else []
        if header != _CSV_HEADER.split(","):
            raise FormatError(path, f"expected {_CSV_HEADER}, got header {','.join(header)[:60]!r}", 1)
        skip = 1
    states = []
    for number, line in enumerate(lines[skip:], start=skip + 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            row = [float(field) for field in line.split(separator)]
        except ValueError:
            row = []
        if len(row) != 3 or not all(map(math.isfinite, row)):
            given = line.strip()[:60]
            raise FormatError(path, f"expected three finite numbers x, y, theta, got row {given!r}", number)
        states.append(row)
    return states
