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
from tests.support.trials import trials

from trailmark import LandmarkPlanner, Rectangle, Robot, World
from trailmark.collision import StateChecker
from trailmark.exploration import landmark_ways
from trailmark.exploration.candidates import MOST_TRIES
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.landmark_ways import plan_to
from trailmark.exploration.reachability import NOWHERE, Reach
from trailmark.exploration.strategies import STRATEGIES, Outlook
from trailmark.exploration.survey import EXCLUDED, Memory, Survey, survey
from trailmark.exploration.views import sight
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


def room(width: int = 30, height: int = 30) -> KnownMap:
    rows = ["#" * width, *["#" + "." * (width - 2) + "#"] * (height - 2), "#" * width]
    return known_of(rows)


def room_with_a_door(width: int = 6, side: int = 30) -> KnownMap:
    """A room, a number of cells wide, in the wall of which a part is unknown."""
    known = room(side, side)
    state = known.state.copy()
    state[14 : 14 + width, -1] = UNKNOWN
    known.set_state(state)
    return known


def chosen(outlook: Outlook, landmark: tuple[float, float, float], any_heading: bool) -> Survey:
    """A survey of one landmark, from which nothing is expected."""
    nothing = np.empty(0, np.intp)
    there = outlook._replace(landmarks=np.array([landmark]))
    return Survey(there, "", "complete", ((nothing, nothing),), np.array([any_heading]), narrow=False)


def look(
    known: KnownMap, pose: tuple[float, float, float], memory: Memory | None = None, sensor_range: float = 2.0
) -> tuple[Survey, LandmarkPlanner]:
    world = known.follow(World("hall", known.bounds, robot=ROBOT))
    planner = LandmarkPlanner(world, ROBOT, seed=0)
    memory = Memory(known) if memory is None else memory
    rng = np.random.default_rng(0)
    return survey(known, planner, ROBOT, np.array(pose), None, sensor_range, rng, memory), planner


def test_a_closed_room_is_done() -> None:
    found, _ = look(room(), (1.5, 1.5, 0.0))
    assert found.status == "complete"
    assert "everything" in found.ended
    assert len(found.outlook.landmarks) == 0


def test_a_place_without_a_way_keeps_nothing_from_being_done_if_nothing_would_be_seen_from_it() -> None:
    known = room()
    memory = Memory(known)
    look(known, (1.5, 1.5, 0.0), memory)
    memory.refused[10, 10] = 1
    assert look(known, (1.5, 1.5, 0.0), memory)[0].status == "complete"


def test_a_door_is_seen_from_a_landmark_to_which_a_path_leads() -> None:
    known = room_with_a_door()
    found, planner = look(known, (0.5, 0.5, 0.0))
    assert found.ended == ""
    assert found.outlook.sees.any(axis=0).all()
    result = plan_to(known, planner, found, 0, ExplorationSettings(), Memory(known))
    assert result.status == "solved"


@pytest.mark.parametrize("behind", ["?", "#"], ids=["unknown", "walls"])
def test_what_is_not_reachable_yet_is_told_from_what_never_is(behind: str) -> None:
    # A room with a window that the robot does not fit through; around it and at its end nothing is known, or there are
    # walls.
    room = ["#######", *["#......"] * 5, ".......", *["#......"] * 5, "#######"]
    inner = [f"{'.' * 12}{row}{behind * 6}" for row in room]
    outer = [f"{'.' * 12}{behind * 13}"] * 6
    known = known_of([*outer, *inner, *outer])
    world = known.follow(World("hall", known.bounds, robot=ROBOT))
    planner, memory = LandmarkPlanner(world, ROBOT, seed=0), Memory(known)
    outlook = look(known, (0.5, 0.9, 0.0))[0].outlook
    found = chosen(outlook, (1.6, 1.3, 0.0), any_heading=True)
    row, column = (int(at[0]) for at in known.cells_of(found.outlook.landmarks[:, :2]))
    result = plan_to(known, planner, found, 0, ExplorationSettings(), memory)
    assert result.status == "infeasible"
    assert memory.refused[row, column] > 100
    assert memory.never[row, column] == (behind == "#")
    assert memory.refusal.startswith("not reachable at all" if behind == "#" else "not reachable yet")
    # It is not tried again before the end, and is then, if something has changed.
    memory.again |= memory.never
    done = look(known, (0.5, 0.9, 0.0), memory)[0]
    assert not memory.never.any() or len(done.outlook.landmarks)


def test_proofs_from_before_the_last_drive_are_made_anew_before_the_end() -> None:
    # The end of the hall is unknown, and was proven not to be reachable; nothing has changed there since.
    known = room_with_a_door()
    memory = Memory(known)
    found, planner = look(known, (0.5, 0.5, 0.0), memory)
    memory.refused[:] = EXCLUDED
    memory.never[:] = True
    assert look(known, (0.5, 0.5, 0.0), memory)[0].status == "complete"  # proven for this map
    plan_to(known, planner, found, 0, ExplorationSettings(), memory)
    anew, _ = look(known, (0.5, 0.5, 0.0), memory)
    assert anew.ended == ""
    assert len(anew.outlook.landmarks)


