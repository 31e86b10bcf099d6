"""The colours of pictures that are drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image

__all__ = ["colours_of", "is_colour"]


def is_colour(rgb: Any, colour: str, tolerance: float = 0.03) -> Any:
    """Return where rgb in 0..1, shape (..., 3), is a colour by its name, shape (...)."""
    return np.abs(rgb - np.array(to_rgb(colour))).max(axis=-1) < tolerance


def colours_of(file: Path) -> tuple[Any, Any]:
    """Return the colours of a picture, rgb in 0..1 of shape (n, 3), and how many pixels have each, shape (n,)."""
    with Image.open(file) as picture:
        found: Any = picture.convert("RGB").getcolors(picture.width * picture.height)
    counts, colours = zip(*found, strict=True)
    return np.array(colours) / 255.0, np.array(counts)
