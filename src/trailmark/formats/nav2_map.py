"""ROS / nav2 occupancy maps, a YAML file that names an image: read, written, and read as filter masks.

Definitions follow nav2_map_server (map_io.cpp), and for masks nav2_costmap_2d's KeepoutFilter and SpeedFilter. A cell
is free only if the map says so; occupied and unknown cells both become obstacles.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from trailmark.arguments import Positive, checked_arguments, number
from trailmark.errors import FormatError, WorldError, expected_name
from trailmark.formats.files import write_atomically
from trailmark.formats.grid import MAX_CELLS, check_size, grid_fields, grid_polygons
from trailmark.formats.yaml_data import read_yaml
from trailmark.shapes import Polygon, Shape

if TYPE_CHECKING:
    from PIL.Image import Image

    from trailmark.formats.schema import MapFile

__all__ = [
    "FREE",
    "KINDS",
    "OCCUPIED",
    "UNKNOWN",
    "MaskKind",
    "free_cells",
    "pixels_of",
    "read_grid",
    "read_image",
    "read_mask",
    "read_nav2_map",
    "save_nav2_cells",
    "save_nav2_map",
]

T = TypeVar("T", bound=np.generic)

IMAGE_KINDS = {"PPM": "PGM/PBM/PPM", "PNG": "PNG", "BMP": "BMP", "JPEG": "JPEG"}

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
"""Grey values, as nav2's map_saver writes them."""

_ROWS_AT_ONCE = 256  # bounds the memory for one image's brightness values


def read_nav2_map(data: dict[str, Any], path: Path, unknown: bool | None = None) -> dict[str, Any]:
    """Return the arguments of a nav2 map's :class:`trailmark.World`.

    Obstacles are the cells that are not free, as polygons; with ``unknown`` False, those that are occupied. Where it is
    not None, ``unknown`` holds the polygons of cells that are neither free nor occupied. Bounds are the map's
    rectangle. If the origin has a yaw, the map is turned about its origin; then the rectangle is the boundary, and the
    bounds are its box.

    Args:
        data: the YAML file's plain data: image (beside the file, absolute, or ~/…), resolution (metres per pixel),
            origin [x, y, yaw] of the lower left pixel's outer corner; optional negate (0), occupied_thresh (0.65),
            free_thresh (0.196), mode (trinary). Other keys are ignored, as by nav2.
        path: the YAML file; its stem names the world.
        unknown: whether unknown cells are obstacles; None as if they were, and they are not told apart.

    Raises:
        FormatError: a field is missing or wrong, the image is missing, of another kind, damaged, or too large.
    """
    file = _map_file(data, path)
    image = path.parent / file.image
    fields = _fields(image, file, path.stem, (path.absolute(), image.absolute()), blocked=unknown is not False)
    if unknown is None:
        return fields
    cells, (x, y, yaw) = pixels_of(image, lambda pixels: _unknown_cells(pixels, file))[::-1], file.origin
    return {**fields, "unknown": grid_polygons(cells, file.resolution, (x, y, yaw))}


def read_grid(data: dict[str, Any], path: Path) -> tuple[NDArray[np.bool_], MapFile]:
    """Return which cells of a nav2 map are free, shape (rows, columns), row 0 with the smallest y, and its file.

    Arguments and errors are those of :func:`read_nav2_map`.
    """
    file = _map_file(data, path)
    return pixels_of(path.parent / file.image, lambda pixels: free_cells(pixels, file))[::-1], file


def read_image(path: Path, fields: dict[str, Any]) -> dict[str, Any]:
    """Return those of a map's image, whose nav2 map file would hold ``fields``; the origin's yaw may be left out.

    Raises:
        FormatError: as :func:`read_nav2_map`.
    """
    origin = np.asarray(fields["origin"]).tolist()
    given = [*origin, 0.0] if isinstance(origin, list) and len(origin) == 2 else origin
    file = _map_file({**fields, "origin": given, "image": path.name}, path)
    return _fields(path, file, path.stem, (path.absolute(),))


def _map_file(data: dict[str, Any], path: Path) -> MapFile:
    from trailmark.formats.schema import MapFile, validate

    return validate(MapFile, data, path)


