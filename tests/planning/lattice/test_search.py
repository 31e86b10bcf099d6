"""Lattice searches: certified ways, as cheap as the lattice has them; graphs by networkx, collisions by shapely."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import networkx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few, trials

from trailmark.collision import StateChecker
from trailmark.planning.lattice.cost_to_go import CostToGo
from trailmark.planning.lattice.search import GOAL_EVERY, Lattice
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]
Judge = Callable[..., float]

STRAIGHT = CostToGo.straight()
PLENTY = 1_000_000


@lru_cache(maxsize=64)
def checker(name: str, seed: int) -> StateChecker:
    world = random_world(seed, 25, size=24.0, radii=(0.5, 2.0), discs=0.3, holes=0.2, origin=(-7.0, 3.0))
    return StateChecker(world, ROBOTS[name], cell=0.2)


def valid_states(checker: StateChecker, n: int, rng: np.random.Generator) -> FloatArray:
    xmin, ymin, xmax, ymax = checker.world.bounds
    q = rng.uniform((xmin, ymin, -math.pi), (xmax, ymax, math.pi), (400, 3))
    return np.asarray(q[checker.valid(q)][:n])


def turn(a: FloatArray, b: FloatArray) -> float:
    return abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))


def cost(states: FloatArray) -> float:
    return sum(math.dist(a[:2], b[:2]) + 0.5 * turn(a, b) for a, b in pairwise(states))


def middles(robot: Robot, q: FloatArray) -> NDArray[np.complex128]:
    """The inscribed disc's centre at each configuration, as complex numbers."""
    return np.asarray(q[..., 0] + 1j * q[..., 1] + complex(*robot.inscribed_disc.center) * np.exp(1j * q[..., 2]))


class Chart(NamedTuple):
    """A lattice spelled out: its certified motions, and whether any motion between valid nodes was refused."""

    graph: networkx.Graph
    states: dict[tuple[int, int, int], FloatArray]
    whole: bool


def chart(checker: StateChecker, start: FloatArray, size: float, headings: int) -> Chart:
    """Build the lattice around ``start`` with positions of the inscribed disc's centre in the bounds."""
    centre, first = complex(*checker.robot.inscribed_disc.center), complex(middles(checker.robot, start))
    xmin, ymin, xmax, ymax = checker.world.bounds
    states = {}
    for i in range(math.ceil((xmin - first.real) / size), math.floor((xmax - first.real) / size) + 1):
        for j in range(math.ceil((ymin - first.imag) / size), math.floor((ymax - first.imag) / size) + 1):
            for k in range(headings):
                theta = start[2] + 2.0 * math.pi * k / headings
                place = first + size * complex(i, j) - centre * np.exp(1j * theta)
                states[i, j, k] = np.array([place.real, place.imag, theta])
    valid = checker.valid(np.array(list(states.values())))
    nodes = {key for key, ok in zip(states, valid, strict=True) if ok}
    pairs = []
    for i, j, k in sorted(nodes):
        beside = [(i + 1, j, k), (i, j + 1, k), (i + 1, j + 1, k), (i + 1, j - 1, k)]
        if headings > 1:
            beside.append((i, j, (k + 1) % headings))
        pairs += [((i, j, k), other) for other in beside if other in nodes]
    free = checker.motions_valid(*(np.array([states[pair[end]] for pair in pairs]) for end in (0, 1)))
    graph = networkx.Graph()
    graph.add_node((0, 0, 0))
    for (a, b), ok in zip(pairs, free, strict=True):
        if ok:
            length = math.pi / headings if a[2] != b[2] else size * math.dist(a[:2], b[:2])
            graph.add_edge(a, b, weight=length)
    return Chart(graph, states, bool(free.all()))


def cheapest(
    checker: StateChecker, found: Chart, goal: FloatArray, near: tuple[float, float] = (math.inf, math.inf)
) -> float:
    """The least cost of a node and the straight distance from there, of nodes near the goal and joined to it."""
    costs = networkx.single_source_dijkstra_path_length(found.graph, (0, 0, 0))
    q = np.array([found.states[key] for key in costs])
    away = np.abs(middles(checker.robot, q) - middles(checker.robot, goal))
    turns = np.array([turn(a, goal) for a in q])
    joined = checker.motions_valid(q, np.tile(goal, (len(q), 1))) & (away < near[0]) & (turns < near[1])
    return float((np.array(list(costs.values())) + away)[joined].min(initial=np.inf))


