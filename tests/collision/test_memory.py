"""Blocks of memory: used again as soon as nobody holds an array of theirs, and no sooner."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.edits import Blocks

KINDS: list[NDArray[Any]] = [np.zeros((3, 5), np.int32), np.zeros(7, np.float32), np.zeros((0, 4))]


def test_arrays_have_the_shapes_and_types_asked_for() -> None:
    arrays, content = Blocks(KINDS).take(object(), [])
    assert content is None
    for array, kind in zip(arrays, KINDS, strict=True):
        assert array.shape == kind.shape
        assert array.dtype == kind.dtype
        assert array.flags.c_contiguous
        assert array.flags.aligned
        assert array.flags.writeable


def test_a_block_is_free_when_the_last_view_of_its_arrays_is_gone() -> None:
    blocks, first, second, third = Blocks(KINDS), object(), object(), object()
    arrays, _ = blocks.take(first, [])
    arrays[0][...] = 5
    view = arrays[0][1:].view(np.uint32).T[2:]
    del arrays
    others, content = blocks.take(second, [first])
    assert content is None
    others[0][...] = 7
    assert (view == 5).all()
    del view
    again, content = blocks.take(third, [second, first])
    assert content is first
    assert (again[0] == 5).all()
    assert (others[0] == 7).all()


def test_content_that_nobody_wants_is_not_named() -> None:
    blocks = Blocks(KINDS)
    blocks.take(object(), [])
    assert blocks.take(object(), [object()])[1] is None


def test_the_most_useful_free_block_is_taken() -> None:
    blocks, versions = Blocks(KINDS), [object() for _ in range(3)]
    held = [blocks.take(version, [])[0] for version in versions]
    held.clear()
    assert blocks.take(object(), [versions[1], versions[0]])[1] is versions[1]
