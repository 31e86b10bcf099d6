"""The map of an exploration, and the planner's world that follows it."""

from __future__ import annotations

import numpy as np
import shapely

from trailmark import Robot, World
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap

BOUNDS = (-1.0, 2.0, 4.0, 5.5)


def test_the_world_holds_exactly_what_is_not_free() -> None:
    rng = np.random.default_rng(0)
    known = KnownMap(BOUNDS, 0.1)
    world = World("hall", BOUNDS, robot=Robot.disc(0.2))
    for _ in range(4):
        state = known.state.copy()
        r, c = rng.integers(0, 30, 2)
        state[r : r + 20, c : c + 20] = rng.choice([UNKNOWN, FREE, OCCUPIED], size=state[r : r + 20, c : c + 20].shape)
        known.set_state(state)
        world = known.follow(world)
        for kind, name in ((UNKNOWN, "unknown"), (OCCUPIED, "occupied")):
            shapes = [s for s, i in zip(world.obstacles, world.ids, strict=True) if (i or "").startswith(name)]
            cells = known.centres(*np.nonzero(state == kind))
            region = shapely.union_all([shapely.box(*(xy - 0.05), *(xy + 0.05)) for xy in cells])
            covered = shapely.union_all([shape.polygon().shapely() for shape in shapes])
            assert covered.symmetric_difference(region).area < 1e-9
            assert len(shapes) <= len(cells)
    assert known.revision == 4


def test_what_does_not_change_keeps_its_obstacles() -> None:
    known = KnownMap(BOUNDS, 0.1)
    before = known.follow(World("hall", BOUNDS))
    assert known.follow(before) is before
    state = known.state.copy()
    state[0, 0] = FREE
    known.set_state(state)
    after = known.follow(before)
    assert len(before.difference(after).items) < 6 < len(before.obstacles)