def test_while_the_robot_stands_noise_makes_nothing_be_proven_for_ever() -> None:
    memory = Memory(room_with_a_door())
    ended, surveys = "", 0
    while not ended and surveys < 10:
        # All is proven not to be reachable, and by the next reading the map has changed around it.
        known = room_with_a_door()
        state = known.state.copy()
        state[15, 26] = OCCUPIED if surveys % 2 else FREE
        known.set_state(state)
        memory.refused[:], memory.failed = EXCLUDED, 1
        found, _ = look(known, (0.5, 0.5, 0.0), memory)
        ended, surveys = found.ended, surveys + 1
    assert "everything" in ended
    assert surveys == 2
    # A robot that has driven since does not go by that.
    memory.confirmed, memory.again[:] = False, True
    assert look(room_with_a_door(), (0.5, 0.5, 0.0), memory)[0].ended == ""


@pytest.mark.slow
@pytest.mark.parametrize("robot", [ROBOT, Robot.rectangle(0.5, 0.3)], ids=["disc", "rectangle"])
def test_from_a_place_that_the_map_has_closed_nothing_is_proven_of_the_rest(robot: Robot) -> None:
    # The robot came out of the hall on the left into the chamber on the right, whose door is closed now.
    known = known_of([*["." * 20 + "#" + "." * 7] * 12, *["." * 20 + "#" + "#" * 7] * 8])
    world = known.follow(World("hall", known.bounds, robot=robot))
    planner, memory, rng = LandmarkPlanner(world, robot, seed=0), Memory(known), np.random.default_rng(0)
    memory.been[10, 10] = True
    here = np.array([2.45, 1.4, 0.0])
    outlook = survey(known, planner, robot, here, None, 2.0, rng, memory).outlook
    found = chosen(outlook._replace(here=here), (0.6, 1.5, 0.0), any_heading=True)
    assert plan_to(known, planner, found, 0, ExplorationSettings(planning_time=5.0), memory).path is None
    assert memory.closed_in
    assert "closes the robot in" in memory.refusal
    assert not (memory.refused == EXCLUDED).any()
    # Without the place where it was, the same is a proof.
    memory.been[10, 10], memory.closed_in = False, False
    survey(known, planner, robot, here, None, 2.0, rng, memory)
    plan_to(known, planner, found, 0, ExplorationSettings(planning_time=5.0), memory)
    assert not memory.closed_in
    assert memory.refused[15, 6] == EXCLUDED


@pytest.mark.parametrize("reverse", [True, False])
def test_a_robot_that_cannot_drive_backwards_goes_nowhere_where_it_cannot_turn_round(reverse: bool) -> None:
    wall = "." * 20 + "#" * 13
    known = known_of([*[wall] * 8, *["." * 32 + "#"] * 5, *[wall] * 7])
    robot = Robot.rectangle(0.5, 0.3).differential(reverse=reverse)
    planner = LandmarkPlanner(known.follow(World("hall", known.bounds, robot=robot)), robot, seed=0)
    memory, here = Memory(known), np.array([1.05, 1.05, 0.0])
    rng, settings = np.random.default_rng(0), ExplorationSettings(planning_time=0.5)
    outlook = survey(known, planner, robot, here, None, 2.0, rng, memory).outlook
    for place, back in (((2.8, 0.95, 0.0), reverse), ((0.6, 1.55, 0.0), True)):
        found = plan_to(
            known, planner, chosen(outlook._replace(here=here), place, any_heading=True), 0, settings, memory
        )
        assert (found.path is not None) == back
        assert back or "no way back" in memory.refusal


def test_where_nothing_is_found_any_longer_the_robot_came_from_there(monkeypatch: pytest.MonkeyPatch) -> None:
    # As in the test before, but the proof takes too long.
    known = known_of([*["." * 20 + "#" + "." * 7] * 12, *["." * 20 + "#" + "#" * 7] * 8])
    world, robot = known.follow(World("hall", known.bounds, robot=ROBOT)), Robot.rectangle(0.5, 0.3)
    planner, memory, rng = LandmarkPlanner(world, robot, seed=0), Memory(known), np.random.default_rng(0)
    memory.been[10, 10] = True
    here = np.array([2.45, 1.4, 0.0])
    outlook = survey(known, planner, robot, here, None, 2.0, rng, memory).outlook
    found = chosen(outlook._replace(here=here), (0.6, 1.5, 0.0), any_heading=True)
    monkeypatch.setattr(landmark_ways, "_excluded", lambda *_: np.zeros(memory.been.shape, np.bool_))
    for failed in (1, 2, 3):
        plan_to(known, planner, found, 0, ExplorationSettings(planning_time=0.2), memory)
        assert memory.failed == failed
        assert memory.closed_in == (failed == 3)
    # Once it has left, nothing speaks against what it did not find from there; what is proven stays.
    assert memory.refused[15, 6] == MOST_TRIES
    memory.refused[0, 0] = EXCLUDED
    memory.forget_failures()
    assert memory.refused[15, 6] == memory.failed == 0
    assert memory.refused[0, 0] == EXCLUDED


