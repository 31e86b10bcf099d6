from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
import shapely.affinity
from tests.helpers.oracles import assert_within_limits
from tests.helpers.trials import few, trials
from tests.helpers.worlds import random_world

from trailmark import (
    ConfigurationError,
    CurvePath,
    LandmarkPlanner,
    Path,
    Polygon,
    Rectangle,
    Robot,
    StateChecker,
    Steering,
    World,
    check_path,
    se2,
)
from trailmark.benchmark.referee import Referee
from trailmark.trajectories import SmoothPath
from trailmark.world.zones import OneWayZone

BOX = Rectangle((5.0, 5.0), 2.0, 2.0)
WORLD = World(name="box", bounds=(0.0, 0.0, 10.0, 10.0), obstacles=(BOX,))
OPEN = World(name="open", bounds=(-20.0, -20.0, 20.0, 20.0))
ROBOT = Robot.rectangle(0.6, 0.4)
AROUND = Path(np.array([[1.0, 3.5, 0.0], [6.5, 3.5, 0.0], [6.5, 9.0, 1.5]]))


def path_of(*states: tuple[float, float, float]) -> Path:
    return Path(np.array(states))


def assert_correct(path: SmoothPath, world: World, robot: Robot, like: Path) -> None:
    """It passes the referee, is continuous with continuous velocity but for its stops, and its states lie on it."""
    fault = Referee(world, robot.steered(None)).fault(path.states, like.states[0], like.states[-1])
    assert fault is None
    pieces = path.pieces
    if len(pieces.length):
        np.testing.assert_allclose(pieces.ends()[:-1, :2], pieces.start[1:, :2], atol=1e-9)
        assert (np.abs(se2.difference(pieces.ends()[:-1], pieces.start[1:])[:, 2]) < 1e-9).all()
    # The straight motions from state to state stay as near to the curve as is said.
    middle = se2.interpolate(path.states[:-1], path.states[1:], 0.5)
    dense = path.resample(1e-3 * min(1.0, path.length)).states
    reach = robot.sweep_radius
    for row in middle[:: max(1, len(middle) // 20)]:
        assert se2.motion_bound(dense, row, reach).min() < 1e-3 + 1e-4
    assert path.length == pytest.approx(Path(dense).length, rel=1e-3)
    assert path.rotation == pytest.approx(Path(dense).rotation, rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("robot", [Robot.rectangle(0.4, 0.4), Robot.disc(0.2)], ids=["square", "disc"])
def test_a_clearance_is_kept_where_corners_are_cut(robot: Robot) -> None:
    walls = Polygon(np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 5.0], [3.8, 5.0], [3.8, 1.2], [0.0, 1.2]]))
    world = World(name="corridor", bounds=(0.0, 0.0, 5.0, 5.0), boundary=walls)
    checker = StateChecker(world, robot, clearance=0.25)
    path = path_of((1.2, 0.6, 0.0), (4.4, 0.6, 0.0), (4.4, 3.8, 0.0))
    nearer, smooth = path.smooth(world, robot), path.smooth(checker)
    assert checker.clearance(nearer.resample(0.01).states).min() < 0.25
    assert len(smooth.stops) == 0
    assert checker.clearance(smooth.resample(0.01).states).min() >= 0.25
    assert checker.motions_valid(smooth.states[:-1], smooth.states[1:]).all()


@pytest.mark.parametrize("robot", [ROBOT, Robot.disc(0.3)], ids=["rectangle", "disc"])
def test_a_reversal_and_turns_in_place_are_stops(robot: Robot) -> None:
    smooth = path_of((0, 0, 0), (5, 0, 0), (1, 0, 0)).smooth(OPEN, robot)
    np.testing.assert_array_equal(smooth.stops, [[5.0, 0.0, 0.0]])
    smooth = path_of((0, 0, 0), (5, 0, 0), (5, 0, 1), (5, 5, 1)).smooth(OPEN, robot)
    np.testing.assert_allclose(smooth.stops, [[5.0, 0.0, 0.0], [5.0, 0.0, 1.0]], atol=1e-12)


