"""Strategies: which landmark an exploration goes to next."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError, expected_name
from trailmark.exploration.outlook import Outlook, Strategy
from trailmark.exploration.tour import tour

__all__ = ["STRATEGIES", "choice_of", "gain_per_cost", "nearest_frontier", "strategy_of"]


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
