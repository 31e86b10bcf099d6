"""StateChecker.edited: the answers of a checker built anew, and nothing changes for those who use the old one."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.random_worlds import ROBOTS, random_states, random_world, short_motions, star_polygon
from tests.support.trials import few, trials

from trailmark import Disc, Polygon, Rectangle, Robot, World, WorldError
from trailmark.collision import StateChecker
from trailmark.world import RiskBound

KINDS = ["disc", "rectangle", "L", "thin"]


def random_edit(world: World, rng: np.random.Generator, kind: int | None = None) -> World:
    """Return the world with an obstacle added (kind 0), removed, moved or replaced (3); by default any of these."""
    i = int(rng.integers(len(world.obstacles)))
    center = tuple(rng.uniform(0.0, 20.0, 2).tolist())
    shape = (
        Disc(center, float(rng.uniform(0.1, 1.5))),
        Rectangle(center, float(rng.uniform(0.1, 3.0)), float(rng.uniform(0.1, 3.0)), float(rng.uniform(-3, 3))),
        star_polygon(rng, center, float(rng.uniform(0.2, 2.0))),
    )[int(rng.integers(3))]
    match int(rng.integers(4)) if kind is None else kind:
        case 0:
            return world.edited(add=[shape])
        case 1:
            return world.edited(remove=[i])
        case 2:
            return world.edited(move={i: (*rng.normal(0.0, 0.5, 2), float(rng.normal()))})
        case _:
            return world.edited(replace={i: shape})


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_an_edited_checker_answers_as_one_built_anew(kind: str) -> None:
    rng = np.random.default_rng([5, KINDS.index(kind)])
    world = random_world(3, 25, size=20.0, radii=(0.3, 2.0), discs=0.3, holes=0.4, boundary=True)
    checker = StateChecker(world, ROBOTS[kind])
    n = 300
    checker.scene.collides(np.array([5.0, 5.0, 0.0]))
    for k in trials(12):
        world = random_edit(world, rng, k % 4)
        checker = checker.edited(world)
        anew = StateChecker(world, ROBOTS[kind])
        assert checker.world is world
        q = random_states(world, n, rng)
        free = checker.valid(q)
        assert np.array_equal(free, anew.valid(q))
        assert np.array_equal(checker.clearance(q), anew.clearance(q))
        a, b = short_motions(world, n, rng, 2.0)
        assert np.array_equal(checker.motions_valid(a, b), anew.motions_valid(a, b))
        assert np.array_equal(
            checker.motions_by_field(q[free][:-1], q[free][1:]), anew.motions_by_field(q[free][:-1], q[free][1:])
        )
        for row in q[:20]:
            assert checker.scene.collides(row) == anew.scene.collides(row)


@pytest.mark.slow
def test_the_old_checker_stays_as_it_is() -> None:
    rng = np.random.default_rng(0)
    world = random_world(3, 25, size=20.0, radii=(0.3, 2.0), discs=0.3)
    checker = StateChecker(world, ROBOTS["rectangle"])
    q = random_states(world, 2000, rng)
    old: list[tuple[StateChecker, np.ndarray, np.ndarray]] = []
    for _ in range(20):
        old = [(checker, checker.valid(q), checker.clearance(q)), *old[:3]]
        world = random_edit(world, rng)
        checker = checker.edited(world)
        for before, free, clearance in old:
            assert np.array_equal(before.valid(q), free)
            assert np.array_equal(before.clearance(q), clearance)
    assert any(not np.array_equal(free, checker.valid(q)) for _, free, _ in old)


@pytest.mark.slow
def test_threads_see_one_world_or_another_and_no_mixture() -> None:
    """Memory of old versions is used again while others are being asked."""
    rng = np.random.default_rng(1)
    worlds = [random_world(3, 25, size=20.0, radii=(0.3, 2.0), discs=0.3)]
    for _ in range(40):
        worlds.append(random_edit(worlds[-1], rng))
    q = random_states(worlds[0], 300, rng)
    expected = {id(world): StateChecker(world, ROBOTS["rectangle"]).clearance(q) for world in worlds}
    newest = [StateChecker(worlds[0], ROBOTS["rectangle"])]
    done = threading.Event()

    def ask() -> int:
        count = 0
        while not done.is_set() or count == 0:
            checker = newest[0]
            if not np.array_equal(checker.clearance(q), expected[id(checker.world)]):
                return -1
            count += 1
        return count

    with ThreadPoolExecutor(3) as threads:
        asked = [threads.submit(ask) for _ in range(3)]
        try:
            for _ in range(few(10, of=5)):
                for world in (*worlds[1:], *worlds[-2::-1]):
                    newest[0] = newest[0].edited(world)
        finally:
            done.set()
        assert all(answers.result() > 0 for answers in asked)


def test_obstacles_in_another_order_change_nothing() -> None:
    world = random_world(3, 25, size=20.0, radii=(0.3, 2.0), discs=0.3)
    checker = StateChecker(world, ROBOTS["rectangle"])
    turned = replace(world, obstacles=world.obstacles[::-1])
    edited = checker.edited(turned).edited(turned.edited(remove=[0]))
    anew = StateChecker(edited.world, ROBOTS["rectangle"])
    q = random_states(world, 1000, np.random.default_rng(0))
    assert np.array_equal(edited.valid(q), anew.valid(q))
    assert np.array_equal(edited.clearance(q), anew.clearance(q))


def test_what_cannot_be_edited_is_built_anew() -> None:
    world = random_world(3, 200, size=20.0)
    checker = StateChecker(world, Robot.rectangle(1.0, 0.5), cell=0.4)
    wider = replace(world, bounds=(0.0, 0.0, 30.0, 20.0))
    walled = replace(world, boundary=Polygon(np.array([[1.0, 1.0], [19.0, 1.0], [19.0, 19.0], [1.0, 19.0]])))
    for other in (wider, walled, random_world(4, 200, size=20.0)):
        edited, anew = checker.edited(other), StateChecker(other, checker.robot, cell=0.4)
        q = random_states(other, 500, np.random.default_rng(0))
        assert edited.robot is checker.robot
        assert np.array_equal(edited.valid(q), anew.valid(q))
        assert edited.field[1:] == anew.field[1:]


def test_a_world_grown_for_another_robot_is_refused() -> None:
    world = random_world(3, 5, size=20.0)
    checker = StateChecker(world, Robot.rectangle(2.0, 1.0))
    risk = RiskBound(0.9, np.eye(3) * 1e-4, reach=0.1)
    with pytest.raises(WorldError, match="grown for a robot that reaches"):
        checker.edited(replace(world, risk=risk))
