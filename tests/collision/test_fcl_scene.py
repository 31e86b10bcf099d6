"""The FCL scene against shapely: the same collisions."""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_states, random_world

from trailmark.collision import StateChecker
from trailmark.collision.fcl_scene import FclScene
from trailmark.shapes import Disc, Polygon, Rectangle
from trailmark.world import Robot, World


def square(x: float, y: float, size: float) -> Polygon:
    return Polygon(np.array([[x, y], [x + size, y], [x + size, y + size], [x, y + size]]))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("origin", [(0.0, 0.0), (1e5, -1e5)])
def test_fcl_agrees_with_shapely(name: str, origin: tuple[float, float]) -> None:
    world = random_world(11, 40, size=30.0, radii=(0.3, 3.0), discs=0.3, holes=0.4, boundary=True, origin=origin)
    scene, oracle = FclScene(world, ROBOTS[name]), Oracle(world, ROBOTS[name])
    q = random_states(world, 100, np.random.default_rng(5), 1.0)
    free = np.array([not scene.collides(row) for row in q])
    assert not oracle.disagrees(q, free).any()
    assert 8 < free.sum() < 92


@pytest.mark.parametrize("robot", [Robot.disc(1.0), Robot.rectangle(2.0, 1.0)])
@pytest.mark.parametrize("kept", [1e-9, 7e-8, 1e-7, 2e-7, 0.1])
def test_a_clearance_is_kept_however_small(robot: Robot, kept: float) -> None:
    world = World("w", (0.0, 0.0, 10.0, 8.0), (Rectangle((6.0, 4.0), 2.0, 8.0),))
    checker = StateChecker(world, robot, clearance=kept)
    # Dilated by the clearance, it overlaps by no more than 1e-7 m.
    assert not checker.valid((4.0 - kept + 1.1e-7, 4.0, 0.0))
    assert not checker.valid((4.0 + 1e-9, 4.0, 0.0))
    assert checker.valid((4.0 - kept - 1e-8, 4.0, 0.0))


def test_one_inside_the_other_is_a_collision() -> None:
    world = World("w", (0, 0, 100, 100), (square(10, 10, 20), Disc((60, 60), 15.0), square(80, 10, 0.01)))
    for robot in (Robot.disc(1.0), Robot.rectangle(2, 1), ROBOTS["L"]):
        scene = FclScene(world, robot)
        for inside in ((20, 20, 0.3), (60, 60, 0.3), (80.02, 10.01, 0.3)):
            q = np.array(inside)
            assert scene.collides(q)


def test_a_hole_is_free_and_what_lies_in_it_is_not() -> None:
    ring = Polygon(square(0, 0, 40).vertices + 30.0, (square(40, 40, 20).vertices,))
    scene = FclScene(World("w", (0, 0, 100, 100), (ring, Disc((55, 55), 1.0))), Robot.rectangle(4, 2))
    assert not scene.collides(np.array((45.0, 50.0, 0.0)))
    assert scene.collides(np.array((55.0, 54.0, 1.0)))
    assert scene.collides(np.array((41.0, 50.0, 0.0)))


def test_the_outside_is_blocked() -> None:
    scene = FclScene(World("w", (0, 0, 10, 8)), Robot.rectangle(2, 1))
    assert not scene.collides(np.array((1.0, 0.5, 0.0)))
    assert scene.collides(np.array((0.999, 4.0, 0.0)))
    assert scene.collides(np.array((0.6, 4.0, 0.7)))
    round_scene = FclScene(World("w", (0, 0, 10, 8)), Robot.disc(1.0))
    assert not round_scene.collides(np.array((1.0, 1.0, 0.0)))
    assert round_scene.collides(np.array((0.999, 1.0, 0.0)))


@pytest.mark.parametrize(
    "boundary",
    [
        square(-100, -100, 300),
        Polygon(np.array([[1, 1], [9, 1], [9, 7], [5, 2], [1, 7]], dtype=float)),
        Polygon(np.array([[5, -9], [30, 4], [5, 20], [-20, 4]], dtype=float)),
    ],
    ids=["beyond the bounds", "a notch", "across the bounds"],
)
def test_a_boundary_is_not_left(boundary: Polygon) -> None:
    world = World("w", (0, 0, 10, 8), boundary=boundary)
    for name in ("disc", "rectangle", "L"):
        scene, oracle = FclScene(world, ROBOTS[name]), Oracle(world, ROBOTS[name])
        q = random_states(world, 200, np.random.default_rng(2), 1.0)
        assert not oracle.disagrees(q, np.array([not scene.collides(row) for row in q])).any()


@pytest.mark.parametrize("radius", [1e-6, 1e-7, 5e-8, 1e-12])
def test_the_smallest_disc_still_collides(radius: float) -> None:
    scene = FclScene(World("w", (0, 0, 10, 10), (square(4, 4, 2),)), Robot.disc(radius))
    assert scene.collides(np.array((5.0, 5.0, 0.0)))
    assert not scene.collides(np.array((3.0, 5.0, 0.0)))


@pytest.mark.parametrize("obstacle", [square(20, 20, 10), Disc((25, 25), 5.0), Rectangle((25, 25), 10, 10, 0.7)])
def test_huge_configurations_are_outside(obstacle: Polygon | Disc | Rectangle) -> None:
    for robot in ROBOTS.values():
        scene = FclScene(World("w", (0, 0, 50, 50), (obstacle,)), robot)
        for far in (1e9, 1e20, 1e300, -1.7e308):
            for q in ((far, 0.0, 1.0), (25.0, far, math.pi), (far, -far, -1.0)):
                assert scene.collides(np.array(q))


@pytest.mark.slow
def test_threads_may_share_a_scene() -> None:
    """The robot is one object that is moved to be looked at: without turns, one thread looks at another's robot."""
    world = World("w", (0, 0, 20, 20), (square(10, 5, 1), square(14, 5, 3)))
    scene = FclScene(world, Robot.rectangle(2.0, 0.5))
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(7, 18, 4000), rng.uniform(3, 9, 4000), rng.uniform(-3, 3, 4000)])
    collides = [scene.collides(row) for row in q]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as threads:
            orders = [rng.permutation(len(q)) for _ in range(4)]
            looks = [threads.submit(lambda order: [scene.collides(q[i]) for i in order], order) for order in orders]
            for order, look in zip(orders, looks, strict=True):
                assert look.result() == [collides[i] for i in order]
    finally:
        sys.setswitchinterval(interval)
