"""Hidden worlds for exploration as PNG images, in which the start is marked: those of ARiADNE and its successors.

One pixel is one metre, as a cell of a MovingAI map is; the map lies in [0, width] x [0, height] with y up. By their
brightness, 0 to 255 (ITU-R BT.709, as scikit-image has it), pixels above 150 are free and all others blocked; those of
208, yellow or grey, are the block that marks the start, and free. The published images are 640 x 480 pixels, of which
127 is blocked and 195 free; sensors reach 80 m.

Source: Y. Cao et al., ARiADNE: A Reinforcement learning approach using Attention-based Deep Networks for Exploration,
ICRA 2023, https://github.com/marmotlab/ARiADNE (``env.py``).
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError, WorldError
from trailmark.formats.grid import CellObstacles
from trailmark.formats.nav2_map import pixels_of

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["read_png_grid"]

FREE_ABOVE = 150
START = 208

_BRIGHTNESS = np.array([0.2125, 0.7154, 0.0721])
"""Of red, green and blue."""


def read_png_grid(path: Path) -> dict[str, Any]:
    """Return the arguments of an image's :class:`trailmark.World`.

    It has one query, ``start``: it begins, and ends, amid the start's block.

    Raises:
        FormatError: a damaged or too large image, or one in which no block, or more than one, marks the start.
    """
    from scipy import ndimage

    brightness = pixels_of(path, _brightness)[::-1]
    blocks, count = ndimage.label(brightness == START)
    if count != 1:
        expected = f"expected one block of pixels of brightness {START} that marks the start, got {count}"
        raise FormatError(path, f"{expected} (other maps need the YAML file of a nav2 map)")
    block = np.argwhere(blocks)
    row, column = block[np.argmin(np.hypot(*(block - block.mean(axis=0)).T))]
    height, width = brightness.shape
    try:
        obstacles = CellObstacles(brightness <= FREE_ABOVE).as_tuple()
    except WorldError as error:
        raise FormatError(path, str(error)) from None
    start = (float(column) + 0.5, float(row) + 0.5, 0.0)
    bounds = (0.0, 0.0, float(width), float(height))
    fields = {"name": path.stem, "bounds": bounds, "obstacles": obstacles}
    return {**fields, "queries": (("start", start, start),), "sources": (path.absolute(),)}


def _brightness(image: Image) -> NDArray[np.uint8]:
    """Return the brightness of pixels, shape (rows, columns), whatever their opacity."""
    if image.mode not in ("1", "L", "LA", "P", "PA", "RGB", "RGBA"):
        raise WorldError(f"expected grey or colours of 8 bits, got pixels of mode {image.mode}")
    if image.mode in ("1", "L", "LA"):
        return np.asarray(image.convert("L"))
    # As in the source, what is after the decimal point is left off: yellow (255, 216, 0) is 208.7.
    return np.asarray(np.asarray(image.convert("RGB")) @ _BRIGHTNESS + 1e-6, dtype=np.uint8)