def _fields(image: Path, file: MapFile, name: str, sources: tuple[Path, ...], blocked: bool = True) -> dict[str, Any]:
    unknown = 0

    def taken(pixels: Image) -> NDArray[np.bool_]:
        nonlocal unknown
        free = free_cells(pixels, file)
        if file.mode != "raw" and not file.negate and file.free_thresh >= (255 - UNKNOWN) / 255:
            values, full, _ = _channels(pixels)
            unknown = int(np.count_nonzero(free & (values[..., :3] == UNKNOWN).all(axis=-1))) if full == 255 else 0
        return free if blocked else free | _unknown_cells(pixels, file)

    free = pixels_of(image, taken)
    notes: tuple[str, ...] = ()
    if unknown and blocked and len(sources) > 1:  # whoever reads an image alone has named the threshold himself
        what = f"{unknown:,} cells of grey {UNKNOWN}, which map savers write for unknown, are free"
        notes = (f"{sources[0]}: {what} by free_thresh {file.free_thresh:g}; 0.196 keeps them out",)
    try:
        fields = grid_fields(~free[::-1], file.resolution, file.origin, name)
    except WorldError as error:
        raise FormatError(image, str(error)) from None
    return {**fields, "sources": sources, "notes": notes}


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
        p = _probability(values[rows].astype(np.int64), full, has_alpha, file)
        free[rows] = (p <= file.free_thresh) & (p < file.occupied_thresh)
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
        with warnings.catch_warnings():
            # Pillow's guard against decompression bombs is looser than the limit below, and warns first.
            warnings.simplefilter("ignore")
            with Image.open(path, formats=tuple(IMAGE_KINDS)) as image:
                check_size(*image.size)  # known from the header, before any pixel is decoded
                return take(image)
    except UnidentifiedImageError:
        problem = f"not an image that can be read; {allowed}"
    except Image.DecompressionBombError:
        problem = f"too many pixels; expected at most {MAX_CELLS:,}"
    except WorldError as error:
        problem = str(error)
    except Exception as error:  # Pillow's decoders raise errors of many kinds on damaged data
        reason = error.strerror if isinstance(error, OSError) else None
        damage = f"damaged image: {error or type(error).__name__}; {allowed}"
        problem = f"image cannot be read: {reason}; {allowed}" if reason else damage
    raise FormatError(path, problem)


MaskKind = Literal["keep-out", "speed"]
KINDS = ("keep-out", "speed")


def read_mask(
    path: Path,
    kind: MaskKind,
    *,
    max_speed: float = 1.0,
    base: float = 100.0,
    multiplier: float = -1.0,
    threshold: float = 100.0,
    max_factor: float = 1.0,
) -> tuple[list[tuple[Polygon, float]], tuple[Path, ...]]:
    """Return regions of a mask's cells, each with its speed limit or cost factor, and the files that were read.

    Cells of a keep-out mask from a value of ``threshold`` on are kept out of, their factor being infinite; lower ones
    are graded: a cell of value v costs 1 + (``max_factor`` - 1) · v / 100 times as much. Where that is 1, as it is
    unless told otherwise, or v is unknown, there is no zone. A cell of value v of a speed mask limits the speed to
    ``base + multiplier · v`` percent of ``max_speed``; where v is 0 or unknown, or that is not above 0 and at most 100,
    there is no limit. nav2's own mask of depot is read with base 100 and multiplier -1.

    Args:
        path: the YAML file, in the form of a nav2 map.
        kind: ``keep-out`` or ``speed``.
        max_speed: metres per second, above 0.
        base: percent.
        multiplier: percent for each unit of a cell's value.
        threshold: of a keep-out mask, above 0 and at most 100.
        max_factor: of a keep-out mask, 1 or more.

    Raises:
        WorldError: another kind, a number that is not finite, or a speed that is not above 0.
        FormatError: the file or its image cannot be read, or is no nav2 map.
    """
    if kind not in KINDS:
        raise WorldError(f"mask: kind: {expected_name(str(kind), KINDS)}")
    fastest = number(max_speed, "mask: max speed:", above=0.0, unit="m/s", error=WorldError)
    base, multiplier = (
        number(v, f"mask: {name}:", error=WorldError) for v, name in ((base, "base"), (multiplier, "multiplier"))
    )
    threshold = number(threshold, "mask: threshold:", above=0.0, maximum=100.0, error=WorldError)
    max_factor = number(max_factor, "mask: max factor:", minimum=1.0, maximum=1e6, error=WorldError)
    data: Any = read_yaml(path, "expected the YAML file of a nav2 mask")
    if not isinstance(data, dict) or "image" not in data:
        raise FormatError(path, "no mask: expected nav2 map YAML (keys image, resolution, origin)")
    file = _map_file(data, path)
    image = path.parent / file.image
    values = pixels_of(image, lambda pixels: _occupancy(pixels, file))[::-1]
    x, y, yaw = file.origin
    zones = list[tuple[Polygon, float]]()
    try:
        if kind == "keep-out":
            regions = grid_polygons(values >= threshold, file.resolution, (x, y, yaw))
            zones += [(region, np.inf) for region in regions]
        for value in np.unique(values[values > 0]).tolist():
            limit = 0.01 * (base + multiplier * value)
            if kind == "keep-out":
                limit = 1.0 + 0.01 * (max_factor - 1.0) * value
                if limit == 1.0 or value >= threshold:
                    continue
            elif not 0.0 < limit <= 1.0:
                continue
            regions = grid_polygons(values == value, file.resolution, (x, y, yaw))
            zones += [(region, limit if kind == "keep-out" else limit * fastest) for region in regions]
    except WorldError as error:
        raise FormatError(image, str(error)) from None
    return zones, (path.absolute(), image.absolute())


def _unknown_cells(image: Image, file: MapFile) -> NDArray[np.bool_]:
    """Return which pixels are neither free nor occupied."""
    return np.asarray((_occupancy(image, file, graded=False) == -1) & ~free_cells(image, file))


