"""Cells: a grid map as an embedded image, where outlines would be too many to be drawn as they are."""

# Tested by tests/sketch/test_cells.py.
from __future__ import annotations

import base64
import io

import numpy as np
from numpy.typing import NDArray

__all__ = ["MAX_SIDE", "cells_image"]

MAX_SIDE = 1024
"""Pixels along a side: of larger maps a pixel shows by its opacity how much of some cells is occupied."""

LEVELS = 16
"""Of opacity: what four bits a pixel hold."""


def cells_image(occupied: NDArray[np.bool_], colour: str) -> str:
    """Return cells as a data URI of a PNG that is transparent where they are free.

    Args:
        occupied: shape (rows, columns), row 0 with the smallest y, which is the image's last.
        colour: of the occupied ones, such as ``#808080``.
    """
    from PIL import Image

    step = -(-max(occupied.shape) // MAX_SIDE)
    shown = occupied[::-1]
    if step > 1:
        # The last cells stand for those beyond the map.
        rows, columns = (-length % step for length in shown.shape)
        padded = np.pad(shown, ((0, rows), (0, columns)), mode="edge")
        shares = padded.reshape(padded.shape[0] // step, step, padded.shape[1] // step, step).mean(axis=(1, 3))
    else:
        shares = shown.astype(np.float64)
    image = Image.fromarray(np.rint(shares * (LEVELS - 1)).astype(np.uint8), mode="P")
    image.putpalette(bytes.fromhex(colour.removeprefix("#")) * LEVELS)
    opacities = np.rint(np.linspace(0.0, 255.0, LEVELS)).astype(np.uint8).tobytes()
    file = io.BytesIO()
    image.save(file, "PNG", optimize=True, bits=4, transparency=opacities)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
