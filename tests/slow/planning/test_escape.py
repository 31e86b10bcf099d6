"""The way out of an obstacle: short, never deeper, free at its end; depths by shapely's own sums."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from tests.helpers.trials import few, trials
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import (
    ConfigurationError,
    Disc,
    KeepOutZone,
    LandmarkPlanner,
    Path,
    PlannerSettings,
    Polygon,
    Rectangle,
    Robot,
    StateChecker,
    World,
)
from trailmark.motion import motion_of
from trailmark.penetration import Penetration
from trailmark.planning.escape import way_out
from trailmark.se2 import transform
from trailmark.trajectories import path_of


def depth_of(world: World, robot: Robot, states: np.ndarray) -> np.ndarray:
    """Return how deep a robot is in the obstacle that it is deepest in, metres."""
    # Most obstacles are too far off for any of the robot to be in them.
    reach = float(np.hypot(*robot.outline.vertices.T).max())
    low, high = states[:, :2].min(axis=0) - reach, states[:, :2].max(axis=0) + reach
    boxes = np.array([shape.bounding_box() for shape in world.obstacles])
    near = np.flatnonzero((boxes[:, :2] <= high).all(axis=1) & (boxes[:, 2:] >= low).all(axis=1))
    return np.asarray(np.max([Penetration(robot.footprint, world.obstacles[i]).at(states) for i in near], axis=0))


@pytest.mark.parametrize("name", ["disc", "rectangle", "L", "offset", "star"])
def test_it_is_never_deeper_than_before_and_ends_free(name: str) -> None:
    robot, rng, met = ROBOTS[name], np.random.default_rng(1), 0
    for seed in trials(4, of=2):
        world = random_world(seed, 30, size=40.0, discs=0.3)
        checker = StateChecker(world, robot)
        q = np.column_stack([rng.uniform(3, 37, (200, 2)), rng.uniform(-3, 3, 200)])
        for start in q[~checker.valid(q)][:12]:
            out = way_out(checker, start)
            assert np.array_equal(out[0], start)
            assert checker.valid(out[-1])
            assert out[-1, 2] == start[2]
            if len(out) > 2:
                rows = np.vstack([a + np.linspace(0.0, 1.0, 40)[:, None] * (b - a) for a, b in pairwise(out)])
                assert depth_of(world, robot, rows).argmax() == 0
                continue
            states = start + np.linspace(0.0, 1.0, 40)[:, None] * (out[-1] - start)
            length = float(np.hypot(*(out[-1] - start)[:2]))
            depths = depth_of(world, robot, states)
            # Alone, each obstacle is no deeper than all of them together, whose depth falls from the length to 0.
            together = length * (1.0 - np.linspace(0.0, 1.0, 40))
            assert (depths <= together + 1e-4).all()
            met += 1
    assert met > few(20, of=2)


def depths_in(parts: list[shapely.Polygon], robot: Robot, q: np.ndarray) -> list[float]:
    """Return how far the nearest place is at which a robot overlaps a part no more, metres, for each part."""
    found, body = [], Polygon(transform(q, robot.outline.vertices)).shapely()
    for part in parts:
        sums = [
            shapely.MultiPoint(
                (shapely.get_coordinates(a)[:, None] - shapely.get_coordinates(b)).reshape(-1, 2)
            ).convex_hull
            for a in shapely.get_parts(shapely.constrained_delaunay_triangles(part))
            for b in shapely.get_parts(shapely.constrained_delaunay_triangles(body))
        ]
        blocked, here = shapely.union_all(sums), shapely.Point(0.0, 0.0)
        found.append(here.distance(blocked.boundary) if blocked.contains(here) else 0.0)
    return found


def test_out_of_two_obstacles_it_is_deeper_in_neither_but_where_it_is_wedged() -> None:
    robot = Robot.polygon(ROBOTS["L"].outline.vertices / ROBOTS["L"].circumradius)
    rng, met, deeper = np.random.default_rng(3), 0, 0
    for _ in range(40):
        q, first = np.array([5.0, 5.0, rng.uniform(-3.0, 3.0)]), rng.uniform(0.0, 2.0 * np.pi)
        center = shapely.get_coordinates(Polygon(transform(q, robot.outline.vertices)).shapely().centroid)[0]
        sides = []
        for angle in (first, first + rng.uniform(0.5, 2.0)):
            at = center + (rng.uniform(0.2, 0.6) + 0.5) * np.array([np.cos(angle), np.sin(angle)])
            sides.append(Rectangle((float(at[0]), float(at[1])), 1.0, float(rng.uniform(0.3, 2.0)), angle))
        checker = StateChecker(World("pressed", (0.0, 0.0, 10.0, 10.0), tuple(sides)), robot)
        parts = shapely.get_parts(shapely.union_all([side.polygon().shapely() for side in sides])).tolist()
        if checker.valid(q):
            continue
        out = way_out(checker, q, 5.0)
        assert out is not None
        assert checker.valid(out[-1])
        rows = np.vstack([a + np.linspace(0.0, 1.0, 20)[:, None] * (b - a) for a, b in pairwise(out)])
        depths = np.array([depths_in(parts, robot, row) for row in rows])
        met += 1
        deeper += bool((depths[1:] > np.minimum.accumulate(depths)[:-1] + 1e-4).any())
    assert met == 40
    assert deeper <= 3  # the straight way out would be in 6


@pytest.mark.parametrize("reverse", [True, False])
def test_a_differential_drive_neither_turns_nor_drives_deeper_into_anything(reverse: bool) -> None:
    robot, rng, met = Robot.rectangle(1.0, 0.4).differential(reverse=reverse), np.random.default_rng(2), 0
    for seed in trials(4, of=2):
        world = random_world(seed, 30, size=40.0, discs=0.3)
        checker = StateChecker(world, robot)
        motion = motion_of(checker)
        q = np.column_stack([rng.uniform(3, 37, (300, 2)), rng.uniform(-3, 3, 300)])
        for start in q[~checker.valid(q)][: few(25, of=2)]:
            out = way_out(checker, start)
            if out is None:
                continue
            assert checker.valid(out[-1])
            driven = path_of(motion, out)
            depths = depth_of(world, robot, driven.resample(0.02).states)
            assert depths.max() <= depths[0] + 1e-4
            met += 1
    assert met > few(20)


@pytest.mark.parametrize("drive", ["omnidirectional", "differential"])
def test_a_start_in_an_obstacle_and_a_keep_out_zone_leads_out_of_both(drive: str) -> None:
    zone = KeepOutZone(Rectangle((5.0, 5.0), 2.0, 2.0).polygon())
    world = World("both", (0.0, 0.0, 10.0, 10.0), (Rectangle((6.2, 5.0), 1.0, 1.0),), zones=(zone,))
    robot = Robot.disc(0.3) if drive == "omnidirectional" else Robot.rectangle(0.6, 0.4).differential(reverse=True)
    planner = LandmarkPlanner(world, robot, seed=0)
    start, goal = (5.5, 5.0, 0.0), (1.0, 1.0, 0.0)
    with pytest.raises(ConfigurationError, match="the way out is"):
        planner.plan(start, goal)
    result = planner.plan(start, goal, 5.0, escape=True)
    assert result.status == "solved"
    assert result.path is not None
    out = result.path.states[result.escape :]
    bodies = [Polygon(transform(q, robot.outline.vertices)).shapely() for q in Path(out).resample(0.05).states]
    blocked = shapely.union(zone.region.shapely(), world.obstacles[0].polygon().shapely())
    assert max(shapely.intersection(body, blocked).area for body in bodies) < 1e-5


@pytest.mark.parametrize("name", ["disc", "rectangle", "car"])
def test_replanning_leads_out_first(name: str) -> None:
    robot = ROBOTS["rectangle"].steered(2.0) if name == "car" else ROBOTS[name]
    world = World("field", (0.0, 0.0, 40.0, 20.0))
    planner = LandmarkPlanner(world, robot, seed=0, settings=PlannerSettings(patience=1))
    start, goal = np.array([5.0, 10.0, 0.0]), np.array([35.0, 10.0, 0.0])
    path = planner.plan(start, goal).path
    assert path is not None
    planner.update(world.edited(add=[Disc((5.9, 10.3), 0.5)]))
    stuck = planner.replan(start, goal, path)
    assert (stuck.status, stuck.escape) == ("infeasible", 0)
    result = planner.replan(start, goal, path, time_limit=10.0, escape=True)
    assert (result.status, result.kept) == ("solved", False)
    assert result.escape >= 1
    assert "leads out first" in result.reason
    assert np.array_equal(result.path.states[0], start)
    assert np.array_equal(result.path.states[-1], goal)
    places = result.path.resample(0.02).states
    valid = planner.checker.valid(places)
    # Once it is out it stays out.
    assert not valid[0]
    assert valid[np.argmax(valid) :].all()
