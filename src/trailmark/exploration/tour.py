"""The tour strategy: a shortest way past landmarks from which all frontiers are seen; the first of them is next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.compiled import njit
from trailmark.exploration.outlook import Outlook
from trailmark.se2 import FloatArray

__all__ = ["covering_tour", "shortened_tour", "tour"]

FAR = 1e6
"""Metres: in place of the cost of a way that was not found; finite, so that tours with such ways can be compared."""

SURER = 2.0
"""Metres of the tour that it is worth to come one metre earlier to where the standard deviation of the robot's place is
expected to fall by one metre, as a loop is closed. What is mapped on the way there lies as far off as the robot.
Without noise nothing falls."""

RETURN = 0.3
"""Share of the way from the last landmark back to where the robot is that counts in the tour's cost, where there is no
home: new frontiers appear before the tour ends, and what was left behind has to be come back for from there."""

ROUNDS = 10
"""Of improvements at most; each of them makes the tour shorter."""


def tour(outlook: Outlook) -> int:
    """Return the first landmark of a short tour from here past landmarks that together see all frontiers.

    The tour ends at home, or where there is none at any landmark, rather one from which it is not far back here. What
    has been left behind near the way is so seen before the robot goes on, wherever going back later would cost more; a
    room is seen to the end before it is left.
    Of about equal tours, that is taken which comes early to where a loop is closed (:data:`SURER`).

    Source: tours of frontiers instead of the nearest: Kulich, Faigl & Přeučil, "On distance utility in the exploration
    task", ICRA 2011.
    """
    n = len(outlook.landmarks)
    ways = np.zeros((n + 2, n + 2))
    ways[1 : n + 1, 1 : n + 1] = outlook.between
    ways[0, 1 : n + 1] = ways[1 : n + 1, 0] = outlook.costs
    # The last node is home, or stands for a part of the way back here.
    ends = outlook.home_costs if outlook.home is not None else RETURN * outlook.costs
    ways[n + 1, 1 : n + 1] = ways[1 : n + 1, n + 1] = ends
    weights = np.zeros(n + 2)
    weights[1 : n + 1] = SURER * outlook.certainty
    return int(covering_tour(np.minimum(ways, FAR), weights, outlook.sees)[0])


def covering_tour(ways: FloatArray, weights: FloatArray, sees: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return landmarks in their order along a short tour that sees everything, shape (k,).

    Landmarks are inserted where they make the tour least longer for what they add to what is seen. Then what is not
    needed is left out, landmarks are replaced by others that see what they alone see, and the order is improved,
    until nothing of that helps.

    Args:
        ways: costs between the start, n landmarks and the end, in this order, shape (n + 2, n + 2).
        weights: of the length up to each of them, shape (n + 2,).
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
    order = shortened_tour(ways, weights, np.array(stops, dtype=np.int64))
    for _ in range(ROUNDS):
        before = tour_cost(ways, weights, order)
        order = shortened_tour(ways, weights, _replaced(ways, weights, sees, order))
        if tour_cost(ways, weights, order) >= before - 1e-9:
            break
    return np.asarray(order[1:-1] - 1)


def _insertions(ways: FloatArray, order: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return for each node by how much it makes a tour longer where it does so least, and where that is."""
    a, b = order[:-1], order[1:]
    longer = ways[:, a] + ways[:, b] - ways[a, b]
    place = longer.argmin(axis=1)
    return longer[np.arange(len(ways)), place], place + 1


def _replaced(
    ways: FloatArray, weights: FloatArray, sees: NDArray[np.bool_], order: NDArray[np.int64]
) -> NDArray[np.int64]:
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
        if tour_cost(ways, weights, np.array(rest)) < tour_cost(ways, weights, np.array(stops)) - 1e-9:
            stops = rest
    return np.array(stops, dtype=np.int64)


@njit(cache=True, nogil=True)
def tour_cost(ways: FloatArray, weights: FloatArray, order: NDArray[np.int64]) -> float:
    """Return the length of a tour, and the lengths up to its nodes, weighted, in addition."""
    length, cost = 0.0, 0.0
    for i in range(1, len(order)):
        length += ways[order[i - 1], order[i]]
        cost += weights[order[i]] * length
    return length + cost


@njit(cache=True, nogil=True)
def shortened_tour(ways: FloatArray, weights: FloatArray, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a tour with its order improved, its ends kept, until no reversal and no move of a part makes it better.

    Sources: 2-opt: Croes, "A method for solving traveling-salesman problems", Operations Research 1958; Or-opt: Or,
    "Traveling salesman-type combinatorial problems", 1976.

    Args:
        ways: costs between nodes, shape (n, n).
        weights: of the length up to each node, shape (n,).
        order: nodes in their order, shape (k,).
    """
    tour, k = order.copy(), len(order)
    best = tour_cost(ways, weights, tour)
    better = True
    while better:
        better = False
        for i in range(1, k - 1):
            for j in range(i, k - 1):
                part = tour[i : j + 1].copy()
                rest = np.concatenate((tour[:i], tour[j + 1 :]))
                # Put back elsewhere, if it is a short part, either way round; a long one is reversed where it is.
                first, last = (1, len(rest)) if len(part) <= 3 else (i, i + 1)
                for at in range(first, last):
                    for turned in range(2):
                        piece = part[::-1].copy() if turned else part
                        other = np.concatenate((rest[:at], piece, rest[at:]))
                        cost = tour_cost(ways, weights, other)
                        if cost < best - 1e-9:
                            tour, best, better = other, cost, True
    return tour
