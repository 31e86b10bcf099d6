"""One definition of the shorter turn: compiled code, numpy arrays, paths and planning agree around half a turn."""

from __future__ import annotations

from fractions import Fraction
from math import cos, inf, nextafter, pi, sin

import numpy as np
import pytest
import shapely

from trailmark import Disc, LandmarkPlanner, Path, Robot, StateChecker, World, se2
from trailmark.heading import turn, wrapped

HALF_TURNS = [(a, a + s * 180) for a in (-172, -163, -154, -26, -17, -8, 0, 45, 90) for s in (1, -1)]
"""Degrees: turned by 180, which in radians is up to an ulp more or less than the double nearest to pi."""


def nudged(value: float, ulps: int) -> float:
    for _ in range(abs(ulps)):
        value = nextafter(value, inf if ulps > 0 else -inf)
    return value


def headings() -> np.ndarray:
    rng = np.random.default_rng(0)
    edges = [nudged(sign * pi * part, k) for sign in (1, -1) for part in (0.5, 1.0) for k in range(-3, 4)]
    inside = [angle for angle in edges if -pi <= angle <= pi]
    return np.concatenate([rng.uniform(-pi, pi, 300), inside, [0.0, 1e-300, -1e-16, 5e-324]])


def test_wrapped_is_the_same_for_numbers_and_for_arrays() -> None:
    rng = np.random.default_rng(1)
    angles = np.concatenate(
        [rng.uniform(-7, 7, 2000), rng.uniform(-1e6, 1e6, 2000), [k * pi for k in range(-9, 10)], [1e15, -1e15]]
    )
    angles = np.concatenate([[nudged(float(a), k) for k in (-1, 0, 1)] for a in angles])
    found = np.asarray(se2.wrap(angles))
    assert found.tolist() == [wrapped(float(a)) for a in angles]
    assert ((found > -pi) & (found <= pi)).all()
    kept = (angles > -pi) & (angles <= pi)
    assert (found[kept] == angles[kept]).all()


def test_turns_are_the_same_for_numbers_and_for_arrays() -> None:
    a, b = (q.ravel() for q in np.meshgrid(headings(), headings()))
    zero = np.zeros_like(a)
    by_arrays = se2.difference(np.column_stack([zero, zero, a]), np.column_stack([zero, zero, b]))[:, 2]
    assert by_arrays.tolist() == [turn(float(x), float(y)) for x, y in zip(a, b, strict=True)]


def test_a_turn_is_the_shorter_way_by_exact_arithmetic() -> None:
    half = Fraction(pi)
    for a in headings()[::5].tolist():
        for b in headings()[::3].tolist():
            rounded = Fraction(b - a)  # as every program computes it, OMPL's too
            exact = rounded - 2 * half if rounded > half else rounded + 2 * half if rounded <= -half else rounded
            assert Fraction(turn(a, b)) == exact


@pytest.mark.parametrize(("first", "second"), HALF_TURNS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_side_that_is_certified_is_the_one_that_is_driven(first: float, second: float, side: float) -> None:
    a, b = float(se2.wrap(np.deg2rad(first))), float(se2.wrap(np.deg2rad(second)))
    middle = a + side * pi / 2
    world = World("half turn", (-2, -2, 2, 2), (Disc((0.7 * cos(middle), 0.7 * sin(middle)), 0.2),))
    robot = Robot.polygon([[0, -0.05], [1, -0.05], [1, 0.05], [0, 0.05]])
    checker = StateChecker(world, robot)
    obstacle = shapely.Point(world.obstacles[0].center).buffer(0.2)  # type: ignore[union-attr]  # it is a disc

    def swept_is_free(states: np.ndarray) -> bool:
        bodies = shapely.polygons(se2.transform(states, robot.outline.vertices))
        return not bool(shapely.intersects(bodies, obstacle).any())

    start, goal = np.array([0.0, 0.0, a]), np.array([0.0, 0.0, b])
    driven = Path(np.array([start, goal])).resample(0.01).states
    assert checker.motion_valid(start, goal) == swept_is_free(driven)
    result = LandmarkPlanner(world, robot, seed=0).plan(start, goal, time_limit=5.0)
    if result.path is not None:
        assert swept_is_free(result.path.resample(0.01).states)
        assert swept_is_free(result.path.at(np.linspace(0, 1, 500)))
