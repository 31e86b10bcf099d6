"""A differential drive's motions: their costs, what they certify, and the paths that are made of them."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.helpers.oracle import Oracle, motion_states
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark.collision import StateChecker
from trailmark.errors import ShapeError
from trailmark.landmarks import free_samples
from trailmark.motion import DifferentialMotion, motion_of
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray, difference
from trailmark.shapes import Disc, Rectangle
from trailmark.trajectories import path_of
from trailmark.verify import RIM, Verifier
from trailmark.world import Robot, World

OPEN = World("open", (-50.0, -50.0, 50.0, 50.0), ())
CART = Robot.rectangle(0.6, 0.4).differential()


def motion_in(world: World, robot: Robot) -> DifferentialMotion:
    found = motion_of(StateChecker(world, robot))
    assert isinstance(found, DifferentialMotion)
    return found


def assert_driven(states: FloatArray, reverse: bool = False) -> None:
    """Assert that each piece of a path is a turn in place or a drive along the heading."""
    for a, b in pairwise(states):
        dx, dy, turned = difference(a, b)
        length = math.hypot(dx, dy)
        if length == 0.0:
            continue
        assert turned == 0.0
        ahead = dx * math.cos(a[2]) + dy * math.sin(a[2])
        assert (abs(ahead) if reverse else ahead) == pytest.approx(length, abs=1e-12 + 1e-9 * length)


def test_costs_are_length_and_half_of_all_turns() -> None:
    a = np.array([[0.0, 0.0, 0.0]] * 5)
    b = np.array([[3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [1.0, 1.0, math.pi / 4]])
    half = 0.5 * math.pi
    assert motion_in(OPEN, CART).costs(a, b) == pytest.approx(
        [3.0, 2.0 + half, 0.5, 1.0 + 2.0 * half, math.sqrt(2.0) + half / 4]
    )
    assert motion_in(OPEN, CART.differential(reverse=True)).costs(a, b)[3] == pytest.approx(1.0)


@pytest.mark.parametrize("reverse", [False, True])
def test_costs_obey_the_triangle_inequality_and_agree_with_the_path(reverse: bool) -> None:
    rng, motion = np.random.default_rng(1), motion_in(OPEN, CART.differential(reverse))
    q = np.column_stack([rng.uniform(-2, 2, (600, 2)), rng.uniform(-math.pi, math.pi, 600)])
    a, b, c = q[:200], q[200:400], q[400:]
    if not reverse:
        assert (motion.costs(a, c) <= motion.costs(a, b) + motion.costs(b, c) + 1e-9).all()
    path = path_of(motion, q)
    assert_driven(path.states, reverse)
    assert path.cost == pytest.approx(motion.cost_of(q))
    for start, end, cost in zip(a[:20], b[:20], motion.costs(a, b), strict=False):
        assert cost >= math.dist(start[:2], end[:2]) + 0.5 * abs(difference(start, end)[2]) - 1e-12
        assert path_of(motion, np.array([start, end])).cost == pytest.approx(cost)


def test_reversible_motions_are_their_opposites() -> None:
    rng, motion = np.random.default_rng(2), motion_in(OPEN, CART.differential(reverse=True))
    q = np.column_stack([rng.uniform(-2, 2, (400, 2)), rng.uniform(-math.pi, math.pi, 400)])
    a, b = q[:200], q[200:]
    assert motion.reversible(a, b).all()
    for start, end in zip(a[:50], b[:50], strict=True):
        there, back = (path_of(motion, np.array(pair)).states for pair in ((start, end), (end, start)))
        assert there[::-1] == pytest.approx(back, abs=1e-9)
    level = np.array([[0.0, 0.0, math.pi / 2]]), np.array([[1.0, 0.0, math.pi / 2]])
    assert not motion.reversible(*level).any()
    assert motion_in(OPEN, CART).directed


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle", "L", "offset"])
def test_certified_motions_meet_nothing(name: str) -> None:
    world = random_world(4, 60, size=40.0, discs=0.3)
    robot = ROBOTS[name].differential()
    motion = motion_in(world, robot)
    rng = np.random.default_rng(3)
    n = few(200)
    a = free_samples(motion.checker, n, random_state=1)
    b = a + np.column_stack([rng.uniform(-4, 4, (n, 2)), rng.uniform(-2, 2, n)])
    free = motion.motions_valid(a, b)
    assert 0.1 * n < free.sum() < 0.9 * n
    driven = [path_of(motion, np.array(ends)).states for ends in zip(a, b, strict=True)]
    of = np.repeat(np.arange(n), [len(states) - 1 for states in driven])
    first, last = (np.concatenate([states[part] for states in driven]) for part in (slice(-1), slice(1, None)))
    hits = Oracle(world, robot).collides(motion_states(first, last, 200).reshape(-1, 3)).reshape(-1, 200).any(axis=1)
    hit = np.bincount(of, hits, n) > 0
    assert not (free & hit).any()
    # What grazes something within 200 states of a piece may be refused.
    assert (~free & ~hit).sum() <= 0.01 * n


def narrow(width: float) -> World:
    """Two rooms joined by a corridor 4 m long, upwards to the right by 0 degrees."""
    low, high = 3.0 - width / 2, 3.0 + width / 2
    parts = (Rectangle((5.0, low / 2), 4.0, low), Rectangle((5.0, (6.0 + high) / 2), 4.0, 6.0 - high))
    return World("narrow", (0.0, 0.0, 10.0, 6.0), parts)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [CART, CART.differential(True), Robot.disc(0.25).differential()])
def test_paths_turn_in_place_and_drive_ahead(robot: Robot) -> None:
    # In the corridor a cart cannot turn round: it has to be headed there before.
    world = narrow(0.55)
    planner = LandmarkPlanner(world, robot, seed=1, settings=PlannerSettings(patience=1))
    result = planner.plan((1.0, 1.0, 2.0), (9.0, 5.0, -1.0), 2.0, gap=0.2)
    assert result.path is not None
    assert_driven(result.path.states, bool(robot.reverse))
    assert result.cost == pytest.approx(result.path.cost)
    assert result.lower_bound is not None
    assert result.lower_bound <= result.path.cost <= 1.25 * result.lower_bound
    many = planner.plan_many([(1.0, 1.0, 2.0)], [(9.0, 5.0, -1.0)], 0.5, max_iterations=1)[0]
    assert many.path is not None
    assert_driven(many.path.states, bool(robot.reverse))
    world = planner.world.edited(add=[Disc((1.8, 2.4), 0.2)])
    planner.update(world)
    again = planner.replan((1.0, 1.0, 2.0), (9.0, 5.0, -1.0), result.path, 2.0)
    assert again.path is not None
    assert_driven(again.path.states, bool(robot.reverse))
    assert not Oracle(world, robot).collides(again.path.resample(0.02).states).any()


def test_the_final_check_refuses_what_cannot_be_driven() -> None:
    motion, check = motion_in(OPEN, CART), Verifier(OPEN, CART, RIM)
    ends = np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 1.0]])
    path = path_of(motion, ends)
    assert check.fault(path, *ends) is None
    for other, robot in ((path_of(motion_of(StateChecker(OPEN, Robot.rectangle(0.6, 0.4))), ends), CART), (path, CART)):
        states = other.states.copy()
        if len(states) > 2:
            states = states[::-1].copy()
        fault = Verifier(OPEN, robot, RIM).fault(type(other)(states), states[0], states[-1])
        assert fault is not None
        assert "neither a turn in place nor a drive ahead" in fault


@pytest.mark.slow
def test_roadmaps_are_saved_with_their_directions(tmp_path: Path) -> None:
    planner = LandmarkPlanner(narrow(1.0), CART, seed=1, landmarks=60)
    planner.build()
    planner.roadmap.certify_all()
    for suffix in ("npz", "graphml"):
        file = tmp_path / f"roadmap.{suffix}"
        planner.roadmap.save(file)
        loaded = Roadmap.load(file, planner.checker)
        assert loaded.directed
        assert np.count_nonzero(loaded.certified) == np.count_nonzero(planner.roadmap.certified) > 100


def test_drives_of_robots() -> None:
    shape = Disc((0.0, 0.0), 1.0)
    assert (Robot(shape).drive, Robot(shape).reverse) == ("omnidirectional", True)
    assert (Robot(shape, drive="differential").drive, Robot(shape, drive="differential").reverse) == (
        "differential",
        False,
    )
    assert (Robot(shape, 2.0).drive, Robot(shape, 2.0).reverse) == ("car", True)
    assert CART.steered(2.0).drive == "car"
    assert CART.steered(2.0).differential() == CART
    assert CART.describe() == "rectangle 0.6 x 0.4 m, differential drive"
    for wrong in (
        {"drive": "car"},
        {"drive": "differential", "turning_radius": 1.0},
        {"drive": "tracked"},
        {"drive": 3},
    ):
        with pytest.raises(ShapeError, match="expected"):
            Robot(shape, **wrong)
