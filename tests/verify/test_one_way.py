"""Paths through one-way zones: by hand, in intervals, and against samples and the compiled test."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.support.trials import few, trials

from trailmark import CurvePath, OneWayZone, Path, Polygon, Robot, Steering, World, check_path
from trailmark.curves.shortest import MAX_WORDS, shortest_word
from trailmark.curves.words import PIECES
from trailmark.motion.one_way import curve_allowed, one_ways, straight_allowed
from trailmark.verify import RIM, Verifier

ROBOT = Robot.rectangle(0.4, 0.2)
SQUARE = Polygon(np.array([[2.0, 2.0], [6.0, 2.0], [6.0, 6.0], [2.0, 6.0]]))


def world_of(*zones: OneWayZone) -> World:
    return World("w", (-20.0, -20.0, 20.0, 20.0), zones=zones)


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ([[0, 4, 0], [8, 4, 0]], []),
        ([[8, 4, 0], [0, 4, 0]], [(2.0, 6.0, "one-way zone 0", 2.0)]),
        ([[8, 4, 0], [5, 4, 0], [0, 4, 0]], [(2.0, 6.0, "one-way zone 0", 2.0)]),
        ([[8, 2, 0], [0, 2, 0]], []),  # along the outline
        ([[3, 3, 0], [3, 3, 2]], []),  # in place
        (
            [[4, 0, 0], [4, 3, 0], [5, 3, 0], [5, 1, 0]],
            [(2.0, 3.0, "one-way zone 0", 1.0), (4.0, 5.0, "one-way zone 0", 1.0)],
        ),
    ],
)
def test_paths_by_hand(states: list[list[float]], expected: list[tuple[float, float, str, float]]) -> None:
    audit = check_path(world_of(OneWayZone(SQUARE, 0.0, 0.5)), ROBOT, states)
    assert audit.free == (not expected)
    assert [c.obstacle for c in audit.collisions] == [row[2] for row in expected]
    for c, (begin, end, _, depth) in zip(audit.collisions, expected, strict=True):
        assert (c.begin, c.end, c.depth) == pytest.approx((begin, end, depth), abs=2e-3)


def test_a_car_in_reverse_travels_backwards() -> None:
    line = np.array([[8.0, 4.0, 0.0], [0.0, 4.0, 0.0]])
    path = CurvePath(line, Steering(1.0))
    assert not check_path(world_of(OneWayZone(SQUARE, 0.0, 0.5)), ROBOT, path).free
    assert check_path(world_of(OneWayZone(SQUARE, math.pi, 0.0)), ROBOT, path).free


# --- What the planner's exit says, against the compiled test.

UNIT = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
AROUND = (-20.0, -20.0, 20.0, 20.0)


def check_of(zone: OneWayZone, robot: Robot) -> Verifier:
    return Verifier(World("w", AROUND, zones=(zone,)), robot, RIM)


@pytest.mark.slow
def test_it_agrees_with_the_compiled_test() -> None:
    rng = np.random.default_rng(5)
    agreed = {True: 0, False: 0}
    for _ in trials(400):
        zone = OneWayZone(Polygon(UNIT), rng.uniform(-math.pi, math.pi), rng.uniform(0.0, math.pi))
        a, b = rng.uniform([-3, -3, -3], [5, 5, 3], (2, 3))
        if rng.random() < 0.5:
            allowed = bool(straight_allowed(one_ways([zone]), a, b))
            path: Path = Path(np.array([a, b]))
            robot = Robot.rectangle(0.5, 0.3)
        else:
            steering = Steering(rng.uniform(0.3, 2.0), bool(rng.random() < 0.5))
            word = shortest_word(a, b, steering.radius, steering.reverse, np.empty((MAX_WORDS, 2, PIECES)))
            allowed = bool(curve_allowed(one_ways([zone]), a, word, steering.radius))
            path, robot = CurvePath(np.array([a, b]), steering), Robot.rectangle(0.5, 0.3)
        assert (check_of(zone, robot).fault(path, path.states[0], path.states[-1]) is None) == allowed
        agreed[allowed] += 1
    assert min(agreed.values()) > few(50)
