"""Messages about invalid configurations: which obstacle or bound, and by how much, in one line."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from trailmark.collision import StateChecker
from trailmark.collision.explain import invalid_reason
from trailmark.errors import ConfigurationError
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import Robot, World

BOUNDS = (0.0, 0.0, 10.0, 10.0)


def box(xmin: float, ymin: float, xmax: float, ymax: float) -> Polygon:
    return Polygon(np.array([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]], dtype=float))


def world(*obstacles: Shape, boundary: Polygon | None = None) -> World:
    return World("w", BOUNDS, obstacles, boundary=boundary)


QUARTER = math.pi / 2
SQUARE = Robot.rectangle(2, 2)
SPIKE = Polygon(np.array([[1, 1], [4.9, 1], [5, 6], [5.1, 1], [9, 1], [9, 9], [1, 9]], dtype=float))

REASONS = [
    (world(), SQUARE, (0.75, 5, 0), "reaches 0.25 m over the left bound"),
    (world(), SQUARE, (5, 9.5, 0), "reaches 0.5 m over the upper bound"),
    (world(), Robot.disc(1), (5, 0.875, 0), "reaches 0.125 m over the lower bound"),
    (world(), Robot.disc(1), (11, 5, 0), "reaches 2 m over the right bound"),
    (world(), Robot.disc(1), (1e300, 5, 0), "reaches 1e+300 m over the right bound"),
    (world(), SQUARE, (5, -1e300, 1), "reaches 1e+300 m over the lower bound"),
    (world(boundary=box(2, 2, 8, 8)), SQUARE, (5, 2.5, 0), "reaches 0.5 m over the boundary"),
    (world(boundary=box(2, 2, 8, 8)), Robot.disc(1), (5, 7.5, 0), "reaches 0.5 m over the boundary"),
    (world(boundary=box(1, 1, 4, 4)), Robot.disc(1), (5, 2, 0), "reaches 2 m over the boundary"),
    (world(boundary=SPIKE), Robot.rectangle(2, 0.2), (5, 4, 0), "reaches 1.04 m over the boundary"),
    (world(box(5.75, 0, 7, 9)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (polygon) by 0.25 m"),
    (world(Rectangle((6.75, 5), 2, 9)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (rectangle) by 0.25 m"),
    (world(Disc((7.5, 5), 1.75)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (disc) by 0.25 m"),
    (world(Disc((7.5, 5), 1.75)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 0 (disc) by 0.25 m"),
    (world(box(5.75, 0, 7, 9)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 0.25 m"),
    (world(box(2, 2, 8, 8)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 4 m"),
    (world(box(2, 2, 8, 8)), Robot.rectangle(1, 1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 3.5 m"),
    # One crosses the other, or holds it.
    (world(box(4.9, 2, 5.1, 8)), Robot.rectangle(2, 0.1), (5, 5, 0), "overlaps obstacle 0 (polygon) by 1.1 m"),
    (world(box(5, 5, 5.1, 5.1)), SQUARE, (5, 5, 0), "overlaps obstacle 0 (polygon) by 1 m"),
    # The one that is overlapped most, not the first; rounding at a contact elsewhere is not the reason.
    (world(box(0, 0, 4, 10), box(5.75, 0, 6, 10)), SQUARE, (5, 5, QUARTER), "overlaps obstacle 1 (polygon) by 0.25 m"),
    (world(box(1.75, 4, 3, 6)), SQUARE, (1 - 1e-15, 5, QUARTER), "overlaps obstacle 0 (polygon) by 0.25 m"),
    (world(Disc((7, 5), 1), box(3, 4, 4.5, 6)), Robot.disc(1), (5, 5, 0), "overlaps obstacle 1 (polygon) by 0.5 m"),
    (world(box(6, 0, 8, 10)), SQUARE, (5 + 2e-7, 5, 0), "overlaps obstacle 0 (polygon) by 2e-07 m"),
]  # fmt: skip


@pytest.mark.parametrize(("where", "robot", "q", "reason"), REASONS)
def test_the_reason_names_the_obstacle_and_the_depth(
    where: World, robot: Robot, q: tuple[float, float, float], reason: str
) -> None:
    checker = StateChecker(where, robot)
    assert not checker.valid(q)
    said = invalid_reason(where, robot, np.array(q, dtype=float))
    assert said == reason or re.fullmatch(reason, said)
    with pytest.raises(ConfigurationError) as caught:
        checker.require_valid(q, "start")
    message = str(caught.value)
    assert message.startswith("start (")
    assert message.endswith(f"is not valid: the robot ({robot.describe()}) {said}")
    assert "\n" not in message