def _occupancy(image: Image, file: MapFile, graded: bool = True) -> NDArray[np.int8]:
    """Return the values that nav2 gives to pixels: 0 (free) to 100 (occupied), -1 where they are unknown.

    What is not ``graded`` in mode scale is, between the thresholds, unknown.
    """
    values, full, has_alpha = _channels(image)
    p = _probability(values.astype(np.int64), full, has_alpha, file)
    if file.mode == "raw":
        return np.where(p <= 1.0, np.rint(100.0 * p), -1).astype(np.int8)
    between, unknown = np.full(p.shape, -1.0), np.zeros(p.shape, np.bool_)
    if file.mode == "scale":
        unknown = (values[..., -1] != full) & has_alpha
        # Where both thresholds are the same, nothing lies between them but that value itself.
        room = file.occupied_thresh - file.free_thresh
        between = np.rint(100.0 * (p - file.free_thresh) / (room if room > 0.0 else 1.0)) if graded else between
    found = np.select([unknown, p > file.occupied_thresh, p < file.free_thresh], [-1.0, 100.0, 0.0], between)
    return found.astype(np.int8)


@checked_arguments(WorldError)
def save_nav2_map(world: Any, path: str | Path, resolution: Positive = 0.05) -> tuple[Path, Path]:
    """Write a :class:`trailmark.World` as a nav2 map.

    A cell is occupied where an obstacle may touch it, unknown where the world says that nothing is known (obstacles
    without an estimate, in a world that has estimates) or that is outside of its boundary, else free.

    Args:
        world: with its obstacles.
        path: the YAML file; the image stands beside it, with the suffix ``.pgm``.
        resolution: side of a cell, metres.

    Returns:
        The two files.

    Raises:
        WorldError: too many cells.
        OutputError: a path that cannot be written.
    """
    xmin, ymin, xmax, ymax = world.bounds
    columns, rows = (int(np.ceil((high - low) / resolution - 1e-6)) for low, high in ((xmin, xmax), (ymin, ymax)))
    check_size(columns, rows)
    grid = np.full((rows, columns), FREE, dtype=np.uint8)
    pairs = list(zip(world.obstacles, world.estimates or world.obstacles, strict=True))
    for shape in [shape for shape, known in pairs if known is None]:
        _fill(grid, shape, UNKNOWN, (xmin, ymin), resolution, 0.0)
    if world.boundary is not None:
        inside = np.zeros_like(grid)
        _fill(inside, world.boundary, 1, (xmin, ymin), resolution, 0.0)
        grid[inside == 0] = UNKNOWN
    for shape in [shape for shape, known in pairs if known is not None]:
        _fill(grid, shape, OCCUPIED, (xmin, ymin), resolution, resolution / np.sqrt(2.0))
    return save_nav2_cells(grid, path, resolution, (xmin, ymin))


def save_nav2_cells(
    cells: NDArray[np.uint8], path: str | Path, resolution: float, origin: tuple[float, float]
) -> tuple[Path, Path]:
    """Write a grid as a nav2 map.

    Args:
        cells: FREE, UNKNOWN or OCCUPIED, shape (rows, columns); row 0 has the smallest y.
        path: the YAML file; the image stands beside it, with the suffix ``.pgm``.
        resolution: side of a cell, metres.
        origin: x, y of the outer corner of cell (0, 0), metres.

    Returns:
        The two files.

    Raises:
        OutputError: a path that cannot be written.
    """
    file = Path(path)
    image = file.with_suffix(".pgm")
    (rows, columns), (x, y) = cells.shape, origin
    write_atomically(image, f"P5\n# CREATOR: trailmark\n{columns} {rows}\n255\n".encode() + cells[::-1].tobytes())
    lines = (
        "# Written by trailmark",
        f"image: {image.name}",
        "mode: trinary",
        f"resolution: {float(resolution)!r}",
        f"origin: [{float(x)!r}, {float(y)!r}, 0.0]",
        "negate: 0",
        "occupied_thresh: 0.65",
        "free_thresh: 0.196",
    )
    write_atomically(file, "\n".join(lines) + "\n")
    return file, image


def _fill(
    grid: NDArray[np.uint8], shape: Shape, value: int, origin: tuple[float, float], cell: float, margin: float
) -> None:
    """Set the cells whose centres lie within ``margin`` metres of a shape."""
    import shapely

    region = shape.polygon(0.1 * cell).shapely()
    region = shapely.buffer(region, margin) if margin > 0.0 else region
    low, high = np.array(region.bounds).reshape(2, 2)
    first = np.maximum(np.floor((low - origin) / cell).astype(int), 0)
    last = np.minimum(np.ceil((high - origin) / cell).astype(int), grid.shape[::-1])
    if (last <= first).any():
        return
    x = origin[0] + cell * (np.arange(first[0], last[0]) + 0.5)
    y = origin[1] + cell * (np.arange(first[1], last[1]) + 0.5)
    shapely.prepare(region)
    own = grid[first[1] : last[1], first[0] : last[0]]
    own[shapely.intersects_xy(region, x[None, :], y[:, None])] = value
