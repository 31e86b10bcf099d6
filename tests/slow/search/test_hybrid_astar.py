"""Hybrid A*: configurations that a car gets to from others by certified drives, and the way there."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.oracles import Oracle

from trailmark import Rectangle, Robot, StateChecker, World
from trailmark.landmarks import Relaxation
from trailmark.motion import CurveMotion
from trailmark.search.hybrid_astar import Reached, hybrid_astar

# A slot for parking, 1.6 m longer than the car.
WALLS = (Rectangle((4.0, 2.0), 8.0, 2.0), Rectangle((17.6, 2.0), 8.0, 2.0), Rectangle((10.0, 0.4), 20.0, 0.8))
CAR = Robot.rectangle(4.0, 1.8).steered(4.0)
SLOT, ROAD = np.array([10.8, 1.9, 0.0]), np.array([4.0, 5.0, 0.0])


def grown(reverse: bool, into: bool, sources: np.ndarray, goal: np.ndarray, most: int = 6000) -> tuple[World, Reached]:
    world = World("slot", (0.0, 0.0, 20.0, 8.0), WALLS, CAR.steered(4.0, reverse))
    checker = StateChecker(world)
    relaxation = Relaxation(checker)
    motion, costs, rng = CurveMotion(checker), relaxation.costs_from(goal), np.random.default_rng(0)
    found = hybrid_astar(motion, relaxation, costs, sources, reverse=into, step=0.4, most=most, landmarks=60, rng=rng)
    return world, found


@pytest.mark.parametrize("into", [False, True])
@pytest.mark.parametrize("reverse", [True, False], ids=["both ways", "forwards"])
def test_every_configuration_hangs_on_another_by_a_free_curve(reverse: bool, into: bool) -> None:
    sources = ROAD[None]
    world, found = grown(reverse, into, sources, np.array([16.0, 6.0, 0.0]), most=2000)
    assert world.robot is not None
    checker = StateChecker(world)
    motions = CurveMotion(checker)
    nodes = np.concatenate([sources, found.configurations])
    assert len(found.configurations) > 40
    assert checker.valid(found.configurations).all()
    ends = nodes[found.parents], found.configurations
    a, b = ends[::-1] if into else ends
    certified = motions.motions_valid(a, b)
    assert certified.mean() > 0.98
    lengths = motions.steering.lengths(a, b)
    states = motions.steering.states(a, b, lengths[:, None] * np.linspace(0.0, 1.0, 60))
    assert not Oracle(world, world.robot).collides(states[certified].reshape(-1, 3)).any()
    # All hang on the source, and on nothing that hangs on them.
    for start in range(len(found.parents)):
        node, steps = start + 1, 0
        while node > 0:
            node, steps = int(found.parents[node - 1]), steps + 1
            assert steps <= len(nodes)
    # On one side at a time: pieces are not longer than a quarter of a circle.
    curves = motions.steering.curves(a, b)
    turned = np.where(curves.sides != 0, np.abs(curves.signed_lengths), 0.0)
    assert (turned.max(axis=1) <= 0.5 * np.pi * 4.0 + 0.4 + 1e-6).all()
