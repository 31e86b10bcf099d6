"""Where a robot gets to in the known map, against every configuration of a lattice, asked of shapely."""

from __future__ import annotations

import itertools
import math
from functools import partial
from itertools import product

import networkx as nx
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.helpers.trials import trials

from trailmark import Rectangle, Robot, StateChecker, World
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.reachability import CERTAIN, NOWHERE, TIGHT, Travel, costs_between, perhaps_reached, reach_of

CELL = 0.1


def solid(free: NDArray[np.bool_]) -> shapely.Geometry:
    """All that is not free, the outside included."""
    rows, columns = free.shape
    cells = [shapely.box(c * CELL, r * CELL, (c + 1) * CELL, (r + 1) * CELL) for r, c in np.argwhere(~free).tolist()]
    hall = shapely.box(0.0, 0.0, columns * CELL, rows * CELL)
    return shapely.union_all(
        [*cells, shapely.box(-9.0, -9.0, columns * CELL + 9.0, rows * CELL + 9.0).difference(hall)]
    )


def known_of(free: NDArray[np.bool_], blocked: int = UNKNOWN) -> KnownMap:
    known = KnownMap((0.0, 0.0, CELL * free.shape[1], CELL * free.shape[0]), CELL)
    known.set_state(np.where(free, FREE, blocked).astype(np.uint8))
    return known


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
    levels = reach_of(known_of(free), been, robot).levels
    places = lattice_places(free, robot, (0.36, 0.46), 16)
    assert len(places) > 20
    assert [place for place in places if levels[place] == NOWHERE] == []
    # Where surfaces lie in occupied cells is not known: no less is left then.
    for blocked in (UNKNOWN, OCCUPIED):
        perhaps = perhaps_reached(known_of(free, blocked), been, robot)
        assert [place for place in places if not perhaps[place]] == []


@pytest.mark.parametrize("robot", [Robot.disc(0.2), Robot.rectangle(0.5, 0.2), Robot.disc(0.1).keeping(0.1)])
def test_where_it_certainly_gets_to_every_heading_is_free(robot: Robot) -> None:
    free = world_of(5)
    free[:16, :10], free[:16, 10] = True, False
    been = np.zeros(free.shape, np.bool_)
    been[8, 5] = True
    levels = reach_of(known_of(free), been, robot).levels
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
    levels = reach_of(known_of(free), been, Robot.rectangle(0.8, 0.29)).levels
    assert bool((levels[:, 25:] > NOWHERE).any()) == through
    # A disc around it would not pass.
    round_levels = reach_of(known_of(free), been, Robot.disc(0.41)).levels
    assert not (round_levels[:, 25:] > NOWHERE).any()


def test_occupied_cells_are_no_proof_of_more_than_a_surface_in_them() -> None:
    # A wall at an odd angle with a door hardly wider than the robot: all cells that the wall's outline goes through
    # are occupied, and leave less than the robot's width free.
    door, angle, cell = 0.42, 1.2, 0.04
    along = np.array([np.cos(angle), np.sin(angle)])
    walls = [
        Rectangle(tuple((np.array([3.0, 2.0]) + side * along * (0.5 * door + 2.0)).tolist()), 4.0, 0.2, angle)
        for side in (-1.0, 1.0)
    ]
    solid = shapely.union_all([wall.polygon().shapely() for wall in walls])
    world = World("door", (0.0, 0.0, 6.0, 4.0), tuple(walls), Robot.disc(0.2))
    across = np.array([along[1], -along[0]])
    ends = [np.append(np.array([3.0, 2.0]) + side * across, 0.0) for side in (-1.0, 1.0)]
    assert StateChecker(world, Robot.disc(0.2)).motion_valid(*ends)
    known = KnownMap(world.bounds, cell)
    rows, columns = np.indices(known.state.shape)
    corner = cell * np.stack([columns, rows], -1)
    cells = shapely.box(corner[..., 0], corner[..., 1], corner[..., 0] + cell, corner[..., 1] + cell)
    state = np.where(shapely.intersects(cells, solid.boundary), OCCUPIED, FREE)
    state[shapely.contains_properly(solid, cells)] = UNKNOWN
    been = np.zeros(state.shape, np.bool_)
    been[known.cells_of(ends[0][None, :2])] = True
    known.set_state(state.astype(np.uint8))
    there = known.cells_of(ends[1][None, :2])

    def perhaps(radius: float) -> bool:
        return bool(perhaps_reached(known, been, Robot.disc(radius))[there])

    assert perhaps(0.2)
    assert not perhaps(0.25)
    # What is unknown stands in the way as a whole.
    state[state == OCCUPIED] = UNKNOWN
    known.set_state(state.astype(np.uint8))
    assert not perhaps(0.2)


lengths = partial(nx.single_source_dijkstra_path_length, weight="cost")


def graph_of(fits: np.ndarray, cells: np.ndarray) -> nx.DiGraph:
    """Return the steps from cell to cell; a place is one whatever its cell is."""
    graph, places = nx.DiGraph(), {(int(r), int(c)) for r, c in cells}
    rows, columns = fits.shape
    for r, c, dr, dc in itertools.product(range(rows), range(columns), (-1, 0, 1), (-1, 0, 1)):
        there = r + dr, c + dc
        inside = 0 <= there[0] < rows and 0 <= there[1] < columns
        if inside and (dr, dc) != (0, 0) and (fits[there] != NOWHERE or there in places):
            graph.add_edge((r, c), there, cost=math.hypot(dr, dc) * (1.0 if fits[there] == CERTAIN else TIGHT))
    return graph


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(5))
def test_costs_are_those_of_shortest_ways(seed: int) -> None:
    rng = np.random.default_rng(seed)
    fits = rng.choice(np.array([NOWHERE, 3, CERTAIN], np.uint8), (17, 23), p=[0.35, 0.25, 0.4])
    cells = np.column_stack([rng.integers(0, 17, 8), rng.integers(0, 23, 8)])
    found = costs_between(fits, cells, len(cells), TIGHT)
    graph, reached = graph_of(fits, cells), 0
    for i, j in itertools.product(range(8), range(8)):
        ends = tuple(map(tuple, cells[[i, j]].tolist()))
        ways = [lengths(graph, a).get(b, math.inf) for a, b in (ends, ends[::-1]) if a in graph]
        expected = 0.0 if i == j else min(ways, default=math.inf)
        assert found[i, j] == pytest.approx(expected, rel=0.002)
        reached += i != j and math.isfinite(expected)
    assert reached > 10


def test_ways_past_the_nearest_places_are_joined() -> None:
    # A corridor of 60 cells with a place in every second one.
    fits = np.full((3, 60), CERTAIN, np.uint8)
    cells = np.column_stack([np.ones(30, np.intp), np.arange(0, 60, 2)])
    found = Travel(fits, 1.0).between(cells)
    assert found == pytest.approx(np.abs(cells[:, 1] - cells[:, None, 1]).astype(float))
    walled = fits.copy()
    walled[:, 31] = NOWHERE
    assert np.isinf(Travel(walled, 1.0).between(cells)[0, 16:]).all()
