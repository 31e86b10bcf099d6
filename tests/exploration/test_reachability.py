"""Where a robot gets to in the known map, against every configuration of a lattice, asked of shapely."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.support.trials import trials

from trailmark import Rectangle, Robot, StateChecker, World
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.reachability import CERTAIN, NOWHERE, Reach, excluded_with

CELL = 0.1


def solid(free: NDArray[np.bool_]) -> shapely.Geometry:
    """All that is not free, the outside included."""
    rows, columns = free.shape
    cells = [shapely.box(c * CELL, r * CELL, (c + 1) * CELL, (r + 1) * CELL) for r, c in np.argwhere(~free).tolist()]
    hall = shapely.box(0.0, 0.0, columns * CELL, rows * CELL)
    return shapely.union_all(
        [*cells, shapely.box(-9.0, -9.0, columns * CELL + 9.0, rows * CELL + 9.0).difference(hall)]
    )


def world_of(seed: int) -> NDArray[np.bool_]:
    rng = np.random.default_rng(seed)
    free = np.ones((18, 24), np.bool_)
    free[:, 10] = False
    gap = int(rng.integers(2, 12))
    free[gap : gap + int(rng.integers(2, 5)), 10] = True
    for _ in range(6):
        r, c = int(rng.integers(0, 16)), int(rng.integers(8, 22))
        free[r : r + 2, c : c + 2] = False
    free[:9, :7] = True
    return free


def lattice_places(
    free: NDArray[np.bool_], robot: Robot, start: tuple[float, float], headings: int
) -> set[tuple[int, int]]:
    """Cells that hold a place to which free configurations of a lattice lead, side by side."""
    step = 0.5 * CELL
    rows, columns = 2 * free.shape[0], 2 * free.shape[1]
    outline = robot.outline.vertices
    theta = np.arange(headings) * 2.0 * np.pi / headings
    k, i, j = np.meshgrid(np.arange(headings), np.arange(rows), np.arange(columns), indexing="ij")
    turned = np.stack(
        [
            np.cos(theta)[:, None] * outline[:, 0] - np.sin(theta)[:, None] * outline[:, 1],
            np.sin(theta)[:, None] * outline[:, 0] + np.cos(theta)[:, None] * outline[:, 1],
        ],
        axis=-1,
    )
    middle = np.stack([(j + 0.5) * step, (i + 0.5) * step], axis=-1)
    rings = turned[k] + middle[..., None, :]
    walls = solid(free).buffer(-1e-9)
    shapely.prepare(walls)
    hit = shapely.intersects(walls, shapely.polygons(rings.reshape(-1, *outline.shape))).reshape(k.shape)
    begin = (0, int(start[1] / step), int(start[0] / step))
    assert not hit[begin]
    seen, todo = {begin}, [begin]
    while todo:
        a, b, c = todo.pop()
        for da, db, dc in product((-1, 0, 1), repeat=3):
            q = (a + da) % headings, b + db, c + dc
            if 0 <= q[1] < rows and 0 <= q[2] < columns and q not in seen and not hit[q]:
                seen.add(q)
                todo.append(q)
    return {(b // 2, c // 2) for _, b, c in seen}


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(4, of=2))
def test_nowhere_is_never_where_a_lattice_of_configurations_leads(seed: int) -> None:
    free, robot = world_of(seed), Robot.rectangle(0.6, 0.24)
    been = np.zeros(free.shape, np.bool_)
    been[4, 3] = True
    levels, _ = Reach(robot, CELL).levels(np.where(free, FREE, UNKNOWN).astype(np.uint8), been)
    places = lattice_places(free, robot, (0.36, 0.46), 16)
    assert len(places) > 20
    assert [place for place in places if levels[place] == NOWHERE] == []


@pytest.mark.parametrize("robot", [Robot.disc(0.2), Robot.rectangle(0.5, 0.2), Robot.disc(0.1).keeping(0.1)])
def test_where_it_certainly_gets_to_every_heading_is_free(robot: Robot) -> None:
    free = world_of(5)
    free[:16, :10], free[:16, 10] = True, False
    been = np.zeros(free.shape, np.bool_)
    been[8, 5] = True
    levels, _ = Reach(robot, CELL).levels(np.where(free, FREE, UNKNOWN).astype(np.uint8), been)
    cells = np.argwhere(levels == CERTAIN)
    assert len(cells) > 5
    away = shapely.distance(solid(free), shapely.points((cells[:, ::-1] + 0.5) * CELL))
    assert away.min() >= robot.circumradius - 1e-9


@pytest.mark.parametrize(("width", "through"), [(0, False), (3, True), (4, True)])
def test_a_door_is_passed_by_what_fits_through_it(width: int, through: bool) -> None:
    free = np.ones((20, 40), np.bool_)
    free[:, 20] = False
    free[8 : 8 + width, 20] = True
    been = np.zeros(free.shape, np.bool_)
    been[9, 5] = True
    levels, _ = Reach(Robot.rectangle(0.8, 0.29), CELL).levels(np.where(free, FREE, UNKNOWN).astype(np.uint8), been)
    assert bool((levels[:, 25:] > NOWHERE).any()) == through
    # A disc around it would not pass.
    round_levels, _ = Reach(Robot.disc(0.41), CELL).levels(np.where(free, FREE, UNKNOWN).astype(np.uint8), been)
    assert not (round_levels[:, 25:] > NOWHERE).any()


def test_what_is_kept_from_call_to_call_is_what_is_found_anew() -> None:
    rng = np.random.default_rng(3)
    free = world_of(1)
    been = np.zeros(free.shape, np.bool_)
    been[4, 3] = True
    kept = Reach(Robot.rectangle(0.6, 0.24), CELL)
    for _ in range(6):
        levels, _ = kept.levels(np.where(free, FREE, UNKNOWN).astype(np.uint8), been)
        fresh, _ = Reach(Robot.rectangle(0.6, 0.24), CELL).levels(np.where(free, FREE, UNKNOWN).astype(np.uint8), been)
        np.testing.assert_array_equal(levels, fresh)
        free = free.copy()
        r, c = int(rng.integers(0, 18)), int(rng.integers(8, 24))
        free[r, c] = ~free[r, c]


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(3))
def test_changes_anywhere_in_a_larger_map_are_found(seed: int) -> None:
    """Distances are found anew around the changes alone; windows end in free space, at surfaces and at the border."""
    rng = np.random.default_rng(seed)
    state = rng.choice(np.array([FREE, OCCUPIED, UNKNOWN], np.uint8), (90, 120), p=[0.994, 0.003, 0.003])
    been = np.zeros(state.shape, np.bool_)
    been[45, 60] = True
    robot = Robot.rectangle(0.6, 0.24)
    kept = Reach(robot, CELL)
    for step in range(12):
        levels, changed = kept.levels(state, been)
        fresh, every = Reach(robot, CELL).levels(state, been)
        np.testing.assert_array_equal(levels, fresh)
        assert every.all()
        assert changed.all() if step == 0 else changed.any() == (step % 4 != 3) and not changed.all()
        if step % 4 != 2:  # else nothing changes but where the robot was
            row, column = (int(rng.integers(0, size - 3)) for size in state.shape)
            state[row : row + 3, column] = OCCUPIED if state[row, column] == FREE else FREE
        been[int(rng.integers(40, 50)), int(rng.integers(50, 70))] = True


def test_no_way_to_a_cell_is_none_to_those_that_motions_join_to_it() -> None:
    wall = Rectangle((3.0, 2.0), 0.2, 4.0)
    world = World("walls", (0.0, 0.0, 6.0, 4.0), (wall,), Robot.disc(0.2))
    known = KnownMap(world.bounds, 0.1)
    found = excluded_with(known, StateChecker(world), np.ones(known.state.shape, np.bool_), 20, 10)
    x, y = known.centres(*np.nonzero(~found)).T
    # All but the places on the other side of the wall where the disc fits.
    assert len(x) == 25 * 36
    assert x.min() == pytest.approx(3.35)
    assert (y.min(), y.max()) == pytest.approx((0.25, 3.75))
