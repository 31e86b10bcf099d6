"""Moving AI Lab grid benchmarks: ``.map`` grids and the ``.scen`` problems beside them.

One cell is one metre. Cell (x, y), counted from the top row down, has its centre at (x + 0.5, height - y - 0.5), so
that the map lies in [0, width] x [0, height] with y up. Free are ``.`` (ground), ``G`` (ground) and ``S`` (swamp,
which the benchmark's octile paths enter from ground at no extra cost); blocked are ``@`` and ``O`` (outside), ``T``
(trees) and ``W`` (water, which cannot be entered from ground).

Source: N. Sturtevant, Benchmarks for Grid-Based Pathfinding, 2012, https://movingai.com/benchmarks/formats.html.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError, WorldError, expected_name
from trailmark.formats.files import read_text
from trailmark.formats.grid import CellObstacles, check_size

__all__ = ["FREE", "Scenario", "parse_grid", "read_movingai", "read_scenarios", "scenario_query"]

FREE = ".GS"
BLOCKED = "@OTW"

_COLUMNS = ("bucket", "map", "width", "height", "start x", "start y", "goal x", "goal y", "optimal length")


class Scenario(NamedTuple):
    """One row of a ``.scen`` file.

    Attributes:
        bucket: the optimal length divided by four, as the file has it.
        map: the map's file name.
        width: the map's width in cells.
        height: its height in cells.
        start: cell (x, y), row 0 on top.
        goal: cell (x, y), row 0 on top.
        optimal_length: of the shortest octile path (steps of 1 and sqrt 2, no cut corners), in cells.
    """

    bucket: int
    map: str
    width: int
    height: int
    start: tuple[int, int]
    goal: tuple[int, int]
    optimal_length: float


def read_movingai(text: str, path: Path) -> dict[str, Any]:
    """Return the arguments of the :class:`trailmark.World` of a ``.map``, queries as arguments of theirs.

    The rows of ``NAME.map.scen`` or ``NAME.scen`` beside it are its queries.

    A query's name is its row's number from 0 on, its headings are 0. Obstacles are the blocked cells as polygons.

    Args:
        text: the map file's content.
        path: the map file; its stem names the world.

    Raises:
        FormatError: a map or scenario file that breaks the format, or belongs to a map of another size; the
            message has the line.
    """
    free = parse_grid(text, path)
    height, width = free.shape
    try:
        obstacles = CellObstacles(~free[::-1]).as_tuple()
    except WorldError as error:
        raise FormatError(path, str(error)) from None
    queries: tuple[tuple[Any, ...], ...] = ()
    sources = [path.absolute()]
    for scen in (path.with_name(path.name + ".scen"), path.with_suffix(".scen")):
        if scen.exists():
            rows = _scenario_rows(scen, (width, height))
            queries = tuple(scenario_query(row, str(i)) for i, (_, row) in enumerate(rows))
            sources.append(scen.absolute())
            break
    bounds = (0.0, 0.0, float(width), float(height))
    fields = {"name": path.stem, "bounds": bounds, "obstacles": obstacles}
    return {**fields, "queries": queries, "sources": tuple(sources)}


def parse_grid(text: str, path: Path) -> NDArray[np.bool_]:
    """Return which cells are free, shape (height, width), row 0 on top.

    Args:
        text: the map file's content.
        path: the map file, for messages.

    Raises:
        FormatError: a header that is not ``type octile``, ``height``, ``width``, ``map``; rows too many, too few, too
            short or too long; characters other than ``. G S @ O T W``; more cells than allowed.
    """
    lines = text.rstrip().splitlines()
    size, first = _header(lines, path)
    width, height = size["width"], size["height"]
    try:
        check_size(width, height)
    except WorldError as error:
        raise FormatError(path, str(error)) from None
    rows = lines[first:]
    for number, row in enumerate(rows[:height], start=first + 1):
        if len(row) != width:
            raise FormatError(path, f"expected a row of {width} cells, got {len(row)}", number)
    if len(rows) != height:
        raise FormatError(path, f"expected {height} rows, got {len(rows)}", min(len(lines), first + height + 1))
    cells = np.frombuffer("".join(rows).encode("latin-1", "replace"), dtype=np.uint8).reshape(height, width)
    free = np.isin(cells, np.frombuffer(FREE.encode(), dtype=np.uint8))
    known = free | np.isin(cells, np.frombuffer(BLOCKED.encode(), dtype=np.uint8))
    if not known.all():
        y, x = np.argwhere(~known)[0]
        allowed = f"expected {' '.join(FREE + BLOCKED)}"
        raise FormatError(path, f"column {x + 1}: {allowed}, got {rows[y][x]!r}", first + int(y) + 1)
    return free


def read_scenarios(path: Path) -> list[Scenario]:
    """Return the rows of a ``.scen`` file, in file order.

    Raises:
        FormatError: the file cannot be read or a row breaks the format; the message has the line.
    """
    return [row for _, row in _scenario_rows(path, None)]


def scenario_query(row: Scenario, name: str) -> tuple[Any, ...]:
    """Return a row's query as its arguments: from the middle of its start's cell to that of its goal's, heading 0."""
    (sx, sy), (gx, gy) = row.start, row.goal
    return (name, (sx + 0.5, row.height - sy - 0.5, 0.0), (gx + 0.5, row.height - gy - 0.5, 0.0))


