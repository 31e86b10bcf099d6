"""Running into what the sensor does not show: it is marked where it may stand, and explored around."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from trailmark import Rectangle, Robot, World
from trailmark.estimation.virtual_sensors import RayCaster
from trailmark.exploration import ExplorationSettings, Explorer
from trailmark.exploration.following import contact_points
from trailmark.exploration.known_map import OCCUPIED, UNKNOWN
from trailmark.exploration.result import keep_exploration, load_exploration
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


@pytest.mark.slow
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
        settings=ExplorationSettings(cell=0.1, sense_period=0.2, confidence=0.99 if noise else None),
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
