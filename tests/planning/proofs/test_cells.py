"""Cells tile their space, and each knows all that lie across its faces; intervals of whole numbers judge."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.support.trials import few

from trailmark.planning.proofs.cells import (
    CHILD,
    COLUMNS,
    LEVEL,
    LEVELS,
    Division,
    I,
    J,
    K,
    leaf_at,
    neighbours,
    split,
)

DEEPEST = 4


def division(turns: list[int]) -> Division:
    none, starts = np.empty((0, 2)), np.zeros(LEVELS + 1, np.int64)
    half, open_ = 0.5 ** np.arange(1, LEVELS + 1, dtype=np.float64), np.zeros(LEVELS)
    return Division(0.0, 0.0, 3, 2, half, np.array(turns, np.int64), open_, none, np.zeros(1, np.int64), starts)


def boxes(cells: NDArray[np.int32], space: Division) -> NDArray[np.int64]:
    """Return each cell's low and high x, y and heading in units of the deepest level's cells, shape (n, 3, 2)."""
    level = cells[:, LEVEL].astype(np.int64)
    edge = np.column_stack([1 << (DEEPEST - level)] * 2 + [1 << (space.turns[DEEPEST] - space.turns[level])])
    low = cells[:, [I, J, K]] * edge
    return np.stack([low, low + edge], axis=-1)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=few(40))
def test_neighbours_are_all_that_share_a_part_of_a_face(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = np.concatenate([[0], np.cumsum(rng.integers(0, 2, LEVELS - 1))]).tolist()
    space = division(turns)
    cells = np.zeros((4000, COLUMNS), np.int32)
    used = space.columns * space.rows
    cells[:used, I], cells[:used, J] = np.arange(used) % space.columns, np.arange(used) // space.columns
    cells[:used, CHILD] = -1
    for _ in range(25):
        cell = int(rng.integers(used))
        if cells[cell, CHILD] < 0 and cells[cell, LEVEL] < DEEPEST:
            used = split(cells, space, cell, used)
    leaves = np.flatnonzero(cells[:used, CHILD] < 0)
    box = boxes(cells[leaves], space)
    headings = 1 << int(space.turns[DEEPEST])
    whole = (space.columns << DEEPEST) * (space.rows << DEEPEST) * headings
    assert np.prod(box[..., 1] - box[..., 0], axis=1).sum() == whole
    around = np.empty(1, np.int64)
    for at, leaf in enumerate(leaves):
        count, around = neighbours(cells, space, int(leaf), around)
        expected = set()
        for round_ in (-headings, 0, headings):
            shifted = box + np.array([0, 0, round_])[:, None]
            shared = np.minimum(box[at, :, 1], shifted[..., 1]) - np.maximum(box[at, :, 0], shifted[..., 0])
            touching = ((shared == 0).sum(axis=1) == 1) & ((shared > 0).sum(axis=1) == 2)
            expected |= set(leaves[touching].tolist())
        assert set(around[:count].tolist()) - {leaf} == expected - {leaf}
        i, j, k = (box[at, :, 0]).tolist()
        assert leaf_at(cells, space, DEEPEST, i, j, k) == leaf
