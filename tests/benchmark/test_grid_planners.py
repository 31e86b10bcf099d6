"""The grid planners of benchmarks/ (smac_like, theta_star_like, any_angle_exact) on benchmarks/costmap.py."""

from __future__ import annotations

import itertools
import math
from types import ModuleType

import networkx
import numpy as np
import pytest
import shapely
from benchmarks import any_angle_exact, smac_like, theta_star_like
from benchmarks.any_angle_exact import corners_of, shortest_way
from benchmarks.costmap import RESOLUTION, costmap_of
from numpy.typing import NDArray
from tests.support.trials import trials

from trailmark.benchmark.referee import Referee
from trailmark.clock import Deadline
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


@pytest.mark.slow
@pytest.mark.parametrize("module", [smac_like, theta_star_like, any_angle_exact])
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


@pytest.mark.slow
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


@pytest.mark.parametrize("module", [smac_like, theta_star_like, any_angle_exact])
def test_where_there_is_no_way_there_is_no_path(module: ModuleType) -> None:
    robot = Robot.disc(0.3)
    assert planned(module, robot, "shut") is None
    assert planned(module, robot, "block", np.array([5.0, 2.5, 0.0])) is None  # within the block


DRIVES = {
    "omnidirectional": lambda robot: robot,
    "differential": lambda robot: robot.differential(),
    "differential, reverse": lambda robot: robot.differential(reverse=True),
    "Dubins car": lambda robot: robot.steered(0.5, reverse=False),
    "Reeds-Shepp car": lambda robot: robot.steered(0.5),
}


@pytest.mark.slow
@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("walls", ["open", "block"])
def test_hybrid_a_star_plans_what_each_drive_can_do(drive: str, walls: str) -> None:
    path = planned(smac_like, DRIVES[drive](Robot.rectangle(0.6, 0.3)), walls)
    assert path is not None
    # What is checked on cells alone may graze obstacles: the robot that is judged is a cell smaller all around.
    slim = DRIVES[drive](Robot.rectangle(0.6 - 2.0 * RESOLUTION, 0.3 - 2.0 * RESOLUTION))
    world = World("room", (0.0, 0.0, 10.0, 5.0), WALLS[walls])
    assert Referee(world, slim).fault(path.tolist(), START, GOAL) is None
    states = [START, *path[1:-1], GOAL]
    driven = sum(math.hypot(*(b - a)[:2]) for a, b in itertools.pairwise(states))
    assert driven < (1.1 if walls == "open" else 1.25) * math.hypot(*(GOAL - START)[:2])


def test_a_forward_car_that_starts_towards_a_wall_has_no_way_and_one_that_reverses_has() -> None:
    robot, start = Robot.rectangle(0.6, 0.3), np.array([9.4, 2.5, 0.0])
    assert planned(smac_like, robot.steered(1.0, reverse=False), "open", start) is None
    path = planned(smac_like, robot.steered(1.0), "open", start)
    assert path is not None
    ahead = np.diff(path[:, 0]) * np.cos(path[:-1, 2]) + np.diff(path[:, 1]) * np.sin(path[:-1, 2])
    assert ahead.min() < 0.0


@pytest.mark.parametrize("module", [theta_star_like, any_angle_exact])
def test_searches_for_the_disc_around_a_robot_are_not_for_cars(module: ModuleType) -> None:
    assert planned(module, Robot.disc(0.3).steered(1.0), "open") is None


@pytest.mark.slow
@pytest.mark.parametrize("module", [smac_like, theta_star_like, any_angle_exact])
def test_searches_end_when_their_time_is_up(module: ModuleType) -> None:
    checker = StateChecker(World("room", (0.0, 0.0, 10.0, 5.0), WALLS["block"], Robot.disc(0.3)))
    prepared = module.prepare(checker)
    assert module.plan(checker, START, GOAL, 0.0, 0, prepared=prepared) is None
    assert module.plan(checker, START, GOAL, 60.0, 0, prepared=module.prepare(checker)) is not None


def seen_pairs(
    inside: shapely.Geometry, places: FloatArray, a: NDArray[np.int64], b: NDArray[np.int64]
) -> list[tuple[int, int, float]]:
    """Return those of the pairs of places between which a straight line meets nothing, and how far apart they are."""
    seen = ~shapely.intersects(shapely.linestrings(np.stack([places[a], places[b]], axis=1)), inside)
    return list(
        zip(a[seen].tolist(), b[seen].tolist(), np.hypot(*(places[a] - places[b]).T)[seen].tolist(), strict=True)
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(9))  # three densities by turns
def test_the_exact_way_is_the_shortest_of_a_visibility_graph_by_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    blocked = rng.random((9, 11)) < (0.1, 0.2, 0.3)[seed % 3]
    corners = corners_of(blocked)
    cells = [shapely.box(column, row, column + 1, row + 1) for row, column in np.argwhere(corners.blocked)]
    # Where two cells meet at a corner nothing passes; and a line may go along a cell.
    inside = shapely.union_all([cell.buffer(-1e-4) for cell in cells])
    for row, column in np.argwhere(corners.blocked[:-1, :-1]):
        for other in (-1, 1):
            if 0 <= column + other < 11 and corners.blocked[row + 1, column + other]:
                middles = [(column + 0.5, row + 0.5), (column + other + 0.5, row + 1.5)]
                inside = inside.union(shapely.LineString(middles).buffer(1e-4))
        beside = [(column, row, column + 1, row), (column, row, column, row + 1)]
        for a, b, c, d in beside:
            if corners.blocked[d, c]:
                inside = inside.union(shapely.LineString([(a + 0.5, b + 0.5), (c + 0.5, d + 0.5)]).buffer(1e-4))
    free = np.argwhere(~corners.blocked)
    nodes = np.array([(c, r) for r in range(10) for c in range(12)], dtype=float)
    shapely.prepare(inside)
    between = networkx.Graph()
    between.add_weighted_edges_from(seen_pairs(inside, nodes, *np.triu_indices(len(nodes), 1)))
    found = 0
    for _ in range(6):
        ends = free[rng.integers(0, len(free), 2)][:, ::-1] + rng.uniform(0.05, 0.95, (2, 2))
        graph, places, n = between.copy(), np.concatenate([nodes, ends]), len(nodes)
        of_ends = np.concatenate([np.column_stack([np.full(n, end), range(n)]) for end in (n, n + 1)] + [[(n, n + 1)]])
        graph.add_weighted_edges_from(seen_pairs(inside, places, *of_ends.T))
        way = shortest_way(corners, ends[0], ends[1], Deadline.after(60.0))
        if graph.has_node(n) and graph.has_node(n + 1) and networkx.has_path(graph, n, n + 1):
            assert len(way)
            length = float(np.hypot(*np.diff(way, axis=0).T).sum())
            assert length == pytest.approx(networkx.shortest_path_length(graph, n, n + 1, "weight"), abs=2e-3)
            found += 1
        else:
            assert not len(way)
    assert found > 0


def test_the_exact_search_ends_in_time() -> None:
    corners = corners_of(np.random.default_rng(0).random((300, 300)) < 0.2)
    assert not len(shortest_way(corners, np.array([5.5, 5.5]), np.array([290.5, 290.5]), Deadline.after(0.0)))


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
