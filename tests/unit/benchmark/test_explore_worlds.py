"""The worlds and the oracle of the exploration benchmark, beside what trailmark itself says of the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.explore_oracle import boundary_errors, overlaps, seen_share, tour_length, truth_of
from tests.helpers.explore_worlds import KINDS, explore_world

from trailmark import Query, Rectangle, Robot, StateChecker, World
from trailmark.exploration.known_map import FREE
from trailmark.exploration.visible_area import reachable_places, visible_area
from trailmark.world.estimates import ObstacleEstimate


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_world_and_its_start_is_free(kind: str) -> None:
    world = explore_world(kind, 3)
    assert world == explore_world(kind, 3)
    assert world != explore_world(kind, 5)
    assert StateChecker(world).valid(world.query().start)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["office", "cave"])
def test_two_ways_to_find_what_can_be_seen(kind: str) -> None:
    whole = explore_world(kind, 0)
    x, y, _ = whole.query().start
    # The part about the start, which takes a third as long.
    xmin = min(max(x - 5.0, whole.bounds[0]), whole.bounds[2] - 10.0)
    ymin = min(max(y - 4.0, whole.bounds[1]), whole.bounds[3] - 8.0)
    world = replace(whole, bounds=(xmin, ymin, xmin + 10.0, ymin + 8.0))
    assert world.robot is not None
    truth = truth_of(world, 5.0)
    area = visible_area(world, reachable_places(world, world.robot, np.array([world.query().start])), 5.0)
    assert seen_share(truth, area.state, area.origin, area.cell) > 0.98
    assert (area.state == FREE).sum() * area.cell**2 == pytest.approx(len(truth.targets) * 0.2**2, rel=0.05)


def corridor() -> World:
    """A corridor of 20 x 2 m, closed by nothing, with a box in the middle of its upper side."""
    start = (1.0, 1.0, 0.0)
    box = Rectangle((10.0, 1.75), 2.0, 0.5)
    return World("corridor", (0.0, 0.0, 20.0, 2.0), (box,), Robot.disc(0.3), queries=(Query("start", start, start),))


def test_the_anchor_of_a_corridor() -> None:
    """With 5 m of sight the far corners are seen from 15.1 m on, so that 14.1 m are to be driven, 0.5 % less seen."""
    length = tour_length(truth_of(corridor(), 5.0))
    assert 13.0 < length < 15.0


@pytest.mark.slow
def test_surfaces_that_nobody_can_see_do_not_count() -> None:
    """The box's front and its sides, but neither its back against the wall nor what faces a gap too narrow to see."""
    truth = truth_of(corridor(), 30.0)
    assert len(truth.surface) * 0.05 == pytest.approx(2.0 + 2 * 0.5, abs=0.1)
    beside = replace(corridor(), obstacles=(*corridor().obstacles, Rectangle((11.51, 1.75), 1.0, 0.5)))
    assert len(truth_of(beside, 30.0).surface) * 0.05 == pytest.approx(3.0 + 2 * 0.5, abs=0.15)


def test_overlaps_and_boundary_errors() -> None:
    world = corridor()
    truth = truth_of(world, 30.0)
    poses = np.array([[10.0, 1.2, 0.0], [10.0, 1.25, 0.0], [0.3, 1.0, 0.0], [0.2, 1.0, 0.0]])
    assert overlaps(truth, world, poses) == 2
    moved = Rectangle((10.0, 1.73), 2.0, 0.5)
    none = World("made", world.bounds, (moved,))
    assert boundary_errors(truth, none)["missing"] == 1.0  # what has no estimate is not known
    made = World("made", world.bounds, (), estimates=()).edited(add=[ObstacleEstimate(moved, 1e-4 * np.eye(2))])
    found = boundary_errors(truth, made)
    assert found["missing"] == 0.0
    assert 0.012 < found["rms"] < 0.02  # 2 cm along the front, next to nothing along the sides
    assert 0.012 < found["inside"] < 0.02
