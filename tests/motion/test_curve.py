"""Certified curves: what is accepted never collides, and what is clearly free is accepted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracle import Oracle
from tests.helpers.random_worlds import ROBOTS, random_world, short_motions
from tests.support.oracles import checker_and_oracle
from tests.support.trials import few, pairs, trials

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError
from trailmark.motion import CurveMotion
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.shapes import Disc, Polygon, Shape
from trailmark.trajectories import CurvePath
from trailmark.world import Robot, World
from trailmark.world.objective import Objective

KINDS = [Steering(1.5), Steering(1.5, reverse=False)]
NAMES = ["reeds-shepp", "dubins"]
WORLDS = {
    "polygons": random_world(21, 200),
    "holes, discs, boundary": random_world(22, 120, discs=0.3, holes=0.5, boundary=True),
    "far": random_world(23, 100, discs=0.3, holes=0.3, boundary=True, origin=(1e5, -1e5)),
    "crowded": random_world(24, 25, size=20.0, radii=(0.1, 1.0), discs=0.3, holes=0.4),
}
PAIRS = pairs(WORLDS, ROBOTS)
SAMPLES = 150


def box(xmin: float, ymin: float, xmax: float, ymax: float) -> Polygon:
    return Polygon(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]]))


@pytest.mark.slow
@pytest.mark.parametrize("steering", KINDS, ids=NAMES)
@pytest.mark.parametrize(("world", "name"), PAIRS)
def test_curves_in_random_worlds(world: str, name: str, steering: Steering) -> None:
    checker, oracle = checker_and_oracle(WORLDS[world], ROBOTS[name])
    motions = CurveMotion(checker, steering)
    a, b = short_motions(checker.world, 400, np.random.default_rng(12), 4.0)
    # Half of the ends ahead of the car, as most are on paths.
    b[200:, 2] = se2.wrap(a[200:, 2] + 0.5 * (b[200:, 2] - a[200:, 2]))
    valid = checker.valid(a) & checker.valid(b)
    a, b = a[valid], b[valid]
    accepted = motions.motions_valid(a, b)
    assert 5 < accepted.sum() < len(a) - 2

    # Sound: none of the accepted ones collides anywhere.
    lengths = steering.lengths(a, b)
    states = steering.states(a, b, lengths[:, None] * np.linspace(0.0, 1.0, SAMPLES))
    assert not oracle.collides(states[accepted].reshape(-1, 3)).any()

    # Complete: one that keeps 1 mm away everywhere is accepted. The moves between two samples are shorter than
    # what their clearances allow for; each second one will do, for at most one is left out beside each.
    clearance = checker.clearance(states[~accepted, ::2].reshape(-1, 3), cap=1.0).reshape(-1, SAMPLES // 2)
    half_step = lengths[~accepted] * (1.0 + checker.footprint.sweep_radius / steering.radius) / (SAMPLES - 1)
    assert not (clearance.min(axis=1) - half_step >= 1e-3).any()

    # One a call: the same answers.
    single = PointwiseChecker(checker, steering)
    alone = [single.motion_valid(tuple(p), tuple(q)) for p, q in zip(a.tolist(), b.tolist(), strict=True)]
    assert alone == accepted.tolist()


@pytest.mark.parametrize("steering", KINDS, ids=NAMES)
def test_fine_sampling_finds_hardly_any_free_curve_that_was_refused(steering: Steering) -> None:
    world, robot = WORLDS["polygons"], ROBOTS["rectangle"]
    checker, oracle = StateChecker(world, robot), Oracle(world, robot)
    a, b = short_motions(world, 200, np.random.default_rng(5), 3.0)
    valid = checker.valid(a) & checker.valid(b)
    a, b = a[valid], b[valid]
    refused = ~CurveMotion(checker, steering).motions_valid(a, b)
    free = 0
    for p, q in zip(a[refused], b[refused], strict=True):
        length = steering.lengths(p, q)
        coarse = steering.states(p, q, np.linspace(0.0, length, 60))
        if oracle.collides(coarse).any():
            continue
        free += not oracle.collides(steering.states(p, q, np.arange(0.0, length, 1e-3))).any()
    assert free <= 1
    assert refused.sum() > 10


poses = st.tuples(st.floats(6.0, 14.0), st.floats(6.0, 14.0), st.floats(-math.pi, math.pi))


@pytest.mark.slow
@given(
    st.sampled_from(sorted(ROBOTS)),
    st.sampled_from(KINDS),
    poses,
    poses,
    st.floats(0.0, 1.0),
    st.tuples(st.floats(0.01, 0.99), st.floats(0.01, 0.99)),
    st.sampled_from([1e-5, 1e-3]),
)
@settings(max_examples=few(60))
def test_no_needle_is_small_enough_to_be_missed(
    name: str,
    steering: Steering,
    a: tuple[float, float, float],
    b: tuple[float, float, float],
    t: float,
    where: tuple[float, float],
    size: float,
) -> None:
    """A speck anywhere that the robot passes over, at any moment: no sampling at a resolution would find it."""
    robot = ROBOTS[name]
    inscribed = robot.inscribed_disc
    r, angle = 0.99 * where[0] * inscribed.radius, 2.0 * math.pi * where[1]
    point = np.add(inscribed.center, (r * math.cos(angle), r * math.sin(angle)))
    q = steering.states(a, b, [t * steering.lengths(a, b)])[0]
    x, y = se2.transform(q, point[None])[0]
    speck: Shape = Disc((x, y), size) if where[0] < 0.5 else box(x - size, y - size, x + size, y + size)
    checker = StateChecker(World("w", (-20.0, -20.0, 40.0, 40.0), (speck,)), robot, cell=0.25)
    assert not CurveMotion(checker, steering).motion_valid(a, b)
    single = PointwiseChecker(checker, steering)
    if checker.valid(a) and checker.valid(b):
        assert not single.motion_valid(a, b)


def test_forwards_only_and_in_reverse() -> None:
    # A dead end: out of it leads the way back only.
    walls = (box(0, 4, 10, 4.4), box(0, 5.6, 10, 6), box(9.4, 4, 10, 6))
    checker = StateChecker(World("dead end", (0, 0, 20, 10), walls), Robot.rectangle(1, 0.5))
    inside, outside = (8.0, 5.0, 0.0), (3.0, 5.0, 0.0)
    assert CurveMotion(checker, Steering(2.0)).motion_valid(inside, outside)
    assert CurveMotion(checker, Steering(2.0)).motion_valid(outside, inside)
    assert CurveMotion(checker, Steering(2.0, reverse=False)).motion_valid(outside, inside)
    assert not CurveMotion(checker, Steering(2.0, reverse=False)).motion_valid(inside, outside)


def test_a_curve_may_leave_contact_and_arrive_in_it() -> None:
    checker = StateChecker(World("wall", (0, 0, 20, 20), (box(6, 0, 8, 20),)), Robot.rectangle(2, 2))
    motions = CurveMotion(checker, Steering(2.0))
    contact, away = (5.0, 8.0, 0.0), (2.0, 8.0, 0.0)
    assert checker.clearance(contact) == 0.0
    assert motions.motion_valid(contact, away)
    assert motions.motion_valid(away, contact)
    assert motions.motion_valid(contact, contact)
    # Along the wall, touching it all the way, is not certified.
    assert not motions.motion_valid((5.0, 8.0, math.pi / 2), (5.0, 10.0, math.pi / 2))
    assert motions.motion_valid((4.99, 8.0, math.pi / 2), (4.99, 10.0, math.pi / 2))


def test_the_robots_own_steering_and_bad_input() -> None:
    world = World("w", (0, 0, 20, 20))
    car = Robot(Robot.rectangle(2, 1).footprint, turning_radius=3.0, reverse=False)
    assert CurveMotion(StateChecker(world, car)).steering == Steering(3.0, reverse=False)
    with pytest.raises(ConfigurationError, match="expected steering, or a robot with a turning radius, got neither"):
        CurveMotion(StateChecker(world, Robot.disc(1)))
    motions = CurveMotion(StateChecker(world, car))
    with pytest.raises(ConfigurationError, match="expected as many ends as starts, got 2 and 1"):
        motions.motions_valid([(5, 5, 0)] * 2, [(6, 5, 0)])
    with pytest.raises(ConfigurationError, match="shapes"):
        motions.motion_valid([(5, 5, 0)], [(6, 5, 0)])


@pytest.mark.slow
def test_cost_of_a_path_counts_changes_of_direction_and_metres_in_reverse() -> None:
    steering, rng = Steering(1.5), np.random.default_rng(3)
    checker = StateChecker(World("open", (-20.0, -20.0, 20.0, 20.0), ()), Robot.rectangle(1.0, 0.5).steered(1.5))
    plain = CurveMotion(checker, steering)
    motion = CurveMotion(checker, steering, Objective(direction_change=2.0, reverse=1.5))
    for _ in trials(200):
        # States on a grid: some motions lead straight on, some nowhere.
        states = np.column_stack([rng.integers(-3, 4, (6, 2)), rng.choice([0.0, 0.5 * np.pi, np.pi], 6)])
        path = CurvePath(states, steering)
        assert plain.cost_of(states) == pytest.approx(path.length)
        expected = path.length + 2.0 * path.cusps + 0.5 * path.reverse_length
        assert motion.cost_of(states) == pytest.approx(expected)
        bound = motion.least_cost(states[0], states[-1])
        assert plain.least_cost(states[0], states[-1]) - 1e-9 <= bound <= expected + 1e-9


def test_driven_backwards_all_the_way_costs_the_factor() -> None:
    checker = StateChecker(World("open", (-20.0, -20.0, 20.0, 20.0), ()), Robot.rectangle(1.0, 0.5).steered(1.5))
    motion = CurveMotion(checker, objective=Objective(direction_change=2.0, reverse=1.5))
    start, goal = np.zeros(3), np.array([-4.0, 0.0, 0.0])
    assert motion.cost_of(np.array([start, goal])) == pytest.approx(6.0)
    assert motion.least_cost(start, goal) == pytest.approx(6.0)
