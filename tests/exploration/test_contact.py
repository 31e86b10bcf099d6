"""Running into what the sensor does not show: it is marked where it may stand, and explored around."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from trailmark import Rectangle, Robot, World
from trailmark.collision.footprint import build_footprint
from trailmark.estimation.simulation.raycast import RayCaster
from trailmark.exploration import ExplorationSettings, Explorer
from trailmark.exploration.contact import contact_points, way_back, way_back_to
from trailmark.exploration.exploration_folder import keep_exploration, load_exploration
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.simulated_robot import SimulatedRobot, laser_scanner

BOUNDS = (0.0, 0.0, 6.0, 4.0)
WALLS = (Rectangle((3.0, 0.7), 0.2, 1.4), Rectangle((3.0, 3.3), 0.2, 1.4))
GLASS = Rectangle((2.0, 1.6), 0.1, 1.2)
"""In the straight way from the start to the door."""


@pytest.mark.parametrize("robot", [Robot.disc(0.2), Robot.rectangle(0.6, 0.3)], ids=["disc", "rectangle"])
@pytest.mark.parametrize("motion", [(0.3, 0.0, 0.0), (0.0, 0.0, 0.4), (-0.1, 0.2, -0.3)])
def test_contact_lies_ahead_and_not_where_the_robot_stands(robot: Robot, motion: tuple[float, float, float]) -> None:
    here, cell = np.array([1.0, 2.0, 0.7]), 0.05
    points = contact_points(robot, np.array([here, here + motion]), cell)
    if robot.sweep_radius == 0.0 and motion[0] == 0.0:
        assert len(points) == 0  # a round robot turns within itself
        return
    body = shapely.affinity.rotate(robot.outline.shapely(), here[2], origin=(0.0, 0.0), use_radians=True)
    body = shapely.affinity.translate(body, *here[:2])
    away = shapely.distance(shapely.points(points), body)
    assert not shapely.contains_xy(body, *points.T).any()
    assert 0.5 * cell <= away.max() <= 2.0 * cell + 1e-9


def test_the_way_back_is_what_was_driven_last() -> None:
    driven = np.column_stack([np.arange(6.0), np.zeros((6, 2))])
    np.testing.assert_array_equal(way_back(driven, 2.5, 0.3)[:, 0], [5.0, 4.0, 3.0, 2.0])
    assert len(way_back(driven, 100.0, 0.3)) == 6
    assert len(way_back(driven[:1], 1.0, 0.3)) == 1


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


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_what_the_laser_does_not_see_is_run_into_once_and_explored_around(noise: float, tmp_path: Path) -> None:
    body = Robot.disc(0.2)
    seen = World("rooms", BOUNDS, WALLS, body)
    robot = SimulatedRobot(
        replace(seen, obstacles=(*WALLS, GLASS)), body, (0.6, 0.6, 0.0), laser_scanner(3.0, 0.1), noise=noise
    )
    robot._caster = RayCaster(seen)  # the glass stops the robot alone
    exploring = Explorer(
        robot,
        body,
        robot.sensor,
        start=robot.pose,
        bounds=BOUNDS,
        settings=ExplorationSettings(cell=0.1, confidence=0.99 if noise else None),
        strategy="nearest-frontier",
    )
    while exploring.ended is None:
        exploring.step()
    assert exploring.ended[0] == "complete"
    assert any("ran into something" in progress.event for progress in exploring.history)
    assert 1 <= robot.collisions <= 6
    known = exploring.mapper.known
    assert (known.state[known.cells_of(np.array([[4.0, 2.0], [5.5, 0.5], [5.5, 3.5]]))] != UNKNOWN).all()
    # Beams have gone through the glass again and again since.
    touched = known.centres(*np.nonzero(known.state == OCCUPIED))
    near = shapely.distance(shapely.points(touched), GLASS.polygon().shapely()) <= 0.15
    assert near.any()
    # Who goes on with it knows that too.
    keep_exploration(exploring.saved(), tmp_path / "run")
    saved = load_exploration(tmp_path / "run")
    assert len(saved.contacts) > 0
    settings = exploring.settings
    after = Explorer(robot, body, robot.sensor, start=robot.pose, bounds=BOUNDS, settings=settings, resumed=saved)
    assert np.array_equal(after.mapper.known.contacts, known.contacts)
    assert (after.mapper.known.state[after.mapper.known.cells_of(saved.contacts)] == OCCUPIED).all()
