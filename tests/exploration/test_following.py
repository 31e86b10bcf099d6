"""Following a path by commands in the robot's own frame."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.trials import few

from trailmark import Disc, Path, Rectangle, Robot, World
from trailmark.collision import StateChecker
from trailmark.collision.footprint import build_footprint
from trailmark.estimation.virtual_sensors import RayCaster, Scanner
from trailmark.exploration.following import PathFollower
from trailmark.exploration.known_map import FREE, OCCUPIED, KnownMap
from trailmark.se2 import compose, difference

STATES = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 2.0], [1.0, 1.5, 3.0]])
BODY = Robot.rectangle(0.6, 0.4)


def follower_of(path: Path, robot: Robot) -> PathFollower:
    return PathFollower(path, robot, build_footprint(robot))


def driven(follower: PathFollower, pose: np.ndarray, step: float, offset: float = 0.0) -> np.ndarray:
    """Return the poses of a robot that carries out each command for a step, shape (n, 3)."""
    poses, moved = [pose], 0.0
    for _ in range(200):
        follower.advance(poses[-1], moved)
        states = follower.command(poses[-1])
        assert states[0].tolist() == [0.0, 0.0, 0.0]
        part = Path(states) if len(states) > 1 else None
        if part is None or part.cost == 0.0:
            break
        ahead = part.at(min(1.0, step / part.cost))
        moved = float(np.hypot(*ahead[:2]))
        poses.append(compose(poses[-1], ahead + np.array([0.0, offset, 0.0])))
        offset = 0.0
        if step >= part.cost:
            break
    return np.array(poses)


@pytest.mark.parametrize("robot", [BODY, BODY.differential(), BODY.steered(0.5)], ids=lambda robot: robot.drive)
def test_an_exact_robot_stays_on_its_path_to_the_end(robot: Robot) -> None:
    path = Path(STATES)
    follower = follower_of(path, robot)
    poses = driven(follower, STATES[0], 0.13)
    assert np.abs(difference(poses[-1], STATES[-1])).max() < 1e-9
    dense = path.at(np.linspace(0.0, 1.0, 20_001))
    for pose in poses:
        assert np.abs(difference(dense, pose)).sum(axis=1).min() < 1e-3
    assert follower.advance(poses[-1], 0.13) < 1e-9
    assert len(follower.rest) == 1


def test_what_was_free_and_is_not_any_more_endangers_it() -> None:
    known = KnownMap((-1.0, -2.0, 4.0, 2.0), 0.1)
    known.set_state(np.full(known.state.shape, FREE, dtype=np.uint8))
    follower = follower_of(Path(STATES[:2]), Robot.disc(0.3))
    assert not follower.endangered(known)
    for place, expected in (((1.0, 1.0), False), ((1.0, 0.25), True)):
        state = known.state.copy()
        row, column = known.cells_of(np.array([place]))
        state[row, column] = OCCUPIED
        known.set_state(state)
        assert follower.endangered(known) is expected


def test_a_surface_that_is_larger_than_it_was_endangers_it() -> None:
    # Two poles in one cell: the second one makes no cell occupied that was free.
    known, sensor = KnownMap((-1.0, -2.0, 4.0, 2.0), 0.1), Scanner(2000, 2.0 * np.pi, 3.0, sigma=0.0)
    poles = Disc((1.05, 0.37), 0.01), Disc((1.05, 0.33), 0.01)
    for count in (1, 1, 2):
        world = World("poles", known.bounds, poles[:count])
        scan = sensor.sweep(0.0, np.zeros(3), RayCaster(world, bounds=True), np.random.default_rng(0))
        before = known.state.copy()
        known.add_scan(scan, np.zeros(3), 3.0)
        if count == 1:
            follower = follower_of(Path(STATES[:2]), Robot.disc(0.3))
            assert not follower.endangered(known)
    assert not ((before == FREE) & (known.state == OCCUPIED)).any()
    assert follower.endangered(known)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Robot.disc(0.3), Robot.rectangle(0.9, 0.3).keeping(0.04)], ids=["disc", "kept"])
def test_what_does_not_endanger_it_is_not_met(robot: Robot) -> None:
    rng, outcomes = np.random.default_rng(3), list[tuple[bool, bool]]()
    for _ in range(few(150)):
        path = Path(rng.uniform((-0.5, -1.5, -np.pi), (3.5, 1.5, np.pi), (3, 3)))
        known = KnownMap((-2.0, -3.0, 5.0, 3.0), 0.1)
        state = np.full(known.state.shape, FREE, dtype=np.uint8)
        known.set_state(state)
        follower = follower_of(path, robot)
        assert not follower.endangered(known)
        at = path.at(rng.uniform())[:2] + rng.normal(0.0, 0.5, 2)
        row, column = (int(place[0]) for place in known.cells_of(at[None]))
        state[row, column] = OCCUPIED
        known.set_state(state)
        cell = Rectangle((-2.0 + 0.1 * (column + 0.5), -3.0 + 0.1 * (row + 0.5)), 0.1, 0.1)
        checker = StateChecker(World("cell", known.bounds, (cell,)), robot)
        free = bool(checker.motions_valid(path.states[:-1], path.states[1:]).all())
        inside = bool(StateChecker(World("none", known.bounds), robot).valid(path.states).all())
        outcomes.append((follower.endangered(known), free or not inside))
    assert (False, False) not in outcomes
    assert outcomes.count((True, False)) >= few(20)
    # Nor is it said to be without need, much.
    assert outcomes.count((True, True)) < 0.15 * len(outcomes)
    assert outcomes.count((False, True)) >= few(40)
