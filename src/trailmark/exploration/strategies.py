"""Strategies: which landmark an exploration goes to next."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError, expected_name
from trailmark.jit import njit
from trailmark.se2 import FloatArray

__all__ = [
    "STRATEGIES",
    "Outlook",
    "Strategy",
    "choice_of",
    "covering_tour",
    "gain_per_cost",
    "nearest_frontier",
    "shortened_tour",
    "strategy_of",
    "tour",
]


# Metres: in place of the cost of a way that was not found; finite, so that tours with such ways can be compared.
FAR = 1e6
# Share of the way from the last landmark back to where the robot is that counts in the tour's cost, where there is no
# home: new frontiers appear before the tour ends, and what was left behind has to be come back for from there.
RETURN = 0.3
ROUNDS = 10  # Of improvements at most; each of them makes the tour shorter.


def tour(outlook: Outlook) -> int:
    """Return the first landmark of a short tour from here past landmarks that together see all frontiers.

    The tour ends at home, or where there is none at any landmark, rather one from which it is not far back here. What
    has been left behind near the way is so seen before the robot goes on, wherever going back later would cost more; a
    room is seen to the end before it is left.

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
        before = tour_cost(ways, order)
        order = shortened_tour(ways, _replaced(ways, sees, order))
        if tour_cost(ways, order) >= before - 1e-9:
            break
    return np.asarray(order[1:-1] - 1)


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
        if tour_cost(ways, np.array(rest)) < tour_cost(ways, np.array(stops)) - 1e-9:
            stops = rest
    return np.array(stops, dtype=np.int64)


@njit(nogil=True, numbers=True)
def tour_cost(ways: FloatArray, order: NDArray[np.int64]) -> float:
    """Return the length of a tour."""
    length = 0.0
    for i in range(1, len(order)):
        length += ways[order[i - 1], order[i]]
    return length


@njit(nogil=True)
def shortened_tour(ways: FloatArray, order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a tour with its order improved, its ends kept, until no reversal and no move of a part makes it better.

    Sources: 2-opt: Croes, "A method for solving traveling-salesman problems", Operations Research 1958; Or-opt: Or,
    "Traveling salesman-type combinatorial problems", 1976.

    Args:
        ways: costs between nodes, shape (n, n).
        order: nodes in their order, shape (k,).
    """
    tour, k = order.copy(), len(order)
    best = tour_cost(ways, tour)
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
                        cost = tour_cost(ways, other)
                        if cost < best - 1e-9:
                            tour, best, better = other, cost, True
    return tour


class Outlook(NamedTuple):
    """The landmarks from which something new may be seen, n of them, with what is known before one is chosen."""

    here: FloatArray
    """The robot's configuration, shape (3,)."""
    home: FloatArray | None
    """Where the exploration has to end, shape (3,); None where it may end anywhere."""
    landmarks: FloatArray
    """Configurations, shape (n, 3)."""
    costs: FloatArray
    """Estimated costs of the ways from here to each, shape (n,), metres."""
    between: FloatArray
    """Estimated costs of the ways between landmarks, shape (n, n), metres."""
    home_costs: FloatArray
    """Estimated costs of the ways from each landmark home, shape (n,), metres; 0 without a home."""
    areas: FloatArray
    """Unknown area that is expected to be seen from each behind the frontiers in sight, shape (n,), square metres."""
    frontiers: FloatArray
    """Lengths of the frontiers between free and unknown space, shape (m,), metres."""
    sees: NDArray[np.bool_]
    """Which landmark sees which frontier, shape (n, m): from near, or from afar if none does; a short frontier from
    wherever. A landmark that sees from afar alone what others see from near may see none."""
    sensor_range: float
    """Metres."""


Strategy = Callable[[Outlook], int]
"""Returns the index of the landmark to drive to next."""


def nearest_frontier(outlook: Outlook) -> int:
    """Return the landmark that costs least to get to.

    Source: Yamauchi, "A frontier-based approach for autonomous exploration", CIRA 1997.
    """
    return int(np.argmin(outlook.costs))


def gain_per_cost(outlook: Outlook) -> int:
    """Return the landmark of the largest area expected, discounted by what the way there costs.

    The utility is A·exp(-λ·L), with λ = 5 over the sensor's range. Smaller values, such as the published 0.2 per metre,
    leave more behind to come back for, and make for longer ways where everything has to be seen.

    Source: González-Baños & Latombe, "Navigation strategies for exploring indoor environments", Int. J. Robotics
    Research 2002.
    """
    return int(np.argmax(outlook.areas * np.exp(-5.0 * outlook.costs / outlook.sensor_range)))


STRATEGIES: Final[Mapping[str, Strategy]] = MappingProxyType(
    {"nearest-frontier": nearest_frontier, "gain-per-cost": gain_per_cost, "tour": tour}
)
"""By the names that the shell takes."""


def strategy_of(strategy: str | Strategy) -> tuple[str, Strategy]:
    """Return the name and the function of a strategy that is given by either.

    Raises:
        ConfigurationError: a name of none.
    """
    if callable(strategy):
        return getattr(strategy, "__name__", "custom"), strategy
    if strategy not in STRATEGIES:
        raise ConfigurationError(f"strategy: {expected_name(str(strategy), STRATEGIES)}")
    return strategy, STRATEGIES[strategy]


def choice_of(strategy: Strategy, outlook: Outlook) -> int:
    """Return the index of the landmark that a strategy chooses.

    Raises:
        ConfigurationError: what it returns is none.
    """
    index, count = strategy(outlook), len(outlook.landmarks)
    if not isinstance(index, int | np.integer) or not 0 <= index < count:
        raise ConfigurationError(f"strategy: expected the index of one of {count} landmarks, got {brief(index)}")
    return int(index)
