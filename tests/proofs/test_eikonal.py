"""Eikonal: a bound that no path is below, and that is not far below the best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.oracles import sampled_cost
from tests.helpers.trials import few

from trailmark import CostZone, Disc, Objective, Polygon, Rectangle, SpeedZone, StateChecker, World
from trailmark.motion import Motion, motion_of
from trailmark.proofs.eikonal import Eikonal
from trailmark.world.robot import Robot


def weighted(world: World, objective: Objective | None = None, robot: Robot | None = None) -> Motion:
    motion = motion_of(StateChecker(world, robot or Robot.disc(0.2)), objective=objective)
    assert motion.weighted
    return motion


@pytest.mark.slow
def test_no_path_costs_less() -> None:
    rng, tight = np.random.default_rng(3), 0
    for _ in range(few(16, of=6)):
        zones: list[CostZone | SpeedZone] = []
        for _ in range(rng.integers(1, 5)):
            corner, sides = rng.uniform(0.0, 8.0, 2), rng.uniform(0.05, 6.0, 2)
            x, y, u, v = *corner, *(corner + sides)
            square = [(x, y), (u, y), (u, v), (x, v)]
            zones.append(CostZone(Polygon(np.array(square, dtype=float)), float(rng.uniform(0.1, 5.0))))
            zones.append(SpeedZone(Polygon(np.array(square[:3], dtype=float)), float(rng.uniform(0.1, 2.0))))
        obstacles = tuple(Disc(tuple(rng.uniform(0.0, 10.0, 2)), float(rng.uniform(0.1, 1.0))) for _ in range(4))
        world = World("w", (0.0, 0.0, 10.0, 10.0), obstacles, zones=tuple(zones))
        length, hasty = (float(v) for v in rng.uniform(0.1, 2.0, 2))
        objective = Objective(length, hasty, clearance=float(rng.choice([0.0, 3.0])))
        eikonal = Eikonal(weighted(world, objective))
        checker = eikonal.motion.checker
        q = np.column_stack([rng.uniform(0.2, 9.8, (24, 2)), rng.uniform(-3.0, 3.0, 24)])
        q = q[checker.valid(q)]
        for a, b in zip(q[:-1:2], q[1::2], strict=False):
            if checker.motion_valid(a, b):
                direct = sampled_cost(world, objective, np.array([a, b]), 5e-3)
                bound = eikonal.of(a, b)
                assert bound <= direct * 1.002 + 0.02
                tight += bound > 0.5 * direct
    assert tight > few(20, of=6)


def test_obstacles_stop_it() -> None:
    """Through a wall that the disc cannot pass nothing leads; the bound goes round it, or claims nothing."""
    wall = Rectangle((5.0, 4.0), 8.0, 1.0, np.pi / 2)
    world = World(
        "wall",
        (0.0, 0.0, 10.0, 10.0),
        (wall,),
        zones=(CostZone(Polygon(np.array([(0, 0), (10, 0), (10, 10), (0, 10)], dtype=float)), 2.0),),
    )
    start, goal = np.array([2.0, 2.0, 0.0]), np.array([8.0, 2.0, 0.0])
    assert Eikonal(weighted(world)).of(start, goal) > 2.0 * 13.0
    shut = replace(world, obstacles=(Rectangle((5.0, 5.0), 10.0, 1.0, np.pi / 2),))
    assert Eikonal(weighted(shut)).of(start, goal) == pytest.approx(0.0, abs=1e-9)
