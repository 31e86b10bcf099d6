"""The survey of what is left to be seen, and its parts."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from tests.helpers.trials import trials

from trailmark import LandmarkPlanner, Robot, World
from trailmark.exploration.frontiers import frontiers_of, places_in_sight, sight
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.strategies import STRATEGIES
from trailmark.exploration.survey import MOST_TRIES, NO_ROOM, Memory, Survey, survey
from trailmark.planning.result import PlanResult
from trailmark.se2 import FloatArray
from trailmark.world.goals import Goal

ROBOT = Robot.disc(0.2)


def known_of(rows: list[str], cell: float = 0.1) -> KnownMap:
    """A map of a drawing, the largest y first: ``.`` free, ``#`` occupied, ``?`` unknown."""
    state = np.array([["?.#".index(c) for c in row] for row in rows[::-1]], dtype=np.uint8)
    known = KnownMap((0.0, 0.0, cell * state.shape[1], cell * state.shape[0]), cell)
    known.set_state(state)
    return known


def room(door: int = 0) -> KnownMap:
    """A room, in the wall of which a part, so many cells wide, is unknown."""
    known = known_of(["#" * 30, *["#" + "." * 28 + "#"] * 28, "#" * 30])
    state = known.state.copy()
    state[14 : 14 + door, -1] = UNKNOWN
    known.set_state(state)
    return known


def look(known: KnownMap, pose: FloatArray, memory: Memory) -> tuple[Survey, LandmarkPlanner]:
    planner = LandmarkPlanner(known.follow(World("hall", known.bounds, robot=ROBOT)), ROBOT, seed=0)
    return survey(known, planner.checker, pose, None, 2.0, np.random.default_rng(0), memory, pose[None]), planner


def test_a_closed_room_is_done_by_proof() -> None:
    known = room()
    found, _ = look(known, np.array([1.5, 1.5, 0.0]), Memory.of(known))
    assert len(found.outlook.landmarks) == 0
    assert not found.doubts


def test_a_door_is_seen_from_a_landmark_to_which_a_path_leads() -> None:
    known, here = room(door=6), np.array([0.5, 0.5, 0.0])
    found, planner = look(known, here, Memory.of(known))
    assert found.outlook.sees.any(axis=0).all()
    assert found.any_heading[0]
    assert planner.plan(here, Goal(pose=tuple(found.outlook.landmarks[0, :2].tolist()))).status == "solved"
    assert all((known.state[cells] == UNKNOWN).all() for cells in found.expected)


def test_what_no_way_leads_to_is_put_off_until_something_changes_there_and_leaves_doubts() -> None:
    known, here = room(door=6), np.array([0.5, 0.5, 0.0])
    memory, tries = Memory.of(known), 0
    found = look(known, here, memory)[0]
    while len(found.outlook.landmarks):
        memory.refuse(known, found.outlook.landmarks[0], certainly=False)
        assert memory.failed == (tries := tries + 1)
        found = look(known, here, memory)[0]
    assert found.doubts
    assert MOST_TRIES <= tries <= 20
    assert (memory.refused[known.state == FREE] >= MOST_TRIES).all()
    # The robot has driven since, and something stands there now, or there is more room.
    memory.failed = 0
    assert not len(look(known, here, memory)[0].outlook.landmarks)
    state = known.state.copy()
    state[20, 20] = OCCUPIED
    known.set_state(state)
    memory.failed = 0
    assert len(look(known, here, memory)[0].outlook.landmarks)


def test_where_the_robot_does_not_fit_with_any_heading_is_told_from_where_no_way_was_found() -> None:
    known = known_of(
        [*["." * 12 + "#" + "." * 4 + "?"] * 3, *["." * 17 + "?"] * 4, *["." * 12 + "#" + "." * 4 + "?"] * 3]
    )
    memory = Memory.of(known)
    found = look(known, np.array([0.5, 0.5, 0.0]), memory)[0]
    assert len(found.outlook.landmarks)
    assert not (memory.refused == NO_ROOM)[:, :10].any()


@pytest.mark.parametrize("seed", range(20))
def test_lines_of_sight_are_those_of_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = np.where(rng.random((12, 12)) < 0.2, OCCUPIED, FREE).astype(np.uint8)
    state[5, 5] = UNKNOWN
    places = np.vstack([rng.uniform(0.0, 12.0, (50, 2)), np.indices((12, 12)).reshape(2, -1).T + 0.5])
    edge = np.array([[5.5, 5.0, 0.0, 1.0]])
    cells = [shapely.box(c, r, c + 1, r + 1) for r, c in np.argwhere(state != FREE).tolist()]
    blocked = shapely.union_all(cells)
    found = sight(state, places, edge, np.array([9.0]))[:, 0]
    for place, seen in zip(places, found, strict=True):
        line = shapely.LineString([place, edge[0, :2]])
        free = line.intersection(blocked).length < 1e-9
        assert seen == (free and line.length <= 9.0 and place[1] < 5.0)
    # The cells from which it is seen are found from the other end, too.
    ranks = np.ones(state.shape, np.uint8)
    one = places_in_sight(state, ranks, edge, np.array([9.0]), 1, 0.5)[0, 0]
    assert (one >= 0) == found[50:].any()
    assert one < 0 or found[50:].reshape(12, 12).T[divmod(int(one), 12)]


