"""Damage to files: bytes and words changed, lost, doubled, moved, or replaced by what readers stumble over."""

from __future__ import annotations

import gzip
import io
import re
import sqlite3
import zipfile
from contextlib import closing, suppress
from pathlib import Path

import numpy as np

__all__ = ["damage"]

Rng = np.random.Generator

WORDS = [
    *b"nan inf -inf -0.0 0 -1 1 1e999 1e308 -1e308 1e-320 99999999999999999999 2147483648 -2147483649 9e15 0x10 1_000 "
    b"true null None ~ [] {} '' \"\" [[]] - : * & ! % @ ` | > # , ; \\ / .. ../x /dev/null 1.5 1e5 1e7 1e9 3.14159 "
    b"\xef\xbc\x91 \xc2\xb2 \xff \x00 \xe2\x80\xa8 \r \x85 \x1f\x8b trailmark image type octile bounds obstacles".split(
        b" "
    ),
    *(b"", b" ", b"\n", b"\t", b"[" * 3000, b"{" * 3000, b"a" * 70000, b"1" * 5000, b"- " * 2000),
]
"""What stands in the place of a word: numbers out of range, other types, nesting, control characters."""

NUMBER = re.compile(rb"[-+]?\d[\d.eE+-]*")
WORD = re.compile(rb"[^\s,:\[\]{}<>=\"']+")


def damage(data: bytes, rng: Rng, suffix: str) -> bytes:
    """Return a file's content, damaged in one to four places."""
    inner = {".npz": _archive, ".db": _database}.get(suffix)
    if inner is not None and rng.random() < 0.6:
        with suppress(ValueError, OSError, zipfile.BadZipFile, sqlite3.Error):
            return inner(data, rng)
    text = b"\0" not in data[:4096]
    # Most readers give up at the first thing that is wrong: one alone goes deepest.
    for _ in range(int(rng.choice([1, 1, 1, 2, 4]))):
        kinds = (_words, _words, _numbers, _numbers, _lines, _bytes, _cut) if text else (_bytes, _cut, _fields)
        data = kinds[int(rng.integers(len(kinds)))](data, rng)
    if rng.random() < 0.02:
        data = gzip.compress(data) if rng.random() < 0.5 else data * int(rng.integers(2, 20))
    return data


def _replaced(data: bytes, pattern: re.Pattern[bytes], rng: Rng) -> bytes:
    places = [match.span() for match in pattern.finditer(data[:200_000])]
    if not places:
        return data
    low, high = places[int(rng.integers(len(places)))]
    return data[:low] + WORDS[int(rng.integers(len(WORDS)))] + data[high:]


def _words(data: bytes, rng: Rng) -> bytes:
    return _replaced(data, WORD, rng)


def _numbers(data: bytes, rng: Rng) -> bytes:
    return _replaced(data, NUMBER, rng)


def _lines(data: bytes, rng: Rng) -> bytes:
    """Lose, double, move or indent a line."""
    lines = data.split(b"\n")
    i, j = (int(k) for k in rng.integers(0, len(lines), 2))
    kind = rng.integers(4)
    if kind == 0:
        del lines[i]
    elif kind == 1:
        lines[i:i] = [lines[j]] * int(rng.choice([1, 2, 50]))
    elif kind == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines[i] = b" " * int(rng.integers(1, 9)) + lines[i]
    return b"\n".join(lines)


def _bytes(data: bytes, rng: Rng) -> bytes:
    """Change, lose or add some bytes."""
    if not data:
        return bytes(rng.integers(0, 256, 8, dtype=np.uint8))
    at, n = int(rng.integers(len(data))), int(rng.choice([1, 1, 2, 4, 16, 200]))
    new = bytes(rng.integers(0, 256, n, dtype=np.uint8))
    kind = rng.integers(3)
    return data[:at] + (b"" if kind == 0 else new) + data[at + (0 if kind == 1 else n) :]


def _fields(data: bytes, rng: Rng) -> bytes:
    """Replace a field of a binary header by a number out of range."""
    size = int(rng.choice([1, 2, 4, 8]))
    at = int(rng.integers(max(1, min(len(data), 600) - size)))
    value = int(rng.choice([0, 1, 0x7F, 0xFF])).to_bytes(1, "little") * size
    return data[:at] + value + data[at + size :]


def _cut(data: bytes, rng: Rng) -> bytes:
    """Lose an end, or a piece between."""
    low, high = np.sort(rng.integers(0, len(data) + 1, 2))
    return data[:low] if rng.random() < 0.5 else data[:low] + data[high:]


def _archive(data: bytes, rng: Rng) -> bytes:
    """Change, retype, reshape or lose an array of an .npz file."""
    with np.load(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files}
    name = list(arrays)[int(rng.integers(len(arrays)))]
    array = arrays[name]
    kind = rng.integers(6)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[name] = array.astype(str(rng.choice(["float32", "int64", "uint8", "bool", "complex128", "U5", "S3"])))
    elif kind == 2:
        arrays[name] = array.reshape(-1) if array.ndim > 1 else np.stack([array, array])
    elif kind == 3:
        arrays[name] = array[: len(array) // 2] if array.ndim else np.array([])
    elif array.size and array.dtype.kind in "fiu":
        flat = array.reshape(-1).copy()
        values = [np.nan, np.inf, 1e300, -1.0] if array.dtype.kind == "f" else [-1, 255, 2**31 - 1]
        with np.errstate(all="ignore"):
            flat[int(rng.integers(len(flat)))] = np.array(rng.choice(values)).astype(array.dtype)
        arrays[name] = flat.reshape(array.shape)
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _database(data: bytes, rng: Rng) -> bytes:
    """Change a cell, lose a column or a table of a database."""
    with closing(sqlite3.connect(":memory:")) as db:
        db.deserialize(data)
        tables = [row[0] for row in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = tables[int(rng.integers(len(tables)))]
        columns = [row[1] for row in db.execute(f'PRAGMA table_info("{table}")')]
        column = columns[int(rng.integers(len(columns)))]
        kind = rng.integers(8)
        if kind == 0:
            db.execute(f'DROP TABLE "{table}"')
        elif kind == 1:
            db.execute(f'ALTER TABLE "{table}" DROP COLUMN "{column}"')
        else:
            values = ("nan", "", None, -1, 1e308, 9e18, b"\xff\xfe", "[[", '{"a": 1}', float("inf"), "x" * 10_000, 0, 7)
            value = values[int(rng.integers(len(values)))]
            db.execute(f'UPDATE "{table}" SET "{column}" = ?', (value,))  # noqa: S608  names come from the file itself
        db.commit()
        return db.serialize()


def whole_folder(folder: Path) -> list[Path]:
    """Return the files of a folder, in order."""
    return sorted(path for path in folder.rglob("*") if path.is_file())
