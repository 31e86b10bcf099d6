"""A roadmap brought up to date, against one whose every edge is certified anew in the changed world."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world, star_polygon

from trailmark import StateChecker
from trailmark.landmarks import free_samples
from trailmark.motion import motion_of
from trailmark.roadmap import EdgeStatus, Roadmap
from trailmark.roadmap.revalidation import revalidated
from trailmark.shapes import Shape
from trailmark.world import Robot, World


def boxes(*shapes: Shape) -> np.ndarray:
    return np.array([shape.bounding_box() for shape in shapes]).reshape(-1, 4)


def roadmap_in(world: World, robot: Robot) -> Roadmap:
    roadmap = Roadmap(StateChecker(world, robot))
    roadmap.add(free_samples(roadmap.checker, 150, random_state=1))
    roadmap.certify_all()
    return roadmap


@pytest.mark.slow
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
