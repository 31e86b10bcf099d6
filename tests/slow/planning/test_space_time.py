"""Paths among moving obstacles: each is judged by shapely at many moments, robot and obstacles where they are then."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from tests.helpers.trials import few, trials
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import Disc, LandmarkPlanner, Moving, Path, Rectangle, ReplanResult, Robot, StateChecker, World, se2
from trailmark.collision.footprint import build_footprint
from trailmark.planning.space_time import MovingObstacles, motions_clear
from trailmark.se2 import FloatArray
from trailmark.shapes import Polygon, Shape

START, GOAL = np.array([2.0, 10.0, 0.0]), np.array([38.0, 10.0, 0.0])
FIELD = World("field", (0.0, 0.0, 40.0, 20.0))
HALL = World("hall", (0.0, 0.0, 40.0, 20.0), (Rectangle((20.0, 4.0), 2.0, 8.0), Rectangle((20.0, 17.0), 2.0, 6.0)))
L_SHAPE = Polygon(np.array([[0, 0], [2, 0], [2, 0.5], [0.5, 0.5], [0.5, 1.5], [0, 1.5]]))
SHAPES: tuple[Shape, ...] = (Disc((0.0, 0.0), 0.7), Rectangle((0.0, 0.0), 1.5, 0.6, 0.4), L_SHAPE)


def radius(shape: Shape) -> float:
    return shape.radius if isinstance(shape, Disc) else 0.0


def gap(robot: Robot, q: FloatArray, moving: Moving) -> float:
    """Return the distance between a robot and an obstacle where it is now, negative as far as discs overlap."""
    apart = shapely.distance(placed(robot.footprint, q[None]), placed(moving.shape, np.zeros((1, 3))))[0]
    return float(apart) - radius(robot.footprint) - radius(moving.shape)


def least_gap(robot: Robot, states: FloatArray, speed: float, obstacles: list[Moving], step: float = 0.004) -> float:
    """Return the least distance along a path driven at a speed, at moments ``step`` seconds apart."""
    path, least = Path(states), np.inf
    times = np.append(np.arange(0.0, path.cost / speed, step), path.cost / speed)
    places = path.at(times * speed / max(path.cost, 1e-12))
    bodies = placed(robot.footprint, places)
    for moving in obstacles:
        known = times <= moving.until
        moved = np.column_stack([times[known, None] * np.array(moving.velocity), np.zeros(known.sum())])
        gaps = shapely.distance(bodies[known], placed(moving.shape, moved))
        least = min(least, float(gaps.min(initial=np.inf)) - radius(robot.footprint) - radius(moving.shape))
    return least


def placed(shape: Shape, q: FloatArray) -> FloatArray:
    """Return a shape's region in configurations (n, 3); of a disc, its centre."""
    c, s = np.cos(q[:, 2, None]), np.sin(q[:, 2, None])
    x, y = np.array([shape.center] if isinstance(shape, Disc) else shape.polygon().vertices).T
    points = np.stack([q[:, :1] + c * x - s * y, q[:, 1:2] + s * x + c * y], axis=-1)
    return np.asarray(shapely.points(points[:, 0]) if isinstance(shape, Disc) else shapely.polygons(points))


def motion_clear(obstacles: MovingObstacles, a: FloatArray, begin: float, b: FloatArray, end: float) -> bool:
    return bool(motions_clear(obstacles, a[None], np.array([begin]), b[None], np.array([end]))[0])


def random_moving(rng: np.random.Generator, fastest: float = 4.0) -> Moving:
    shape, velocity = SHAPES[rng.integers(3)], rng.uniform(-fastest, fastest, 2)
    placed = Moving(shape, (float(velocity[0]), float(velocity[1])), float(rng.uniform(0.3, 4.0)))
    dx, dy, turn = rng.uniform((-5.0, -5.0, -3.0), (5.0, 5.0, 3.0))
    return placed.displaced(float(dx), float(dy), float(turn))


@pytest.mark.parametrize("name", ["disc", "rectangle", "L"])
def test_a_motion_is_clear_just_when_no_moment_shows_contact(name: str) -> None:
    rng, robot = np.random.default_rng(5), ROBOTS[name]
    verdicts = np.zeros((2, 2), int)
    for _ in trials(150, of=6):
        moving = random_moving(rng)
        a, b = np.column_stack([rng.uniform(-4, 4, (2, 2)), rng.uniform(-3, 3, 2)])
        speed = rng.uniform(0.5, 5.0)
        if gap(robot, a, moving) <= 0.0:
            continue
        least = least_gap(robot, np.array([a, b]), speed, [moving], 0.01)
        obstacles = MovingObstacles.of([moving], build_footprint(robot))
        clear = motion_clear(obstacles, a, 0.0, b, float(se2.distance(a, b)) / speed)
        # The same motion a while later, with the obstacle as far back.
        late = rng.uniform(0.0, 3.0)
        vx, vy = moving.velocity
        back = Moving(moving.at(-late), (vx, vy), moving.until + late)
        obstacles = MovingObstacles.of([back], build_footprint(robot))
        assert clear == motion_clear(obstacles, a, late, b, late + float(se2.distance(a, b)) / speed)
        verdicts[int(clear), int(least > 0.0)] += 1
        # Between two moments robot and obstacle come nearer by what they move in that time.
        if abs(least) > 0.1:
            assert clear == (least > 0.0)
        assert not (clear and least <= 0.0)
    assert verdicts[0, 0] > few(5, of=6)
    assert verdicts[1, 1] > few(10, of=6)


