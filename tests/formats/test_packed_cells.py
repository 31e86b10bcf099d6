"""Packed cells: a grid map's cells survive a line of text."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.errors import WorldError
from trailmark.formats.cell_obstacles import CellObstacles
from trailmark.formats.packed_cells import packed_cells, unpacked_cells


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (64, 33)])
def test_cells_come_back_as_they_were(shape: tuple[int, int]) -> None:
    occupied = np.random.default_rng(1).random(shape) < 0.3
    cells = CellObstacles(occupied, 0.1, (-3.7, 0.1 + 0.2, 0.5))
    found = unpacked_cells("trailmark: 1\nname: map\n" + packed_cells(cells))
    assert found is not None
    assert (found.occupied == occupied).all()
    assert (found.cell, found.origin) == (cells.cell, cells.origin)


def test_a_text_without_cells_has_none() -> None:
    assert unpacked_cells("trailmark: 1\n") is None
    assert unpacked_cells("# cells: 1 1 1.0 0.0 0.0 0.0 x\ntrailmark: 1\n") is None
    assert unpacked_cells("") is None


@pytest.mark.parametrize("line", ["1 1 1.0 0.0 0.0 0.0", "1 1 1.0 0.0 0.0 0.0 x", "9 9 1.0 0.0 0.0 0.0 eJxjAAAAAQAB"])
def test_cells_that_were_changed_are_refused(line: str) -> None:
    with pytest.raises(WorldError, match="expected what packed_cells wrote"):
        unpacked_cells(f"# cells: {line}\n")
