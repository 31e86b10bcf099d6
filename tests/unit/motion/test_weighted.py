"""Weighted motions: as certified as those they are without, dearer or cheaper, and one way where a zone says so."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracles import sampled_cost

from trailmark import CostZone, Disc, Objective, OneWayZone, Polygon, Robot, StateChecker, World
from trailmark.collision.kernels import FREE
from trailmark.motion import motion_of
from trailmark.motion.base import costs
from trailmark.trajectories import path_of

ROBOTS = {
    "disc": Robot.disc(0.3),
    "rectangle": Robot.rectangle(0.8, 0.4),
    "car": Robot.rectangle(0.8, 0.4).steered(0.8),
}
ZONE = CostZone(Polygon(np.array([(3, 0), (7, 0), (7, 6), (3, 6)], dtype=float)), 2.0)
WORLD = World("w", (0.0, 0.0, 10.0, 10.0), (Disc((5.0, 4.0), 1.0), Disc((2.0, 7.0), 0.7)), zones=(ZONE,))


def pairs(seed: int, count: int, checker: StateChecker) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(0.5, 9.5, (4 * count, 2)), rng.uniform(-np.pi, np.pi, 4 * count)])
    q = q[checker.valid(q)][: 2 * count]
    if checker.footprint.is_disc:
        q[:, 2] = 0.0
    half = len(q) // 2
    return q[:half], q[half : 2 * half]


@pytest.mark.parametrize("name", ROBOTS)
def test_a_cost_is_between_the_length_and_the_factor_times_it(name: str) -> None:
    checker = StateChecker(WORLD, ROBOTS[name])
    weighted = motion_of(checker)
    a, b = pairs(1, 40, checker)
    length, cost = (np.asarray(costs(kind, a, b)) for kind in (weighted.kind._replace(weighted=()), weighted.kind))
    assert (cost >= length * (1.0 - 1e-9)).all()
    assert (cost <= 2.0 * length * (1.0 + 1e-9)).all()
    assert (cost > length * 1.01).any()
    lower = [weighted.least_cost(*ends) for ends in zip(a, b, strict=True)]
    assert (
        np.array(lower) <= [weighted.whole_cost(c, *ends) + 1e-9 for c, *ends in zip(cost, a, b, strict=True)]
    ).all()


@pytest.mark.slow
@pytest.mark.parametrize("objective", [Objective(), Objective(clearance=5.0)], ids=["length", "clearance"])
def test_a_curve_is_charged_along_its_arcs(objective: Objective) -> None:
    checker = StateChecker(WORLD, ROBOTS["car"])
    weighted = motion_of(checker, objective=objective)
    a, b = pairs(2, 3, checker)
    for start, end in zip(a, b, strict=True):
        # Chords of 3 cm are shorter than their arcs by 6e-5 of the length.
        states = np.array(path_of(weighted, np.array([start, end])).resample(0.03).states)
        states[:, 2] = 0.0
        expected = sampled_cost(WORLD, objective, states)
        cost, error = weighted.cost_within(np.array([start, end]))
        assert cost == pytest.approx(expected, abs=error + 0.01)
        # Two changes of direction may each hide up to a chord where a metre is dearest.
        assert error < 0.04 * cost
        assert weighted.cost_of(np.array([start, end])) == pytest.approx(expected, rel=0.05, abs=0.1)


@pytest.mark.parametrize("name", ROBOTS)
def test_one_way_zones_forbid_a_direction(name: str) -> None:
    zone = OneWayZone(Polygon(np.array([(3, 0), (7, 0), (7, 10), (3, 10)], dtype=float)), 0.0, 0.8)
    checker = StateChecker(World("w", (0.0, 0.0, 10.0, 10.0), zones=(zone,)), ROBOTS[name])
    motion = motion_of(checker)
    assert motion.directed
    east, west = np.array([[1.0, 5.0, 0.0], [9.0, 5.0, 0.0]]), np.array([[9.0, 5.0, np.pi], [1.0, 5.0, np.pi]])
    assert motion.motions_valid(east[:1], east[1:]).all()
    assert not motion.motions_valid(west[:1], west[1:]).any()
    assert not (motion.motions_by_field(west[:1], west[1:]) == FREE).any()
    assert not motion.reversible(east[:1], east[1:]).any()
    # Beside the zone every direction is allowed.
    assert motion.motions_valid(west[:1], west[:1] - [1.0, 0.0, 0.0]).all()