def check(result: ReplanResult, world: World, robot: Robot, speed: float, start: FloatArray, goal: FloatArray) -> None:
    """Assert that a path, if there is one, joins start and goal and meets nothing, standing or moving."""
    if result.path is None:
        return
    states = result.path.states
    assert np.array_equal(states[0], start)
    assert np.array_equal(states[-1], goal)
    moving = [m for m in world.moving if m is not None]
    assert least_gap(robot, states, speed, moving) > 0.0
    stands = world.edited(remove=[i for i, m in enumerate(world.moving) if m is not None])
    assert StateChecker(stands, robot).valid(result.path.resample(0.05).states).all()


@pytest.mark.parametrize("name", ["disc", "rectangle", "L"])
@pytest.mark.parametrize("world", [FIELD, HALL])
def test_a_path_passes_what_crosses_it(world: World, name: str) -> None:
    robot, speed = ROBOTS[name], 2.0
    planner = LandmarkPlanner(world, robot, seed=0)
    path = planner.plan(START, GOAL, time_limit=5.0, max_iterations=2).path
    # Where the robot is after 4 s, there the obstacle is too.
    meeting = path.at(8.0 / path.cost)
    crossing = Moving(Disc((float(meeting[0]), float(meeting[1]) - 8.0), 0.8), (0.0, 2.0), 8.0)
    changed = world.edited(add={"cart": crossing})
    planner.update(changed)
    result = planner.replan(START, GOAL, path, speed=speed)
    assert (result.status, result.kept) == ("solved", False)
    assert "moving" in result.reason
    check(result, changed, robot, speed, START, GOAL)
    assert result.cost < 1.15 * path.cost
    # It goes on with that path while the obstacle does as foreseen.
    assert result.path is not None
    driven, now = result.path, 1.5
    later = changed.edited(replace={"cart": Moving(crossing.at(now), crossing.velocity, 8.0)})
    planner.update(later)
    here = driven.at(now * speed / driven.cost)
    again = planner.replan(here, GOAL, driven, speed=speed)
    assert again.path is not None
    check(again, later, robot, speed, here, GOAL)


def test_a_robot_that_stands_in_what_will_be_swept_gets_out_of_the_way() -> None:
    robot, speed = ROBOTS["disc"], 2.0
    planner = LandmarkPlanner(FIELD, robot, seed=0)
    for velocity, at in (((2.0, 0.0), (-3.0, 0.0)), ((-3.0, 0.0), (4.0, 0.1)), ((0.0, -3.0), (0.0, 4.0))):
        here = np.array([20.0, 10.0, 0.0])
        world = FIELD.edited(add=[Moving(Disc((20.0 + at[0], 10.0 + at[1]), 1.0), velocity, 4.0)])
        planner.update(world)
        result = planner.replan(here, GOAL, Path(np.array([here, GOAL])), speed=speed)
        check(result, world, robot, speed, here, GOAL)
        assert result.path is not None


def test_no_way_out_says_so_and_gives_the_steps_that_last_longest() -> None:
    robot, speed = ROBOTS["disc"], 1.0
    planner = LandmarkPlanner(FIELD, robot, seed=0)
    wall = Moving(Rectangle((35.0, 10.0), 1.0, 19.9), (-6.0, 0.0), 8.0)
    world = FIELD.edited(add=[wall])
    planner.update(world)
    result = planner.replan(START, GOAL, Path(np.array([START, GOAL])), speed=speed)
    assert result.path is None
    assert "no path was found" in result.reason
    assert least_gap(robot, result.nearest.states, speed, [wall]) > 0.0
    planner.update(FIELD.edited(add=[Moving(Disc((2.0, 10.0), 1.0), (1.0, 0.0), 3.0)]))
    result = planner.replan(START, GOAL, Path(np.array([START, GOAL])), speed=speed)
    assert result.path is None
    assert "where it is" in result.reason


@pytest.mark.parametrize("name", ["disc", "rectangle", "L"])
def test_many_moving_obstacles_never_give_a_path_that_meets_one(name: str) -> None:
    rng, robot, speed = np.random.default_rng(11), ROBOTS[name], 2.0
    found = 0
    for seed in trials(2, of=2):
        world = random_world(seed, 25, size=40.0)
        planner = LandmarkPlanner(world, robot, seed=0)
        q = np.column_stack([rng.uniform(2, 38, (500, 2)), rng.uniform(-3, 3, 500)])
        q = q[planner.checker.valid(q)]
        start, goal = q[np.argmin(q[:, :2].sum(axis=1))], q[np.argmax(q[:, :2].sum(axis=1))]
        path = planner.plan(start, goal, time_limit=20.0, max_iterations=1).path
        assert path is not None
        for _ in range(8):
            places = rng.uniform(0.0, 40.0, (12, 2))
            changed = world.edited(add=[random_moving(rng).displaced(*place) for place in places])
            planner.update(changed)
            result = planner.replan(start, goal, path, speed=speed)
            check(result, changed, robot, speed, start, goal)
            found += result.path is not None
    assert found > few(6, of=2)
