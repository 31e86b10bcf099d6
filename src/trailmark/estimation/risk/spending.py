"""Risk spent along a path: the obstacles are grown just as far as the path's own probability of a collision asks for.

Growing each obstacle for its share of the risk (:func:`trailmark.estimation.regrow`) protects every path past all of
them at once. A single path passes few obstacles closely, and can do with less room: the growth is scaled, the path
planned anew and its probability of a collision counted, by bisection. Janson, Schmerling & Pavone, "Monte Carlo motion
planning for robot trajectory optimization under uncertainty", ISRR 2015, algorithm 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from trailmark.checked import Count, NonNegative, Probability, Seed, checked_arguments
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk.allocation import grown_less, regrow
from trailmark.estimation.risk.path_risk import PathRisk, path_risk
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["SpentRisk", "spend_risk"]

HITS = 200
"""Draws that may meet a path at least, so that the bound on its probability is not much above what it is."""

MAX_DRAWS = 1_000_000
"""Of each obstacle; for a confidence that would ask for more, the bound gives less away."""


class SpentRisk(NamedTuple):
    """What :func:`spend_risk` comes to.

    Attributes:
        world: that the path was planned in. Its growth protects this path; for other paths it states no risk.
        states: the path's configurations, shape (n, 3), or None if no path was found.
        cost: the path's; infinite without one.
        risk: of the path.
        scale: of the growth that the even shares of the risk ask for, 0 to 1.
    """

    world: World
    states: FloatArray | None
    cost: float
    risk: PathRisk | None
    scale: float


@checked_arguments(EstimationError)
def spend_risk(
    world: World,
    plan: Callable[[World], tuple[FloatArray, float] | None],
    confidence: Probability | None = None,
    *,
    rounds: Count = 6,
    seed: Seed = 0,
    margin: NonNegative = 0.0,
) -> SpentRisk:
    """Return the cheapest path found whose probability of meeting any true obstacle is at most 1 − confidence.

    Args:
        world: with estimates and a robot.
        plan: gives a path's configurations, shape (n, 3), and its cost, in a world; None if it finds none.
        confidence: above 0 and below 1; None for what the world is grown for.
        rounds: plans at most, >= 1.
        seed: of the draws.
        margin: metres by which the robot may be off the straight motions between the configurations.

    Raises:
        EstimationError: a world without estimates or a robot, or with no confidence given and none stated.
    """
    known = [estimate for estimate in world.estimates if estimate is not None]
    if not known or world.robot is None:
        raise EstimationError("spend_risk: expected a world with estimates and a robot, got one without")
    if confidence is None:
        if world.risk is None:
            raise EstimationError("confidence: expected a number above 0 and below 1, got a world without one")
        confidence = world.risk.confidence
    allowed = 1.0 - confidence
    draws = min(MAX_DRAWS, max(10_000, math.ceil(HITS / allowed)))
    full = regrow(world, confidence)
    best = SpentRisk(full, None, math.inf, None, 1.0)
    low, high = 0.0, 1.0
    for i in range(rounds):
        # As far as even shares ask for, which is safe; not at all, in case the path keeps its distance by itself.
        scale = (1.0, 0.0)[i] if i < 2 else 0.5 * (low + high)
        grown = full if scale == 1.0 else grown_less(full, scale)
        found = plan(grown)
        risk = None if found is None else path_risk(full, found[0], draws=draws, seed=seed, margin=margin)
        # Past obstacles grown by their full shares, Boole's inequality alone keeps the promise.
        if found is not None and risk is not None and scale < 1.0 and risk.upper_bound > allowed:
            low = scale
            continue
        if found is not None and found[1] <= best.cost:
            best = SpentRisk(grown, found[0], found[1], risk, scale)
        if scale == 0.0:
            break
        high = scale
    return best
