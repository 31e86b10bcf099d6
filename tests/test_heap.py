"""The heap against the standard library's."""

from __future__ import annotations

import heapq

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.heap import heap_grow, heap_pop, heap_push

KEYS = st.lists(st.floats(-1e9, 1e9), max_size=40)


@pytest.mark.slow
@given(KEYS, st.data())
def test_entries_come_out_smallest_first(numbers: list[float], data: st.DataObject) -> None:
    keys, values, size = np.empty(1), np.empty(1, np.int64), 0
    expected: list[float] = []
    for value, key in enumerate(numbers):
        if size == len(keys):
            keys, values = heap_grow(keys, values)
        size = heap_push(keys, values, size, key, value)
        heapq.heappush(expected, key)
        if data.draw(st.booleans()):
            size = heap_pop(keys, values, size)
            assert keys[size] == heapq.heappop(expected) == numbers[values[size]]
    while size:
        size = heap_pop(keys, values, size)
        assert keys[size] == heapq.heappop(expected) == numbers[values[size]]
    assert expected == []


@pytest.mark.parametrize("length", [1, 2, 5])
def test_a_grown_heap_has_twice_the_room_and_the_same_entries(length: int) -> None:
    keys, values = np.arange(length, dtype=float), np.arange(length)
    more_keys, more_values = heap_grow(keys, values)
    assert (len(more_keys), len(more_values)) == (2 * length, 2 * length)
    assert np.array_equal(more_keys[:length], keys)
    assert np.array_equal(more_values[:length], values)
