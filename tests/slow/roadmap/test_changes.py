"""A roadmap changes in one step or not at all: an exception before any line leaves it whole, and of use."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from tests.helpers.interrupts import interrupted, places_run
from tests.helpers.trials import few, thorough
from tests.helpers.worlds import ROBOTS, random_world, star_polygon

from trailmark import ConfigurationError, Robot, StateChecker, World
from trailmark.collision.kernels import BLOCKED, FREE, UNDECIDED
from trailmark.landmarks import free_samples
from trailmark.motion import motion_of
from trailmark.roadmap import EdgeStatus, Roadmap
from trailmark.roadmap.revalidation import revalidated
from trailmark.shapes import Shape

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


def boxes(*shapes: Shape) -> np.ndarray:
    return np.array([shape.bounding_box() for shape in shapes]).reshape(-1, 4)


def roadmap_in(world: World, robot: Robot) -> Roadmap:
    roadmap = Roadmap(StateChecker(world, robot))
    roadmap.add(free_samples(roadmap.checker, 150, random_state=1))
    roadmap.certify_all()
    return roadmap


@pytest.mark.parametrize("name", ["disc", "rectangle", "L", "car"])
def test_every_edge_has_the_status_that_the_changed_world_gives_it(name: str) -> None:
    robot = ROBOTS["rectangle"].steered(2.0) if name == "car" else ROBOTS[name]
    world = random_world(5, 30, size=40.0, discs=0.3)
    roadmap = roadmap_in(world, robot)
    rng = np.random.default_rng(2)
    gained = lost = dropped = 0
    for _ in range(few(8, of=2)):
        gone = int(rng.integers(len(world.obstacles)))
        come = star_polygon(rng, (float(rng.uniform(0, 40)), float(rng.uniform(0, 40))), 4.0)
        changed = world.edited(add=[come], remove=[gone])
        motion = motion_of(StateChecker(changed, robot))
        before = [np.array(rows) for rows in roadmap.rows()]
        found = revalidated(roadmap, motion, boxes(world.obstacles[gone]), boxes(come))
        for i, rows in enumerate(roadmap.rows()):
            assert np.array_equal(np.array(rows), before[i])
        q, edges, _, status = found.roadmap.rows()
        assert motion.checker.valid(q).all()
        assert len(q) + len(found.dropped) == len(roadmap)
        if len(found.dropped):
            assert not motion.checker.valid(found.dropped).any()
        free = motion.motions_between_valid(q[edges[:, 0]], q[edges[:, 1]])
        assert np.array_equal(status == EdgeStatus.FREE, free)
        gained, lost, dropped = gained + found.gained, lost + found.lost, dropped + len(found.dropped)
        world, roadmap = changed, found.roadmap
    assert gained > 0
    assert lost > 0
    assert dropped > 0
