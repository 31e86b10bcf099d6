"""Contact: touching is allowed, however edges and corners meet; 1e-5 m of overlap is not, 1e-5 m of gap is."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from trailmark import Robot, StateChecker, World
from trailmark.collision.fcl_scene import FclScene
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
DIAMOND = Robot.polygon([(1, 0), (0, 1), (-1, 0), (0, -1)])
L_SHAPE = Robot.polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
BLOCK = Polygon(SQUARE * 2.0 + 4.0)
L_BLOCK = Polygon(np.array([[4, 4], [7, 4], [7, 7], [6, 7], [6, 5], [4, 5]], dtype=float))
U_BLOCK = Polygon(np.array([[3, 3], [7, 3], [7, 7], [6, 7], [6, 4], [4, 4], [4, 7], [3, 7]], dtype=float))
RING = Polygon(SQUARE * 6.0 + 2.0, (SQUARE * 2.0 + 4.0,))
DIAGONAL = Polygon(np.array([[5, 3], [7, 5], [5, 7], [3, 5]], dtype=float))
HALF = math.sqrt(0.5)


def shifted(shape: Shape, offset: tuple[float, float]) -> Shape:
    if isinstance(shape, Polygon):
        return Polygon(shape.vertices + np.array(offset), tuple(hole + np.array(offset) for hole in shape.holes))
    return replace(shape, center=(shape.center[0] + offset[0], shape.center[1] + offset[1]))


# What, robot, obstacle, configuration in contact, direction that leads out of the contact (length 1).
CONTACTS: list[tuple[str, Robot, Shape | None, tuple[float, float, float], tuple[float, float]]] = [
    ("edge on edge", Robot.rectangle(2, 2), BLOCK, (3, 5, 0), (-1, 0)),
    ("edge on edge, turned a quarter", Robot.rectangle(2, 1), BLOCK, (3.5, 5, math.pi / 2), (-1, 0)),
    ("edge on edge, turned half", Robot.rectangle(2, 2), BLOCK, (5, 7, math.pi), (0, 1)),
    ("edges of one length", Robot.rectangle(2, 2), BLOCK, (5, 3, 0), (0, -1)),
    ("part of an edge on part of an edge", Robot.rectangle(2, 2), BLOCK, (3, 6.5, 0), (-1, 0)),
    ("corner on corner", Robot.rectangle(2, 2), BLOCK, (3, 3, 0), (-HALF, -HALF)),
    ("corner on edge", DIAMOND, BLOCK, (3, 5, 0), (-1, 0)),
    ("corner on edge, turned", Robot.rectangle(2, 2), BLOCK, (5, 6 + math.sqrt(2), math.pi / 4), (0, 1)),
    ("edge on corner", DIAMOND, BLOCK, (3.5, 3.5, 0), (-HALF, -HALF)),
    ("corner of the robot on corner of a diamond", DIAMOND, DIAGONAL, (2, 5, 0), (-1, 0)),
    ("sloped edge on sloped edge", DIAMOND, DIAGONAL, (3.5, 3.5, 0), (-HALF, -HALF)),
    ("an inner corner around a corner", L_SHAPE, BLOCK, (7, 7, -math.pi), (HALF, HALF)),
    ("an inner corner around a corner, unturned", L_SHAPE, BLOCK, (3, 3, 0), (-HALF, -HALF)),
    ("into the inner corner of an L", Robot.rectangle(1, 1), L_BLOCK, (5.5, 5.5, 0), (-HALF, HALF)),
    ("into a slot of its own width", Robot.rectangle(2, 2), U_BLOCK, (5, 5, 0), (0, 1)),
    ("into a hole of its own size", Robot.rectangle(2, 2), RING, (5, 5, 0), (0, 0)),
    ("corners on a hole's edges", DIAMOND, RING, (5, 5, 0), (0, 0)),
    ("disc in a hole of its own size", Robot.disc(1), RING, (5, 5, 0), (0, 0)),
    ("disc on edge", Robot.disc(1), BLOCK, (3, 5, 0), (-1, 0)),
    ("disc on corner", Robot.disc(1), BLOCK, (4 - HALF, 4 - HALF, 0), (-HALF, -HALF)),
    ("disc on disc", Robot.disc(1), Disc((5, 5), 2), (2, 5, 0), (-1, 0)),
    ("disc on disc, sloped", Robot.disc(1), Disc((5, 5), 2), (5 - 3 * 0.6, 5 - 3 * 0.8, 0), (-0.6, -0.8)),
    ("edge on disc", Robot.rectangle(2, 2), Disc((5, 5), 1), (3, 5, 0), (-1, 0)),
    ("corner on disc", DIAMOND, Disc((5, 5), 1), (3, 5, 0), (-1, 0)),
    ("corner on a turned rectangle", DIAMOND, Rectangle((5, 5), 2, 2, math.pi / 4), (4 - 2 * HALF, 5, 0), (-1, 0)),
    ("edge on bound", Robot.rectangle(2, 2), None, (1, 5, 0), (1, 0)),
    ("edges on two bounds", Robot.rectangle(2, 2), None, (9, 9, 0), (-1, -1)),
    ("corner on bound", DIAMOND, None, (5, 1, 0), (0, 1)),
    ("disc on bound", Robot.disc(1), None, (9, 5, 0), (-1, 0)),
]


@pytest.mark.parametrize("offset", [(0.0, 0.0), (-7.25, 3.1), (1e5, -1e5)], ids=["origin", "near", "far"])
@pytest.mark.parametrize("contact", CONTACTS, ids=[contact[0] for contact in CONTACTS])
def test_touching_is_valid(
    contact: tuple[str, Robot, Shape | None, tuple[float, float, float], tuple[float, float]],
    offset: tuple[float, float],
) -> None:
    _, robot, obstacle, at, out = contact
    bounds = (offset[0], offset[1], offset[0] + 10, offset[1] + 10)
    world = World("w", bounds, (shifted(obstacle, offset),) if obstacle else ())
    checker = StateChecker(world, robot)
    q = np.array([at[0] + offset[0], at[1] + offset[1], at[2]])
    outwards = np.array([*out, 0.0])
    assert checker.valid(q)
    assert checker.clearance(q) <= 1e-9
    if any(out):
        assert checker.valid(q + 1e-5 * outwards)
        assert not checker.valid(q - 1e-5 * outwards)
        assert checker.clearance(q - 1e-5 * outwards) == 0.0
    # Against a hole of the robot's own size every way is in.
    for sx, sy in itertools.product((-1, 1), (-1, 1)) if out == (0, 0) else ():
        assert not checker.valid(q + 1e-5 * np.array([sx, sy, 0.0]))


@pytest.mark.parametrize(("outward", "valid"), [(1e-5, True), (2e-8, True), (0.0, True), (-2e-8, True), (-1e-5, False)])
def test_the_tolerance_of_touching(outward: float, valid: bool) -> None:
    world = World("w", (0, 0, 10, 10), (BLOCK, Disc((8, 5), 0.5)))
    for robot, x in ((Robot.rectangle(2, 1), 3.0), (Robot.disc(1), 3.0), (L_SHAPE, 2.0)):
        checker = StateChecker(world, robot)
        assert checker.valid((x - outward, 5.0, 0.0)) is valid
        assert checker.valid((5.0, 6.0 + outward - (x - 4.0 if x == 3.0 else 0.0), math.pi / 2 * (x == 3.0))) is valid


def test_a_spike_beyond_the_end_of_a_narrow_notch() -> None:
    robot = Robot.polygon([(-1, -1), (1, -1), (1, 1), (0.02, 1), (0, -0.5), (-0.02, 1), (-1, 1)])
    # Narrower than the notch, its tip 4 um past the notch's end: the erosion of the footprint must not hide it.
    spike = np.array([[5.0, 4.5], [5.005, 7.0], [4.995, 7.0]])
    for depth, valid in ((4e-6, False), (-1e-5, True), (0.0, True)):
        world = World("w", (0, 0, 10, 10), (Polygon(spike - (0.0, depth)),))
        assert StateChecker(world, robot).valid((5.0, 5.0, 0.0)) is valid


@pytest.mark.parametrize("half", [5.0, 0.5, 0.05, 0.01])
def test_a_sharp_tip_reaches_no_deeper_than_any_other_part(half: float) -> None:
    """The tip's half angle is given in degrees; the robot drives at a wall, and along inside of one."""
    width = math.tan(math.radians(half))
    robot = Robot.polygon([(0, 0), (-1, width), (-1, -width)])
    wall = Polygon(np.array([[5.0, 0.0], [6.0, 0.0], [6.0, 10.0], [5.0, 10.0]]))
    checker = StateChecker(World("tip", (0, 0, 10, 10), (wall,)), robot)
    for turned in (0.0, 0.3, -0.7):
        assert checker.valid((5.0 - 1e-9, 5.0, turned))
        for depth in (1.2e-7, 1e-6, 1e-5):
            assert not checker.valid((5.0 + depth, 5.0, turned))
            sliding = [(5.0 + depth, 5.0 + k * 5e-7, turned) for k in range(3)]
            assert not checker.motions_valid(sliding[:-1], sliding[1:]).any()


