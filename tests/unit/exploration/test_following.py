"""Following a path by commands in the robot's own frame."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.helpers.trials import few

from trailmark import Path, Rectangle, Robot, StateChecker, World
from trailmark.collision.footprint import build_footprint
from trailmark.exploration.following import STEP, PathFollower, contact_points, way_back, way_back_to
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


def test_where_the_robot_stood_the_way_back_has_one_row() -> None:
    driven = np.zeros((400, 3))
    driven[200:, 0] = 0.01 * np.arange(200)
    driven = np.concatenate([driven, np.repeat(driven[-1:], 100, axis=0)])
    back = way_back(driven, 5.0, 0.3)
    np.testing.assert_array_equal(back[[0, -1]], driven[[-1, 0]])
    steps = -np.diff(back[:, 0])
    assert (steps[:-1] >= STEP - 1e-9).all()
    assert (steps <= 2.0 * STEP + 0.01).all()
    rows = np.column_stack([np.arange(6.0), np.zeros((6, 2))])
    np.testing.assert_array_equal(way_back(rows, 2.5, 0.3)[:, 0], [5.0, 4.0, 3.0, 2.0])
    assert [len(way_back(rows[:n], 100.0, 0.3)) for n in (6, 1)] == [6, 1]


def test_the_way_back_is_driven_through_what_the_map_takes_for_closed_by_a_cell_alone() -> None:
    known, robot = KnownMap((0.0, 0.0, 6.0, 4.0), 0.1), Robot.disc(0.3)
    state = np.full(known.state.shape, FREE)
    driven = np.column_stack([np.arange(0.5, 5.05, 0.1), np.full(46, 2.0), np.zeros(46)])
    there = np.zeros(state.shape, np.bool_)
    there[:, :10] = True
    known.set_state(state)
    back = way_back_to(there, driven, known, robot)
    np.testing.assert_array_equal(back.states[0], driven[-1])
    assert 0.9 <= back.states[-1, 0] < 1.0
    # A surface that reaches a cell into the robot's way, then two.
    for row, free in ((22, True), (20, False)):
        state[row, 30] = OCCUPIED
        known.set_state(state)
        assert (way_back_to(there, driven, known, robot) is not None) == free
    assert way_back_to(~there & (np.arange(60) > 50), driven[:20], known, robot) is None
    known.set_state(np.full(state.shape, FREE))
    assert way_back_to(there, driven, known, Robot.rectangle(0.6, 0.4).steered(0.5, reverse=False)) is None


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
