"""Packed cells: the cells of a grid map as one line of text, which a YAML file may hold as a comment."""

# Tested by tests/formats/test_packed_cells.py.

from __future__ import annotations

import base64
import zlib

import numpy as np

from trailmark.arguments import brief
from trailmark.errors import WorldError
from trailmark.formats.cell_obstacles import CellObstacles
from trailmark.formats.grid import check_size

__all__ = ["packed_cells", "unpacked_cells"]

_BEGIN = "# cells: "


def packed_cells(cells: CellObstacles) -> str:
    """Return the cells as a line: shape, side and origin (metres, radians), and which are occupied."""
    packed = base64.b64encode(zlib.compress(np.packbits(cells.occupied).tobytes())).decode()
    numbers = (*cells.occupied.shape, float(cells.cell), *map(float, cells.origin))
    return f"{_BEGIN}{' '.join(map(repr, numbers))} {packed}\n"


def unpacked_cells(text: str) -> CellObstacles | None:
    """Return the cells that the last line of a text holds, as :func:`packed_cells` wrote it; None if it does not.

    Raises:
        WorldError: a line that was changed since.
    """
    line = text[text.rstrip("\n").rfind("\n") + 1 :]
    if not line.startswith(_BEGIN):
        return None
    try:
        rows, columns, cell, x, y, yaw, packed = line[len(_BEGIN) :].split()
        check_size(int(columns), int(rows))
        bits = np.unpackbits(np.frombuffer(zlib.decompress(base64.b64decode(packed)), np.uint8))
        occupied = bits[: int(rows) * int(columns)].reshape(int(rows), int(columns)).astype(np.bool_)
        return CellObstacles(occupied, float(cell), (float(x), float(y), float(yaw)))
    except (ValueError, zlib.error) as error:
        raise WorldError(f"cells: expected what packed_cells wrote, got {brief(line)}") from error
