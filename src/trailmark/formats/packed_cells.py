"""Packed cells: a grid map's cells as the ``grid`` of a world file, a bit for each cell."""

from __future__ import annotations

import base64
import zlib
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark.errors import WorldError
from trailmark.formats.cell_obstacles import CellObstacles
from trailmark.formats.grid import check_size

if TYPE_CHECKING:
    from trailmark.formats.schema import GridEntry

__all__ = ["packed_cells", "unpacked_cells"]


def packed_cells(cells: CellObstacles) -> dict[str, Any]:
    """Return the cells as a world file's ``grid``."""
    rows, columns = cells.occupied.shape
    return {
        "rows": rows,
        "columns": columns,
        "cell": float(cells.cell),
        "origin": [float(number) for number in cells.origin],
        "occupied": base64.b64encode(zlib.compress(np.packbits(cells.occupied).tobytes())).decode(),
    }


def unpacked_cells(entry: GridEntry) -> CellObstacles:
    """Return the cells of a world file's ``grid``.

    Raises:
        WorldError: too many cells, or other bits than its rows and columns need.
    """
    rows, columns = entry.rows, entry.columns
    check_size(columns, rows)
    size = -(-rows * columns // 8)
    try:
        unpacked = zlib.decompressobj().decompress(base64.b64decode(entry.occupied, validate=True), size + 1)
    except (ValueError, zlib.error) as error:
        raise WorldError(f"expected occupied to be bits by zlib and base64, got other text ({error})") from error
    if len(unpacked) != size:
        got = f"more than {size:,}" if len(unpacked) > size else f"{len(unpacked):,}"
        raise WorldError(f"expected {size:,} bytes of bits for {rows} rows of {columns} cells, got {got}")
    bits = np.unpackbits(np.frombuffer(unpacked, np.uint8), count=rows * columns)
    x, y, yaw = entry.origin
    return CellObstacles(bits.reshape(rows, columns).astype(np.bool_), entry.cell, (x, y, yaw))
