"""A roadmap changes in one step or not at all: an exception before any line leaves it whole, and of use."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from tests.helpers.interrupts import interrupted, lines_run, places_run
from tests.helpers.oracles import Oracle, motion_states
from tests.helpers.trials import few, thorough
from tests.helpers.worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.errors import ConfigurationError
from trailmark.landmarks import free_samples
from trailmark.roadmap import Roadmap
from trailmark.world import Robot

Action = Callable[[Roadmap], object]

FILES = ("roadmap/roadmap.py", "roadmap/search.py")

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
    roadmap = Roadmap(CHECKERS[name])
    for seed in range(3):
        roadmap.add(free_samples(roadmap.checker, 30, random_state=seed))
    roadmap.shortest_path(0, 40)
    return roadmap


def twin(roadmap: Roadmap) -> Roadmap:
    """A copy, of the same checker."""
    return copy.deepcopy(roadmap, {id(roadmap.checker): roadmap.checker})


def contents(roadmap: Roadmap) -> tuple[NDArray[Any], ...]:
    return tuple(rows.copy() for rows in roadmap.rows())


def same(one: tuple[NDArray[Any], ...], two: tuple[NDArray[Any], ...]) -> bool:
    """Whether nodes, edges and lengths are the same; a status may have been found out meanwhile."""
    return all(np.array_equal(a, b) for a, b in zip(one[:3], two[:3], strict=True))


def assert_whole(roadmap: Roadmap) -> None:
    """Assert that all that belongs to nodes and edges agrees, that what is found by them is there, and is right."""
    q, edges, lengths, status = roadmap.rows()
    assert len(lengths) == len(status) == len(edges)
    assert ((edges >= 0) & (edges < len(q))).all()
    assert np.isin(status, (BLOCKED, FREE, UNDECIDED)).all()
    assert np.allclose(roadmap.motion.costs(q[edges[:, 0]], q[edges[:, 1]]), lengths, rtol=1e-9, atol=1e-9)
    free = roadmap.motion.motions_between_valid(q[edges[:, 0]], q[edges[:, 1]])
    assert free[status == FREE].all()
    assert not free[status == BLOCKED].any()
    radius = roadmap.motion.radius
    points = np.column_stack([q[:, :2], radius * np.cos(q[:, 2]), radius * np.sin(q[:, 2])])
    tree, links = roadmap._graph().tree, roadmap._graph().links
    found = tree.query(points, np.arange(1, 5))[1]
    assert np.array_equal(found, np.argsort(cdist(points, points), axis=1, kind="stable")[:, :4])
    # Each edge once at its first node, and at its second too if it leads both ways.
    there = np.column_stack([np.repeat(np.arange(len(q)), np.diff(links.start)), links.node])
    expected = edges if roadmap.directed else np.vstack([edges, edges[:, ::-1]])
    assert sorted(map(tuple, there.tolist())) == sorted(map(tuple, expected.tolist()))
    assert np.array_equal(links.length, lengths[links.edge])


def actions(roadmap: Roadmap) -> dict[str, Action]:
    more = free_samples(roadmap.checker, 40, random_state=9)
    way = max((roadmap.shortest_path(0, i).nodes for i in range(1, len(roadmap))), key=len)
    states = roadmap.configurations[way].copy()
    states[1::2, 0] += 1e-9  # half of its states are nodes
    parents = np.array([0, 1, len(roadmap)])
    return {
        "add": lambda r: r.add(more, neighbours=4),
        "add_path": lambda r: r.add_path(states),
        "add_tree": lambda r: r.add_tree(more[:3], parents),
        "search": lambda r: r.shortest_path(int(way[0]), int(way[-1]), limit=1e9),
        "certify": lambda r: r.certify_all(),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", CHECKERS)
def test_a_change_that_is_cut_short_has_not_taken_place(name: str) -> None:
    origin, robot = base(name), list(CHECKERS).index(name)
    before, ends = contents(origin), 0
    for action in actions(origin).values():
        done = twin(origin)
        action(done)
        after = contents(done)
        places = places_run(FILES, partial(action, twin(origin)))
        assert len(places) > 3
        # Before each line that is run: each time, or once, with every other robot.
        times = range(len(places))
        moments = times if thorough() else sorted(dict(zip(places, times, strict=True)).values())[robot % 2 :: 2]
        for k in moments:
            roadmap = twin(origin)
            assert interrupted(FILES, partial(action, roadmap), k)
            now = contents(roadmap)
            assert same(now, before) or same(now, after)
            ends += same(now, after) and not same(before, after)
            # Then as if nothing had happened: the same change, with the same outcome.
            if same(now, before):
                action(roadmap)
                assert same(contents(roadmap), after)
            if k % 23 == 0 or k == moments[0]:  # a prime, so that each action and robot has it after other lines
                assert_whole(roadmap)
    # Some come after the one step.
    assert ends > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle"])
def test_ways_after_interrupts_are_free(name: str) -> None:
    roadmap, oracle = base(name), Oracle(WORLD, CHECKERS[name].robot)
    checked = k = 0
    for round_ in range(few(40, of=2)):
        q = free_samples(roadmap.checker, 5, random_state=100 + round_)
        k = (k + 7) % lines_run(FILES, lambda q=q: twin(roadmap).add(q))  # type: ignore[misc]
        assert interrupted(FILES, lambda q=q: roadmap.add(q), k)  # type: ignore[misc]
        for goal in range(1, len(roadmap), 9) if round_ % 10 == 9 else ():
            states = roadmap.configurations[roadmap.shortest_path(0, goal).nodes]
            for a, b in pairwise(states):
                assert not oracle.collides(motion_states(a[None], b[None], 60)[0]).any()
                checked += 1
    assert checked > few(50, of=2)
    assert_whole(roadmap)


def test_bad_input_changes_nothing_and_rows_are_of_one_moment() -> None:
    roadmap = base("rectangle")
    rows, before = roadmap.rows(), contents(roadmap)
    for call, states in (
        (roadmap.add, [[1.0, 2.0, np.nan]]),
        (roadmap.add_path, [[1.0, 2.0, 0.0], [1.0, np.inf, 0.0]]),
    ):
        with pytest.raises(ConfigurationError):
            call(np.array(states))
    assert same(contents(roadmap), before)
    roadmap.add(free_samples(roadmap.checker, 100, random_state=5))
    assert same(rows, before)
    assert len(roadmap.rows()[1]) > len(rows[1])
    assert_whole(roadmap)
