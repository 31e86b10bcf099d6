"""Robots with a turning radius: values, texts, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from trailmark.errors import ShapeError
from trailmark.world import TURNING_LIMIT, Robot


def test_a_robot_moves_in_every_direction_unless_it_has_a_turning_radius() -> None:
    for robot in (Robot.disc(0.3), Robot.rectangle(2, 1), Robot.parse("rectangle:2x1")):
        assert robot.turning_radius is None
        assert robot.reverse
    car = Robot.rectangle(2, 1).steered(5, reverse=False)
    assert car == Robot(Robot.rectangle(2, 1).footprint, turning_radius=5.0, reverse=False)
    assert isinstance(car.turning_radius, float)
    assert car.steered(None) == Robot.rectangle(2, 1)
    assert len({car, car.steered(5.0, reverse=False), car.steered(5.0), car.steered(6.0), car.steered(None)}) == 4
    assert car.circumradius == Robot.rectangle(2, 1).circumradius


def test_descriptions() -> None:
    car = Robot.disc(0.5).steered(4.5)
    assert car.describe() == "disc 0.5 m, turning radius 4.5 m"
    assert car.steered(4.5, reverse=False).describe() == "disc 0.5 m, turning radius 4.5 m, forward only"
    assert Robot.rectangle(2, 1).describe() == "rectangle 2 x 1 m"


@pytest.mark.parametrize(
    "radius", [0.0, -1.0, math.nan, math.inf, -math.inf, 2 * TURNING_LIMIT, True, "5", [5.0]], ids=repr
)
def test_a_radius_that_is_none(radius: Any) -> None:
    with pytest.raises(ShapeError, match=r"turning_radius .* given, allowed: a number above 0") as raised:
        Robot.rectangle(2, 1).steered(radius)
    assert "\n" not in str(raised.value)


def test_numbers_of_numpy_are_numbers() -> None:
    assert Robot.disc(1).steered(float(np.float64(3.0))).turning_radius == 3.0
    assert Robot(Robot.disc(1).footprint, turning_radius=np.float64(3.0)).turning_radius == 3.0


def test_only_a_car_can_drive_forwards_only() -> None:
    with pytest.raises(ShapeError, match="reverse False given without a turning radius"):
        Robot.disc(1).steered(None, reverse=False)
    with pytest.raises(ShapeError, match="reverse 0 given, allowed: True, False"):
        Robot.disc(1).steered(3.0, reverse=0)  # type: ignore[arg-type]  # that is what is tested
