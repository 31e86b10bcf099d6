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


def test_in_a_uniform_world_it_is_nearly_the_straight_distance() -> None:
    world = World("open", (0.0, 0.0, 20.0, 10.0))
    for goal in ((19.0, 9.0, 0.0), (19.0, 1.0, 0.0), (10.0, 6.0, 0.0)):
        start = np.array([1.0, 1.0, 0.0])
        bound = Eikonal(weighted(world, Objective.of("time", max_speed=2.0))).of(start, np.array(goal))
        straight = float(np.hypot(*(np.array(goal) - start)[:2])) / 2.0
        assert 0.93 * straight <= bound <= straight


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


def test_a_dear_wall_is_gone_round_or_through() -> None:
    """A strip of factor 10 with a gap: the bound knows of both ways."""
    strip = [(4.0, 0.0), (5.0, 0.0), (5.0, 8.0), (4.0, 8.0)]
    world = World("strip", (0.0, 0.0, 10.0, 10.0), zones=(CostZone(Polygon(np.array(strip, dtype=float)), 10.0),))
    start, goal = np.array([2.0, 2.0, 0.0]), np.array([8.0, 2.0, 0.0])
    bound = Eikonal(weighted(world)).of(start, goal)
    through, round_it = 5.0 + 10.0, float(np.hypot(2.0, 6.0) + 1.0 + np.hypot(3.0, 6.0))
    assert 0.9 * min(through, round_it) <= bound <= min(through, round_it)


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


def test_a_reference_point_outside_of_the_footprint_bounds_nothing_away() -> None:
    robot = Robot.polygon(np.array([(0.5, -0.2), (1.0, -0.2), (1.0, 0.2), (0.5, 0.2)]))
    world = World(
        "w",
        (0.0, 0.0, 4.0, 4.0),
        zones=(CostZone(Polygon(np.array([(0, 0), (4, 0), (4, 4), (0, 4)], dtype=float)), 3.0),),
    )
    motion = weighted(world, robot=robot)
    a, b = np.array([-0.4, 2.0, 0.0]), np.array([2.9, 2.0, 0.0])
    assert motion.motion_valid(a, b)
    assert 0.0 < Eikonal(motion).of(a, b) <= motion.cost_of(np.array([a, b])) + 1e-9