def assert_driven_free(path: SmoothPath, world: World, robot: Robot, step: float = 0.01) -> None:
    """By dense samples: a differential drive moves along its heading, backwards if it may, and meets nothing."""
    pieces = path.pieces
    piece = np.repeat(np.arange(len(pieces.length)), 40)
    s = (pieces.length[:, None] * np.linspace(0.0, 1.0, 40)).ravel()
    heading, (moved, _) = pieces.states(piece, s)[:, 2], pieces.derivatives(piece, s)
    assert np.abs(moved[:, 1] * np.cos(heading) - moved[:, 0] * np.sin(heading)).max() < 1e-8
    if not robot.reverse:
        assert (moved[:, 0] * np.cos(heading) + moved[:, 1] * np.sin(heading)).min() > -1e-9
    taken = shapely.union_all([obstacle.polygon().shapely() for obstacle in world.obstacles])
    for x, y, theta in path.resample(step).states:
        body = shapely.affinity.rotate(robot.outline.shapely(), theta, origin=(0, 0), use_radians=True)
        body = shapely.affinity.translate(body, x, y)
        assert shapely.intersection(body, taken).area < 1e-9
        assert shapely.covers(shapely.box(*world.bounds).buffer(1e-7), body)


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(12, of=3))
def test_differential_drives_among_random_obstacles_keep_off_them(seed: int) -> None:
    outline = [(-0.4, -0.3), (0.4, -0.3), (0.4, 0.0), (0.0, 0.0), (0.0, 0.3), (-0.4, 0.3)]
    robot = (Robot.rectangle(0.9, 0.4), Robot.polygon(outline))[seed % 2].differential(reverse=seed % 3 > 0)
    world = random_world(seed, 20, size=12.0, radii=(0.3, 1.3), discs=0.0, holes=0.2)
    checker, rng = StateChecker(world, robot), np.random.default_rng(seed)
    q = np.column_stack([rng.uniform(0.0, 12.0, (200, 2)), rng.uniform(-np.pi, np.pi, 200)])
    start, goal = q[checker.valid(q)][:2]
    path = LandmarkPlanner(world, robot, seed=0).plan(start, goal, time_limit=0.1).path
    if path is None:
        return
    smooth = path.smooth(checker)
    assert_correct(smooth, world, robot, path)
    assert_driven_free(smooth, world, robot)


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False])
def test_a_cars_curvature_is_continuous_but_for_stops(reverse: bool) -> None:
    rng = np.random.default_rng(8)
    smoothed = 0
    for _ in range(few(4)):
        knots = np.column_stack([rng.uniform(-15.0, 15.0, (4, 2)), rng.uniform(-3.0, 3.0, 4)])
        path = CurvePath(knots, Steering(1.0, reverse))
        robot = ROBOT.steered(1.0, reverse)
        smooth = path.smooth(OPEN.with_robot(robot))
        assert_correct(smooth, OPEN, robot, path)
        assert smooth.max_curvature <= 1.0 + 1e-12
        assert smooth.cost == smooth.length == pytest.approx(path.length, rel=0.05)
        piece = np.arange(len(smooth.pieces.length))
        begin, _ = smooth.pieces.derivatives(piece, np.zeros(len(piece)))
        end, _ = smooth.pieces.derivatives(piece, smooth.pieces.length)
        jump = np.abs(end[:-1] - begin[1:]).max(axis=1) > 1e-6
        assert np.count_nonzero(jump) == len(smooth.stops)
        # It is a car that drives: the reference point moves along the heading.
        q = smooth.resample(0.01).states
        move, middle = np.diff(q[:, :2], axis=0), se2.interpolate(q[:-1], q[1:], 0.5)[:, 2]
        aside = move[:, 1] * np.cos(middle) - move[:, 0] * np.sin(middle)
        assert (np.abs(aside) < 1e-4).all()
        trajectory = smooth.timed(1.0, 0.5, 1.0, 1.0)
        assert_within_limits(trajectory)
        smoothed += trajectory.duration < path.timed(1.0, 0.5, 1.0, 1.0).duration - 1.0
    assert smoothed >= few(2)


def test_what_cannot_be_smoothed_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"certified free of collision; motion 0 is not"):
        path_of((1, 5, 0), (9, 5, 0), (9, 9, 0)).smooth(WORLD, ROBOT)
    with pytest.raises(ConfigurationError, match="its only state is not"):
        path_of((5, 5, 0)).smooth(WORLD, ROBOT)
    with pytest.raises(ConfigurationError, match="smooth already"):
        AROUND.smooth(WORLD, ROBOT).smooth(WORLD, ROBOT)
    with pytest.raises(ConfigurationError, match="expected a car's path, got one of straight motions"):
        AROUND.smooth(WORLD, ROBOT.steered(1.0))


def test_directions_of_what_is_driven_are_allowed_by_one_way_zones() -> None:
    """Along the pieces, by dense samples, where a zone hardly allows for the corner; and the audit agrees."""
    path = path_of((0.0, 0.0, 0.0), (6.5, 0.0, 0.0), (6.5, 9.0, 0.0))
    region = Polygon(np.array([[5.0, -1.0], [8.0, -1.0], [8.0, 2.0], [5.0, 2.0]]))
    rounded = 0
    for tolerance in (1e-3, 0.3, 0.8, 1.6):
        zone = OneWayZone(region, math.pi / 4.0 if tolerance < 1.6 else 0.0, tolerance)
        world = World(name="one-way", bounds=OPEN.bounds, zones=(zone,))
        try:
            smooth = path.smooth(world, ROBOT)
        except ConfigurationError:
            assert tolerance < 0.5 * math.pi / 2.0
            continue
        assert check_path(world, ROBOT, smooth).free
        pieces = smooth.pieces
        piece = np.repeat(np.arange(len(pieces.length)), 400)
        s = (pieces.length[:, None] * np.linspace(0.0, 1.0, 400)).ravel()
        moved = pieces.derivatives(piece, s)[0]
        inside = shapely.contains_xy(region.shapely(), pieces.states(piece, s)[:, :2])
        off = np.abs(se2.wrap(np.arctan2(moved[:, 1], moved[:, 0]) - zone.heading))
        assert (off[inside] <= tolerance + 1e-6).all()
        rounded += len(smooth.stops) == 0
    assert rounded == 2
