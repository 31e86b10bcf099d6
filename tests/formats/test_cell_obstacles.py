"""Cells as obstacles: the same world as their polygons, which are made only for those who ask."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from numpy.typing import NDArray

from trailmark import LandmarkPlanner
from trailmark.collision import StateChecker
from trailmark.formats.grid import CellObstacles, cells_of, grid_polygons, grid_sides
from trailmark.shapes import Disc
from trailmark.world import Robot, World

grids = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.booleans())
ROBOT = Robot.rectangle(0.7, 0.3)


def made(world: World) -> bool:
    """Whether the world's polygons have been made."""
    return "shapes" in world.obstacles.__dict__


@pytest.mark.slow
@given(grids)
def test_sides_are_those_of_the_polygons(occupied: NDArray[np.bool_]) -> None:
    origin = (0.5, -2.0, 0.0)
    sides = grid_sides(occupied, 0.1, origin)
    rings = [ring for polygon in grid_polygons(occupied, 0.1, origin) for ring in polygon.rings()]
    wanted = [np.hstack([ring, np.roll(ring, -1, axis=0)]) for ring in rings]
    expected = np.concatenate(wanted) if wanted else np.empty((0, 4))

    # Where polygons touch in a corner one straight side may be two: the unit edges are the same.
    def units(rows: NDArray[np.float64]) -> set[tuple[int, ...]]:
        cells = np.rint((rows - [0.5, -2.0, 0.5, -2.0]) / 0.1).astype(int)
        found = set[tuple[int, ...]]()
        for x1, y1, x2, y2 in cells.tolist():
            n = max(abs(x2 - x1), abs(y2 - y1))
            dx, dy = (x2 - x1) // n, (y2 - y1) // n
            found |= {(x1 + k * dx, y1 + k * dy, dx, dy) for k in range(n)}
        return found

    assert units(sides) == units(expected)


@pytest.mark.slow
def test_checking_and_planning_make_no_polygons() -> None:
    occupied = np.random.default_rng(0).random((40, 40)) < 0.1
    occupied[:2], occupied[-2:] = False, False
    world = World.from_grid(occupied, 1.0)
    planner = LandmarkPlanner(world, Robot.disc(0.4), seed=0)
    result = planner.plan((0.5, 0.5, 0.0), (39.5, 39.5, 1.0), time_limit=5.0)
    assert result.path is not None
    assert result.path.cost <= 1.01 * (result.lower_bound or 0.0)
    assert not made(world)
    assert len(world.obstacles) == len(grid_polygons(occupied))
    assert made(world)


@pytest.mark.parametrize("seed", range(8))
def test_answers_are_those_of_the_polygons(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = World.from_grid(rng.random((12, 15)) < 0.2, 0.5, (3.0, -1.0))
    plain = replace(world, obstacles=tuple(world.obstacles))
    q = np.column_stack([rng.uniform(3.0, 10.5, 400), rng.uniform(-1.0, 5.0, 400), rng.uniform(-3.0, 3.0, 400)])
    mine, theirs = StateChecker(world, ROBOT), StateChecker(plain, ROBOT)
    assert np.array_equal(mine.valid(q), theirs.valid(q))
    assert mine.clearance(q) == pytest.approx(theirs.clearance(q), abs=1e-12)
    # One obstacle goes and another comes: the grid knows which sides were whose.
    changed = world.edited(remove=[len(world.obstacles) // 2], add=[Disc((6.0, 2.0), 0.3)])
    assert cells_of(changed) is None
    edited, anew = mine.edited(changed), StateChecker(changed, ROBOT)
    assert np.array_equal(edited.valid(q), anew.valid(q))


def test_is_a_sequence_like_a_tuple() -> None:
    occupied = np.eye(4, dtype=np.bool_)
    world, other = World.from_grid(occupied, 1.0), World.from_grid(occupied, 1.0)
    shapes = grid_polygons(occupied)
    assert world == other
    assert hash(world.obstacles) == hash(shapes)
    assert world.obstacles == shapes
    assert shapes == world.obstacles
    assert world.obstacles != shapes[1:]
    assert world.obstacles + shapes == shapes + world.obstacles == (*shapes, *shapes)
    assert world.obstacles[1:3] == shapes[1:3]
    assert repr(world.obstacles) == repr(shapes)
    assert not made(pickle.loads(pickle.dumps(world)))  # noqa: S301  # its own
    assert pickle.loads(pickle.dumps(world)) == world  # noqa: S301  # its own


def test_a_turned_grid_is_no_longer_cells() -> None:
    occupied = np.eye(4, dtype=np.bool_)
    assert cells_of(World.from_grid(occupied, 1.0, (0.0, 0.0, 0.3))) is None
    assert cells_of(World.from_grid(occupied, 1.0)) is not None
    assert CellObstacles(occupied).upright
