"""What a lattice search knows of the nodes that it has come to, in a hash table: memory grows with these alone.

Arrays over all nodes would be simpler, but each page of memory that is touched for the first time costs as much as
taking a node from the queue.

Source: linear probing with multiplicative hashing: Knuth, "The Art of Computer Programming" vol. 3, section 6.4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit

__all__ = ["CHECKED", "DONE", "FEWEST", "SEATED", "VALID", "Tree", "entry_of", "grown", "new_tree"]

CHECKED, VALID, DONE, SEATED = 1, 2, 4, 8
"""What is known of a node: bits."""

FEWEST = 9
"""Power of two: entries of a new table."""

_MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)


class Tree(NamedTuple):
    """A table of nodes; at most half of its entries are to be used.

    Attributes:
        node: numbers plus 1; 0 where an entry is not used.
        known: CHECKED, VALID, DONE, and SEATED where the configuration is not the lattice's own.
        cost: from the start, metres.
        move: that led there, plus 1; 0 if none did.
        retract: configurations of the nodes that are SEATED, (entries, 3); empty if none ever is.
    """

    node: NDArray[np.int64]
    known: NDArray[np.uint8]
    cost: NDArray[np.float32]
    move: NDArray[np.uint8]
    retract: NDArray[np.float64]


@njit(cache=True)
def new_tree(entries: int = 1 << FEWEST, retracts: bool = False) -> Tree:
    """Return an empty table with room for a power of two of entries, and for their retracts if there are any."""
    return Tree(
        np.zeros(entries, np.int64),
        np.zeros(entries, np.uint8),
        np.zeros(entries, np.float32),
        np.zeros(entries, np.uint8),
        np.zeros((entries if retracts else 0, 3)),
    )


@njit(cache=True, inline="always")
def entry_of(tree: Tree, node: int) -> int:
    """Return a node's entry; one that is not used, where the node belongs, if it is not there."""
    mask = len(tree.node) - 1
    # The upper half of the product is well mixed, once what tells headings apart is low enough to get there.
    entry = np.int64((np.uint64(node ^ (node >> 32)) * _MULTIPLIER) >> np.uint64(32)) & mask
    while tree.node[entry] != 0 and tree.node[entry] != node + 1:
        entry = (entry + 1) & mask
    return int(entry)


@njit(cache=True)
def grown(tree: Tree) -> Tree:
    """Return a table of twice the size with the same nodes."""
    larger = new_tree(2 * len(tree.node), len(tree.retract) > 0)
    for old in range(len(tree.node)):
        if tree.node[old] != 0:
            new = entry_of(larger, tree.node[old] - 1)
            larger.node[new], larger.known[new] = tree.node[old], tree.known[old]
            larger.cost[new], larger.move[new] = tree.cost[old], tree.move[old]
            if len(tree.retract):
                larger.retract[new] = tree.retract[old]
    return larger