def square(x: float, y: float, size: float) -> Polygon:
    return Polygon(np.array([[x, y], [x + size, y], [x + size, y + size], [x, y + size]]))


@pytest.mark.parametrize("robot", [Robot.disc(1.0), Robot.rectangle(2.0, 1.0)])
@pytest.mark.parametrize("kept", [1e-9, 7e-8, 1e-7, 2e-7, 0.1])
def test_a_clearance_is_kept_however_small(robot: Robot, kept: float) -> None:
    world = World("w", (0.0, 0.0, 10.0, 8.0), (Rectangle((6.0, 4.0), 2.0, 8.0),))
    checker = StateChecker(world, robot, clearance=kept)
    # Dilated by the clearance, it overlaps by no more than 1e-7 m.
    assert not checker.valid((4.0 - kept + 1.1e-7, 4.0, 0.0))
    assert not checker.valid((4.0 + 1e-9, 4.0, 0.0))
    assert checker.valid((4.0 - kept - 1e-8, 4.0, 0.0))


@pytest.mark.parametrize("radius", [1e-6, 1e-7, 5e-8, 1e-12])
def test_the_smallest_disc_still_collides(radius: float) -> None:
    scene = FclScene(World("w", (0, 0, 10, 10), (square(4, 4, 2),)), Robot.disc(radius))
    assert scene.collides(np.array((5.0, 5.0, 0.0)))
    assert not scene.collides(np.array((3.0, 5.0, 0.0)))
