"""Planning among one-way zones: paths against an oracle that samples their directions, and attacks."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from trailmark import (
    LandmarkPlanner,
    OneWayZone,
    Path,
    PlannerSettings,
    PlanResult,
    Polygon,
    Rectangle,
    Robot,
    World,
    check_path,
    se2,
)

ROBOTS = {
    "disc": Robot.disc(0.3),
    "rectangle": Robot.rectangle(0.8, 0.4),
    "car": Robot.rectangle(0.8, 0.4).steered(0.6),
    "dubins": Robot.rectangle(0.8, 0.4).steered(0.6, reverse=False),
}
BOUNDS = (0.0, 0.0, 16.0, 10.0)
# A wall with two gaps, in the middle and at the top: the direct way leads through the middle.
WALL = (Rectangle((8.0, 2.0), 1.0, 4.0), Rectangle((8.0, 7.0), 1.0, 2.0))
START, GOAL = (2.0, 5.0, 0.0), (14.0, 5.0, 0.0)
QUICK = PlannerSettings(patience=2, drives=1_000, first_landmarks=40, sweeps=10, first_sweeps=3)
"""Of a planner whose paths need not be the shortest."""


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return Polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))


GAP = box(7.0, 4.0, 9.0, 6.0)


def first_path(world: World, robot: Robot) -> PlanResult:
    return LandmarkPlanner(world, robot, seed=1, settings=QUICK).plan(START, GOAL, time_limit=60.0, gap=np.inf)


def assert_right_way(world: World, path: Path) -> None:
    states = path.resample(0.005).states
    step = np.diff(states[:, :2], axis=0)
    moves = np.hypot(*step.T) > 1e-7
    middle, ahead = 0.5 * (states[1:] + states[:-1])[:, :2], np.arctan2(step[:, 1], step[:, 0])
    for zone in world.zones:
        assert isinstance(zone, OneWayZone)
        inside = shapely.contains_xy(shapely.buffer(zone.region.shapely(), -0.003), *middle.T)
        off = np.abs(se2.wrap(ahead - zone.heading))
        assert not (inside & moves & (off > zone.tolerance + 0.01)).any()


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_the_right_way_is_direct_and_the_wrong_way_leads_around(name: str) -> None:
    right = World("w", BOUNDS, WALL, zones=(OneWayZone(GAP, 0.0, 0.5),))
    wrong = World("w", BOUNDS, WALL, zones=(OneWayZone(GAP, math.pi, 0.5),))
    direct, around = first_path(right, ROBOTS[name]), first_path(wrong, ROBOTS[name])
    assert direct.path.length == pytest.approx(12.0, abs=0.05)
    assert around.status == "solved"
    assert around.path.length > 13.0
    for world, result in ((right, direct), (wrong, around)):
        assert_right_way(world, result.path)
        assert result.lower_bound <= result.path.cost + 1e-9


def test_the_way_back_is_another_one() -> None:
    """What the roadmap knows of a way in one direction is not taken in the other."""
    world = World("w", BOUNDS, WALL, zones=(OneWayZone(GAP, 0.0, 0.5),))
    planner = LandmarkPlanner(world, ROBOTS["rectangle"], seed=0, settings=QUICK)
    for start, goal, length in ((START, GOAL, 12.0), (GOAL, START, 14.0), (START, GOAL, 12.0)):
        path = planner.plan(start, goal, time_limit=60.0, gap=np.inf).path
        assert_right_way(world, path)
        assert abs(path.length - length) < 2.5
    planner.build(200)
    there, back = planner.plan_many([START, GOAL], [GOAL, START], time_limit=20.0, max_iterations=2)
    for result in (there, back):
        assert result.path is not None
        assert_right_way(world, result.path)
    assert back.path.length > there.path.length + 0.5


@pytest.mark.parametrize("depth", [8e-8, 1.2e-7, 1.9e-7, 4e-7, 2e-6])
def test_a_path_past_a_corner_is_free_to_an_audit(depth: float) -> None:
    world = World("w", (0.0, 0.0, 4.0, 4.0), robot=ROBOTS["disc"], zones=(OneWayZone(box(2, 1, 3, 2), math.pi, 2.0),))
    start, goal = (1.7, 1.7 - 2.0 * depth, 0.0), (2.3, 2.3 - 2.0 * depth, 0.0)
    result = LandmarkPlanner(world, seed=0, settings=QUICK).plan(start, goal, gap=np.inf)
    assert result.path is not None
    assert check_path(world, None, result.path).free
    assert check_path(world, None, [start, goal]).free == (depth < 1e-7)
