"""Steering: arguments of every shape, names of curves, robots, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trailmark.curves import Steering
from trailmark.errors import ConfigurationError
from trailmark.world import Robot

A, B = (0.0, 0.0, 0.0), (6.0, 4.0, 1.0)


def test_one_or_many() -> None:
    steering = Steering(1.5)
    one = steering.lengths(A, B)
    assert isinstance(one, float)
    assert steering.lengths([A, A], [B, A]).tolist() == [one, 0.0]
    assert steering.lengths([A, B], B).tolist() == [one, 0.0]
    assert steering.states(A, B, [0.0, 1.0, one]).shape == (3, 3)
    assert steering.states([A, B], [B, A], [0.0, 1.0]).shape == (2, 2, 3)
    assert steering.states([A, B], [B, A], [[0.0], [1.0]]).shape == (2, 1, 3)
    assert steering.lengths(np.empty((0, 3)), np.empty((0, 3))).shape == (0,)


def test_places_beyond_the_ends_are_the_ends() -> None:
    steering = Steering(1.5)
    states = steering.states(A, B, [-1.0, 1e9])
    assert states[0] == pytest.approx(A, abs=1e-12)
    assert states[1] == pytest.approx(B, abs=1e-12)


def test_curves_say_what_they_are_made_of() -> None:
    curves = Steering(1.0).curves([A, A, A], [(5, 0, 0), (1, 1, math.pi / 2), (-1, -1, math.pi / 2)])
    assert curves.names() == ["S+", "L+", "R-"]
    assert curves.lengths == pytest.approx([5.0, math.pi / 2, math.pi / 2])
    assert curves.sides.shape == curves.signed_lengths.shape == (3, 5)


def test_a_robots_steering() -> None:
    assert Steering.of(Robot.disc(1.0)) is None
    car = Robot(Robot.rectangle(4.0, 2.0).footprint, turning_radius=5.0, reverse=False)
    assert Steering.of(car) == Steering(5.0, reverse=False)
    assert Steering(5.0).kind == "reeds-shepp"
    assert Steering(5.0, reverse=False).kind == "dubins"


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_a_radius_that_is_none(radius: float) -> None:
    with pytest.raises(ConfigurationError, match="expected a finite number above 0, got"):
        Steering(radius)


def test_other_shapes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="expected as many ends as starts, got 2 starts and 3 ends"):
        Steering(1.0).lengths([A] * 2, [B] * 3)
    with pytest.raises(ConfigurationError, match=r"curve: start: expected shape \(3,\) or \(n, 3\) for x, y, theta,"):
        Steering(1.0).lengths((1.0, 2.0), B)
