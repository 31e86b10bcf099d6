"""Cars' paths as files have them: straight motions between the states that are returned meet nothing either."""

from __future__ import annotations

import numpy as np

from trailmark import (
    CurvePath,
    Disc,
    OneWayZone,
    Path,
    Polygon,
    Rectangle,
    Robot,
    StateChecker,
    Steering,
    World,
    check_path,
)
from trailmark.motion import motion_of
from trailmark.planning.verification import Verification
from trailmark.zones import Zone

RADIUS = 2.0
ROBOT = Robot.rectangle(1.0, 0.4).steered(RADIUS)
AROUND = CurvePath(np.array([[2.0, 7.0, 0.0], [8.0, 7.0, 0.0], [10.0, 5.0, -np.pi / 2]]), Steering(RADIUS))
"""Straight ahead, then a quarter of a circle about (8, 5)."""


def returned(world: World, leaves: bool = False) -> Path:
    checker = StateChecker(world, ROBOT)
    path = Verification(checker, motion_of(checker), seed=0).followed_by_lines(AROUND, leaves)
    assert isinstance(path, CurvePath)
    assert path == AROUND
    return path


def world_with(*obstacles: Disc | Rectangle, zones: tuple[Zone, ...] = ()) -> World:
    return World("w", (0.0, 0.0, 16.0, 12.0), obstacles, zones=zones)


def wrong_way(gap: float = 1e-5) -> OneWayZone:
    """Return a zone whose corners lie ``gap`` metres inside the arc, and which may be travelled to the left alone."""
    # A number of which no number of states on the arc is a multiple: corners between two of them are what lines meet.
    angles = np.linspace(0.0, 2.0 * np.pi, 61, endpoint=False)
    corners = np.array([8.0, 5.0]) + (RADIUS - gap) * np.column_stack([np.cos(angles), np.sin(angles)])
    return OneWayZone(Polygon(corners), heading=np.pi, tolerance=0.2)


def test_lines_beside_a_one_way_zone() -> None:
    world = world_with(zones=(wrong_way(),))
    assert check_path(world, ROBOT, AROUND).free
    assert not check_path(world, ROBOT, Path(AROUND.states)).free
    path = returned(world)
    assert check_path(world, ROBOT, Path(path.states)).free
    assert len(path.states) < 100 * len(AROUND.states)


def test_lines_beside_a_disc_are_free_where_the_path_leads_out_of_another_one() -> None:
    disc, behind = Disc((8.0, 5.0), RADIUS - 0.2004), Rectangle((1.5, 7.0), 0.2, 1.0)
    free = world_with(disc)
    assert check_path(free, ROBOT, AROUND).free
    assert not check_path(free, ROBOT, Path(AROUND.states)).free
    world = world_with(disc, behind)
    path = returned(world, leaves=True)
    outside = np.asarray(StateChecker(world, ROBOT).valid(path.states))
    first = int(np.argmax(outside))
    assert not outside[0]
    assert outside[first:].all()
    assert check_path(world, ROBOT, Path(path.states[first:])).free
    # Where it leaves the first one, no states were added.
    assert np.array_equal(path.states[: first + 1], AROUND.states[: first + 1])
