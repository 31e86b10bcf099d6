"""Cells: after any change, grid and field are those of the changed world built anew, and versions before stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.helpers.random_worlds import random_world, star_polygon

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.cells import Cells
from trailmark.collision.distances import point_clearance, point_depth
from trailmark.collision.field import build_field
from trailmark.collision.obstacles import ObstacleGrid, build_grid, is_crowded
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import Robot, World

SIZE = 12.0
"""Edge of the worlds, metres."""


def random_shape(rng: np.random.Generator) -> Shape:
    """Return an obstacle of any kind: tiny or huge, partly or wholly outside the bounds, on round coordinates."""
    radius = float(rng.choice([1e-4, 0.05, 0.4, 1.5, 5.0, 40.0], p=[0.1, 0.2, 0.3, 0.25, 0.13, 0.02]))
    x, y = rng.uniform(-2.0, SIZE + 2.0, 2)
    if rng.random() < 0.3:
        x, y = np.round((x, y))
    center = float(x), float(y)
    kind = rng.integers(4)
    if kind == 0:
        return Disc(center, radius)
    if kind == 1:
        heading = float(rng.choice([0.0, 0.5 * np.pi, rng.uniform(-3, 3)]))
        return Rectangle(center, 2.0 * radius, radius * float(rng.uniform(0.01, 2.0)), heading)
    polygon = star_polygon(rng, center, radius)
    if kind == 3 and len(polygon.vertices) > 3:
        return Polygon(polygon.vertices, (0.5 * (polygon.vertices + np.array(center)),))
    return polygon


def changed(rng: np.random.Generator, shapes: list[Shape]) -> list[tuple[Shape | None, Shape | None]]:
    """Change the list of obstacles in one to three places, and return the changes."""
    changes: list[tuple[Shape | None, Shape | None]] = []
    for _ in range(int(rng.integers(1, 4))):
        kind = rng.integers(4)
        i = int(rng.integers(len(shapes))) if shapes else 0
        if not shapes or kind == 0:
            # Equal obstacles, too.
            shapes.append(shapes[i] if shapes and rng.random() < 0.1 else random_shape(rng))
            changes.append((None, shapes[-1]))
        elif kind == 1 or len(shapes) > 25:
            changes.append((shapes.pop(i), None))
        else:
            before = shapes[i]
            if kind == 2 and isinstance(before, Disc):
                shapes[i] = Disc(tuple(np.add(before.center, rng.normal(0, 0.3, 2))), before.radius)
            elif kind == 2 and isinstance(before, Polygon):
                shift = rng.normal(0, 0.3, 2)
                shapes[i] = Polygon(before.vertices + shift, tuple(hole + shift for hole in before.holes))
            else:
                shapes[i] = random_shape(rng)
            changes.append((before, shapes[i]))
    return changes


def content(grid: ObstacleGrid) -> FloatArray:
    """Return what each cell lists: its number and the coordinates, a row each, in order; discs end in NaN."""
    counts = np.diff(grid.cell_start, axis=1).ravel()
    ends = np.cumsum(counts)
    at = np.arange(ends[-1]) + np.repeat(grid.cell_start[:, :-1].ravel() - ends + counts, counts)
    items = grid.items[at]
    found = np.full((len(items), 5), np.nan)
    found[:, 0] = np.repeat(np.arange(len(counts)), counts)
    found[items >= 0, 1:] = grid.segments[items[items >= 0]]
    found[items < 0, 1:4] = grid.discs[-1 - items[items < 0]]
    return found[np.lexsort(found.T[::-1])]


def arrays_of(cells: Cells) -> list[np.ndarray]:
    grid = cells.grid
    return [grid.segments, grid.discs, grid.cell_start, grid.items, grid.winding, cells.field.distance]


def assert_same(cells: Cells, world: World) -> None:
    """Compare with a grid and a field built anew: nothing may differ but the order of items."""
    grid = build_grid(world, cells.grid.size, whole=True)
    field = build_field(grid)
    assert np.array_equal(cells.grid.winding, grid.winding)
    assert np.array_equal(np.diff(cells.grid.cell_start), np.diff(grid.cell_start))
    assert np.array_equal(content(cells.grid), content(grid), equal_nan=True)
    assert np.array_equal(cells.field.distance, field.distance)
    assert cells.field[1:] == field[1:]
    assert cells.grid[5:] == grid[5:]


@pytest.mark.parametrize("seed", range(6))
def test_random_changes_make_what_is_built_anew(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boundary = Polygon(np.array([[0.5, 0.3], [11.0, 1.0], [11.5, 11.0], [6.0, 7.0], [1.0, 11.9]])) if seed % 3 else None
    shapes = [random_shape(rng) for _ in range(int(rng.integers(0, 12)))]
    world = World("w", (0.0, 0.0, SIZE, SIZE), tuple(shapes), boundary=boundary)
    grid = build_grid(world, float(rng.choice([0.2, 0.37, 1.0, 3.0])), whole=True)
    cells = Cells(world, grid, build_field(grid))
    held: list[tuple[Cells, list[np.ndarray]]] = []
    for _ in range(16):
        if rng.random() < 0.3:
            # Old versions, which someone still uses, or no longer.
            held = [(cells, [array.copy() for array in arrays_of(cells)]), *held[: rng.integers(4)]]
        cells = cells.edited(changed(rng, shapes))
        assert_same(cells, replace(world, obstacles=tuple(shapes)))
        for old, arrays in held:
            assert all(np.array_equal(a, b) for a, b in zip(arrays, arrays_of(old), strict=True))


def test_two_versions_of_the_same_one_do_not_know_each_other() -> None:
    rng = np.random.default_rng(3)
    world = random_world(1, 15, size=SIZE, radii=(0.2, 2.0), discs=0.3, holes=0.4)
    grid = build_grid(world, 0.3, whole=True)
    branches = [(Cells(world, grid, build_field(grid)), list(world.obstacles))]
    for _ in range(25):
        cells, shapes = branches[int(rng.integers(len(branches)))]
        shapes = list(shapes)
        cells = cells.edited(changed(rng, shapes))
        assert_same(cells, replace(world, obstacles=tuple(shapes)))
        branches.append((cells, shapes))
        if len(branches) > 4:
            branches.pop(int(rng.integers(4)))
    for cells, shapes in branches:
        assert_same(cells, replace(world, obstacles=tuple(shapes)))


def test_a_world_without_obstacles_or_with_no_free_place() -> None:
    world = World("w", (0.0, 0.0, SIZE, SIZE))
    grid = build_grid(world, 0.4, whole=True)
    cells = Cells(world, grid, build_field(grid))
    all_of_it = Rectangle((6.0, 6.0), 40.0, 40.0)
    for before, after in ((None, all_of_it), (all_of_it, Disc((6.0, 6.0), 1.0)), (Disc((6.0, 6.0), 1.0), None)):
        cells = cells.edited([(before, after)])
        assert_same(cells, replace(world, obstacles=() if after is None else (after,)))


def test_rows_get_more_room_when_many_obstacles_gather() -> None:
    rng = np.random.default_rng(0)
    world = World("w", (0.0, 0.0, SIZE, SIZE))
    grid = build_grid(world, 0.3, whole=True)
    cells, shapes = Cells(world, grid, build_field(grid)), []
    for _ in range(60):
        shapes.append(Rectangle((6.0, float(rng.uniform(5.9, 6.1))), 11.0, 0.05))
        cells = cells.edited([(None, shapes[-1])])
    assert_same(cells, replace(world, obstacles=tuple(shapes)))


@pytest.mark.slow
def test_crowded_discs_are_listed_once_a_cell_and_answers_are_the_same() -> None:
    rng = np.random.default_rng(0)
    discs = tuple(Disc((float(x), float(y)), float(r)) for x, y, r in rng.uniform((0, 0, 0.5), (20, 20, 4.0), (300, 3)))
    world = World("crowd", (0.0, 0.0, 30.0, 20.0), discs)
    sparse, whole = build_grid(world, 0.25), build_grid(world, 0.25, whole=True)
    assert is_crowded(sparse.discs, 0.25, sparse.rows * sparse.columns)
    assert len(sparse.items) < 0.1 * len(whole.items)
    assert np.array_equal(np.diff(sparse.cell_start, axis=1) > 0, np.diff(whole.cell_start, axis=1) > 0)
    for x, y in rng.uniform((0, 0), (30, 20), (600, 2)):
        assert point_clearance(sparse, x, y, 0.7) == point_clearance(whole, x, y, 0.7)
        assert point_depth(sparse, x, y, 0.7) <= point_depth(whole, x, y, 0.7)
        assert (point_depth(sparse, x, y, 0.7) > 0.0) == (point_depth(whole, x, y, 0.7) > 0.0)
    robot = Robot.rectangle(0.5, 0.3)
    q = np.column_stack([rng.uniform(15, 30, 800), rng.uniform(0, 20, 800), rng.uniform(-3, 3, 800)])
    changed = world.edited(remove=[3, 40], add=[Disc((25.0, 10.0), 1.0)])
    first = StateChecker(world, robot)
    assert np.array_equal(first.edited(changed).valid(q), StateChecker(changed, robot).valid(q))
    assert np.array_equal(first.valid(q), free_of_discs(world, robot, q))


def free_of_discs(world: World, robot: Robot, q: FloatArray) -> NDArray[np.bool_]:
    """Whether shapely finds the robot at each q apart from all discs and within the bounds."""
    bodies = shapely.polygons([se2.transform(state, robot.outline.vertices) for state in q])
    free = shapely.covers(shapely.box(*world.bounds), bodies)
    for disc in (shape for shape in world.obstacles if isinstance(shape, Disc)):
        free &= shapely.distance(bodies, shapely.Point(disc.center)) > disc.radius
    return np.asarray(free)
