"""The survey of what is left to be seen, and its parts."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from trailmark import LandmarkPlanner, Rectangle, Robot, World
from trailmark.collision import StateChecker
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.reachability import NOWHERE, Reach
from trailmark.exploration.survey import Memory, Survey, plan_to, survey
from trailmark.exploration.views import sight

ROBOT = Robot.disc(0.2)


def known_of(rows: list[str], cell: float = 0.1) -> KnownMap:
    """A map of a drawing, the largest y first: ``.`` free, ``#`` occupied, ``?`` unknown."""
    state = np.array([["?.#".index(c) for c in row] for row in rows[::-1]], dtype=np.uint8)
    known = KnownMap((0.0, 0.0, cell * state.shape[1], cell * state.shape[0]), cell)
    known.set_state(state)
    return known


def room(width: int = 30, height: int = 30) -> KnownMap:
    rows = ["#" * width, *["#" + "." * (width - 2) + "#"] * (height - 2), "#" * width]
    return known_of(rows)


def look(
    known: KnownMap, pose: tuple[float, float, float], memory: Memory | None = None
) -> tuple[Survey, LandmarkPlanner]:
    world = known.follow(World("hall", known.bounds, robot=ROBOT))
    planner = LandmarkPlanner(world, ROBOT, seed=0)
    memory = Memory(known) if memory is None else memory
    rng = np.random.default_rng(0)
    return survey(known, planner, ROBOT, np.array(pose), None, 2.0, ExplorationSettings(), rng, memory), planner


def test_a_closed_room_is_done() -> None:
    found, _ = look(room(), (1.5, 1.5, 0.0))
    assert found.status == "complete"
    assert "everything" in found.ended
    assert len(found.outlook.landmarks) == 0


def test_a_door_is_seen_from_a_landmark_to_which_a_path_leads() -> None:
    known = room()
    state = known.state.copy()
    state[14:20, 29] = FREE
    state[14:20, 29] = UNKNOWN
    known.set_state(state)
    found, planner = look(known, (0.5, 0.5, 0.0))
    assert found.ended == ""
    assert found.outlook.sees.any(axis=0).all()
    result = plan_to(known, planner, found, 0, ExplorationSettings(), Memory(known))
    assert result.status == "solved"


@pytest.mark.parametrize("seed", range(20))
def test_lines_of_sight_are_those_of_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = np.where(rng.random((12, 12)) < 0.2, OCCUPIED, FREE).astype(np.uint8)
    state[5, 5] = UNKNOWN
    blocked = shapely.union_all([shapely.box(c, r, c + 1, r + 1) for r, c in np.argwhere(state != FREE).tolist()])
    places = rng.uniform(0.0, 12.0, (50, 2))
    edge = np.array([[5.5, 5.0, 0.0, 1.0]])
    found = sight(state, places, edge, np.array([9.0]))[:, 0]
    for place, seen in zip(places, found, strict=True):
        line = shapely.LineString([place, edge[0, :2]])
        free = line.intersection(blocked).length < 1e-9
        assert seen == (free and line.length <= 9.0 and place[1] < 5.0)


def test_occupied_cells_are_no_proof_of_more_than_a_surface_in_them() -> None:
    # A wall at an odd angle with a door hardly wider than the robot: all cells that the wall's outline goes through
    # are occupied, and leave less than the robot's width free.
    door, angle, cell = 0.42, 1.2, 0.04
    along = np.array([np.cos(angle), np.sin(angle)])
    walls = [
        Rectangle(tuple((np.array([3.0, 2.0]) + side * along * (0.5 * door + 2.0)).tolist()), 4.0, 0.2, angle)
        for side in (-1.0, 1.0)
    ]
    solid = shapely.union_all([wall.polygon().shapely() for wall in walls])
    world = World("door", (0.0, 0.0, 6.0, 4.0), tuple(walls), ROBOT)
    across = np.array([along[1], -along[0]])
    ends = [np.append(np.array([3.0, 2.0]) + side * across, 0.0) for side in (-1.0, 1.0)]
    assert StateChecker(world, ROBOT).motion_valid(*ends)
    known = KnownMap(world.bounds, cell)
    rows, columns = np.indices(known.state.shape)
    corner = cell * np.stack([columns, rows], -1)
    cells = shapely.box(corner[..., 0], corner[..., 1], corner[..., 0] + cell, corner[..., 1] + cell)
    state = np.where(shapely.intersects(cells, solid.boundary), OCCUPIED, FREE)
    state[shapely.contains_properly(solid, cells)] = UNKNOWN
    been = np.zeros(state.shape, np.bool_)
    been[known.cells_of(ends[0][None, :2])] = True
    levels, _ = Reach(ROBOT, cell).levels(state.astype(np.uint8), been)
    assert levels[known.cells_of(ends[1][None, :2])] > NOWHERE
    # What is unknown stands in the way as a whole.
    state[state == OCCUPIED] = UNKNOWN
    levels, _ = Reach(ROBOT, cell).levels(state.astype(np.uint8), been)
    assert levels[known.cells_of(ends[1][None, :2])] == NOWHERE
