"""What the readers of text logs share: lines of a file, gzipped or not, tables of numbers, and bad records."""

# Tested by tests/estimation/logs/test_source.py.

from __future__ import annotations

import gzip
import io
import math
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.formats.files import MAX_FILE_BYTES, read_bytes
from trailmark.se2 import FloatArray

__all__ = [
    "BadRecords",
    "Table",
    "in_order",
    "name_of",
    "numbers",
    "read_data",
    "read_head",
    "read_lines",
    "read_table",
]

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_GZIP = b"\x1f\x8b"
_PIECE = 2**20


class BadRecords:
    """What becomes of a bad record: an error that names file and line, or one more on the count.

    Args:
        skip: whether bad records are left out and counted.
    """

    def __init__(self, skip: bool) -> None:
        self.skip = skip
        self.dropped = 0

    def report(self, path: Path, problem: str, line: int | None = None, count: int = 1) -> None:
        """Count the bad records, or raise for the first of them.

        Raises:
            FormatError: bad records are not to be skipped.
        """
        if not self.skip:
            raise FormatError(path, f"{problem} (--skip-bad leaves it out)", line)
        self.dropped += count

    def report_late(self, path: Path, t: float, latest: float, line: int | None = None, name: str = "") -> None:
        """Count a record whose time goes back, or raise for the first of them; ``name`` begins the message."""
        self.report(path, f"{name}time: expected {latest!r} or later, got {t!r}", line)


class Table(NamedTuple):
    """Rows of numbers and where they stood."""

    lines: IntArray
    """1-based line numbers, shape (n,)."""
    values: FloatArray
    """Shape (n, columns), all finite."""

    def keep(self, good: BoolArray) -> Table:
        """Return the rows for which ``good``, shape (n,), holds."""
        return self if good.all() else Table(self.lines[good], self.values[good])


def read_head(path: Path, size: int) -> bytes:
    """Return the first ``size`` bytes of a file, unpacked if it is gzipped.

    Raises:
        FormatError: missing, unreadable, or a broken gzip stream.
    """
    try:
        with path.open("rb") as file:
            packed = file.read(len(_GZIP)) == _GZIP
            file.seek(0)
            if not packed:
                return file.read(size)
            with gzip.GzipFile(fileobj=file) as unpacked:
                return unpacked.read(size)
    except (OSError, ValueError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise FormatError(path, f"cannot be read: {reason}") from None


def read_data(path: Path, limit: int = MAX_FILE_BYTES) -> bytes:
    """Return the content of a file, unpacked if it is gzipped (recognised by its first bytes).

    Raises:
        FormatError: missing, unreadable, a broken gzip stream, or larger than ``limit`` bytes, packed or not.
    """
    data = read_bytes(path, limit)
    if not data.startswith(_GZIP):
        return data
    try:
        # Counted first, piece by piece: what grows a thousandfold is refused before it takes the memory.
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as file:
            size = 0
            while piece := file.read(_PIECE):
                size += len(piece)
                if size > limit:
                    raise FormatError(path, f"expected at most {limit:,} bytes when unpacked, got more")
        return gzip.decompress(data)
    except (OSError, EOFError, zlib.error) as error:
        raise FormatError(path, f"cannot be unpacked: {error}") from None


def read_lines(path: Path, bad: BadRecords) -> list[str]:
    """Return the lines of a text file, gzipped or not, without their ends.

    Bytes that are no UTF-8 spoil their line only: with ``skip_bad`` they are replaced, so that the line is bad.

    Raises:
        FormatError: as :func:`read_data`, or a byte that is no UTF-8.
    """
    data = read_data(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if not bad.skip:
            line = data.count(b"\n", 0, error.start) + 1
            raise FormatError(path, f"expected UTF-8 text, got byte {data[error.start]:#04x}", line) from None
        text = data.decode("utf-8-sig", errors="replace")
    # str.splitlines also breaks at characters that editors, which count lines, do not break at.
    lines = [line.removesuffix("\r") for line in text.split("\n")]
    if lines and not lines[-1]:
        lines.pop()
    return lines


def read_table(path: Path, columns: Sequence[str], bad: BadRecords, separator: str | None = None) -> Table:
    """Return the rows of a table of numbers; empty lines and comments (``#``) are skipped.

    Args:
        path: the file.
        columns: their names, for messages.
        bad: what becomes of a row with too few or too many columns, or a value that is not a finite number.
        separator: what sets off the columns; None stands for blanks.

    Raises:
        FormatError: as :func:`read_lines`, or a bad row.
    """
    rows, places = [], []
    for number, line in enumerate(read_lines(path, bad), start=1):
        fields = line.split(separator)
        if not line.strip() or line.lstrip()[0] == "#":
            continue
        row = numbers(fields)
        if row is not None and len(row) == len(columns):
            rows.append(row)
            places.append(number)
            continue
        got = f"{len(fields)} columns" if row is not None else f"{line.strip()[:60]!r}"
        bad.report(path, f"expected {len(columns)} finite numbers {', '.join(columns)}, got {got}", number)
    return Table(np.array(places, dtype=np.int64), np.array(rows, dtype=np.float64).reshape(-1, len(columns)))


def numbers(fields: Sequence[str]) -> list[float] | None:
    """Return the fields as numbers, or None if one is not a finite number."""
    try:
        values = [float(field) for field in fields]
    except ValueError:
        return None
    # Python's float takes 1_000, which no other reader of such files does.
    return values if all(map(math.isfinite, values)) and not any("_" in field for field in fields) else None


def in_order(path: Path, table: Table, bad: BadRecords) -> Table:
    """Return the rows of a table whose first column is a time that never goes back; equal times are allowed.

    With ``skip_bad``, a row that is earlier than one before it is left out.

    Raises:
        FormatError: the first row that is earlier than one before it.
    """
    times = table.values[:, 0]
    latest = np.maximum.accumulate(times)
    good = np.asarray(times >= latest)
    if not good.all():
        first = int(np.argmin(good))
        back = f"time: expected {float(latest[first])!r} or later, got {float(times[first])!r}"
        bad.report(path, back, int(table.lines[first]), count=int((~good).sum()))
    return table.keep(good)


def name_of(path: Path) -> str:
    """Return what a log in that file is called: its name without ``.gz`` and without its suffix."""
    name = path.name.removesuffix(".gz")
    return name.rsplit(".", 1)[0] if "." in name[1:] else name
