"""Packed cells: a grid map's cells survive a world file."""

from __future__ import annotations

import base64
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trailmark.errors import FormatError
from trailmark.formats.grid import CellObstacles, cells_of, packed_cells, unpacked_cells
from trailmark.formats.schema import GridEntry
from trailmark.formats.world_yaml import world_from_data, world_text
from trailmark.formats.yaml_data import parse_yaml
from trailmark.world import World

FILE = Path("map.yaml")


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (64, 33)])
def test_cells_come_back_as_they_were(shape: tuple[int, int]) -> None:
    occupied = np.random.default_rng(1).random(shape) < 0.3
    cells = CellObstacles(occupied, 0.1, (-3.7, 0.1 + 0.2, 0.5))
    found = unpacked_cells(GridEntry(**packed_cells(cells)))
    assert (found.occupied == occupied).all()
    assert (found.cell, found.origin) == (cells.cell, cells.origin)


def test_a_world_file_holds_cells_or_polygons() -> None:
    occupied = np.random.default_rng(2).random((9, 17)) < 0.3
    world = World.from_grid(occupied, 0.25, (-1.0, 2.0), name="map")
    read = {grid: _read(world_text(world, grid)) for grid in (False, True)}
    cells = cells_of(read[True])
    assert cells is not None
    assert (cells.occupied == occupied).all()
    assert cells_of(read[False]) is None
    assert tuple(read[True].obstacles) == read[False].obstacles == tuple(world.obstacles)
    # What is known of single obstacles is written with them.
    named = World("map", world.bounds, world.obstacles, ids=tuple(map(str, range(len(world.obstacles)))))
    assert _read(world_text(named, grid=True)).ids == named.ids


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": 0}, "grid.rows: "),
        ({"rows": 4}, "expected 3 bytes of bits for 4 rows of 6 cells, got 2"),
        ({"rows": 1}, "expected 1 bytes of bits for 1 rows of 6 cells, got more than 1"),
        ({"columns": 10**9}, "expected 1 to 64,000,000 cells"),
        ({"occupied": "x"}, "expected occupied to be bits"),
        ({"occupied": base64.b64encode(b"bits").decode()}, "expected occupied to be bits"),
        ({"occupied": base64.b64encode(zlib.compress(bytes(10**8))).decode()}, "got more than 2"),
        ({"origin": [0.0, 0.0]}, "grid.origin: "),
        ({"side": 1.0}, "grid.side: unknown key"),
    ],
)
def test_other_cells_are_refused(change: dict[str, Any], message: str) -> None:
    grid = packed_cells(CellObstacles(np.eye(2, 6, dtype=np.bool_)))
    with pytest.raises(FormatError, match=message):
        _from_data(grid=grid | change)


def test_cells_and_obstacles_exclude_each_other() -> None:
    grid = packed_cells(CellObstacles(np.eye(2, dtype=np.bool_)))
    with pytest.raises(FormatError, match="expected obstacles or a grid, got both"):
        _from_data(grid=grid, obstacles=[{"shape": "disc", "center": [0.5, 0.5], "radius": 0.1}])


def _read(text: str) -> World:
    data = parse_yaml(text, FILE)
    assert isinstance(data, dict)
    return world_from_data(data, FILE)


def _from_data(**parts: Any) -> World:
    return world_from_data({"trailmark": 1, "bounds": [0.0, 0.0, 6.0, 6.0], **parts}, FILE)
