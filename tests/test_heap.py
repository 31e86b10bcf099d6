"""The heap against the standard library's, and labels against a dictionary and that."""

from __future__ import annotations

import heapq

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark.heap import (
    COUNT,
    WAITING,
    Labels,
    add_label,
    entry_of,
    heap_grow,
    heap_pop,
    heap_push,
    label_of,
    new_labels,
    next_label,
    with_room,
)
from trailmark.jit import njit


@pytest.mark.slow
@given(st.lists(st.floats(-1e9, 1e9), max_size=40), st.data())
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


@njit(nogil=True)
def first_labels() -> Labels:
    return new_labels(2, 1)


@njit(nogil=True)
def with_room_for_one(labels: Labels) -> Labels:
    return with_room(labels, 1)


NODES = st.one_of(st.integers(-3, 20), st.integers(-(2**62), 2**62))


@pytest.mark.slow
@given(st.lists(st.tuples(NODES, st.floats(0.0, 1e9)), max_size=40), st.sets(st.integers(0, 39)))
def test_labels_are_found_by_node_and_come_out_by_key(found: list[tuple[int, float]], closed: set[int]) -> None:
    labels, newest = first_labels(), dict[int, int]()
    for i, (node, key) in enumerate(found):
        labels = with_room_for_one(labels)
        assert add_label(labels, entry_of(labels, node), node, i - 1, 2.0 * key, key) == i == labels.counts[COUNT] - 1
        labels.q[i], labels.more[i], newest[node] = (i, key, 1.0), -key, i
        labels.closed[i] = i in closed
    assert all(label_of(labels, node) == newest.get(node, -1) for node in [*newest, 21, -4])
    for i, (node, key) in enumerate(found):
        assert (labels.node[i], labels.parent[i], labels.cost[i], labels.more[i, 0]) == (node, i - 1, 2.0 * key, -key)
        assert labels.q[i].tolist() == [i, key, 1.0]
    taken = []
    while labels.counts[WAITING] > 0:
        label, key = next_label(labels), labels.keys[labels.counts[WAITING]]
        taken.append(key)
        assert label in (-1, *range(len(found)))
        assert label < 0 or (label not in closed and found[label][1] == key)
    assert taken == sorted(key for _, key in found)
