"""benchmarks/smac_like.py and benchmarks/theta_star_like.py on benchmarks/costmap.py: ways, and where none are."""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
import pytest
from benchmarks import smac_like, theta_star_like
from benchmarks.costmap import RESOLUTION, costmap_of

from trailmark.benchmark.referee import Referee
from trailmark.collision import StateChecker
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

START, GOAL = np.array([1.02, 2.51, 0.0]), np.array([8.97, 2.48, 1.2])
WALLS = {"open": (), "block": (Rectangle((5.0, 2.5), 2.0, 2.0),), "shut": (Rectangle((5.0, 2.5), 0.5, 5.0),)}


def planned(module: ModuleType, robot: Robot, walls: str, start: FloatArray = START) -> FloatArray | None:
    checker = StateChecker(World("room", (0.0, 0.0, 10.0, 5.0), WALLS[walls], robot))
    found: FloatArray | None = module.plan(checker, start, GOAL, 1.0, 0, prepared=module.prepare(checker))
    return found


@pytest.mark.parametrize("module", [smac_like, theta_star_like])
def test_ways_lead_around_obstacles_and_are_short(module: ModuleType) -> None:
    radius = 0.3
    path = planned(module, Robot.disc(radius), "block")
    assert path is not None
    assert np.array_equal(path[[0, -1]], [START, GOAL])
    # The disc's way about a corner: tangents and an arc.
    leg = math.hypot(4.0 - START[0], 1.0)
    tangent = math.sqrt(leg**2 - radius**2)
    arc = math.atan2(1.0, 4.0 - START[0]) + math.asin(radius / leg)
    shortest = 2.0 * (tangent + radius * arc) + 2.0 + 0.5 * 1.2
    assert 0.99 * shortest < Path(path).cost < 1.1 * shortest
    small = Referee(World("room", (0.0, 0.0, 10.0, 5.0), WALLS["block"]), Robot.disc(radius - 2.0 * RESOLUTION))
    assert small.fault(path.tolist(), START, GOAL) is None


def test_a_footprint_turns_to_fit() -> None:
    world = World("gap", (0.0, 0.0, 10.0, 5.0), (Rectangle((5.0, 1.0), 0.3, 2.0), Rectangle((5.0, 4.0), 0.3, 2.0)))
    robot = Robot.rectangle(1.6, 0.5)
    checker = StateChecker(world, robot)
    sideways = np.array([1.0, 2.5, math.pi / 2])
    path = smac_like.plan(checker, sideways, GOAL, 1.0, 0, prepared=smac_like.prepare(checker))
    assert path is not None
    within = path[np.abs(path[:, 0] - 5.0) < 0.2]
    assert (np.abs(np.sin(within[:, 2])) < 0.8).all()
    # The disc about it does not pass.
    assert theta_star_like.plan(checker, sideways, GOAL, 1.0, 0, prepared=theta_star_like.prepare(checker)) is None


@pytest.mark.parametrize("module", [smac_like, theta_star_like])
def test_where_there_is_no_way_there_is_no_path(module: ModuleType) -> None:
    robot = Robot.disc(0.3)
    assert planned(module, robot, "shut") is None
    assert planned(module, robot, "block", np.array([5.0, 2.5, 0.0])) is None  # within the block
    assert planned(module, robot.steered(1.0), "open") is None  # a car


def test_costmaps_know_what_touches_their_cells() -> None:
    checker = StateChecker(World("room", (0.0, 0.0, 10.0, 5.0), WALLS["block"], Robot.disc(0.3)))
    costmap = costmap_of(checker)
    rows, columns = np.indices(costmap.distance.shape)
    x = costmap.x0 + (columns + 0.5) * costmap.size
    y = costmap.y0 + (rows + 0.5) * costmap.size
    apart = np.maximum(np.abs(x - 5.0) - 1.0, np.abs(y - 2.5) - 1.0)
    assert costmap.size == pytest.approx(RESOLUTION)
    assert (costmap.distance[apart < -costmap.size] == 0.0).all()
    inside = (apart > costmap.size) & (np.minimum(np.minimum(x, 10.0 - x), np.minimum(y, 5.0 - y)) > costmap.size)
    assert (costmap.distance[inside] > 0.0).all()
