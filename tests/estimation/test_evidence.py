"""The grid of hits and passes, against beams that are followed in small steps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.estimation.grid import EvidenceGrid

coordinate = st.floats(-0.7, 4.7)


@pytest.mark.slow
@given(st.tuples(coordinate, coordinate), st.tuples(coordinate, coordinate), st.booleans(), st.floats(0.0, 3.0))
def test_a_beam_counts_in_the_cells_that_it_crosses(
    start: tuple[float, float], end: tuple[float, float], met: bool, margin: float
) -> None:
    grid = EvidenceGrid((0.0, 0.0, 4.0, 3.0), 0.25)
    a, b = np.array(start), np.array(end)
    length = float(np.hypot(*(b - a)))
    grid.add(a, b[None], np.array([met]), margin, (0.1, 0.1))
    assert grid.passes.max() <= 1
    t = np.linspace(0.0, 1.0, 2001)
    steps = np.floor((a + t[:, None] * (b - a)) / 0.25).astype(int)
    last = np.floor(b / 0.25).astype(int)
    # Padded by a cell: what lies next to the steps may be crossed by rounding.
    near = np.zeros((14, 18), dtype=bool)
    kept = (steps >= -1).all(axis=1) & (steps[:, 0] <= 16) & (steps[:, 1] <= 12)
    for i, j in np.unique(steps[kept], axis=0):
        near[max(0, j) : j + 3, max(0, i) : i + 3] = True
    assert (grid.passes[~near[1:-1, 1:-1]] == 0).all()
    # Cells that are crossed over a length that no rounding makes up.
    before_hit = ~((steps == last).all(axis=1) | (t * length > length - margin * 0.25)) | (not met)
    own = kept & before_hit & (steps >= 0).all(axis=1) & (steps[:, 0] < 16) & (steps[:, 1] < 12)
    counts = np.zeros((12, 16), dtype=int)
    np.add.at(counts, (steps[own, 1], steps[own, 0]), 1)
    assert length < 1e-300 or (grid.passes[counts > 5] == 1).all()
    hit = met and length > 0.0 and 0.0 <= b[0] < 4.0 and 0.0 <= b[1] < 3.0
    assert grid.hits.sum() == int(hit)
    if hit:
        assert grid.hits[last[1], last[0]] == 1
        assert grid.passes[last[1], last[0]] == 0
        assert grid.variance.sum() == pytest.approx(0.01 + (0.1 * length) ** 2, rel=1e-5)


def test_what_was_there_and_is_gone_is_free() -> None:
    grid = EvidenceGrid((0.0, 0.0, 4.0, 1.0), 0.1)
    start, near, far = np.array([0.05, 0.55]), np.array([[2.05, 0.55]]), np.array([[3.05, 0.55]])
    for _ in range(3):
        grid.add(start, near, np.array([True]))
    assert grid.occupied()[5, 20]
    for _ in range(20):
        grid.add(start, far, np.array([True]))
    assert not grid.occupied()[5, 20]
    assert grid.occupied()[5, 30]
    assert grid.centres(grid.occupied()) == pytest.approx(np.array([[3.05, 0.55]]))
    rows, columns = grid.cells(np.array([[2.05, 0.55], [-9.0, 99.0]]))
    assert rows.tolist() == [5, 9]
    assert columns.tolist() == [20, 0]