class Known(NamedTuple):
    """A query in a random world, with its lattice spelled out and what reaching the goal costs in it."""

    checker: StateChecker
    start: FloatArray
    goal: FloatArray
    size: float
    headings: int
    chart: Chart
    least: float


@lru_cache(maxsize=16)
def known(name: str, seed: int) -> Known:
    """Return what several tests compare searches with."""
    judged = checker(name, seed)
    start, goal = valid_states(judged, 2, np.random.default_rng(seed + 3))
    size, headings = (0.5, 1) if name == "disc" else (1.0, 8)
    spelled = chart(judged, start, size, headings)
    return Known(judged, start, goal, size, headings, spelled, cheapest(judged, spelled, goal))


def lattice_cost(robot: Robot, way: FloatArray) -> float:
    """What a raw way costs in the lattice: positions count as the disc's centre, its last motion has no turn."""
    steps = np.abs(np.diff(middles(robot, way)))
    return float(steps.sum()) + sum(0.5 * turn(a, b) for a, b in pairwise(way[:-1]))


def cells_crossed(robot: Robot, way: FloatArray, size: float, headings: int) -> set[int]:
    """How many cells the moves of a raw way span, 0 for a turn by one heading; but not its last motion, to the goal."""
    spans = set()
    for a, b in pairwise(way[:-1]):
        step = complex(middles(robot, b) - middles(robot, a)) / size
        parts = abs(step.real), abs(step.imag)
        span = round(max(parts))
        assert all(min(abs(part), abs(part - span)) < 1e-6 for part in parts), step
        assert turn(a, b) == pytest.approx(0.0 if span else 2.0 * math.pi / headings, abs=1e-9)
        spans.add(span)
    return spans


@pytest.mark.slow
@settings(max_examples=few(60))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 5),
    seed=st.integers(0, 10_000),
    headings=st.sampled_from([3, 8, 16]),
    size=st.floats(0.4, 1.5),
    weight=st.sampled_from([1.0, 2.0, 5.0]),
    multi_steps=st.booleans(),
)
def test_ways_are_certified_and_end_where_they_should(
    judge: Judge, name: str, world: int, seed: int, headings: int, size: float, weight: float, multi_steps: bool
) -> None:
    judged = checker(name, world)
    ends = valid_states(judged, 2, np.random.default_rng(seed))
    if len(ends) < 2:
        return
    headings = 1 if name == "disc" else headings
    before = ends.copy()
    guides = (STRAIGHT, CostToGo.of(judged, ends[1], 400))
    for to_go in guides:
        way, taken = Lattice(judged, size, headings).find_path(
            ends[0], ends[1], to_go, weight=weight, budget=20_000, multi_steps=multi_steps
        )
        assert 1 <= taken <= 20_000
        assert np.array_equal(ends, before)
        if len(way):
            judge(judged.world, judged.robot, *ends, way)
            assert judged.motions_valid(way[:-1], way[1:]).all()
            assert cells_crossed(judged.robot, way, size, headings) <= ({0, 1, 2, 4, 8} if multi_steps else {0, 1})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "L", "offset"])
def test_with_weight_1_ways_are_as_cheap_as_the_lattice_has_them(name: str) -> None:
    found = 0
    # From the last down: in those worlds greedy searches lead to dearer ways.
    for seed in (7 - trial for trial in trials(4, of=2)):
        judged, start, goal, size, headings, spelled, least = known(name, seed)
        way, _ = Lattice(judged, size, headings).find_path(start, goal, STRAIGHT, weight=1.0, budget=PLENTY)
        near = (1.5 * size, 3.0 * math.pi / headings if headings > 1 else math.inf)
        best = cheapest(judged, spelled, goal, near)
        # Whoever is near the goal tries to join it, and now and then others do.
        assert len(way) > 0 or not np.isfinite(best)
        if len(way):
            found += 1
            raw = lattice_cost(judged.robot, way)
            assert raw >= least - 1e-4
            # A node whose motion fails takes the next one at hand, which need not be the cheapest.
            assert raw <= best * (1.0 if spelled.whole else 1.05) + 1e-4
    assert found >= 2


