"""Paths that leave keep-out zones, against shapely: clear of all else, and never back in a zone once they left it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from trailmark import (
    ConfigurationError,
    Disc,
    Goal,
    KeepOutZone,
    LandmarkPlanner,
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
from trailmark.shapes import Shape

ROBOTS = {
    "disc": Robot.disc(0.3),
    "rectangle": Robot.rectangle(0.8, 0.4),
    "car": Robot.rectangle(0.8, 0.4).steered(1.0),
    "dubins": Robot.rectangle(0.8, 0.4).steered(1.0, reverse=False),
}
QUICK = PlannerSettings(patience=1)
"""Paths settle at the first round that gains nothing."""
BOUNDS = (0.0, 0.0, 20.0, 12.0)
MIDDLE = Rectangle((6.0, 6.0), 6.0, 6.0)
# Two towers on a base: from one to the other, the straight way leaves the zone and comes back.
U_SHAPE = [[2, 2], [14, 2], [14, 9], [10, 9], [10, 4], [6, 4], [6, 9], [2, 9]]


def zone(shape: Shape) -> KeepOutZone:
    return KeepOutZone(shape.polygon())


def plan(
    world: World, robot: Robot, start: tuple[float, ...], goal: tuple[float, ...], seconds: float = 2.0
) -> PlanResult:
    return LandmarkPlanner(world, robot, seed=1, settings=QUICK).plan(start, goal, time_limit=seconds)


def overlaps(robot: Robot, states: np.ndarray, shape: Shape) -> np.ndarray:
    """Return at which states the robot overlaps a shape by more than a micrometre or two."""
    region = shapely.buffer(shape.polygon(1e-9).shapely(), -2e-6)
    if isinstance(robot.footprint, Disc):
        return np.array(shapely.distance(region, shapely.points(states[:, :2])) < robot.footprint.radius)
    shapely.prepare(region)
    return np.array(shapely.intersects(region, shapely.polygons(se2.transform(states, robot.outline.vertices))))


def assert_leaves(world: World, robot: Robot, path: Path) -> None:
    states = path.resample(0.01).states
    for obstacle in world.obstacles:
        assert not overlaps(robot, states, obstacle).any()
    for other in world.zones:
        inside = overlaps(robot, states, other.region)
        left = int(np.argmin(inside))
        assert not inside[left:].any()


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_it_does_not_come_back(name: str) -> None:
    world = World("w", BOUNDS, zones=(KeepOutZone(Polygon(np.array(U_SHAPE, dtype=float))),))
    result = plan(world, ROBOTS[name], (4.0, 8.0, 0.0), (18.0, 5.0, 0.0))
    assert result.status == "solved"
    assert_leaves(world, ROBOTS[name], result.path)
    # Straight through would be 14.3 m.
    assert 14.0 <= result.lower_bound <= result.path.cost
    assert result.path.length > 14.6


def test_the_cheapest_of_several_goals_is_outside() -> None:
    world = World("w", BOUNDS, zones=(zone(MIDDLE),))
    planner = LandmarkPlanner(world, ROBOTS["rectangle"], seed=0, settings=QUICK)
    # The cheapest one is in the zone still, in which a path may not end.
    goals = [Goal((6.0, 7.0, 0.0)), Goal((15.0, 6.0, 0.0), cost=9.0), Goal((1.0, 10.0), cost=0.5)]
    result = planner.plan((6.0, 6.0, 0.0), goals)
    assert result.goal.index == 2
    assert result.cost == pytest.approx(result.path.cost + 0.5)
    assert result.lower_bound <= result.cost + 1e-9
    assert_leaves(world, ROBOTS["rectangle"], result.path)
    with pytest.raises(ConfigurationError, match=r"^goal 0 .* overlaps keep-out zone 0"):
        planner.plan((6.0, 6.0, 0.0), [Goal((6.0, 7.0, 0.0)), Goal((7.0, 7.0, 0.0))])


def test_where_nothing_leads_out_that_is_proven() -> None:
    walls = tuple(
        Rectangle(center, *size)
        for center, size in (((6.0, 9.0), (6.4, 0.2)), ((6.0, 3.0), (6.4, 0.2)), ((3.0, 6.0), (0.2, 6.0)))
    )
    closed = World("w", BOUNDS, (*walls, Rectangle((9.0, 6.0), 0.2, 6.0)), zones=(zone(MIDDLE),))
    assert plan(closed, ROBOTS["rectangle"], (6.0, 6.0, 0.0), (15.0, 6.0, 0.0)).status == "infeasible"
    opened = plan(replace(closed, obstacles=walls), ROBOTS["rectangle"], (6.0, 6.0, 0.0), (15.0, 6.0, 0.0))
    assert opened.status == "solved"


HALL = World("hall", (0.0, 0.0, 12.0, 6.0), zones=(KeepOutZone(Polygon([(4, 0), (8, 0), (8, 5), (4, 5)])),))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "robot",
    [
        Robot.disc(0.3),
        Robot.rectangle(0.6, 0.4),
        Robot.rectangle(0.6, 0.4).differential(reverse=True),
        Robot.rectangle(0.6, 0.4).steered(0.5),
    ],
    ids=lambda robot: robot.describe(),
)
def test_a_centimetre_inside_it_backs_out(robot: Robot) -> None:
    start, goal = (3.71, 2.0, 0.0), (11.0, 2.0, 0.0)
    planner = LandmarkPlanner(HALL, robot, seed=0)
    planned = planner.plan(start, goal)
    many = planner.plan_many([start, (1.0, 1.0, 0.0)], [goal, goal])
    outside = planner.plan((3.69, 2.0, 0.0), goal)
    assert outside.path is not None
    again = planner.replan(start, goal, outside.path)
    assert again.escape >= 1
    assert many[1].path is not None
    for result in (planned, many[0], again):
        assert 11.7 < result.path.length < 13.5
        assert result.min_clearance == 0.0
        assert result.lower_bound <= result.path.cost
        assert check_path(HALL, robot, result.path).free
        assert_leaves(HALL, robot, result.path)
