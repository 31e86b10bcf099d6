"""A second look at cells of SE(2): what is free in them is found, by shapely alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from tests.helpers.cell_oracle import free_somewhere
from tests.support.trials import few

from trailmark import se2
from trailmark.shapes import Polygon, Rectangle
from trailmark.world import Robot, World

CORNERS = [[-0.5, -0.5], [0.9, -0.5], [0.9, -0.1], [-0.1, -0.1], [-0.1, 0.9], [-0.5, 0.9]]
L_SHAPE = Robot(Polygon(np.array(CORNERS)))
ROBOTS = (Robot.rectangle(1.6, 0.4), replace(Robot.rectangle(1.0, 0.6), clearance=0.1), L_SHAPE)
NOWHERE = np.zeros(2)


def _free_share(world: World, robot: Robot, middle: np.ndarray, extent: np.ndarray, rng: np.random.Generator) -> float:
    """Return the share of configurations in a box that are free, of 400 drawn."""
    obstacles = shapely.union_all([shape.polygon().shapely() for shape in world.obstacles])
    placed = shapely.polygons(se2.transform(middle + rng.uniform(-1.0, 1.0, (400, 3)) * extent, robot.outline.vertices))
    shapely.prepare(obstacles)
    free = ~shapely.dwithin(obstacles, placed, robot.clearance) & shapely.covers(shapely.box(*world.bounds), placed)
    return float(free.mean())


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS, ids=["long", "with clearance", "L"])
def test_what_is_free_in_a_box_is_found(robot: Robot) -> None:
    rng = np.random.default_rng(3)
    some = none = 0
    for _ in range(few(100, of=6)):
        places = rng.uniform(1.0, 5.0, (7, 2)).tolist()
        sizes = rng.uniform(0.1, 1.0, (len(places), 2)).tolist()
        walls = tuple(
            Rectangle((x, y), a, b, float(rng.uniform(0.0, 3.0))) for (x, y), (a, b) in zip(places, sizes, strict=True)
        )
        world = World("clutter", (0.0, 0.0, 6.0, 6.0), walls)
        middle = np.array([*rng.uniform(2.0, 4.0, 2), rng.uniform(-3.0, 3.0)])
        side = rng.uniform(0.02, 0.4)
        extent = np.array([side, side, rng.uniform(0.02, 0.8)])
        share = _free_share(world, robot, middle, extent, rng)
        told = free_somewhere(world, robot, middle[None], extent[None], NOWHERE)
        # Small parts of a box may be missed, none of one in twenty is.
        assert told or share < 0.05
        some, none = some + (share >= 0.05), none + (share == 0.0 and not told)
    assert some >= few(8, of=6)
    assert none >= few(8, of=6)


def test_a_slot_as_narrow_as_a_hundredth_of_the_box_is_found() -> None:
    robot, box = Robot.rectangle(1.0, 0.5), np.array([[0.4, 0.4, 0.4]])
    for spare, told in ((0.02, True), (-0.02, False)):
        half = 0.25 + 0.5 * spare
        walls = tuple(Rectangle((3.013, 3.027 + side * (half + 1.0)), 5.0, 2.0) for side in (-1.0, 1.0))
        world = World("slot", (0.0, 0.0, 6.0, 6.0), walls)
        assert free_somewhere(world, robot, np.array([[3.0, 3.0, 0.1]]), box, NOWHERE) == told


def test_boxes_of_many_sizes_are_told_apart() -> None:
    world = World("wall", (0.0, 0.0, 6.0, 6.0), (Rectangle((3.0, 3.0), 2.0, 2.0),))
    robot = Robot.rectangle(0.8, 0.4)
    middles = np.array([[3.0, 3.0, 0.0], [3.2, 2.9, 1.0], [2.9, 3.1, 2.0]])
    extents = np.array([[0.3, 0.3, 0.4], [0.1, 0.1, 0.2], [0.2, 0.2, 3.0]])
    assert not free_somewhere(world, robot, middles, extents, NOWHERE)
    out = np.array([[1.95, 3.0, 0.0]])
    assert free_somewhere(world, robot, np.vstack([middles, out]), np.vstack([extents, [[0.5, 0.5, 0.2]]]), NOWHERE)
