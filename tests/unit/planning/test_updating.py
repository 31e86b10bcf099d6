"""A planner that is brought up to date, against one that is built anew."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest
from tests.helpers.trials import trials
from tests.helpers.worlds import ROBOTS, random_world, star_polygon

from trailmark import Disc, KeepOutZone, LandmarkPlanner, Moving, Rectangle, Robot, World, WorldError


def edit(world: World, rng: np.random.Generator) -> World:
    """Return the world after one random change."""
    count, size = len(world.obstacles), world.bounds[2]
    kind = int(rng.integers(3))
    if kind == 0:
        center = (float(rng.uniform(0, size)), float(rng.uniform(0, size)))
        return world.edited(add=[star_polygon(rng, center, 3.0)])
    if kind == 1:
        return world.edited(remove=[int(rng.integers(count))])
    return world.edited(move={int(rng.integers(count)): (*rng.normal(0.0, 2.0, 2), rng.normal())})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["disc", "rectangle", "L"])
def test_it_knows_what_one_built_anew_knows(name: str) -> None:
    world, robot, rng = random_world(3, 40, size=40.0, discs=0.3), ROBOTS[name], np.random.default_rng(1)
    planner = LandmarkPlanner(world, robot, seed=0)
    planner.build(200)
    changed = 0
    for _ in trials(12, of=2):
        world = edit(world, rng)
        update = planner.update(world)
        assert update.changes == 1
        changed += update.gained + update.lost
        anew = LandmarkPlanner(world, robot, seed=0)
        q = np.column_stack([rng.uniform(0, 40, (300, 2)), rng.uniform(-3, 3, 300)])
        assert np.array_equal(planner.checker.valid(q), anew.checker.valid(q))
        assert np.array_equal(planner.checker.clearance(q), anew.checker.clearance(q))
        assert np.array_equal(planner.checker.field.distance, anew.checker.field.distance)
        nodes, edges = planner.roadmap.configurations, planner.roadmap.edges[planner.roadmap.certified]
        assert anew.motion.motions_valid(nodes[edges[:, 0]], nodes[edges[:, 1]]).all()
    assert changed > 0


def test_bad_changes_change_nothing() -> None:
    world = random_world(3, 10, size=40.0)
    planner = LandmarkPlanner(world, ROBOTS["disc"], seed=0)
    other = random_world(4, 10, size=40.0)
    with pytest.raises(WorldError):
        planner.update(other.difference(other.edited(remove=[2])))
    with pytest.raises(WorldError, match="expected"):
        planner.update("pallet")  # type: ignore[arg-type]
    assert planner.world is world


def test_the_world_is_the_users_and_its_zones_can_be_opened() -> None:
    zone = KeepOutZone(Rectangle((5.0, 4.0), 2.0, 8.0).polygon())
    world = World("zone", (0.0, 0.0, 10.0, 10.0), (Disc((2.0, 8.0), 0.3),), zones=(zone,))
    planner = LandmarkPlanner(world, Robot.disc(0.3), seed=0)
    assert planner.world is world
    with pytest.raises(WorldError, match="keep-out zone 0"):
        planner.world.edited(remove=["keep-out zone 0"])
    planner.update(planner.world.edited(add=[Moving(Disc((2.0, 2.0), 0.3), (0.0, 0.0), 1.0)]))
    assert len(planner.world.obstacles) == 2
    assert not planner.checker.valid((5.0, 2.0, 0.0))
    assert not planner._models.standing.checker.valid((5.0, 2.0, 0.0))
    planner.update(replace(planner.world, zones=()))
    assert planner.checker.valid((5.0, 2.0, 0.0))
    assert planner.plan((1.0, 1.0, 0.0), (9.0, 1.0, 0.0)).cost == pytest.approx(8.0)


@pytest.mark.slow
def test_each_query_sees_one_world_while_updates_go_on() -> None:
    """A wall with its door now left, now right: a path through a closed door would be a mixture."""
    left = World("left", (0.0, 0.0, 20.0, 20.0), (Rectangle((12.5, 10.0), 15.0, 1.0),))
    right = World("right", (0.0, 0.0, 20.0, 20.0), (Rectangle((7.5, 10.0), 15.0, 1.0),))
    planner = LandmarkPlanner(left, ROBOTS["disc"], seed=0)
    done, wrong, asked = threading.Event(), list[str](), list[int]()

    def ask() -> None:
        while not done.is_set():
            path = planner.plan((10.0, 2.0, 0.0), (10.0, 18.0, 0.0), 60.0, max_iterations=1, gap=np.inf).path
            if path is None:
                wrong.append("no path")
                return
            free = [LandmarkPlanner(w, ROBOTS["disc"], warm=False).motion for w in (left, right)]
            ways = [bool(motion.motions_valid(path.states[:-1], path.states[1:]).all()) for motion in free]
            asked.append(ways.index(True) if any(ways) else -1)
            if not any(ways):
                wrong.append(repr(path.states))

    threads = [threading.Thread(target=ask) for _ in range(2)]
    for thread in threads:
        thread.start()
    for i in range(40):
        planner.update(right if i % 2 == 0 else left)
        done.wait(0.01)
    done.set()
    for thread in threads:
        thread.join()
    assert not wrong
    assert {0, 1} <= set(asked)
