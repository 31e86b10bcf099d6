"""Path files as trailmark writes them: its own JSON, CSV, rows as OMPL.app has them, nav2's messages, GeoJSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.errors import OutputError
from trailmark.formats import files, geojson, nav2_messages
from trailmark.path import Path

__all__ = ["CSV_HEADER", "SUFFIXES", "write_path"]

SUFFIXES = (".json", ".csv", ".path", ".txt", ".yaml", ".yml", ".nav2.json", ".geojson")
"""What a path file's suffix may be: it tells the format."""

CSV_HEADER = "x,y,theta"


def write_path(
    path: FilePath, states: ArrayLike | Path, record: Mapping[str, Any] | None = None, frame: str = "map"
) -> None:
    """Write a path, whole or not at all; every number is written with all its digits.

    - ``.json``: one object: ``record`` with ``states`` as a list of [x, y, theta]; without a record, the states and
      their cost, length and rotation.
    - ``.csv``: the header ``x,y,theta``, then one row a state.
    - ``.path``, ``.txt``: rows ``x y theta``, as OMPL.app publishes its solutions.
    - ``.yaml``, ``.nav2.json``: ``nav_msgs/msg/Path`` (:mod:`trailmark.formats.nav2_messages`).
    - ``.geojson``: a line with the headings as ``properties.theta`` (:mod:`trailmark.formats.geojson`).

    Args:
        path: where to; its suffix tells the format.
        states: shape (n, 3), metres and radians, or a Path.
        record: what else a JSON file says; other formats hold the states alone.
        frame: name of the coordinate frame, for messages and GeoJSON.

    Raises:
        ConfigurationError: states of another shape or not finite.
        OutputError: the path cannot be written, or JSON cannot hold the record.
    """
    files.check_writable(path, SUFFIXES)
    checked = states if isinstance(states, Path) else Path(np.asarray(states, dtype=np.float64))
    rows = [[repr(value) for value in row] for row in checked.states.tolist()]
    name, suffix = path.name.lower(), path.suffix.lower()
    if suffix in (".yaml", ".yml") or name.endswith(".nav2.json"):
        message = nav2_messages.path_message(checked.states, frame)
        text = nav2_messages.message_text(message, "nav_msgs/msg/Path", as_json=suffix == ".json")
    elif suffix == ".geojson":
        text = geojson.path_text(checked, frame)
    elif suffix == ".json":
        text = _json_text(path, checked, rows, record)
    elif suffix == ".csv":
        text = "\n".join([CSV_HEADER, *map(",".join, rows)]) + "\n"
    else:
        text = "\n".join(map(" ".join, rows)) + "\n"
    files.write_atomically(path, text)


def _json_text(path: FilePath, checked: Path, rows: list[list[str]], record: Mapping[str, Any] | None) -> str:
    if record is None:
        record = {"states": None, "cost": checked.cost, "length": checked.length, "rotation": checked.rotation}
        curve = getattr(checked, "record", None)  # of a car's path
        record |= {} if curve is None else {"curve": curve()}
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