def _header(lines: list[str], path: Path) -> tuple[dict[str, int], int]:
    """Return width and height, and the index of the first row."""
    size: dict[str, int] = {}
    for number, line in enumerate(lines[:8], start=1):
        key, _, value = line.strip().partition(" ")
        value = value.strip()
        if key == "map" and not value:
            missing = sorted({"width", "height"} - size.keys())
            if missing:
                raise FormatError(path, f"no {' and '.join(missing)} before the line 'map'", number)
            return size, number
        if key == "type":
            if value != "octile":
                raise FormatError(path, f"type: expected octile, got {value!r}", number)
        elif key in ("width", "height"):
            if not (value.isascii() and value.isdigit() and len(value) < 10):
                raise FormatError(path, f"expected a whole number above 0, got {key} {value!r}", number)
            size[key] = int(value)
        elif key:
            raise FormatError(path, expected_name(key, ("type", "height", "width", "map")), number)
    raise FormatError(path, "no line 'map' ends the header; expected type octile, height, width, map")


def _scenario_rows(path: Path, size: tuple[int, int] | None) -> list[tuple[int, Scenario]]:
    """Return line numbers and rows; ``size`` is the width and height that the rows must give, if known."""
    rows = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip() or (number == 1 and line.split()[0] == "version"):
            continue
        row = _scenario(line, path, number)
        if size is not None and (row.width, row.height) != size:
            given = f"map of {row.width} x {row.height} cells"
            raise FormatError(path, f"expected the map's {size[0]} x {size[1]}, got {given}", number)
        for end, (x, y) in (("start", row.start), ("goal", row.goal)):
            if not (0 <= x < row.width and 0 <= y < row.height):
                inside = f"x in 0..{row.width - 1}, y in 0..{row.height - 1}"
                raise FormatError(path, f"expected {inside}, got {end} cell ({x}, {y})", number)
        rows.append((number, row))
    return rows


def _scenario(line: str, path: Path, number: int) -> Scenario:
    # Columns are set off by tabs in most files, and a map's name may hold spaces.
    fields = [field.strip() for field in line.strip().split("\t")] if "\t" in line else line.split()
    if len(fields) != len(_COLUMNS):
        raise FormatError(path, f"expected {len(_COLUMNS)} columns ({', '.join(_COLUMNS)}), got {len(fields)}", number)
    whole: dict[str, int] = {}
    for name, field in zip(_COLUMNS, fields, strict=True):
        if name in ("map", "optimal length"):
            continue
        if not (field.isascii() and field.removeprefix("-").isdigit() and len(field) < 10):
            raise FormatError(path, f"expected a whole number, got {name} {field!r}", number)
        whole[name] = int(field)
    try:
        length = float(fields[-1])
    except ValueError:
        length = math.nan
    if not (math.isfinite(length) and length >= 0.0):
        raise FormatError(path, f"expected a finite number, 0 or more, got optimal length {fields[-1]!r}", number)
    start, goal = (whole["start x"], whole["start y"]), (whole["goal x"], whole["goal y"])
    return Scenario(whole["bucket"], fields[1], whole["width"], whole["height"], start, goal, length)
