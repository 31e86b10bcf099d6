"""What a lattice search knows of the nodes that it has come to, in a hash table: memory grows with these alone.

Arrays over all nodes would be simpler, but each page of memory that is touched for the first time costs as much as
expanding a node.

Source: linear probing with multiplicative hashing: Knuth, "The Art of Computer Programming" vol. 3, section 6.4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit

__all__ = ["CHECKED", "DONE", "MIN_BITS", "RETRACTED", "VALID", "SearchTable", "doubled", "entry_of", "new_table"]

CHECKED, VALID, DONE, RETRACTED = 1, 2, 4, 8
"""What is known of a node: bits."""

MIN_BITS = 9
"""Binary logarithm of the entries of a new table."""

_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)


class SearchTable(NamedTuple):
    """A table of nodes; at most half of its entries are to be used.

    Attributes:
        node: numbers plus 1; 0 where an entry is not used.
        known: CHECKED, VALID, DONE, and RETRACTED where the configuration is not the lattice's own.
        cost: from the start, metres.
        move: that led there, plus 1; 0 if none did.
        retracted: configurations of the nodes that are RETRACTED, (entries, 3); empty if none ever is.
    """

    node: NDArray[np.int64]
    known: NDArray[np.uint8]
    cost: NDArray[np.float32]
    move: NDArray[np.uint8]
    retracted: NDArray[np.float64]


@njit(cache=True)
def new_table(entries: int = 1 << MIN_BITS, retracts: bool = False) -> SearchTable:
    """Return an empty table with room for a power of two of entries, and if ``retracts`` for their configurations."""
    return SearchTable(
        np.zeros(entries, np.int64),
        np.zeros(entries, np.uint8),
        np.zeros(entries, np.float32),
        np.zeros(entries, np.uint8),
        np.zeros((entries if retracts else 0, 3)),
    )


@njit(cache=True)
def entry_of(table: SearchTable, node: int) -> int:
    """Return a node's entry; one that is not used, where the node belongs, if it is not there."""
    mask = len(table.node) - 1
    # The upper half of the product is well mixed, once what tells headings apart is low enough to get there.
    entry = np.int64((np.uint64(node ^ (node >> 32)) * _MULTIPLIER) >> np.uint64(32)) & mask
    while table.node[entry] != 0 and table.node[entry] != node + 1:
        entry = (entry + 1) & mask
    return int(entry)


@njit(cache=True)
def doubled(table: SearchTable) -> SearchTable:
    """Return a table of twice the size with the same nodes."""
    larger = new_table(2 * len(table.node), len(table.retracted) > 0)
    for old in range(len(table.node)):
        if table.node[old] != 0:
            new = entry_of(larger, table.node[old] - 1)
            larger.node[new], larger.known[new] = table.node[old], table.known[old]
            larger.cost[new], larger.move[new] = table.cost[old], table.move[old]
            if len(table.retracted):
                larger.retracted[new] = table.retracted[old]
    return larger
