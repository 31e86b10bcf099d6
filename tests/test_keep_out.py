"""Keep-out zones as obstacles: in worlds, checkers and audits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trailmark import (
    CostZone,
    Disc,
    KeepOutZone,
    OneWayZone,
    Polygon,
    Robot,
    SpeedZone,
    StateChecker,
    World,
    check_path,
)
from trailmark.errors import ConfigurationError, WorldError
from trailmark.world import with_keep_outs

SQUARE = Polygon(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]))
HOLE = np.array([[0.5, 0.5], [1.0, 0.5], [1.0, 1.0]])
ZONES = (
    CostZone(SQUARE, 3.0),
    KeepOutZone(Polygon(SQUARE.vertices, (HOLE,))),
    OneWayZone(SQUARE, 1.5, 0.8),
    SpeedZone(SQUARE, 0.3),
)


def test_keep_out_zones_are_obstacles_of_the_world_that_is_checked() -> None:
    world = World("w", (0, 0, 9, 9), (Disc((5, 5), 1),), zones=ZONES)
    occupied = with_keep_outs(world)
    assert occupied.obstacles == (Disc((5, 5), 1), ZONES[1].region)
    assert occupied.ids == (None, "keep-out zone 1")
    assert with_keep_outs(occupied) is occupied
    assert occupied.zones == ZONES
    assert with_keep_outs(occupied.edited(remove=[0])).ids == ("keep-out zone 1",)
    assert with_keep_outs(occupied.edited(remove=["keep-out zone 1"])).obstacles == occupied.obstacles
    without = replace(world, zones=(ZONES[0],))
    assert with_keep_outs(without) is without
    with pytest.raises(WorldError, match="'keep-out zone 1' is the name of a zone"):
        with_keep_outs(world.edited(add={"keep-out zone 1": Disc((2, 2), 1)}))


def test_a_checker_keeps_the_whole_robot_out() -> None:
    robot = Robot.rectangle(1.0, 0.4)
    world = World("w", (0, 0, 9, 9), (Disc((5, 5), 1),), robot, zones=ZONES)
    checker = StateChecker(world)
    inside, touching, beyond = (1.0, 1.8, 0.0), (2.5, 1.0, 0.0), (2.49, 1.0, 0.0)
    assert checker.valid([inside, touching, beyond]).tolist() == [False, True, False]
    assert not checker.motion_valid((1.0, 3.0, 0.0), (3.0, 1.0, 0.0))
    with pytest.raises(ConfigurationError, match=r"goal .* is not valid: .* overlaps keep-out zone 1 by 0\.01 m"):
        checker.require_valid(beyond, "goal")
    checker.require_for(world)
    moved = checker.edited(world.edited(move={0: (1.0, 0.0)}))
    assert moved.valid([beyond, (3.7, 5.0, 0.0)]).tolist() == [False, True]
    without = moved.edited(replace(world, zones=()))
    assert without.valid(inside)
    audit = check_path(world, None, [[3.0, 3.0, 0.0], [3.0, 1.0, 0.0], [2.0, 1.0, 0.0], [3.0, 1.0, 0.0]])
    assert [(c.obstacle, round(c.depth, 3)) for c in audit.collisions] == [("keep-out zone 1", 0.5)]
