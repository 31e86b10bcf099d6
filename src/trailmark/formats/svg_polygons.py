"""Polygons drawn as paths in an SVG file, as Bench-MR's mazes and robots are: each ``<path>`` one polygon.

Of the path language the straight commands are read (M, L, H, V, Z, absolute and relative). Coordinates are those of the
``d`` attributes with y turned up; as in Bench-MR's own reader, transforms of groups are left out.

Source: E. Heiden et al., Bench-MR: A Motion Planning Benchmark for Wheeled Mobile Robots, RA-L 2021,
https://github.com/robot-motion/bench-mr (``SvgPolygonLoader.hpp``, ``Primitives.h``).
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError
from trailmark.formats.xml_file import local_name, read_xml

__all__ = ["read_svg_polygons"]

_TOKEN = re.compile(r"([A-Za-z](?![A-Za-z]))|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|[\s,]+|(.)")


def read_svg_polygons(path: Path) -> list[NDArray[np.float64]]:
    """Return the polygons of a drawing, each of shape (n, 2), every vertex as it is drawn, in the file's order.

    Raises:
        FormatError: the file is missing, no SVG, or a path has other commands, or fewer than three vertices.
    """
    root = read_xml(path)
    if local_name(root) != "svg":
        raise FormatError(path, f"root element: expected <svg>, got <{local_name(root)}>")
    found = []
    for element in root.iter():
        if local_name(element) == "path":
            name = f"path {element.get('id', '')!r}"
            try:
                vertices = np.array(_vertices(element.get("d", "")), dtype=np.float64).reshape(-1, 2)
            except ValueError as error:
                raise FormatError(path, f"{name}: {error}") from None
            if len(vertices) < 3 or not np.isfinite(vertices).all():
                raise FormatError(path, f"{name}: expected 3 or more finite vertices, got {len(vertices)}")
            found.append(vertices)
    if not found:
        raise FormatError(path, "expected one <path> or more, got none")
    return found


def _vertices(line: str) -> list[tuple[float, float]]:
    """Return the vertices of a path's ``d``, y up."""
    points: list[tuple[float, float]] = []
    x = y = 0.0
    command = ""
    numbers: list[float] = []
    for match in _TOKEN.finditer(line):
        letter, number, other = match.groups()
        if letter or other:
            if numbers:
                raise ValueError(f"expected whole points, got {len(numbers)} number more")
            command = letter or other
            if command not in "MmLlHhVvZz":
                raise ValueError(f"expected the commands M, L, H, V, Z, got {command!r}")
        elif number:
            numbers.append(float(number))
            if len(numbers) < (1 if command in "HhVv" else 2):
                continue
            if command in ("", "Z", "z"):
                raise ValueError(f"expected a command before the number {number}")
            dx = numbers[0] if command in "MmLlHh" else None
            dy = numbers[-1] if command in "MmLlVv" else None
            relative = command.islower()
            x = x if dx is None else dx + x * relative
            y = y if dy is None else y * relative - dy
            points.append((x, y))
            numbers = []
    if not all(map(math.isfinite, (x, y))):
        raise ValueError("expected finite coordinates")
    return points
