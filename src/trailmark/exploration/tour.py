"""The tour strategy: a shortest way past landmarks from which all frontiers are seen; the first of them is next."""

# Tested by tests/exploration/test_strategies.py.

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.exploration.outlook import Outlook
from trailmark.se2 import FloatArray

__all__ = ["covering_tour", "shortened_tour", "tour"]

FAR = 1e6
"""Metres: in place of the cost of a way that was not found; finite, so that tours with such ways can be compared."""

ROUNDS = 10
"""Of improvements at most; each of them makes the tour shorter."""


def tour(outlook: Outlook) -> int:
    """Return the first landmark of a short tour from here past landmarks that together see all frontiers.

    The tour ends at home, or anywhere where there is none. What has been left behind near the way is so seen before the
    robot goes on, wherever going back later would cost more; a room is seen to the end before it is left.

    Source: tours of frontiers instead of the nearest: Kulich, Faigl & Přeučil, "On distance utility in the exploration
    task", ICRA 2011.
    """
    n = len(outlook.landmarks)
    ways = np.zeros((n + 2, n + 2))
    ways[1 : n + 1, 1 : n + 1] = outlook.between
    ways[0, 1 : n + 1] = ways[1 : n + 1, 0] = outlook.costs
    # The last node is home, or a place that is nowhere far.
    ways[n + 1, 1 : n + 1] = ways[1 : n + 1, n + 1] = outlook.home_costs
    return int(covering_tour(np.minimum(ways, FAR), outlook.sees)[0])


def covering_tour(ways: FloatArray, sees: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return landmarks in their order along a short tour that sees everything, shape (k,).

    Landmarks are inserted where they make the tour least longer for what they add to what is seen. Then what is not
    needed is left out, landmarks are replaced by others that see what they alone see, and the order is improved,
    until nothing of that helps.

    Args:
        ways: costs between the start, n landmarks and the end, in this order, shape (n + 2, n + 2).
        sees: what each landmark sees, shape (n, m); each of m is seen by one at least.
    """
    n = len(sees)
    end = n + 1
    stops = [0, end]
    unseen = np.ones(sees.shape[1], np.bool_)
    while unseen.any():
        longer, place = _insertions(ways, np.array(stops))
        gain = (sees & unseen).sum(axis=1)
        score = np.where(gain > 0, longer[1 : n + 1] / np.maximum(gain, 1), np.inf)
        best = int(np.argmin(score))
        stops.insert(int(place[best + 1]), best + 1)
        unseen &= ~sees[best]
    order = shortened_tour(ways, np.array(stops, dtype=np.int64))
    for _ in range(ROUNDS):
        before = _length(ways, order)
        order = shortened_tour(ways, _replaced(ways, sees, order))
        if _length(ways, order) >= before - 1e-9:
            break
    return np.asarray(order[1:-1] - 1)


def _length(ways: FloatArray, order: NDArray[np.int64]) -> float:
    return float(ways[order[:-1], order[1:]].sum())


def _insertions(ways: FloatArray, order: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return for each node by how much it makes a tour longer where it does so least, and where that is."""
    a, b = order[:-1], order[1:]
    longer = ways[:, a] + ways[:, b] - ways[a, b]
    place = longer.argmin(axis=1)
    return longer[np.arange(len(ways)), place], place + 1


def _replaced(ways: FloatArray, sees: NDArray[np.bool_], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the tour with each landmark in turn left out, or replaced, where that makes it shorter."""
    stops = order.tolist()
    for stop in order[1:-1].tolist():
        rest = [other for other in stops if other != stop]
        needed = sees[stop - 1] & ~sees[np.array(rest[1:-1], dtype=np.int64) - 1].any(axis=0)
        if not needed.any():
            stops = rest
            continue
        fit = np.flatnonzero(sees[:, needed].all(axis=1)) + 1
        longer, place = _insertions(ways, np.array(rest))
        best = int(fit[np.argmin(longer[fit])])
        rest.insert(int(place[best]), best)
        if _length(ways, np.array(rest)) < _length(ways, np.array(stops)) - 1e-9:
            stops = rest
    return np.array(stops, dtype=np.int64)


@njit(cache=True, nogil=True)
def shortened_tour(ways: FloatArray, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a tour with its order improved, its ends kept, until no reversal and no move of a part makes it shorter.

    Sources: 2-opt: Croes, "A method for solving traveling-salesman problems", Operations Research 1958; Or-opt: Or,
    "Traveling salesman-type combinatorial problems", 1976.

    Args:
        ways: costs between nodes, symmetric, shape (n, n).
        order: nodes in their order, shape (k,).
    """
    tour, k = order.copy(), len(order)
    better = True
    while better:
        better = False
        for i in range(1, k - 1):
            for j in range(i, k - 1):
                # The part from i to j: reversed where it is,
                a, b, c, d = tour[i - 1], tour[i], tour[j], tour[j + 1]
                if ways[a, c] + ways[b, d] < ways[a, b] + ways[c, d] - 1e-9:
                    tour[i : j + 1] = tour[i : j + 1][::-1].copy()
                    better = True
                    continue
                # or moved between two others, either way round.
                if j - i >= 3:
                    continue
                gain = ways[a, b] + ways[c, d] - ways[a, d]
                for t in range(k - 1):
                    if i - 1 <= t <= j:
                        continue
                    p, q = tour[t], tour[t + 1]
                    forward, back = ways[p, b] + ways[c, q], ways[p, c] + ways[b, q]
                    if min(forward, back) - ways[p, q] < gain - 1e-9:
                        part = tour[i : j + 1].copy()
                        if back < forward:
                            part = part[::-1].copy()
                        rest = np.concatenate((tour[:i], tour[j + 1 :]))
                        at = t + 1 if t < i else t + 1 - len(part)
                        tour = np.concatenate((rest[:at], part, rest[at:]))
                        better = True
                        break
    return tour