OPEN = {
    "wall": (["......", "#???##", "??????"], 3),
    "gap in a wall": (["......", "##??##", "??????"], 0),
    "corner": (["......", "##??..", "????..", "???#.."], 4),
    "gap at a corner": ([".....", "..##.", ".?#..", "....."], 0),
    "post": ([".....", ".....", "..?..", ".....", "....."], 4),
}


@pytest.mark.parametrize(("rows", "edges"), OPEN.values(), ids=OPEN.keys())
def test_gaps_of_two_cells_in_a_surface_are_not_looked_through(rows: list[str], edges: int) -> None:
    found = frontiers_of(known_of(rows).state, 100.0)
    assert len(found.edges) == len(found.unknown) == len(found.group)
    assert len(found.edges) == edges


BEAMS, STEPS_PER_CELL = 900, 4


class Hidden:
    """A hidden world of cells, a robot that senses in it without noise, and an exploration of it."""

    def __init__(self, solid: NDArray[np.bool_], cell: float, robot: Robot, start: tuple[float, float]) -> None:
        self.solid, self.robot, self.range = solid, robot, 4.0
        self.known = KnownMap((0.0, 0.0, cell * solid.shape[1], cell * solid.shape[0]), cell)
        self.state = self.known.state.copy()
        self.start = self.pose = np.array([*start, 0.0])
        self.sense(self.pose)
        self.statuses = list[str]()

    def sense(self, pose: FloatArray) -> None:
        cell, (rows, columns) = self.known.cell, self.solid.shape
        angle = (np.arange(BEAMS) + 0.5) * 2.0 * np.pi / BEAMS
        far = np.arange(0.0, self.range / cell, 1.0 / STEPS_PER_CELL)
        c = np.floor(pose[0] / cell + np.cos(angle)[:, None] * far).astype(int)
        r = np.floor(pose[1] / cell + np.sin(angle)[:, None] * far).astype(int)
        outside = (r < 0) | (c < 0) | (r >= rows) | (c >= columns)
        r, c = np.clip(r, 0, rows - 1), np.clip(c, 0, columns - 1)
        met = self.solid[r, c] | outside
        clear = ~np.maximum.accumulate(met, axis=1)
        first = met & (np.cumsum(met, axis=1) == 1) & ~outside
        self.state[r[first], c[first]] = OCCUPIED
        self.state[r[clear], c[clear]] = FREE

    def explore(self, strategy: str, most: int = 80) -> Survey:
        """Go from landmark to landmark until nothing is left."""
        known, rng, driven = self.known, np.random.default_rng(0), [self.pose]
        known.set_state(self.state)
        planner = LandmarkPlanner(known.follow(World("hidden", known.bounds, robot=self.robot)), self.robot, seed=0)
        memory = Memory.of(known)
        for _ in range(most):
            found = survey(known, planner.checker, self.pose, None, self.range, rng, memory, np.array(driven))
            if not len(found.outlook.landmarks):
                return found
            index = STRATEGIES[strategy](found.outlook)
            landmark = found.outlook.landmarks[index]
            goal = Goal(pose=tuple(landmark[: 2 if found.any_heading[index] else 3].tolist()))
            planned = planner.plan(self.pose, goal, 1.0, gap=0.05)
            self.statuses.append(planned.status)
            if planned.path is None:
                memory.refuse(known, landmark, planned.status == "infeasible")
                continue
            memory.failed, memory.aim = 0, (landmark[:2], found.expected[index])
            for a, b in itertools.pairwise(planned.path.states):
                for share in np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)[:2]) / 0.3))[1:]:
                    driven.append(a + share * (b - a))
                    self.sense(driven[-1])
            self.pose = planned.path.states[-1]
            known.set_state(self.state)
            planner.update(known.follow(planner.world))
        raise AssertionError(f"not at an end after {most} landmarks")

    def unseen(self) -> int:
        """Count the cells that stay unknown although a place where a disc robot gets to sees them, by shapely."""
        cell, radius = self.known.cell, self.robot.circumradius
        rows, columns = self.solid.shape
        boxes = [shapely.box(c * cell, r * cell, (c + 1) * cell, (r + 1) * cell) for r, c in np.argwhere(self.solid)]
        hall = shapely.box(0.0, 0.0, columns * cell, rows * cell)
        walls = shapely.union_all([*boxes, hall.buffer(1.0).difference(hall)])
        shapely.prepare(walls)
        r, c = np.nonzero(~self.solid)
        middles = shapely.points(cell * (c + 0.5), cell * (r + 0.5))
        # What the map's resolution may take for blocked: a cell more than the robot.
        fits = np.zeros(self.solid.shape, np.bool_)
        fits[r, c] = shapely.distance(walls, middles) >= radius + cell
        labels = ndimage.label(fits)[0]
        here = tuple(int(v[0]) for v in self.known.cells_of(self.start[None, :2]))
        places = np.argwhere(labels == labels[here])[::7]
        left = np.argwhere((self.known.state == UNKNOWN) & ~self.solid)
        if len(left) == 0:
            return 0
        ends = np.stack(np.broadcast_arrays(places[:, None], left[None]), axis=2)[..., ::-1] * cell + 0.5 * cell
        lines = shapely.linestrings(ends)
        near = shapely.length(lines) <= self.range - 2.0 * cell
        return int((near & ~shapely.intersects(walls, lines)).any(axis=0).sum())


