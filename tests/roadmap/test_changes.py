"""A roadmap changes in one step or not at all: an exception before any line leaves it whole, and of use."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from tests.helpers.oracle import Oracle, motion_states
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.interrupts import interrupted, lines_run, places_run
from tests.support.trials import few, thorough

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError, TrailmarkError
from trailmark.landmarks import free_samples
from trailmark.motion import CurveMotion
from trailmark.roadmap import Roadmap
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.world import Robot

networkx: Any = nx  # whose functions carry no types

FloatArray = NDArray[np.float64]
Action = Callable[[Roadmap], object]

FILES = ("roadmap/roadmap.py", "roadmap/insertion.py", "roadmap/store.py", "roadmap/adjacency.py", "nearest.py")

WORLD = random_world(1, 60, size=40.0, radii=(0.3, 3.0), discs=0.3, holes=0.2)
CAR = Robot.rectangle(1.6, 0.8).steered(1.5)
CHECKERS = {
    "disc": StateChecker(WORLD, ROBOTS["disc"], cell=0.2),
    "rectangle": StateChecker(WORLD, ROBOTS["rectangle"], cell=0.2),
    "car": StateChecker(WORLD, CAR, cell=0.2),
    "forward car": StateChecker(WORLD, CAR.steered(1.5, reverse=False), cell=0.2),
}


def base(name: str) -> Roadmap:
    """A roadmap that has seen some changes, and knows some of its edges."""
    checker = CHECKERS[name]
    roadmap = Roadmap(checker)
    for seed in range(3):
        # Together enough for the index to have a tree, and points outside of it.
        roadmap.add(free_samples(checker, 30, random_state=seed))
    roadmap.shortest_path(0, 40)
    return roadmap


def twin(roadmap: Roadmap) -> Roadmap:
    """A copy, of the same checker."""
    return copy.deepcopy(roadmap, {id(roadmap.checker): roadmap.checker})


def longest_path(roadmap: Roadmap) -> NDArray[np.int64]:
    paths = [roadmap.shortest_path(0, i).nodes for i in range(1, len(roadmap))]
    return max(paths, key=len)


def contents(roadmap: Roadmap) -> tuple[Any, ...]:
    return tuple(rows.copy() for rows in roadmap.rows())


def assert_whole(roadmap: Roadmap) -> None:
    """Assert that all that belongs to nodes and edges agrees, and what is found by them is there."""
    q, edges, lengths, status = roadmap.rows()
    n, m = len(q), len(edges)
    assert len(roadmap) == len(roadmap.configurations) == n
    assert len(lengths) == len(status) == len(roadmap.certified) == m
    assert ((edges >= 0) & (edges < n)).all()
    assert np.isin(status, (BLOCKED, FREE, UNDECIDED)).all()
    assert np.allclose(roadmap.motion.costs(q[edges[:, 0]], q[edges[:, 1]]), lengths, rtol=1e-9, atol=1e-9)
    # The index, against brute force.
    radius = roadmap.motion.radius
    points = np.column_stack([q[:, :2], radius * np.cos(q[:, 2]), radius * np.sin(q[:, 2])])
    found = roadmap._consistent().index().query(points, 4)
    assert np.array_equal(found, np.argsort(cdist(points, points), axis=1, kind="stable")[:, :4])
    # The lists: each edge once at either end.
    arrays = roadmap._consistent().arrays()
    for newest, side in ((arrays.outgoing, 0), (arrays.incoming, 1)):
        for node in range(n):
            entries, entry = [], int(newest[node])
            while entry >= 0:
                entries.append(entry)
                assert len(entries) <= 2 * m
                entry = int(arrays.older[entry])
            own = [2 * e + side for e in np.flatnonzero(edges[:, side] == node)]
            if not roadmap.directed:
                own += [2 * e + 1 - side for e in np.flatnonzero(edges[:, 1 - side] == node)]
            assert sorted(entries) == sorted(own)


def assert_status_is_right(roadmap: Roadmap) -> None:
    """Assert that edges known to be free are certified, and those known to be blocked are not, one by one."""
    q, edges, _, status = roadmap.rows()
    free = roadmap.motion.motions_between_valid(q[edges[:, 0]], q[edges[:, 1]])
    assert free[status == FREE].all()
    assert not free[status == BLOCKED].any()


def straight_ways_are_free(roadmap: Roadmap) -> int:
    """Assert by shapely that certified ways collide nowhere, and that networkx finds none shorter."""
    oracle = Oracle(WORLD, roadmap.checker.robot)
    checked = 0
    for goal in range(1, len(roadmap), 9):
        states = roadmap.configurations[roadmap.shortest_path(0, goal).nodes]
        for a, b in pairwise(states):
            assert not oracle.collides(motion_states(a[None], b[None], 60)[0]).any()
            checked += 1
    graph: Any = nx.Graph()
    _, edges, lengths, status = roadmap.rows()
    for (u, v), length in zip(edges[status == FREE].tolist(), lengths[status == FREE], strict=True):
        graph.add_edge(u, v, length=length)
    for goal in range(1, len(roadmap), 9):
        way = roadmap.shortest_path(0, goal).nodes
        if len(way) > 1:
            length = networkx.shortest_path_length(graph, 0, goal, weight="length")
            cost = sum(graph.edges[u, v]["length"] for u, v in pairwise(way.tolist()))
            assert cost <= length + 1e-9
    return checked


def actions(roadmap: Roadmap) -> dict[str, Action]:
    more = free_samples(roadmap.checker, 40, random_state=9)
    way = longest_path(roadmap)
    states = roadmap.configurations[way].copy()
    first, last = int(way[0]), int(way[-1])
    middles = states
    if not isinstance(roadmap.motion, CurveMotion):
        # Half of its states are nodes.
        middles = np.repeat(states, 2, axis=0)[:-1]
        middles[1::2] = se2.interpolate(states[:-1], states[1:], 0.5)
    found: dict[str, Action] = {
        # 40 more: the index is sorted anew.
        "add": lambda r: r.add(more, neighbours=4),
        "add_path": lambda r: r.add_path(middles),
        "search": lambda r: r.shortest_path(first, last, limit=1e9),
        "certify": lambda r: r.certify_all(),
        "nearest": lambda r: r.nearest(),
    }
    if isinstance(roadmap.motion, CurveMotion):
        parents = np.array([0, 1, len(roadmap)])
        found["add_tree"] = lambda r: r.add_tree(more[:3], parents) if isinstance(r.motion, CurveMotion) else None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", CHECKERS)
def test_a_change_that_is_cut_short_has_not_taken_place(name: str) -> None:
    origin = base(name)
    before = contents(origin)
    ends = 0
    for kind, action in actions(origin).items():
        done = twin(origin)
        action(done)
        after = contents(done)
        places = places_run(FILES, partial(action, twin(origin)))
        assert len(places) > 3
        robot = list(CHECKERS).index(name)
        # Before which of them: each time that a line is run, or once, the first time or the last.
        times = range(len(places))
        moments = list(times if thorough() else dict(zip(places[::-1], times[::-1], strict=True)).values())
        if robot % 2 and not thorough():
            moments = list(dict(zip(places, times, strict=True)).values())
        # Each with one of the robots that have the action: the two cars alone have trees. Or with twice as many.
        step = 2 if kind == "add_tree" or thorough() else 4
        for k in sorted(moments)[robot % step :: step]:
            roadmap = twin(origin)
            assert interrupted(FILES, partial(action, roadmap), k)
            sizes = [len(rows) for rows in contents(roadmap)]
            assert sizes in ([len(rows) for rows in before], [len(rows) for rows in after])
            ends += sizes == [len(rows) for rows in after]
            expected = before if sizes == [len(rows) for rows in before] else after
            assert all(np.array_equal(a, b) for a, b in zip(contents(roadmap)[:3], expected[:3], strict=True))
            # Then as if nothing had happened: the same change, with the same outcome.
            if sizes != [len(rows) for rows in after] or sizes == [len(rows) for rows in before]:
                action(roadmap)
                assert all(np.array_equal(a, b) for a, b in zip(contents(roadmap)[:3], after[:3], strict=True))
            if k % 23 == 0 or k == moments[0]:  # a prime, so that each action and robot has it after other lines
                assert_whole(roadmap)
                assert_status_is_right(roadmap)
    # Some come after the one step.
    assert ends > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle"])
def test_ways_after_interrupts_are_free(name: str) -> None:
    roadmap = base(name)
    checked, k = 0, 0
    for round_ in range(few(40, of=2)):
        q = free_samples(roadmap.checker, 5, random_state=100 + round_)
        k = (k + 7) % lines_run(FILES, lambda q=q: twin(roadmap).add(q))  # type: ignore[misc]
        assert interrupted(FILES, lambda q=q: roadmap.add(q), k)  # type: ignore[misc]
        if round_ % 10 == 9:
            checked += straight_ways_are_free(roadmap)
    assert checked > few(50, of=2)
    assert_whole(roadmap)
    assert_status_is_right(roadmap)


def test_another_exception_leaves_it_whole_too() -> None:
    roadmap = base("rectangle")
    before = contents(roadmap)
    with pytest.raises(ConfigurationError):
        roadmap.add(np.array([[1.0, 2.0, np.nan]]))
    with pytest.raises(ConfigurationError):
        roadmap.add_path(np.array([[1.0, 2.0, 0.0], [1.0, np.inf, 0.0]]))
    assert all(np.array_equal(a, b) for a, b in zip(contents(roadmap), before, strict=True))
    assert_whole(roadmap)


def test_compiled_searches_get_arrays_that_agree() -> None:
    roadmap = base("rectangle")
    n = len(roadmap)
    with pytest.raises(ConfigurationError, match=rf"to_go: expected shape \({n},\), .* got \({n - 1},\)"):
        roadmap.shortest_path(0, 1, to_go=np.zeros(n - 1))
    with pytest.raises(ConfigurationError, match="banned: expected shape"):
        roadmap.shortest_path(0, 1, banned=np.zeros(n + 1, np.bool_))
    with pytest.raises(ConfigurationError, match=rf"node: expected 0 or more, below {n}, got {n}"):
        roadmap.distances_to(n)
    with pytest.raises(ConfigurationError, match="neighbours: expected 1 or more, got 0"):
        roadmap.add(roadmap.configurations[:1], neighbours=0)
    with pytest.raises(ConfigurationError, match=rf"node: .* got {n}"):
        Roadmap.from_arrays(roadmap.checker, roadmap.configurations, np.array([[0, n]], np.int32), roadmap.status[:1])
    with pytest.raises(TrailmarkError, match="arrays of"):
        Roadmap.from_arrays(roadmap.checker, roadmap.configurations, roadmap.edges, roadmap.status[:-1])
    with pytest.raises(ConfigurationError, match="got -1"):
        RoadmapSnapshot(roadmap).between(-1, 0)


def test_rows_are_of_one_moment() -> None:
    roadmap = base("rectangle")
    rows = roadmap.rows()
    sizes = [len(r) for r in rows]
    roadmap.add(free_samples(roadmap.checker, 100, random_state=5))
    assert [len(r) for r in rows] == sizes
    assert len(roadmap.rows()[1]) > sizes[1]
