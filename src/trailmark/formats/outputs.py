"""Which files an output may replace: none that was read, none that trailmark could not have written itself."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path

from trailmark.errors import OutputError
from trailmark.formats import geojson, nav2_messages, path_files, trajectory_files, world_yaml
from trailmark.formats.files import MAX_FILE_BYTES

__all__ = ["is_world_file", "require_not_an_input", "require_replaceable"]

MARKS = {
    ".png": b"Software\0trailmark",
    ".svg": b"<dc:title>trailmark</dc:title>",
    ".pdf": b"/Creator (trailmark)",
    ".html": b'<meta name="generator" content="trailmark">',
    ".htm": b'<meta name="generator" content="trailmark">',
    ".md": b"Written by `trailmark report`",
    ".log": b"trailmark version",
    ".geojson": geojson.MARK.encode(),
    ".graphml": b"trailmark_roadmap",
    ".npz": b"fingerprint.npy",
    ".gif": b"Written by trailmark",
    ".pgm": b"# CREATOR: trailmark\n",
    ".jsonl": b'{"trailmark_log":',
}
"""What stands near the beginning or the end of the files that trailmark writes and never reads."""

_HEAD, _TAIL = 2**16, 2**12
"""Bytes at a file's beginning and end that are read; JSON is read whole."""

_WORLD = re.compile(r"^trailmark[ \t]*:[ \t]*1[ \t]*(?:#.*)?\r?$", re.MULTILINE)


def require_not_an_input(path: Path, inputs: Iterable[Path]) -> None:
    """Raise if the path is one of the inputs, by whatever name: links, ``./``, other case where that is the same file.

    Args:
        path: the file to be written.
        inputs: files that were read.

    Raises:
        OutputError: it is one of them.
    """
    for other in inputs:
        if _same(path, other):
            name = "" if path.absolute() == other.absolute() else f" {str(other)!r}"
            raise OutputError(f"{path}: is the same file as the input{name}; expected another file")


def require_replaceable(path: Path) -> None:
    """Raise if there is a file that trailmark could not have written under that name; its suffix tells the format.

    An empty file may be replaced.

    Raises:
        OutputError: there is a picture, a table, a map or whatever else of somebody's own.
    """
    try:
        if not path.is_file():
            return
        with path.open("rb") as file:
            head = file.read(MAX_FILE_BYTES if path.suffix.lower() == ".json" else _HEAD)
            file.seek(max(len(head), path.stat().st_size - _TAIL))
            tail = file.read(_TAIL)
    except (OSError, ValueError):
        return  # what cannot be read is not judged; writing to it raises an error of its own
    kind = path.suffix.lower()
    if head.strip() and not _own(kind, head, tail):
        raise OutputError(
            f"{path}: a file that trailmark did not write is there; expected a new file, or one to write again"
        )


def is_world_file(path: Path) -> bool:
    """Return whether a file is a trailmark world file, whoever wrote it, as far as its keys tell."""
    try:
        with path.open("rb") as file:
            return _WORLD.search(file.read(_HEAD).decode("utf-8", "replace")) is not None
    except (OSError, ValueError):
        return False


def _same(path: Path, other: Path) -> bool:
    try:
        return path.is_file() and path.samefile(other)
    except (OSError, ValueError, RuntimeError):  # one that cannot be found is not that file
        return False


def _own(kind: str, head: bytes, tail: bytes) -> bool:
    if kind in MARKS:
        return MARKS[kind] in head or MARKS[kind] in tail
    if b"\0" in head:
        return False
    text = head.decode("utf-8", "replace")
    if kind in (".yaml", ".yml"):
        return text.startswith((nav2_messages.YAML_MARK, world_yaml.HEADER))
    if kind == ".json":
        return text.startswith(nav2_messages.JSON_MARK) or _own_json(text)
    if kind == ".csv":
        header, _, rows = text.partition("\n")
        if header in (path_files.CSV_HEADER, trajectory_files.HEADER):
            return _own_rows(rows, ",", header.count(",") + 1, whole=not tail)
        return False
    if kind in (".path", ".txt"):
        return _own_rows(text, " ", 3, whole=not tail)
    return True


def _own_rows(text: str, separator: str, columns: int, whole: bool) -> bool:
    """Return whether rows of numbers are written as trailmark does: 0.5 and 1e-07, neither .5 nor 0.50."""
    *lines, cut = text.split("\n")
    if whole and cut:
        return False
    try:
        return all(
            len(row) == columns and all(repr(float(number)) == number for number in row)
            for row in (line.split(separator) for line in lines)
        )
    except ValueError:
        return False


def _own_json(text: str) -> bool:
    """Return whether JSON is one of our records: of a path with its cost, of a plan, of an exploration."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        return False
    if not isinstance(data, dict):
        return False
    if "states" not in data:
        return {"status", "strategy", "seen"} <= data.keys()
    rows = data["states"]
    return bool({"cost", "status"} & data.keys() and isinstance(rows, list)) and all(
        isinstance(row, list) and len(row) == 3 and all(isinstance(number, float) for number in row) for row in rows
    )