def hall(rows: int = 60, columns: int = 80) -> NDArray[np.bool_]:
    solid = np.zeros((rows, columns), np.bool_)
    solid[[0, -1]] = solid[:, [0, -1]] = True
    return solid


def slot() -> NDArray[np.bool_]:
    """Two rooms, and between them a slot through which the robot does not fit, but beams do."""
    solid = hall()
    solid[:, 40:44] = True
    solid[28:32, 40:44] = False
    return solid


def slanted() -> NDArray[np.bool_]:
    """A wall at an odd angle with a door in it that the robot just fits through."""
    solid = hall()
    r, c = np.indices(solid.shape)
    along, across = 0.8 * (c - 40) + 0.6 * (r - 30), -0.6 * (c - 40) + 0.8 * (r - 30)
    solid |= (np.abs(along) < 3.0) & (np.abs(across) > 7.0)
    return solid


def islands(seed: int) -> NDArray[np.bool_]:
    """Blocks here and there, one of them hollow."""
    rng, solid = np.random.default_rng(seed), hall()
    for _ in range(8):
        r, c = rng.integers(2, 50), rng.integers(14, 70)
        solid[r : r + rng.integers(2, 9), c : c + rng.integers(2, 9)] = True
    solid[40:52, 60:72] = True
    solid[43:49, 63:69] = False
    solid[:12, :12] = hall()[:12, :12]
    return solid


@pytest.mark.slow
def test_beams_go_where_the_robot_does_not_fit() -> None:
    hidden = Hidden(slot(), 0.05, Robot.disc(0.2), (0.5, 0.5))
    hidden.explore("nearest-frontier")  # the others go by tours
    assert hidden.unseen() <= 0.01 * (hidden.known.state == FREE).sum()  # single cells, far behind the slot
    # Through the slot, not only its own cells.
    assert (hidden.known.state[:, 46:79] == FREE).sum() > 300
    assert hidden.pose[0] < 2.0


@pytest.mark.slow
def test_a_door_that_just_fits_is_driven_through() -> None:
    hidden = Hidden(slanted(), 0.05, Robot.rectangle(0.5, 0.3), (0.5, 0.5))
    hidden.explore("tour")
    assert (hidden.known.state[hall() == hidden.solid] != UNKNOWN).mean() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(3))
def test_at_the_end_nothing_is_in_sight_from_where_the_robot_gets_to(seed: int) -> None:
    hidden = Hidden(islands(seed), 0.05, Robot.disc(0.2), (0.42, 0.42))
    hidden.explore("tour")
    assert hidden.unseen() <= 3
    assert (hidden.known.state[43:49, 63:69] == UNKNOWN).all()  # nobody sees into what is closed


@pytest.mark.slow
def test_ways_that_are_not_found_keep_nothing_else_from_being_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    # A corridor longer than the range, into which no way is found: it is put off, and the rest of the world is seen.
    # The end is no proof then.
    plan = LandmarkPlanner.plan

    def nowhere(planner: LandmarkPlanner, start: FloatArray, goal: Goal, *rest: Any, **options: Any) -> PlanResult:
        result = plan(planner, start, goal, *rest, **options)
        return replace(result, status="timeout", path=None) if goal.pose and goal.pose[1] > 2.5 else result

    monkeypatch.setattr(LandmarkPlanner, "plan", nowhere)
    solid = hall(60, 200)
    solid[:, 100] = True
    solid[17:32, 100] = False
    solid[50, 12:100] = True
    hidden = Hidden(solid, 0.05, Robot.disc(0.2), (3.0, 1.2))
    found = hidden.explore("tour")
    assert (hidden.state[2:58, 104:196] != UNKNOWN).all()
    assert hidden.statuses.count("timeout") >= 2
    assert found.doubts
