"""The campaign's judge itself: depths and rooms that are known."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from benchmarks.soundness import exact
from benchmarks.soundness.carving import carved_world
from benchmarks.soundness.reference import Reference, deepest, moves
from benchmarks.soundness.scenes import SCALES
from benchmarks.soundness.walls import ceiling_world

from trailmark import Disc, Polygon, Rectangle, Robot, World

BLOCK = World("block", (-10.0, -10.0, 10.0, 10.0), (Rectangle((0.0, 0.0), 2.0, 2.0),))


@pytest.mark.parametrize("away", [0.0, 1e6])
@pytest.mark.parametrize(
    ("robot", "x", "depth"),
    [
        (Robot.disc(0.5), 1.5, 0.0),
        (Robot.disc(0.5), 1.4, 0.1),
        (Robot.disc(0.5), 0.8, 0.7),
        (Robot.rectangle(1.0, 0.5), 1.6, 0.0),
        (Robot.rectangle(1.0, 0.5), 1.45, 0.05),
        # A tip that reaches in: half an angle of a hundredth of a degree.
        (Robot.polygon([(-1.0, 0.0), (0.0, 2e-4), (0.0, -2e-4)]), 1.97, 0.03),
    ],
)
def test_depth_is_the_shortest_shift_that_undoes_it(robot: Robot, x: float, depth: float, away: float) -> None:
    world = World("block", (away - 10.0, -10.0, away + 10.0, 10.0), (Rectangle((away, 0.0), 2.0, 2.0),))
    reference = Reference(world, robot)
    q = np.array([[away + x, 0.0, 0.0]])
    assert reference.depth(q)[0] == pytest.approx(depth, abs=1e-9)
    room = 0.1 if x == 1.6 else 0.0
    assert max(0.0, reference.clearance(q)[0]) == pytest.approx(room, abs=1e-9)
    assert reference.collides(q)[0] == (depth > 0.0)
    assert reference.certainly(q[0]) == (depth > 0.0)


@pytest.mark.parametrize("kept", [5e-8, 0.25])
@pytest.mark.parametrize("robot", [Robot.disc(0.5), Robot.rectangle(1.0, 0.5)])
@pytest.mark.parametrize("obstacle", [Rectangle((0.0, 0.0), 2.0, 2.0), Disc((0.0, 0.0), 1.0)])
def test_a_clearance_that_is_kept_dilates_the_robot(robot: Robot, kept: float, obstacle: Rectangle | Disc) -> None:
    reference = Reference(World("block", BLOCK.bounds, (obstacle,)), robot.keeping(kept))
    at = np.array([1.5 + kept + 1e-3, 1.5 + kept - 0.9e-7, 1.5 + kept - 1.2e-7, 1.5, 1.4])
    q = np.column_stack([at, np.zeros((len(at), 2))])
    overlap = 1.5 + kept - at
    assert reference.clearance(q[:1]) == pytest.approx(1e-3, abs=1e-12)
    assert reference.depth(q) == pytest.approx(np.maximum(0.0, overlap), abs=1e-12)
    assert reference.collides(q).tolist() == [reference.certainly(row) for row in q] == (overlap > 1e-7).tolist()


@pytest.mark.parametrize("robot", [Robot.disc(0.5), Robot.rectangle(1.0, 1.0)])
def test_bounds_boundary_and_discs_block_too(robot: Robot) -> None:
    ring = Polygon(np.array([[-5.0, -5.0], [5.0, -5.0], [5.0, 5.0], [-5.0, 5.0]]))
    reference = Reference(World("ring", BLOCK.bounds, (Disc((0.0, 0.0), 1.0),), boundary=ring), robot)
    q = np.array([[1.4, 0.0, 0.0], [4.6, 0.0, 0.0], [9.6, 0.0, 0.0], [3.0, 0.0, 0.0]])
    assert reference.collides(q).tolist() == [True, True, True, False]
    assert reference.clearance(q)[3] == pytest.approx(1.5)


def test_an_overlap_is_decided_to_the_last_bit() -> None:
    square = [
        (Fraction(0), Fraction(0)),
        (Fraction(1), Fraction(0)),
        (Fraction(1), Fraction(1)),
        (Fraction(0), Fraction(1)),
    ]
    depth = Fraction(1, 10**30)
    at = (1 - depth, Fraction(1, 2))
    assert exact.deeper(at, [square], depth)
    assert not exact.deeper((1 - depth / 2, Fraction(1, 2)), [square], depth)
    assert not exact.inside((1 + depth, Fraction(1, 2)), [square])


def test_a_motion_is_searched_for_its_deepest_place() -> None:
    reference = Reference(BLOCK, Robot.disc(0.5))
    a, b = np.array([[-5.0, 1.49, 0.0], [-5.0, 1.6, 0.0]]), np.array([[5.0, 1.49, 0.0], [5.0, 1.6, 0.0]])
    worst, where = deepest(reference, moves(a, b), np.full(2, 10.0))
    assert worst == pytest.approx([0.01, 0.0])
    assert 0.4 <= where[0] <= 0.6


@pytest.mark.slow
@pytest.mark.parametrize("scale", list(SCALES))
def test_the_way_below_a_ceiling_has_room(scale: str) -> None:
    rng = np.random.default_rng(3)
    known = None
    while known is None:
        known = ceiling_world(rng, scale)
    assert known.world.robot is not None
    assert Reference(known.world, known.world.robot).clearance(known.way).min() >= known.margin > 0.0


@pytest.mark.parametrize("scale", list(SCALES))
@pytest.mark.parametrize("car", [False, True])
def test_the_way_of_a_carved_world_has_room(scale: str, car: bool) -> None:
    rng = np.random.default_rng(3)
    known = None
    while known is None:
        known = carved_world(rng, car, scale)
    reference = Reference(known.world, known.world.robot)
    assert reference.clearance(known.way).min() >= known.margin > 0.0
    assert (known.world.robot.turning_radius is not None) == car
    assert known.cost > 0.0
