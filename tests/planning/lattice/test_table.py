"""The table of a lattice search against a dict: what was noted down is found, what was not is not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.trials import few

from trailmark.planning.lattice.nodes import (
    CHECKED,
    DONE,
    MIN_BITS,
    RETRACTED,
    VALID,
    SearchTable,
    doubled,
    entry_of,
    new_table,
)

Known = dict[int, tuple[int, float, int]]
"""Of each node: what is known, cost, move."""

BITS = 24

nodes = st.one_of(
    st.integers(0, 40),
    st.integers(0, 2**63 - 2),
    # As a lattice numbers them: heading, row, column.
    st.builds(
        lambda k, row, column: (k << 2 * BITS) + (row << BITS) + column,
        st.integers(0, 63),
        st.integers(0, 9),
        st.integers(0, 9),
    ),
)
entries = st.tuples(
    st.sampled_from([0, CHECKED, DONE, CHECKED | VALID, CHECKED | VALID | DONE]),
    st.floats(0.0, 1e6, width=32),
    st.integers(0, 255),
)


def take_down(tree: SearchTable, node: int, entry: tuple[int, float, int]) -> None:
    where = entry_of(tree, node)
    assert tree.node[where] in (0, node + 1)
    tree.node[where], tree.known[where], tree.cost[where], tree.move[where] = node + 1, *entry


def contents(tree: SearchTable) -> Known:
    """What a table holds, entry by entry."""
    used = np.flatnonzero(tree.node)
    found = {int(tree.node[i]) - 1: (int(tree.known[i]), float(tree.cost[i]), int(tree.move[i])) for i in used}
    assert len(found) == len(used)
    return found


def room_for_one(tree: SearchTable, used: int) -> SearchTable:
    """The table, doubled if half of it would be used otherwise."""
    return doubled(tree) if 2 * (used + 1) > len(tree.node) else tree


def agree(tree: SearchTable, known: Known) -> None:
    assert contents(tree) == known
    for node in known:
        assert tree.node[entry_of(tree, node)] == node + 1


@pytest.mark.slow
@settings(max_examples=few(100))
@given(written=st.lists(st.tuples(nodes, entries), max_size=60), others=st.lists(nodes, max_size=20))
def test_the_table_is_a_dict(written: list[tuple[int, tuple[int, float, int]]], others: list[int]) -> None:
    tree, known = new_table(4), Known()
    for node, entry in written:
        tree = room_for_one(tree, len(known))
        take_down(tree, node, entry)
        known[node] = entry
    agree(tree, known)
    larger = doubled(tree)
    assert len(larger.node) == 2 * len(tree.node)
    agree(larger, known)
    # The old one is as it was.
    agree(tree, known)
    for table in (tree, larger):
        for node in others:
            where = entry_of(table, node)
            assert table.node[where] == (node + 1 if node in known else 0)
            if node not in known:
                assert (table.known[where], table.cost[where], table.move[where]) == (0, 0.0, 0)
        # Asking takes nothing down.
        assert contents(table) == known


def test_a_new_table_is_empty() -> None:
    for tree, length in ((new_table(), 1 << MIN_BITS), (new_table(16), 16)):
        assert {len(column) for column in tree[:-1]} == {length}
        assert tree.retracted.shape == (0, 3)
        assert new_table(length, True).retracted.shape == (length, 3)
        assert contents(tree) == {}
        assert tree.node[entry_of(tree, 0)] == tree.node[entry_of(tree, 2**62)] == 0


@pytest.mark.parametrize("place", [0, 5, 15])
def test_nodes_that_collide_are_kept_apart(place: int) -> None:
    # Eight that belong at the same place, the last one too, from where it goes on at the first.
    empty = new_table(16)
    colliding = [node for node in range(10_000) if entry_of(empty, node) == place][:9]
    tree, known = new_table(16), Known()
    for i, node in enumerate(colliding[:8]):
        take_down(tree, node, (CHECKED, float(i), i))
        known[node] = (CHECKED, float(i), i)
        agree(tree, known)
    assert sorted(np.flatnonzero(tree.node)) == sorted((place + i) % 16 for i in range(8))
    # One that is not there is not noted for any of them.
    assert entry_of(tree, colliding[8]) == (place + 8) % 16
    agree(doubled(tree), known)


def test_what_is_known_are_bits() -> None:
    bits = (CHECKED, VALID, DONE, RETRACTED)
    assert len(set(bits)) == 4
    assert all(bit and bit & (bit - 1) == 0 for bit in bits)


def test_seats_move_with_their_nodes_when_the_table_grows() -> None:
    tree = new_table(16, True)
    retracts = {node: np.array([float(node), -1.0, 0.5]) for node in (3, 40, 1 << 50)}
    for node, q in retracts.items():
        take_down(tree, node, (VALID | RETRACTED, 1.0, 2))
        tree.retracted[entry_of(tree, node)] = q
    larger = doubled(tree)
    assert larger.retracted.shape == (32, 3)
    for node, q in retracts.items():
        assert (larger.retracted[entry_of(larger, node)] == q).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("headings", "entries"), [(1, 1 << 12), (8, 1 << MIN_BITS), (8, 1 << 12), (16, 1 << 16), (64, 1 << 12)]
)
def test_nodes_of_a_lattice_are_found_where_they_belong_or_nearly(headings: int, entries: int) -> None:
    # A square of positions in all headings, as many as a table is to hold.
    side = math.isqrt(entries // 2 // headings)
    empty, tree, away = new_table(entries), new_table(entries), []
    for row in range(700, 700 + side):
        for column in range(1000, 1000 + side):
            for k in range(headings):
                node = (k << 2 * BITS) + (row << BITS) + column
                where = entry_of(tree, node)
                tree.node[where] = node + 1
                away.append((where - entry_of(empty, node)) % entries)
    # By chance it would be half an entry, at half of the entries in use.
    assert np.mean(away) < 1.0
