"""The survey of what is left to be seen, and the strategies that choose from it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely

from trailmark import Goal, LandmarkPlanner, Robot, World
from trailmark.exploration.frontiers import frontiers_of, sight
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.strategies import STRATEGIES, Outlook, covering_tour
from trailmark.exploration.survey import MOST_TRIES, Memory, Survey, survey
from trailmark.se2 import FloatArray

ROBOT = Robot.disc(0.2)


def known_of(rows: list[str], cell: float = 0.1) -> KnownMap:
    """A map of a drawing, the largest y first: ``.`` free, ``#`` occupied, ``?`` unknown."""
    state = np.array([["?.#".index(c) for c in row] for row in rows[::-1]], dtype=np.uint8)
    known = KnownMap((0.0, 0.0, cell * state.shape[1], cell * state.shape[0]), cell)
    known.set_state(state)
    return known


def room(door: int = 0) -> KnownMap:
    """A room, in the wall of which a part, so many cells wide, is unknown."""
    known = known_of(["#" * 30, *["#" + "." * 28 + "#"] * 28, "#" * 30])
    state = known.state.copy()
    state[14 : 14 + door, -1] = UNKNOWN
    known.set_state(state)
    return known


def look(known: KnownMap, pose: FloatArray, memory: Memory) -> tuple[Survey, LandmarkPlanner]:
    planner = LandmarkPlanner(known.follow(World("hall", known.bounds, robot=ROBOT)), ROBOT, seed=0)
    return survey(known, planner.checker, pose, None, 2.0, np.random.default_rng(0), memory, pose[None]), planner


def test_a_closed_room_is_done_by_proof() -> None:
    known = room()
    found, _ = look(known, np.array([1.5, 1.5, 0.0]), Memory.of(known))
    assert len(found.outlook.landmarks) == 0
    assert found.doubts is None


def test_a_door_is_seen_from_a_landmark_to_which_a_path_leads() -> None:
    known, here = room(door=6), np.array([0.5, 0.5, 0.0])
    found, planner = look(known, here, Memory.of(known))
    assert found.outlook.sees.any(axis=0).all()
    assert found.any_heading[0]
    assert planner.plan(here, Goal(pose=tuple(found.outlook.landmarks[0, :2].tolist()))).status == "solved"
    assert all((known.state[cells] == UNKNOWN).all() for cells in found.expected)


def test_what_no_way_leads_to_is_put_off_until_something_changes_there_and_leaves_doubts() -> None:
    known, here = room(door=6), np.array([0.5, 0.5, 0.0])
    memory, tries = Memory.of(known), 0
    found = look(known, here, memory)[0]
    while len(found.outlook.landmarks):
        memory.refuse(known, found.outlook.landmarks[0], certainly=False)
        assert memory.failed == (tries := tries + 1)
        found = look(known, here, memory)[0]
    assert found.doubts is not None
    assert MOST_TRIES <= tries <= 20
    assert (memory.refused[known.state == FREE] >= MOST_TRIES).all()
    # The robot has driven since, and something stands there now, or there is more room.
    memory.failed = 0
    assert not len(look(known, here, memory)[0].outlook.landmarks)
    state = known.state.copy()
    state[20, 20] = OCCUPIED
    known.set_state(state)
    memory.failed = 0
    assert len(look(known, here, memory)[0].outlook.landmarks)


@pytest.mark.parametrize("seed", range(20))
def test_lines_of_sight_are_those_of_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = np.where(rng.random((12, 12)) < 0.2, OCCUPIED, FREE).astype(np.uint8)
    state[5, 5] = UNKNOWN
    places = np.vstack([rng.uniform(0.0, 12.0, (50, 2)), np.indices((12, 12)).reshape(2, -1).T + 0.5])
    edge = np.array([[5.5, 5.0, 0.0, 1.0]])
    cells = [shapely.box(c, r, c + 1, r + 1) for r, c in np.argwhere(state != FREE).tolist()]
    blocked = shapely.union_all(cells)
    found = sight(state, places, edge, np.array([9.0]))[:, 0]
    for place, seen in zip(places, found, strict=True):
        line = shapely.LineString([place, edge[0, :2]])
        free = line.intersection(blocked).length < 1e-9
        assert seen == (free and line.length <= 9.0 and place[1] < 5.0)