@pytest.mark.slow
@pytest.mark.parametrize("headings", [1, 24])
def test_where_no_motion_between_valid_nodes_fails_the_cost_is_exact(headings: int) -> None:
    # A disc's steps are far shorter than anything round about; what turns meets the bounds alone.
    exact = 0
    robot, size = (Robot.disc(0.5), 0.4) if headings == 1 else (Robot.rectangle(0.9, 0.7), 1.0)
    for seed in range(12) if headings == 1 else trials(7):
        rng = np.random.default_rng(seed)
        places = rng.uniform(2, 10, (3 if headings == 1 else 0, 2))
        walls = tuple(Rectangle((float(x), float(y)), *rng.uniform(1.0, 4.0, 2)) for x, y in places)
        judged = StateChecker(World("walls", (0, 0, 12, 12), walls), robot)
        start, goal = valid_states(judged, 2, rng)
        spelled = chart(judged, start, size, headings)
        near = (1.5 * size, 3.0 * math.pi / headings if headings > 1 else math.inf)
        best = cheapest(judged, spelled, goal, near)
        way, _ = Lattice(judged, size, headings).find_path(start, goal, STRAIGHT, weight=1.0, budget=PLENTY)
        if spelled.whole and np.isfinite(best):
            # Now and then nodes farther off join the goal, sooner; but none at more than its least cost.
            assert lattice_cost(robot, way) <= best + 1e-4
            last = next(
                key for key, q in spelled.states.items() if math.dist(q[:2], way[-2][:2]) + turn(q, way[-2]) < 1e-6
            )
            least = networkx.dijkstra_path_length(spelled.graph, (0, 0, 0), last)
            joined = abs(np.diff(middles(robot, way[-2:]))[0])
            assert lattice_cost(robot, way) - joined == pytest.approx(least, abs=1e-4)
            exact += len(way) > 2
    assert exact >= 3


def test_the_nearest_lattice_to_a_straight_way_is_straight() -> None:
    judged = StateChecker(World("open", (0, 0, 20, 20)), Robot.rectangle(2.0, 1.0))
    start, goal = np.array([2.0, 3.0, 0.5]), np.array([17.0, 3.0, 0.5])
    way, taken = Lattice(judged, 1.0, 16).find_path(start, goal, STRAIGHT, weight=1.0, budget=PLENTY)
    assert cost(way) == pytest.approx(15.0)
    assert taken <= GOAL_EVERY


def test_start_and_goal_may_be_one() -> None:
    judged = checker("L", 0)
    q = valid_states(judged, 1, np.random.default_rng(0))[0]
    way, taken = Lattice(judged, 1.0, 16).find_path(q, q, STRAIGHT, weight=2.0, budget=10)
    assert np.array_equal(way, [q, q])
    assert taken == 1


@pytest.mark.parametrize("start", [0.0, math.pi, -math.pi + 1e-9, math.pi / 2, 3.0])
@pytest.mark.parametrize("goal", [math.pi, -math.pi + 1e-9, 0.0, -3.0])
def test_headings_wrap_at_half_a_turn(judge: Judge, start: float, goal: float) -> None:
    # No room to turn but in the chamber at the end of the corridor.
    walls = (Rectangle((8.0, 1.6), 16.0, 3.2), Rectangle((8.0, 6.4), 16.0, 3.2))
    judged = StateChecker(World("turn", (0, 0, 24, 8), walls), Robot.rectangle(2.2, 1.0))
    ends = np.array([[20.0, 4.0, start], [3.0, 4.0, goal]])
    for headings in (16, 5):
        way, _ = Lattice(judged, 0.5, headings).find_path(ends[0], ends[1], STRAIGHT, weight=2.0, budget=200_000)
        if headings == 16 or len(way):
            judge(judged.world, judged.robot, *ends, way)
            assert judged.motions_valid(way[:-1], way[1:]).all()


