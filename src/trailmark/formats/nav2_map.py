"""ROS / nav2 occupancy maps: a YAML file that names an image.

Definitions follow nav2_map_server (map_io.cpp). A cell is free only if the map says so; occupied and unknown cells
both become obstacles.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import FormatError, WorldError
from trailmark.formats.grid import MAX_CELLS, check_size
from trailmark.formats.grid_world import world_of_grid
from trailmark.world import World

if TYPE_CHECKING:
    from PIL.Image import Image

    from trailmark.formats.schema import MapFile

__all__ = ["free_cells", "occupancy", "pixels_of", "read_grid", "read_image", "read_nav2_map", "unknown_taken_for_free"]

T = TypeVar("T", bound=np.generic)

IMAGE_KINDS = {"PPM": "PGM/PBM/PPM", "PNG": "PNG", "BMP": "BMP", "JPEG": "JPEG"}

UNKNOWN = 205
"""The grey that map_saver writes for unknown cells."""

_ROWS_AT_ONCE = 256  # bounds the memory for one image's brightness values


def read_nav2_map(data: dict[str, Any], path: Path) -> World:
    """Return the world of a nav2 map.

    Obstacles are the cells that are not free, as polygons. Bounds are the map's rectangle. If the origin has a yaw,
    the map is turned about its origin; then the rectangle is the boundary, and the bounds are its box.

    Args:
        data: the YAML file's plain data: image (beside the file, absolute, or ~/…), resolution (metres per pixel),
            origin [x, y, yaw] of the lower left pixel's outer corner; optional negate (0), occupied_thresh (0.65),
            free_thresh (0.196), mode (trinary). Other keys are ignored, as by nav2.
        path: the YAML file; its stem names the world.

    Raises:
        FormatError: a field is missing or wrong, the image is missing, of another kind, damaged, or too large.
    """
    from trailmark.formats.schema import MapFile
    from trailmark.formats.validation import validate

    file = validate(MapFile, data, path)
    image = path.parent / file.image
    return _world(image, file, path.stem, (path.absolute(), image.absolute()))


def read_grid(data: dict[str, Any], path: Path) -> tuple[NDArray[np.bool_], MapFile]:
    """Return which cells of a nav2 map are free, shape (rows, columns), row 0 with the smallest y, and its file.

    Arguments and errors are those of :func:`read_nav2_map`.
    """
    from trailmark.formats.schema import MapFile
    from trailmark.formats.validation import validate

    file = validate(MapFile, data, path)
    return pixels_of(path.parent / file.image, lambda pixels: free_cells(pixels, file))[::-1], file


def read_image(path: Path, fields: dict[str, Any]) -> World:
    """Return the world of a map's image, whose nav2 map file would hold ``fields``; the origin's yaw may be left out.

    Raises:
        FormatError: as :func:`read_nav2_map`.
    """
    from trailmark.formats.schema import MapFile
    from trailmark.formats.validation import validate

    origin = np.asarray(fields["origin"]).tolist()
    given = [*origin, 0.0] if isinstance(origin, list) and len(origin) == 2 else origin
    file = validate(MapFile, {**fields, "origin": given, "image": path.name}, path)
    return _world(path, file, path.stem, (path.absolute(),))


def _world(image: Path, file: MapFile, name: str, sources: tuple[Path, ...]) -> World:
    free = pixels_of(image, lambda pixels: free_cells(pixels, file))
    try:
        world = world_of_grid(~free[::-1], file.resolution, file.origin, name)
    except WorldError as error:
        raise FormatError(image, str(error)) from None
    return replace(world, sources=sources)


def unknown_taken_for_free(sources: Sequence[Path]) -> str:
    """Return a sentence on cells of a nav2 map that are free though they are of the grey of unknown ones, or nothing.

    Args:
        sources: files of a world: a nav2 map's are its YAML file and its image.

    Raises:
        FormatError: as :func:`read_nav2_map`.
    """
    from trailmark.formats.files import read_text
    from trailmark.formats.schema import MapFile
    from trailmark.formats.validation import validate
    from trailmark.formats.yaml_data import parse_yaml

    if len(sources) < 2 or sources[0].suffix.lower() not in (".yaml", ".yml"):
        return ""
    data = parse_yaml(read_text(sources[0]), sources[0])
    if not isinstance(data, dict) or "image" not in data:
        return ""
    file = validate(MapFile, data, sources[0])
    if file.mode == "raw" or file.negate or file.free_thresh < (255 - UNKNOWN) / 255:
        return ""

    def grey(image: Image) -> NDArray[np.bool_]:
        values, full, _ = _channels(image)
        return np.asarray((full == 255) & (values[..., :3] == UNKNOWN).all(axis=-1) & free_cells(image, file))

    if not (count := int(np.count_nonzero(pixels_of(sources[1], grey)))):
        return ""
    what = f"{count:,} cells of grey {UNKNOWN}, which map savers write for unknown, are free"
    return f"{sources[0]}: {what} by free_thresh {file.free_thresh:g}; 0.196 keeps them out"


def free_cells(image: Image, file: MapFile) -> NDArray[np.bool_]:
    """Return which pixels are free.

    The brightness s in [0, 1] is the mean of the colours, p the probability that the cell is occupied. A pixel is
    free where p <= free_thresh and p < occupied_thresh.

    - trinary: p = 1 - s (s if negate). An alpha channel counts as a fourth colour.
    - scale: the same, but alpha stays out of the mean and a pixel that is not opaque is unknown. Values between
      the thresholds, which nav2 grades, are not free.
    - raw: the pixel's value, 0..100, is p in percent whatever negate says; other values are unknown.

    Args:
        image: an image of any mode that Pillow reads from :data:`IMAGE_KINDS`.
        file: thresholds and mode.

    Returns:
        Shape (rows, columns); row 0 is the image's top row.

    Raises:
        WorldError: an image of a mode without brightness, such as floating point.
    """
    values, full, has_alpha = _channels(image)
    free = np.empty(values.shape[:2], dtype=bool)
    for top in range(0, len(free), _ROWS_AT_ONCE):
        rows = slice(top, top + _ROWS_AT_ONCE)
        free[rows] = _free(values[rows].astype(np.int64), full, has_alpha, file)
    return free


def occupancy(image: Image, file: MapFile) -> NDArray[np.int8]:
    """Return the values that nav2 gives to pixels: 0 (free) to 100 (occupied), -1 where they are unknown.

    Arguments, shape and errors are those of :func:`free_cells`.
    """
    values, full, has_alpha = _channels(image)
    p = _probability(values.astype(np.int64), full, has_alpha, file)
    if file.mode == "raw":
        return np.where(p <= 1.0, np.rint(100.0 * p), -1).astype(np.int8)
    between, unknown = np.full(p.shape, -1.0), np.zeros(p.shape, np.bool_)
    if file.mode == "scale":
        # Where both thresholds are the same, nothing lies between them but that value itself.
        room = file.occupied_thresh - file.free_thresh
        between = np.rint(100.0 * (p - file.free_thresh) / (room if room > 0.0 else 1.0))
        unknown = (values[..., -1] != full) & has_alpha
    found = np.select([unknown, p > file.occupied_thresh, p < file.free_thresh], [-1.0, 100.0, 0.0], between)
    return found.astype(np.int8)


def _free(values: NDArray[np.int64], full: int, has_alpha: bool, file: MapFile) -> NDArray[np.bool_]:
    p = _probability(values, full, has_alpha, file)
    free = np.asarray((p <= file.free_thresh) & (p < file.occupied_thresh))
    if has_alpha and file.mode == "scale":
        free &= values[..., -1] == full
    return free


def _probability(values: NDArray[np.int64], full: int, has_alpha: bool, file: MapFile) -> NDArray[np.float64]:
    """Return the probability that each pixel is occupied; beyond 1 where a raw value is unknown."""
    colours = values[..., :-1] if has_alpha and file.mode != "trinary" else values
    # Sums and full scale are whole numbers, so that p is the double nearest to the true quotient.
    bright, scale = colours.sum(axis=-1), full * colours.shape[-1]
    if file.mode == "raw":
        return np.asarray(np.floor(255.0 * bright / scale + 0.5) / 100.0)
    return np.asarray((bright if file.negate else scale - bright) / scale)


def _channels(image: Image) -> tuple[NDArray[Any], int, bool]:
    """Return pixel values of shape (rows, columns, channels), their full scale, and whether the last one is alpha."""
    if image.mode in ("I", "I;16", "I;16B", "I;16L", "I;16N"):  # Pillow's modes for 16-bit grey
        return np.asarray(image)[..., None], 65535, False
    transparent = image.mode in ("LA", "PA", "RGBA", "La", "RGBa") or "transparency" in image.info
    if image.mode in ("1", "L") and not transparent:
        return np.asarray(image.convert("L"))[..., None], 255, False
    if image.mode in ("1", "L", "LA", "La", "P", "PA", "RGB", "RGBA", "RGBa", "RGBX", "CMYK", "YCbCr"):
        return np.asarray(image.convert("RGBA" if transparent else "RGB")), 255, transparent
    raise WorldError(f"expected grey or colours of 8 or 16 bits, got pixels of mode {image.mode}")


def pixels_of(path: Path, take: Callable[[Image], NDArray[T]]) -> NDArray[T]:
    """Return what a function takes from an image file, shape (rows, columns); row 0 is the image's top row.

    Raises:
        FormatError: the image is missing, of another kind, damaged or too large; or the function raises a WorldError.
    """
    from PIL import Image, UnidentifiedImageError

    allowed = f"expected an image of the kinds {', '.join(IMAGE_KINDS.values())}"
    try:
        folder = path.is_dir()
    except OSError as error:  # no file can have that name
        raise FormatError(path, f"image cannot be read: {error.strerror}") from None
    if folder:
        raise FormatError(path, f"{allowed}, got a directory")
    try:
        with warnings.catch_warnings():
            # Pillow's guard against decompression bombs is looser than the limit below, and warns first.
            warnings.simplefilter("ignore")
            with Image.open(path, formats=tuple(IMAGE_KINDS)) as image:
                check_size(*image.size)  # known from the header, before any pixel is decoded
                return take(image)
    except UnidentifiedImageError:
        raise FormatError(path, f"not an image that can be read; {allowed}") from None
    except Image.DecompressionBombError:
        raise FormatError(path, f"too many pixels; expected at most {MAX_CELLS:,}") from None
    except WorldError as error:
        raise FormatError(path, str(error)) from None
    except OSError as error:
        if error.strerror:
            raise FormatError(path, f"image cannot be read: {error.strerror}") from None
        raise FormatError(path, f"damaged image: {error}; {allowed}") from None
    except Exception as error:  # Pillow's decoders raise errors of many kinds on damaged data
        raise FormatError(path, f"damaged image: {error or type(error).__name__}; {allowed}") from None
