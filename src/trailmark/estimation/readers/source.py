"""What the readers of text logs share: lines of a file, gzipped or not, tables of numbers, and bad records."""

from __future__ import annotations

import codecs
import gzip
import itertools
import math
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.se2 import FloatArray

__all__ = ["BadRecords", "Table", "in_order", "name_of", "numbers", "read_head", "read_lines", "read_table"]

IntArray = NDArray[np.int64]

_GZIP = b"\x1f\x8b"
MAX_LOG_BYTES = 2**32  # Largest log, unpacked (4 GiB): some million scans.
# Times its own size that a gzipped log may unpack to, and the bytes (128 MiB) that it may in any case: numbers as
# text pack three- to tenfold, a file made to fill memory a thousandfold.
MAX_RATIO, MIN_UNPACKED_BYTES = 50, 2**27
# Longest line of a log (4 MiB): a record takes some kilobytes; without line ends a file is none.
MAX_LINE_BYTES = 2**22


class BadRecords:
    """What becomes of a bad record: an error that names file and line, or one more on the count.

    Args:
        skip: whether bad records are left out and counted.
    """

    def __init__(self, skip: bool) -> None:
        self.skip = skip
        self.dropped = 0

    def report(self, path: Path, problem: str, line: int | None = None, count: int = 1) -> None:
        """Count the bad records, or raise for the first of them."""
        if not self.skip:
            raise FormatError(path, f"{problem} (--skip-bad leaves it out)", line)
        self.dropped += count

    def report_late(self, path: Path, t: float, latest: float, line: int | None = None, name: str = "") -> None:
        """Count a record whose time goes back, or raise for the first of them; ``name`` begins the message."""
        self.report(path, f"{name}time: expected {latest!r} or later, got {t!r}", line)


class Table(NamedTuple):
    """Rows of numbers and where they stood."""

    lines: IntArray  # 1-based line numbers, shape (n,).
    values: FloatArray  # Shape (n, columns), all finite.


def read_head(path: Path, size: int) -> bytes:
    """Return the first ``size`` bytes of a file, unpacked if it is gzipped."""
    try:
        with path.open("rb") as raw, _unpacked(raw) as file:
            return file.read(size)
    except (OSError, ValueError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        raise FormatError(path, f"cannot be read: {reason}") from None


def read_lines(path: Path, bad: BadRecords, limit: int = MAX_LOG_BYTES) -> Iterator[str]:
    """Yield the lines of a text file, gzipped or not, without their ends; the file is never in memory as a whole.

    Bytes that are no UTF-8 spoil their line only: with ``skip_bad`` they are replaced, so that the line is bad.
    """
    try:
        with path.open("rb") as raw, _unpacked(raw) as file:
            if isinstance(file, gzip.GzipFile):
                limit = min(limit, max(MIN_UNPACKED_BYTES, MAX_RATIO * path.stat().st_size))
            size = 0
            for number in itertools.count(1):
                line = file.readline(MAX_LINE_BYTES + 1)
                if not line:
                    return
                size += len(line)
                if size > limit:
                    raise FormatError(path, f"expected at most {limit:,} bytes when unpacked, got more")
                if len(line) > MAX_LINE_BYTES:
                    raise FormatError(path, f"expected at most {MAX_LINE_BYTES:,} bytes in a line, got more", number)
                if number == 1:
                    line = line.removeprefix(codecs.BOM_UTF8)
                # Only at line feeds, as editors count lines: str.splitlines breaks at other characters too.
                line = line.removesuffix(b"\n").removesuffix(b"\r")
                try:
                    yield line.decode("utf-8")
                except UnicodeDecodeError as error:
                    if not bad.skip:
                        byte = line[error.start]
                        raise FormatError(path, f"expected UTF-8 text, got byte {byte:#04x}", number) from None
                    yield line.decode("utf-8", errors="replace")
    except (OSError, ValueError, EOFError, zlib.error) as error:
        if isinstance(error, FormatError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise FormatError(path, f"cannot be read: {reason}") from None


def _unpacked(raw: BinaryIO) -> BinaryIO | gzip.GzipFile:
    """Return a file's content, unpacked if it is gzipped (recognised by its first bytes)."""
    packed = raw.read(len(_GZIP)) == _GZIP
    raw.seek(0)
    return gzip.GzipFile(fileobj=raw) if packed else raw


def read_table(path: Path, columns: Sequence[str], bad: BadRecords) -> Table:
    """Return the rows of a table of numbers set off by blanks; empty lines and comments (``#``) are skipped."""
    rows, places = [], []
    for number, line in enumerate(read_lines(path, bad), start=1):
        fields = line.split()
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
    """
    times = table.values[:, 0]
    latest = np.maximum.accumulate(times)
    good = np.asarray(times >= latest)
    if good.all():
        return table
    first = int(np.argmin(good))
    back = f"time: expected {float(latest[first])!r} or later, got {float(times[first])!r}"
    bad.report(path, back, int(table.lines[first]), count=int((~good).sum()))
    return Table(table.lines[good], table.values[good])


def name_of(path: Path) -> str:
    """Return what a log in that file is called: its name without ``.gz`` and without its suffix."""
    name = path.name.removesuffix(".gz")
    return name.rsplit(".", 1)[0] if "." in name[1:] else name
