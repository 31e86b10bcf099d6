"""Worlds and grids as ROS / nav2 occupancy maps: a YAML file and the PGM image that it names."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trailmark.checked import Positive, checked_arguments
from trailmark.errors import WorldError
from trailmark.formats.files import write_atomically
from trailmark.formats.grid import check_size
from trailmark.shapes import Shape
from trailmark.world import World

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "save_nav2_cells", "save_nav2_map"]

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
"""Grey values, as nav2's map_saver writes them."""


@checked_arguments(WorldError)
def save_nav2_map(world: World, path: str | Path, resolution: Positive = 0.05) -> tuple[Path, Path]:
    """Write a world as a nav2 map.

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
    estimates = world.estimates or (None,) * len(world.obstacles)
    nothing_known = [s for s, estimate in zip(world.obstacles, estimates, strict=True) if estimate is None]
    unknown, solid = (nothing_known, [s for s, e in zip(world.obstacles, estimates, strict=True) if e is not None])
    if not world.estimates:
        unknown, solid = [], list(world.obstacles)
    for shape in unknown:
        _fill(grid, shape, UNKNOWN, (xmin, ymin), resolution, 0.0)
    if world.boundary is not None:
        inside = np.zeros_like(grid)
        _fill(inside, world.boundary, 1, (xmin, ymin), resolution, 0.0)
        grid[inside == 0] = UNKNOWN
    for shape in solid:
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
