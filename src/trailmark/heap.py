"""What compiled best-first searches share: a binary heap, and on it labels, found by their node in a hash table.

A label is a way to a node of a graph that is made while it is searched. All that is known of labels is in flat arrays,
which grow: what is not reached takes no memory, and each page of it that is touched costs as much as expanding a node.

Source: linear probing with multiplicative hashing: Knuth, "The Art of Computer Programming" vol. 3, section 6.4.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import array_callee, njit

__all__ = [
    "COUNT",
    "NO_LABELS",
    "WAITING",
    "Labels",
    "add_label",
    "entry_of",
    "heap_grow",
    "heap_pop",
    "heap_push",
    "label_of",
    "new_labels",
    "next_label",
    "with_room",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit(numbers=True)
def heap_push(keys: FloatArray, values: IntArray, size: int, key: float, value: int) -> int:
    """Add an entry to a heap of ``size`` entries with room for one more; return the new size."""
    i = size
    while i > 0:
        parent = (i - 1) >> 1
        if keys[parent] <= key:
            break
        keys[i], values[i] = keys[parent], values[parent]
        i = parent
    keys[i], values[i] = key, value
    return size + 1


@njit(numbers=True)
def heap_pop(keys: FloatArray, values: IntArray, size: int) -> int:
    """Move the entry with the smallest key to position size - 1, out of the heap; return the new size."""
    size -= 1
    top_key, top_value = keys[0], values[0]
    key, value = keys[size], values[size]
    i = 0
    while True:
        child = 2 * i + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[i], values[i] = keys[child], values[child]
        i = child
    keys[i], values[i] = key, value
    keys[size], values[size] = top_key, top_value
    return size


@njit(nogil=True)
def heap_grow(keys: FloatArray, values: IntArray) -> tuple[FloatArray, IntArray]:
    """Return copies of both arrays of twice the length."""
    more_keys, more_values = np.empty(2 * len(keys)), np.empty(2 * len(values), np.int64)
    more_keys[: len(keys)] = keys
    more_values[: len(values)] = values
    return more_keys, more_values


COUNT, WAITING = 0, 1
"""Places in :attr:`Labels.counts`."""

_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)


class Labels(NamedTuple):
    """The labels of one search, numbered as they are found."""

    node: IntArray  # (capacity,) what each leads to
    parent: NDArray[np.int32]  # (capacity,) the label before, -1 where there is none
    cost: FloatArray  # (capacity,)
    # (capacity,) whether a label that waits is to be passed over; more by each search's own numbers
    closed: NDArray[np.uint8]
    q: FloatArray  # (capacity, 3) configurations
    more: FloatArray  # (capacity, k) what else a search knows of its labels
    # the newest label of each node, -1 where there is none; a power of two of entries, twice the capacity
    table: NDArray[np.int32]
    keys: FloatArray  # heap of those that wait, (capacity,)
    values: IntArray  # their numbers
    counts: IntArray  # (2,) number of labels, and of those that wait


_EMPTY: Any = (
    *(np.empty(0, kind) for kind in (np.int64, np.int32, np.float64, np.uint8)),
    *(np.empty((0, 0)) for _ in range(2)),
    *(np.empty(0, kind) for kind in (np.int32, np.float64, np.int64)),
    np.zeros(2, np.int64),
)
NO_LABELS = Labels(*_EMPTY)
"""Of a search that has not begun."""


@array_callee
def new_labels(capacity: int, more: int) -> Labels:
    """Return memory for a power of two of labels, none there yet, with ``more`` values of each."""
    return Labels(
        np.empty(capacity, np.int64),
        np.empty(capacity, np.int32),
        np.empty(capacity),
        np.empty(capacity, np.uint8),
        np.empty((capacity, 3)),
        np.empty((capacity, more)),
        np.full(2 * capacity, -1, np.int32),
        np.empty(capacity),
        np.empty(capacity, np.int64),
        np.zeros(2, np.int64),
    )


@array_callee
def with_room(labels: Labels, count: int) -> Labels:
    """Return the labels with room for some more."""
    n, capacity = len(labels.node), len(labels.node)
    while labels.counts[COUNT] + count > capacity:
        capacity *= 2
    if capacity == n:
        return labels
    larger = new_labels(capacity, labels.more.shape[1])
    larger.node[:n], larger.parent[:n], larger.cost[:n] = labels.node, labels.parent, labels.cost
    larger.closed[:n], larger.q[:n], larger.more[:n] = labels.closed, labels.q, labels.more
    larger.keys[:n], larger.values[:n], larger.counts[:] = labels.keys, labels.values, labels.counts
    for label in range(labels.counts[COUNT]):
        larger.table[entry_of(larger, labels.node[label])] = label
    return larger


@njit(numbers=True)
def entry_of(labels: Labels, node: int) -> int:
    """Return a node's entry in the table, or where it belongs."""
    table, mask = labels.table, len(labels.table) - 1
    # The upper half of the product is well mixed, once what tells nodes apart is low enough to get there.
    entry = np.int64((np.uint64(node ^ (node >> 32)) * _MULTIPLIER) >> np.uint64(32)) & mask
    while table[entry] >= 0 and labels.node[table[entry]] != node:
        entry = (entry + 1) & mask
    return int(entry)


@njit(numbers=True)
def label_of(labels: Labels, node: int) -> int:
    """Return a node's newest label, -1 if it has none."""
    return int(labels.table[entry_of(labels, node)])


@njit(numbers=True)
def add_label(labels: Labels, entry: int, node: int, parent: int, cost: float, key: float) -> int:
    """Return a new label, for which there is room: its node's newest by the entry in the table, waiting by its key."""
    label = labels.counts[COUNT]
    labels.counts[COUNT] += 1
    labels.table[entry] = label
    labels.node[label], labels.parent[label], labels.cost[label], labels.closed[label] = node, parent, cost, 0
    labels.counts[WAITING] = heap_push(labels.keys, labels.values, labels.counts[WAITING], key, label)
    return int(label)


@njit(numbers=True)
def next_label(labels: Labels) -> int:
    """Take the label with the smallest key out of those that wait, at least one; return it, -1 if it is closed.

    Its key is in ``keys``, at the number of those that still wait.
    """
    labels.counts[WAITING] = heap_pop(labels.keys, labels.values, labels.counts[WAITING])
    label = labels.values[labels.counts[WAITING]]
    return -1 if labels.closed[label] else int(label)
