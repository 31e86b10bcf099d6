"""Risk spent along a path: the promise is kept, cheaper paths are found, and it never ends worse than it began."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy.stats import norm

from trailmark.estimation.errors import EstimationError
from trailmark.estimation.risk.allocation import regrow
from trailmark.estimation.risk.spending import spend_risk
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import ObstacleEstimate, Robot, World

BOUNDS = (0.0, 0.0, 20.0, 10.0)
NEAR = ObstacleEstimate(Disc((10.0, 4.6), 0.5), 0.01 * np.eye(2))
FAR = [ObstacleEstimate(Disc((x, 1.0), 0.5), 0.01 * np.eye(2)) for x in (3.0, 8.0, 13.0, 17.0)]
ESTIMATES = (NEAR, *FAR)
WORLD = World("w", BOUNDS, tuple(e.mean for e in ESTIMATES), Robot.disc(0.3), estimates=ESTIMATES)


def straight_planner(world: World) -> tuple[FloatArray, float] | None:
    """The free crossing from left to right that is nearest to y = 5."""
    assert world.robot is not None
    blocked = shapely.union_all([shape.polygon(1e-3).shapely() for shape in world.obstacles])
    offsets = np.arange(0.0, 4.5, 0.01)
    lines = shapely.linestrings([[(1.0, 5.0 + offset), (19.0, 5.0 + offset)] for offset in offsets])
    free = np.flatnonzero(shapely.distance(lines, blocked) > world.robot.circumradius + 0.002)
    if not len(free):
        return None
    return np.insert(shapely.get_coordinates(lines[free[0]]), 2, 0.0, axis=1), float(offsets[free[0]])


@pytest.mark.slow
@pytest.mark.parametrize("confidence", [0.8, 0.999])
def test_the_path_comes_as_near_as_it_may_and_no_nearer(confidence: float) -> None:
    spent = spend_risk(WORLD, straight_planner, confidence, rounds=5)
    even = straight_planner(regrow(WORLD, confidence))
    assert even is not None
    assert spent.states is not None
    assert spent.risk is not None
    assert spent.cost < even[1] - 0.05
    gap = 5.0 + spent.cost - 4.6 - 0.5 - 0.3
    exact = norm.cdf(-gap / 0.1)
    assert exact <= 1.0 - confidence
    # Most of what is allowed is used.
    assert exact > 0.4 * (1.0 - confidence)
    assert spent.world.risk is None
    assert 0.0 < spent.scale < 1.0


@pytest.mark.slow
def test_the_worlds_own_confidence_counts_if_none_is_given() -> None:
    spent = spend_risk(regrow(WORLD, 0.99), straight_planner)
    assert spent.cost == spend_risk(WORLD, straight_planner, 0.99).cost
    with pytest.raises(EstimationError, match="confidence: expected a number above 0"):
        spend_risk(WORLD, straight_planner)


def test_without_a_path_it_ends_without_one_and_one_that_only_a_smaller_growth_leaves_is_found() -> None:
    spent = spend_risk(WORLD, lambda _: None, 0.9)
    assert (spent.states, spent.cost, spent.risk) == (None, math.inf, None)
    # Two rows that leave a gap of 1.0 m: even shares close it for the robot, the path's own risk does not.
    wall = [ObstacleEstimate(Disc((10.0, y), 0.5), 0.0049 * np.eye(2)) for y in (3.8, 6.0)]
    more = [ObstacleEstimate(Disc((x, 0.6), 0.5), 0.0049 * np.eye(2)) for x in np.arange(1.0, 19.0, 1.1)]
    gate = World("gate", BOUNDS, tuple(e.mean for e in (*wall, *more)), Robot.disc(0.4), estimates=(*wall, *more))

    def through_the_gap(world: World) -> tuple[FloatArray, float] | None:
        blocked = shapely.union_all([shape.polygon(1e-3).shapely() for shape in world.obstacles])
        line = shapely.LineString([(1.0, 4.9), (19.0, 4.9)])
        if shapely.distance(line, blocked) < 0.402:
            return None
        return np.insert(shapely.get_coordinates(line), 2, 0.0, axis=1), 18.0

    assert through_the_gap(regrow(gate, 0.95)) is None
    found = spend_risk(gate, through_the_gap, 0.95)
    assert found.cost == 18.0
    assert found.risk is not None
    assert found.risk.upper_bound <= 0.05


@pytest.mark.slow
def test_a_path_that_would_be_too_likely_to_collide_is_never_returned() -> None:
    def careless(world: World) -> tuple[FloatArray, float]:
        return np.array([[1.0, 5.39, 0.0], [19.0, 5.39, 0.0]]), 18.0 if world.risk is None else 30.0

    spent = spend_risk(WORLD, careless, 0.99)
    assert spent.cost == 30.0
    assert spent.scale == 1.0


def test_a_world_without_estimates_is_refused() -> None:
    with pytest.raises(EstimationError, match="spend_risk: expected a world with estimates and a robot"):
        spend_risk(World("w", BOUNDS, (), Robot.disc(0.1)), straight_planner, 0.9)
