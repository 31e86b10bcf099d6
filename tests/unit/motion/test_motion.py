"""Kinds of motion: their costs, interpolation and directions, against formulas of this file alone."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.worlds import random_world

from trailmark import ConfigurationError, Robot, StateChecker, Steering, World, se2
from trailmark.motion import CurveMotion, Motion, StraightMotion, TranslationMotion, kind_of, motion_of
from trailmark.trajectories import CurvePath, path_of

WORLD = random_world(5, 30, size=24.0, radii=(0.5, 2.0))
CAR = Robot.rectangle(1.2, 0.6)
MOTIONS: dict[str, Motion] = {
    "translation": motion_of(StateChecker(WORLD, Robot.disc(0.4))),
    "straight": motion_of(StateChecker(WORLD, CAR)),
    "reversing": motion_of(StateChecker(WORLD, CAR.steered(1.5))),
    "forwards": motion_of(StateChecker(WORLD, CAR.steered(1.5, reverse=False))),
}
ANGLES = [0.0, math.pi, -math.pi + 1e-12, math.nextafter(math.pi, 0.0), 1.0, -2.5]


def pairs(seed: int, n: int = 40) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    a, b = (rng.uniform((0, 0, -math.pi), (24, 24, math.pi), (n, 3)) for _ in range(2))
    a[: len(ANGLES), 2], b[: len(ANGLES), 2] = ANGLES, ANGLES[::-1]
    return a, b


def turned(a: np.ndarray, b: np.ndarray) -> float:
    return abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))


def test_robots_move_as_they_are_made() -> None:
    assert [type(motion) for motion in MOTIONS.values()] == [
        TranslationMotion,
        StraightMotion,
        CurveMotion,
        CurveMotion,
    ]
    assert [motion.directed for motion in MOTIONS.values()] == [False, False, False, True]
    assert (kind_of(Robot.disc(1.0)), kind_of(CAR), kind_of(CAR.steered(1.0))) == ("translation", "straight", "curve")
    # A steering given counts, whatever the robot.
    assert isinstance(motion_of(StateChecker(WORLD, Robot.disc(0.4)), Steering(2.0)), CurveMotion)


@pytest.mark.slow
@given(st.integers(0, 1000))
def test_costs_are_those_of_the_metric(seed: int) -> None:
    a, b = pairs(seed)
    away = [math.dist(p[:2], q[:2]) for p, q in zip(a, b, strict=True)]
    turns = [turned(p, q) for p, q in zip(a, b, strict=True)]
    assert MOTIONS["translation"].costs(a, b) == pytest.approx(away)
    assert MOTIONS["straight"].costs(a, b) == pytest.approx([d + 0.5 * t for d, t in zip(away, turns, strict=True)])
    for name in ("reversing", "forwards"):
        lengths = MOTIONS[name].costs(a, b)
        # Neither shorter than the straight line nor than the arc that the turn takes.
        assert (lengths >= np.array(away) - 1e-9).all()
        assert (lengths >= 1.5 * np.array(turns) - 1e-9).all()
    assert (MOTIONS["reversing"].costs(a, b) <= MOTIONS["forwards"].costs(a, b) + 1e-9).all()
    assert MOTIONS["reversing"].costs(a, b) == pytest.approx(MOTIONS["reversing"].costs(b, a))


@pytest.mark.parametrize("name", MOTIONS)
def test_paths_lead_from_the_start_to_the_goal(name: str) -> None:
    motion, (start, goal) = MOTIONS[name], np.array([[1.0, 2.0, 3.0], [9.0, 4.0, -3.0]])
    ends = motion.ends(start, goal)
    middle = np.array([[5.0, 1.0, 0.0]])
    states = motion.whole_states(np.vstack([ends[:1], middle, ends[1:]]), start, goal)
    assert np.array_equal(states[[0, -1]], [start, goal])
    path = path_of(motion, states)
    assert isinstance(path, CurvePath) == (name in ("reversing", "forwards"))
    cheapest = motion.least_cost(start, goal)
    assert cheapest == pytest.approx(path_of(motion, motion.whole_states(ends, start, goal)).cost)
    assert cheapest <= path.cost + 1e-9
    if name == "translation":
        # It turns evenly along its length.
        assert states[1, 2] == pytest.approx(se2.interpolate(start, goal, path_share(states))[2])


def path_share(states: np.ndarray) -> float:
    first, second = (math.dist(states[i, :2], states[i + 1, :2]) for i in (0, 1))
    return first / (first + second)


def test_exactly_half_a_turn_has_another_way_back() -> None:
    a = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, math.pi / 2]])
    b = np.array([[1.0, 0.0, math.pi], [1.0, 0.0, math.nextafter(math.pi, 0.0)], [1.0, 2.0, -math.pi / 2]])
    assert MOTIONS["straight"].reversible(a, b).tolist() == [False, True, False]
    for name in ("translation", "reversing"):
        assert MOTIONS[name].reversible(a, b).all()


def test_bad_input_is_told_in_one_line() -> None:
    for motion in MOTIONS.values():
        with pytest.raises(ConfigurationError, match="expected as many ends as starts"):
            motion.motions_valid(np.zeros((2, 3)), np.zeros((3, 3)))
        with pytest.raises(ConfigurationError, match="expected shapes"):
            motion.motion_valid(np.zeros((1, 3)), np.zeros((1, 3)))
    with pytest.raises(ConfigurationError, match="turning radius"):
        CurveMotion(StateChecker(World("w", (0, 0, 5, 5)), Robot.disc(0.4)))