@pytest.mark.parametrize("multi_steps", [False, True])
def test_exhausted_searches_take_fewer_nodes_than_they_may(multi_steps: bool) -> None:
    # A closed ring about the start.
    ring = tuple(
        Rectangle((10.0 + 4.0 * math.cos(a), 10.0 + 4.0 * math.sin(a)), 1.0, 3.0, a)
        for a in np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)
    )
    for robot, headings in ((Robot.disc(0.5), 1), (Robot.rectangle(1.2, 0.5), 16)):
        judged = StateChecker(World("ring", (0, 0, 20, 20), ring), robot)
        inside, outside = np.array([10.0, 10.0, 0.0]), np.array([2.0, 2.0, 0.0])
        search = partial(
            Lattice(judged, 0.5, headings).find_path, inside, outside, STRAIGHT, weight=2.0, multi_steps=multi_steps
        )
        way, taken = search(budget=PLENTY)
        assert way.shape == (0, 3)
        # No more than there are nodes within the ring, or a stride of 8 cells from there.
        assert 0 < taken < (33 * 33 if multi_steps else 17 * 17) * headings
        # The budget cuts in before that.
        way, cut = search(budget=taken // 2)
        assert way.shape == (0, 3)
        assert cut == taken // 2


@pytest.mark.parametrize("multi_steps", [False, True])
def test_a_search_that_comes_no_nearer_is_given_up(multi_steps: bool) -> None:
    walls = (Rectangle((10.0, 10.0), 1.0, 14.0), Rectangle((7.0, 3.5), 6.0, 1.0), Rectangle((7.0, 16.5), 6.0, 1.0))
    judged = StateChecker(World("pocket", (0, 0, 20, 20), walls), Robot.disc(0.5))
    ends = np.array([[6.0, 10.0, 0.0], [15.0, 10.0, 0.0]])
    search = partial(
        Lattice(judged, 0.5, 1).find_path, ends[0], ends[1], weight=2.0, budget=PLENTY, multi_steps=multi_steps
    )
    whole, taken = search(STRAIGHT)
    assert len(whole) > 2
    none, at_most = search(STRAIGHT, patience=20)
    assert len(none) == 0
    # On the straight way to the wall each node is nearer, 3.5 m of them; from each a stride into the wall is tried.
    assert 20 < at_most <= (38 if multi_steps else 30) < taken
    # A better guide goes on getting nearer.
    found, _ = search(CostToGo.of(judged, ends[1], 1600), patience=20)
    assert len(found) > 2
    again, same = search(STRAIGHT, patience=taken)
    assert np.array_equal(again, whole)
    assert same == taken


@pytest.mark.parametrize("multi_steps", [False, True])
@pytest.mark.parametrize("cells", [0, 1600])
def test_the_limit_prunes(cells: int, multi_steps: bool) -> None:
    judged = StateChecker(World("wall", (0, 0, 20, 20), (Rectangle((10.0, 9.0), 1.0, 16.0),)), Robot.disc(0.5))
    start, goal = np.array([5.0, 9.0, 0.0]), np.array([15.0, 9.0, 0.0])
    guide = CostToGo.of(judged, goal, cells, 0.0) if cells else STRAIGHT
    search = partial(
        Lattice(judged, 0.5, 1).find_path, start, goal, guide, weight=1.0, budget=PLENTY, multi_steps=multi_steps
    )
    free, all_taken = search()
    best = cost(free)
    # A guide that knows eight directions only is no lower bound: the cheapest way may not be found a second time.
    limit = best * (1.05 if cells else 1.0) + 1e-3
    kept, taken = search(limit=limit)
    assert len(kept) > 2
    assert cost(kept) <= limit
    if not cells:
        assert np.array_equal(kept, free)
        assert taken <= all_taken
    none, taken = search(limit=0.9 * best)
    assert none.shape == (0, 3)
    # Only what lies in the ellipse of that length is looked at.
    major = 0.45 * best
    inside = math.pi * major * math.sqrt(major**2 - 25.0) / 0.25
    assert 0 < taken <= 1.2 * inside


@pytest.mark.parametrize("multi_steps", [False, True])
@pytest.mark.parametrize("cells", [0, 400])
def test_the_same_search_gives_the_same_way(multi_steps: bool, cells: int) -> None:
    ways = []
    for _ in range(2):
        judged = StateChecker(checker("L", 1).world, ROBOTS["L"], cell=0.2)
        ends = valid_states(judged, 2, np.random.default_rng(1))
        guide = CostToGo.of(judged, ends[1], cells) if cells else STRAIGHT
        ways.append(
            Lattice(judged, 0.7, 16).find_path(
                ends[0], ends[1], guide, weight=2.0, budget=PLENTY, multi_steps=multi_steps
            )
        )
    assert len(ways[0][0]) > 2
    assert ways[0][1] == ways[1][1]
    assert np.array_equal(ways[0][0], ways[1][0])


@pytest.mark.parametrize("corner", range(4))
@pytest.mark.parametrize("name", ["disc", "rectangle", "offset"])
def test_from_corner_to_corner_of_the_bounds(judge: Judge, name: str, corner: int) -> None:
    # The robot touches two of the bounds, or all but does; the offset one's disc lies off its reference point.
    robot = ROBOTS[name]
    x, y = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)][corner]
    low, high = robot.outline.vertices.min(axis=0), robot.outline.vertices.max(axis=0)
    gap = 2e-3 if name == "disc" else 1e-5
    places = [(gap - low[0], gap - low[1]), (20.0 - gap - high[0], 20.0 - gap - high[1])]
    start = np.array([places[x > 0][0], places[y > 0][1], 0.0])
    goal = np.array([places[x == 0][0], places[y == 0][1], 0.0])
    judged = StateChecker(World("box", (0, 0, 20, 20), (Disc((10.0, 10.0), 2.0),)), robot)
    search = Lattice(judged, 0.7, 1 if name == "disc" else 8)
    for multi_steps in (False, True):
        way, _ = search.find_path(start, goal, STRAIGHT, weight=2.0, budget=PLENTY, multi_steps=multi_steps)
        judge(judged.world, robot, start, goal, way)


