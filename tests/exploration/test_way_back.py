"""The way back along what was driven: its rows, and what is allowed to block it."""

from __future__ import annotations

import numpy as np

from trailmark import Robot
from trailmark.collision.footprint import build_footprint
from trailmark.exploration.following import STEP, way_back, way_back_to
from trailmark.exploration.known_map import FREE, OCCUPIED, KnownMap


def test_the_way_back_is_what_was_driven_last() -> None:
    driven = np.column_stack([np.arange(6.0), np.zeros((6, 2))])
    np.testing.assert_array_equal(way_back(driven, 2.5, 0.3)[:, 0], [5.0, 4.0, 3.0, 2.0])
    assert len(way_back(driven, 100.0, 0.3)) == 6
    assert len(way_back(driven[:1], 1.0, 0.3)) == 1


def test_where_the_robot_stood_the_way_back_has_one_row() -> None:
    driven = np.zeros((400, 3))
    driven[200:, 0] = 0.01 * np.arange(200)
    driven = np.concatenate([driven, np.repeat(driven[-1:], 100, axis=0)])
    back = way_back(driven, 5.0, 0.3)
    np.testing.assert_array_equal(back[[0, -1]], driven[[-1, 0]])
    steps = -np.diff(back[:, 0])
    assert (steps[:-1] >= STEP - 1e-9).all()
    assert (steps <= 2.0 * STEP + 0.01).all()


def test_the_way_back_is_driven_through_what_the_map_takes_for_closed_by_a_cell_alone() -> None:
    known, robot = KnownMap((0.0, 0.0, 6.0, 4.0), 0.1), Robot.disc(0.3)
    state = np.full(known.state.shape, FREE)
    driven = np.column_stack([np.arange(0.5, 5.05, 0.1), np.full(46, 2.0), np.zeros(46)])
    there = np.zeros(state.shape, np.bool_)
    there[:, :10] = True
    footprint = build_footprint(robot)
    back = way_back_to(there, driven, known, robot, footprint)
    assert back is not None
    np.testing.assert_array_equal(back.rest[0], driven[-1])
    assert 0.9 <= back.target[0] < 1.0
    # A surface that reaches a cell into the robot's way, then two.
    for row, free in ((22, True), (20, False)):
        state[row, 30] = OCCUPIED
        known.set_state(state)
        assert (way_back_to(there, driven, known, robot, footprint) is not None) == free
        assert back.endangered(known) != free
    assert way_back_to(~there & (np.arange(60) > 50), driven[:20], known, robot, footprint) is None
    known.set_state(np.full(state.shape, FREE))
    ahead_alone = Robot.rectangle(0.6, 0.4).steered(0.5, reverse=False)
    assert way_back_to(there, driven, known, ahead_alone, footprint) is None
