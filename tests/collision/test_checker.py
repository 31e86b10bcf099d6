"""StateChecker against shapely: validity and clearance in random worlds, and how it is called."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_states, random_world, star_polygon
from tests.support.trials import few, pairs

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError, WorldError
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon
from trailmark.world import Robot, World

WORLDS = {
    "polygons": random_world(1, 200),
    "holes, discs, boundary": random_world(2, 120, discs=0.3, holes=0.5, boundary=True),
    "far": random_world(3, 100, discs=0.3, holes=0.3, boundary=True, origin=(1e5, -1e5)),
    "crowded": random_world(4, 60, size=20.0, radii=(0.2, 1.5), discs=0.3, holes=0.4),
    "2,000 obstacles": random_world(5, 2000, radii=(0.1, 1.0), discs=0.2),
    "no obstacles": random_world(6, 0, size=8.0),
}
PAIRS = pairs(WORLDS, ROBOTS)


def states_near_contact(checker: StateChecker, n: int, rng: np.random.Generator) -> FloatArray:
    """Return configurations of which about half nearly touch: found by bisection between a free and a blocked one."""
    q = random_states(checker.world, n, rng, 1.0)
    valid = checker.valid(q)
    m = min(int(valid.sum()), int((~valid).sum()), n // 4)
    free, blocked = q[valid][:m], q[~valid][:m]
    for _ in range(int(rng.integers(10, 40))):
        middle = 0.5 * (free + blocked)
        ok = checker.valid(middle)
        free[ok], blocked[~ok] = middle[ok], middle[~ok]
    return np.concatenate([q, free, blocked])


@pytest.mark.slow
@pytest.mark.parametrize(("world", "name"), PAIRS)
def test_validity_and_clearance_agree_with_shapely(world: str, name: str) -> None:
    checker = StateChecker(WORLDS[world], ROBOTS[name])
    oracle = Oracle(WORLDS[world], ROBOTS[name])
    # Those that nearly touch, and a few of the others, about which there is little doubt.
    q = states_near_contact(checker, 600, np.random.default_rng(7))[-400:]
    valid = checker.valid(q)
    assert not oracle.disagrees(q, valid).any()
    some = q[-160:]
    clearance, expected = checker.clearance(some), oracle.clearance(some)
    assert clearance == pytest.approx(expected, abs=1e-9)
    assert checker.clearance(some, cap=0.3) == pytest.approx(np.minimum(expected, 0.3), abs=1e-9)


@pytest.mark.slow
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 3, 30]),
    st.sampled_from([0.05, 1.0, 40.0]),
    st.sampled_from([(0.0, 0.0), (-3.0, 1e5), (9e6, -9e6)]),
    st.sampled_from([None, 0.03, 3.0]),
)
@settings(max_examples=few(25))
def test_random_robots_in_random_worlds(
    seed: int, obstacles: int, scale: float, origin: tuple[float, float], cell: float | None
) -> None:
    rng = np.random.default_rng(seed)
    world = random_world(
        seed, obstacles, size=10.0 * scale, radii=(0.1 * scale, 3.0 * scale), discs=0.3, holes=0.3,
        boundary=bool(rng.random() < 0.5), origin=origin,
    )  # fmt: skip
    center = tuple(rng.uniform(-1.0, 1.0, 2) * scale * rng.integers(0, 2))
    robot = Robot(star_polygon(rng, (float(center[0]), float(center[1])), float(rng.uniform(0.05, 1.0)) * scale))
    if rng.random() < 0.2:
        robot = Robot.disc(float(rng.uniform(0.05, 1.0)) * scale)
    checker = StateChecker(world, robot, cell=None if cell is None else cell * scale)
    q = states_near_contact(checker, 300, rng)
    oracle = Oracle(world, robot)
    assert not oracle.disagrees(q, checker.valid(q)).any()
    # A double near 1e7 holds 2e-9.
    assert checker.clearance(q) == pytest.approx(oracle.clearance(q), abs=1e-9 if max(map(abs, origin)) < 1e6 else 2e-8)


@pytest.mark.parametrize("name", ROBOTS)
def test_containment_either_way_is_a_collision(name: str) -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    big, speck = Polygon(square * 30.0 + 10.0), Polygon(square * 1e-3 + 70.0)
    ring = Polygon(square * 60.0 + (20.0, 100.0), (square * 40.0 + (30.0, 110.0),))
    sieve = Polygon(square * 30.0 + (100.0, 10.0), (square * 0.02 + (115.0, 25.0),))
    round_big, round_speck = Disc((80.0, 25.0), 14.0), Disc((75.0, 75.0), 1e-3)
    world = World("w", (0, 0, 160, 180), (big, speck, ring, sieve, round_big, round_speck))
    checker = StateChecker(world, ROBOTS[name])
    body = np.array(ROBOTS[name].inscribed_disc.center)
    for theta in (0.0, 1.0, math.pi / 2, -3.0):
        turn = np.array([[math.cos(theta), -math.sin(theta)], [math.sin(theta), math.cos(theta)]])
        for place, valid in (
            ((25.0, 25.0), False),  # the robot in an obstacle
            ((80.0, 25.0), False),  # in a disc
            ((70.0005, 70.0005), False),  # an obstacle in the robot
            ((75.0, 75.0), False),  # a disc in the robot
            ((50.0, 130.0), True),  # in a hole
            ((115.01, 25.01), False),  # around a hole
        ):
            q = np.array([*(np.array(place) - turn @ body), theta])
            assert checker.valid(q) is valid
            assert (checker.clearance(q) > 0.0) is valid


def test_a_robot_larger_than_the_world_fits_nowhere() -> None:
    world = random_world(1, 10, size=20.0)
    for robot in (Robot.disc(50.0), Robot.rectangle(100.0, 0.1), Robot.rectangle(300.0, 200.0)):
        checker = StateChecker(world, robot)
        q = random_states(world, 50, np.random.default_rng(0), 30.0)
        assert not checker.valid(q).any()
        assert not checker.clearance(q).any()


def test_a_tiny_robot_in_a_big_world() -> None:
    world = random_world(9, 100, size=5000.0, radii=(1.0, 300.0), discs=0.3)
    for robot in (Robot.disc(1e-3), Robot.rectangle(2e-3, 1e-3)):
        checker, oracle = StateChecker(world, robot), Oracle(world, robot)
        q = states_near_contact(checker, 2000, np.random.default_rng(3))
        assert not oracle.disagrees(q, checker.valid(q)).any()


@pytest.mark.parametrize("name", ROBOTS)
def test_configurations_far_outside_are_invalid(name: str) -> None:
    checker = StateChecker(WORLDS["crowded"], ROBOTS[name])
    for far in (50.0, 1e9, 1e18, 1e19, 1e30, 1e300, 1.7e308):
        rows = [(far, 0, 0), (-far, 0, 1), (5, far, 2), (5, -far, 3), (far, far, -1), (-far, far, 1e300)]
        assert not checker.valid(rows).any()
        assert not checker.clearance(rows).any()
        home = np.tile([10.0, 10.0, 0.0], (len(rows), 1))
        assert not checker.motions_valid(home, rows).any()
        assert not checker.motions_valid(rows, home).any()


def test_one_and_many_and_none() -> None:
    checker = StateChecker(WORLDS["crowded"], ROBOTS["L"])
    q = random_states(checker.world, 30, np.random.default_rng(0))
    many = checker.valid(q)
    assert many.dtype == np.bool_
    assert many.tolist() == [checker.valid(row) for row in q]
    assert isinstance(checker.valid(q[0]), bool)
    assert isinstance(checker.clearance(q[0]), float)
    assert checker.clearance(q).tolist() == [checker.clearance(row) for row in q]
    none = np.empty((0, 3))
    assert checker.valid(none).shape == checker.clearance(none).shape == checker.motions_valid(none, none).shape == (0,)
    assert checker.motions_by_field(none, none).shape == (0,)
    assert checker.valid(q.tolist()).tolist() == many.tolist()
    turned = q + (0.0, 0.0, 4.0 * math.pi)  # noqa: RUF005  # a sum of arrays
    assert (checker.valid(turned) == many).all()


@pytest.mark.slow
def test_overlapping_discs_and_polygons_are_one_obstacle() -> None:
    world = World("w", (0, 0, 20, 20), tuple(Disc((10 + 0.2 * i, 10), 2.0) for i in range(5)))
    heap = replace(world, obstacles=world.obstacles + tuple(random_world(3, 30, size=20.0).obstacles) * 2)
    for where in (world, heap):
        checker, oracle = StateChecker(where, ROBOTS["rectangle"]), Oracle(where, ROBOTS["rectangle"])
        q = states_near_contact(checker, 1000, np.random.default_rng(1))
        assert not oracle.disagrees(q, checker.valid(q)).any()


Q = np.zeros((2, 3))


@pytest.mark.parametrize(
    ("call", "part"),
    [
        (lambda c: c.valid([1, 2]), "shape (3,) or (n, 3) for x, y, theta, got (2,)"),
        (lambda c: c.valid([[1, 2, math.nan]]), "not a finite number"),
        (lambda c: c.valid("door"), "'door'"),
        (lambda c: c.clearance([1, 2, math.inf]), "not a finite number"),
        (lambda c: c.clearance(Q, cap=math.nan), "expected 0 or more, got nan"),
        (lambda c: c.clearance(Q, cap=-1.0), "expected 0 or more, got -1.0"),
        (lambda c: c.motions_valid(Q, Q[:1]), "expected as many ends as starts, got 2 and 1"),
        (lambda c: c.motions_valid(Q, [[1, 2]]), "shape (3,) or (n, 3) for x, y, theta, got (1, 2)"),
        (lambda c: c.motion_valid((0, 0), (1, 1, 1)), "motion: start: expected shape (3,) or (n, 3) for x, y,"),
        (lambda c: c.motion_valid((0, 0, 0), Q), "motion: expected shapes (3,), got (3,) and (2, 3)"),
        (lambda c: c.motion_valid((0, 0, 0), (0, 0, math.nan)), "motion: end:"),
    ],
)
def test_misuse_is_one_line(call: Any, part: str) -> None:
    checker = StateChecker(WORLDS["no obstacles"], Robot.disc(0.5))
    with pytest.raises(ConfigurationError) as caught:
        call(checker)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_checker_needs_a_robot_and_a_cell() -> None:
    world = WORLDS["no obstacles"]
    with pytest.raises(WorldError, match="names no robot"):
        StateChecker(world)
    assert StateChecker(world.with_robot(Robot.disc(0.5))).robot == Robot.disc(0.5)
    for cell in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(WorldError, match="cell: "):
            StateChecker(world, Robot.disc(1), cell=cell)