@pytest.mark.slow
@settings(max_examples=few(40))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 5),
    seed=st.integers(0, 10_000),
    weight=st.sampled_from([1.0, 2.0]),
    guided=st.booleans(),
)
def test_strides_find_what_is_found_without(
    judge: Judge, name: str, world: int, seed: int, weight: float, guided: bool
) -> None:
    judged = checker(name, world)
    ends = valid_states(judged, 2, np.random.default_rng(seed))
    headings, size = (1, 0.5) if name == "disc" else (8, 0.8)
    to_go = CostToGo.of(judged, ends[1], 400) if guided else STRAIGHT
    search = partial(Lattice(judged, size, headings).find_path, ends[0], ends[1], to_go, weight=weight, budget=PLENTY)
    plain, _ = search()
    strided, taken = search(multi_steps=True)
    if len(strided):
        judge(judged.world, judged.robot, *ends, strided)
    else:
        # Exhausted; what is far from the goal tries to join it now and then only.
        assert taken < PLENTY
        if len(plain):
            away = abs(np.diff(middles(judged.robot, plain[-2:]))[0])
            assert away >= 1.5 * size or (headings > 1 and turn(plain[-2], ends[1]) >= 3.0 * math.pi / headings)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "offset"])
def test_strides_lead_where_single_steps_lead_and_cost_the_same(name: str) -> None:
    found = 0
    for seed in (7 - trial for trial in trials(4, of=2)):
        judged, start, goal, size, headings, _, least = known(name, seed)
        way, _ = Lattice(judged, size, headings).find_path(
            start, goal, STRAIGHT, weight=2.0, budget=PLENTY, multi_steps=True
        )
        if len(way) > 2:
            found += max(cells_crossed(judged.robot, way, size, headings)) > 1
            assert lattice_cost(judged.robot, way) >= least - 1e-4
    assert found >= 2