@pytest.mark.slow
def test_what_no_heading_leads_to_is_excluded_at_once_for_a_robot_with_a_shape() -> None:
    # The same room behind a window: one landmark, with one heading, tells that none of its cells is reached.
    robot = Robot.rectangle(0.5, 0.3)
    known = known_of([f"{'.' * 14}#{'.' * 13}#"] * 6 + ["." * 28 + "#"] + [f"{'.' * 14}#{'.' * 13}#"] * 6)
    world = known.follow(World("hall", known.bounds, robot=robot))
    planner, memory = LandmarkPlanner(world, robot, seed=0), Memory(known)
    rng, pose = np.random.default_rng(0), np.array([0.5, 0.6, 0.0])
    outlook = survey(known, planner, robot, pose, None, 2.0, rng, memory).outlook
    memory.levels[known.state == FREE] = 1
    found = chosen(outlook, (2.1, 0.6, 0.0), any_heading=False)
    assert plan_to(known, planner, found, 0, ExplorationSettings(planning_time=5.0), memory).status == "infeasible"
    assert (memory.refused[3:10, 17:26] > 100).all()
    # On its own side only where the robot does not fit, whatever its heading.
    assert (memory.refused[2:11, 2:12] < 100).all()
    assert memory.never[6, 21]
    # What is around and not proven has its own turn later, however often this was refused by proof.
    for _ in range(3):
        memory.refused[3:10, 17:26] = 0
        plan_to(known, planner, found, 0, ExplorationSettings(planning_time=5.0), memory)
    around = memory.refused[memory.refused < 100]
    assert around.max() == 1


@pytest.mark.parametrize("seed", range(20))
def test_lines_of_sight_are_those_of_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    state = np.where(rng.random((12, 12)) < 0.2, OCCUPIED, FREE).astype(np.uint8)
    state[5, 5] = UNKNOWN
    places = rng.uniform(0.0, 12.0, (50, 2))
    edge = np.array([[5.5, 5.0, 0.0, 1.0]])
    boxes = np.broadcast_to(np.array([0, 0, 255, 255], np.uint8), (12, 12, 4)).copy()
    # Surfaces that fill a part of their cells.
    boxes[state == OCCUPIED, 2 if seed % 2 else 1] = 100
    blocked = shapely.union_all(
        [
            shapely.box(*(np.array([c, r, c, r]) + (boxes[r, c] / 255.0 if state[r, c] == OCCUPIED else [0, 0, 1, 1])))
            for r, c in np.argwhere(state != FREE).tolist()
        ]
    )
    found = sight(state, boxes, places, edge, np.array([9.0]))[:, 0]
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


OPEN = {
    "wall": ["......", "#???##", "??????"],
    "corner": ["......", "##??..", "????..", "???#.."],
    "side of a box": ["......", "####..", "???#..", "????..", "????..", "????.."],
    "post": [".....", ".....", "..?..", ".....", "....."],
}


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
        known, settings, rng = self.known, ExplorationSettings(), np.random.default_rng(0)
        known.set_state(self.state.copy())
        world = known.follow(World("hidden", known.bounds, robot=self.robot))
        planner, memory = LandmarkPlanner(world, self.robot, seed=0), Memory(known)
        for _ in range(most):
            found = survey(known, planner, self.robot, self.pose, None, self.range, rng, memory)
            if found.ended:
                return found
            planned = plan_to(known, planner, found, STRATEGIES[strategy](found.outlook), settings, memory)
            self.statuses.append(planned.status)
            if planned.path is None:
                continue
            states = planned.path.states
            for a, b in itertools.pairwise(states):
                for share in np.linspace(0.0, 1.0, 2 + int(np.hypot(*(b - a)[:2]) / 0.3))[1:]:
                    self.sense(a + share * (b - a))
            self.pose = states[-1]
            known.set_state(self.state.copy())
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
    found = hidden.explore("nearest-frontier")  # the others go by tours
    assert found.status == "complete"
    assert hidden.unseen() <= 0.01 * (hidden.known.state == FREE).sum()  # single cells, far behind the slot
    # Through the slot, not only its own cells.
    assert (hidden.known.state[:, 46:79] == FREE).sum() > 300
    assert hidden.pose[0] < 2.0


@pytest.mark.slow
def test_a_door_that_just_fits_is_driven_through() -> None:
    hidden = Hidden(slanted(), 0.05, Robot.rectangle(0.5, 0.3), (0.5, 0.5))
    found = hidden.explore("tour")
    assert found.status == "complete"
    assert (hidden.known.state[hall() == hidden.solid] != UNKNOWN).mean() > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(3))
def test_at_the_end_nothing_is_in_sight_from_where_the_robot_gets_to(seed: int) -> None:
    hidden = Hidden(islands(seed), 0.05, Robot.disc(0.2), (0.42, 0.42))
    found = hidden.explore("tour")
    assert found.status == "complete"
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
    assert found.status == "stuck"
    assert "nor is it proven" in found.ended