OPEN = {
    "wall": (["......", "#???##", "??????"], 3),
    "gap in a wall": (["......", "##??##", "??????"], 0),
    "corner": (["......", "##??..", "????..", "???#.."], 4),
    "gap at a corner": ([".....", "..##.", ".?#..", "....."], 0),
    "post": ([".....", ".....", "..?..", ".....", "....."], 4),
}


@pytest.mark.parametrize(("rows", "edges"), OPEN.values(), ids=OPEN.keys())
def test_gaps_of_two_cells_in_a_surface_are_not_looked_through(rows: list[str], edges: int) -> None:
    found = frontiers_of(known_of(rows).state, 100.0)
    assert len(found.edges) == len(found.unknown) == len(found.group)
    assert len(found.edges) == edges


def outlook(places: list[tuple[float, float]], sees: list[list[int]], areas: list[float] | None = None) -> Outlook:
    """Landmarks in the open, the robot at the origin."""
    xy = np.array(places)
    between = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    n = len(xy)
    seen = np.zeros((n, 1 + max(g for row in sees for g in row)), np.bool_)
    for i, row in enumerate(sees):
        seen[i, row] = True
    return Outlook(
        here=np.zeros(3),
        home=None,
        landmarks=np.column_stack([xy, np.zeros(n)]),
        costs=np.hypot(*xy.T),
        between=between,
        home_costs=np.zeros(n),
        areas=np.ones(n) if areas is None else np.array(areas),
        frontiers=np.ones(seen.shape[1]),
        sees=seen,
        sensor_range=5.0,
    )


def test_each_strategy_has_a_name_and_returns_a_landmark() -> None:
    o = outlook([(1.0, 0.0), (9.0, 0.0), (-2.0, 0.0)], [[0], [1], [2]], [0.1, 0.1, 40.0])
    chosen = {name: strategy(o) for name, strategy in STRATEGIES.items()}
    assert chosen == {"nearest-frontier": 0, "gain-per-cost": 2, "tour": 2}


def test_what_is_left_on_one_side_is_seen_before_the_far_other_side() -> None:
    # Nearest first would go to the right, and come back for the landmark on the left.
    o = outlook([(1.0, 0.0), (-1.2, 0.0), (3.0, 0.0), (9.0, 0.0)], [[0], [1], [2], [3]])
    assert STRATEGIES["nearest-frontier"](o) == 0
    assert STRATEGIES["tour"](o) == 1


def best_covering(ways: np.ndarray, sees: np.ndarray) -> float:
    n = len(sees)
    best = np.inf
    for k in range(1, n + 1):
        for chosen in itertools.permutations(range(n), k):
            if sees[list(chosen)].any(axis=0).all():
                stops = [0, *(c + 1 for c in chosen), n + 1]
                best = min(best, sum(ways[a, b] for a, b in itertools.pairwise(stops)))
    return best


@pytest.mark.parametrize("seed", range(12))
def test_tours_see_everything_and_are_nearly_as_short_as_the_shortest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m = 6, 5
    xy = rng.uniform(0.0, 10.0, (n + 1, 2))
    ways = np.zeros((n + 2, n + 2))
    ways[:-1, :-1] = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    sees = rng.random((n, m)) < 0.4
    sees[rng.integers(0, n, m), np.arange(m)] = True
    order = covering_tour(ways, sees)
    assert sees[order].any(axis=0).all()
    assert len(set(order.tolist())) == len(order)
    stops = [0, *(order + 1).tolist(), n + 1]
    length = sum(ways[a, b] for a, b in itertools.pairwise(stops))
    assert length <= 1.35 * best_covering(ways, sees) + 1e-9