def test_with_a_guide_strides_find_ways_sooner() -> None:
    taken = {False: 0, True: 0}
    for seed in range(4):
        judged = StateChecker(random_world(seed, 60, size=60.0, radii=(0.5, 4.0)), ROBOTS["rectangle"])
        q = valid_states(judged, 40, np.random.default_rng(seed))
        # From one corner to the other, about.
        start, goal = (q[choose(q[:, 0] + q[:, 1])] for choose in (np.argmin, np.argmax))
        guide = CostToGo.of(judged, goal, 10_000)
        for multi_steps in taken:
            way, nodes = Lattice(judged, 0.5, 16).find_path(
                start, goal, guide, weight=2.0, budget=PLENTY, multi_steps=multi_steps
            )
            assert len(way) > 2
            taken[multi_steps] += nodes
    assert 2 * taken[True] < taken[False]


GATE = World("gate", (0, 0, 20, 20), (Rectangle((10.13, 4.4), 1.5, 8.8), Rectangle((10.13, 14.95), 1.5, 10.1)))
"""A wall with a gap 1.1 m wide, aside of the positions of a lattice that begins at (5, 5)."""


@pytest.mark.parametrize(("size", "headings"), [(0.3, 8), (0.4, 8), (0.4, 16)])
def test_seats_lead_through_gaps_that_no_node_lies_in(judge: Judge, size: float, headings: int) -> None:
    judged = StateChecker(GATE, Robot.rectangle(2.0, 1.0), cell=0.1)
    start, goal = np.array([5.0, 5.0, 0.0]), np.array([15.0, 5.0, 0.3])
    search = partial(
        Lattice(judged, size, headings).find_path,
        start,
        goal,
        CostToGo.of(judged, goal, 40_000),
        weight=2.0,
        budget=PLENTY,
    )
    for multi_steps in (False, True):
        without, taken = search(multi_steps=multi_steps)
        assert len(without) == 0
        assert taken < PLENTY
        way, _ = search(multi_steps=multi_steps, retracts=True)
        assert len(way) > 2
        judge(GATE, judged.robot, start, goal, way)


@pytest.mark.slow
@settings(max_examples=few(30))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 5),
    seed=st.integers(0, 10_000),
    multi_steps=st.booleans(),
)
def test_ways_over_seats_are_certified(judge: Judge, name: str, world: int, seed: int, multi_steps: bool) -> None:
    judged = checker(name, world)
    ends = valid_states(judged, 2, np.random.default_rng(seed))
    headings, size = (1, 0.5) if name == "disc" else (8, 1.2)
    lattice = Lattice(judged, size, headings)
    ways = [
        lattice.find_path(
            ends[0], ends[1], STRAIGHT, weight=1.5, budget=PLENTY, multi_steps=multi_steps, retracts=retracts
        )[0]
        for retracts in (True, True, False)
    ]
    assert np.array_equal(ways[0], ways[1])
    if len(ways[0]):
        judge(judged.world, judged.robot, *ends, ways[0])
        assert judged.motions_valid(ways[0][:-1], ways[0][1:]).all()


@pytest.mark.slow
@pytest.mark.parametrize("beside", [0.5, 4.0])
@pytest.mark.parametrize("turned", [False, True])
def test_no_path_leads_out_of_the_window_that_costs_to_go_are_known_in(beside: float, turned: bool) -> None:
    # A wall across the window, and beyond its left, or lower, edge; the way around it leads outside.
    edge, size = 8.0, (20.0, 10.0)
    wall = (0.5 * (edge - beside + size[0]), 5.0)
    length = size[0] - edge + beside
    ends = np.array([[10.0, 2.0, 0.0], [10.0, 8.0, 0.0]])
    window, bounds = (edge, 0.0, *size), (0.0, 0.0, *size)
    shape = Rectangle(wall, length, 0.4)
    if turned:
        shape = Rectangle((wall[1], wall[0]), 0.4, length)
        ends = ends[:, [1, 0, 2]]
        window, bounds = (0.0, edge, *size[::-1]), (0.0, 0.0, *size[::-1])
    judged = StateChecker(World("w", bounds, (shape,)), Robot.disc(0.3))
    lattice = Lattice(judged, 0.4, 1)
    found = [
        lattice.find_path(ends[0], ends[1], CostToGo.of(judged, ends[1], 15, window=part), weight=1.0, budget=PLENTY)[0]
        for part in (None, window)
    ]
    assert len(found[0]) > 0
    assert len(found[1]) == 0
