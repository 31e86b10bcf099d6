"""The final check of directions of travel, against the compiled one, and on paths by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.support.trials import few, trials

from trailmark import CurvePath, OneWayZone, Path, Polygon, Robot, Steering, World
from trailmark.curves.shortest import MAX_WORDS, shortest_word
from trailmark.curves.words import PIECES
from trailmark.motion.one_way import curve_allowed, one_ways, straight_allowed
from trailmark.verify import RIM, Verifier

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
AROUND = (-20.0, -20.0, 20.0, 20.0)


def check_of(zone: OneWayZone, robot: Robot) -> Verifier:
    return Verifier(World("w", AROUND, zones=(zone,)), robot, RIM)


@pytest.mark.parametrize(
    ("states", "fault"),
    [
        ([[-1, 1, 0], [3, 1, 0]], None),
        ([[3, 1, 0], [-1, 1, 0]], "motion 0 from [3.0, 1.0, 0.0] goes 3.141593 rad off one-way zone 0's heading"),
        ([[3, 1, 0], [3, 3, 0], [1, 3, 0], [1, 1.9, 0]], "motion 2"),
        ([[3, 0, 0], [-1, 0, 0]], None),  # along the outline
        ([[1, 1, 0], [1, 1, 3]], None),  # in place
    ],
)
def test_paths_by_hand(states: list[list[float]], fault: str | None) -> None:
    path = Path(np.array(states))
    found = check_of(OneWayZone(Polygon(SQUARE), 0.0, 0.5), Robot.rectangle(0.5, 0.3)).fault(
        path, path.states[0], path.states[-1]
    )
    assert (found is None) if fault is None else (found is not None and fault in found)


@pytest.mark.slow
def test_it_agrees_with_the_compiled_test() -> None:
    rng = np.random.default_rng(5)
    agreed = {True: 0, False: 0}
    for _ in trials(400):
        zone = OneWayZone(Polygon(SQUARE), rng.uniform(-math.pi, math.pi), rng.uniform(0.0, math.pi))
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
