"""LatticeSchedule: searches from both ends, level by level, while there is time; other paths; what is not repeated."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few

from trailmark.clock import CLOCK_EVERY
from trailmark.collision import StateChecker
from trailmark.motion import motion_of
from trailmark.planning import LandmarkPlanner
from trailmark.planning.lattice import schedule
from trailmark.planning.lattice.schedule import LEVELS, LatticeSchedule
from trailmark.planning.lattice.search import Lattice
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]
Judge = Callable[..., float]

CAR = Robot.rectangle(1.0, 0.6)
WALL = World("wall", (0, 0, 20, 20), (Rectangle((10.0, 11.0), 1.0, 12.0),))
"""A wall with 5 m below it and 3 m above."""

ACROSS = np.array([[5.0, 10.0, 0.0], [15.0, 10.0, 0.0]])


def scheduled(checker: StateChecker, ends: FloatArray, cell: float = 0.5, seconds: float = math.inf) -> LatticeSchedule:
    return LatticeSchedule(motion_of(checker), np.array(ends), cell, lambda: seconds)


def cost(states: FloatArray) -> float:
    return sum(
        math.dist(a[:2], b[:2]) + 0.5 * abs(math.atan2(math.sin(b[2] - a[2]), math.cos(b[2] - a[2])))
        for a, b in pairwise(states)
    )


class Recorder(Lattice):
    """Takes down what is searched, and finds nothing from some starts, of shape (3,) or (n, 3)."""

    seen: list[tuple[float, int, bytes, int, bool]]
    multi_steps: list[bool]
    blind: FloatArray | None

    def find_path(self, start: FloatArray, goal: FloatArray, to_go: Any, **options: Any) -> tuple[FloatArray, int]:
        found, taken = super().find_path(start, goal, to_go, **options)
        if self.blind is not None and (start == self.blind).all(axis=-1).any():
            found, taken = np.empty((0, 3)), options["budget"]
        type(self).multi_steps.append(options.get("multi_steps", False))
        type(self).seen.append(
            (
                self.size,
                self.headings,
                np.asarray(start).tobytes(),
                taken,
                taken < options["budget"] and options.get("patience") is None,
            )
        )
        return found, taken


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> type[Recorder]:
    monkeypatch.setattr(Recorder, "seen", [], raising=False)
    monkeypatch.setattr(Recorder, "multi_steps", [], raising=False)
    monkeypatch.setattr(Recorder, "blind", None, raising=False)
    monkeypatch.setattr(schedule, "Lattice", Recorder)
    return Recorder


@pytest.mark.slow
@settings(max_examples=few(20))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 5),
    seed=st.integers(0, 1000),
    headings=st.sampled_from([None, (0.0, math.pi), (math.pi, 0.0), (math.pi / 2, -math.pi / 2), (math.pi, math.pi)]),
)
def test_paths_are_certified(
    judge: Judge, name: str, world: int, seed: int, headings: tuple[float, float] | None
) -> None:
    checker = StateChecker(
        random_world(world, 30, size=24.0, radii=(0.5, 2.0), discs=0.3, holes=0.2), ROBOTS[name], cell=0.2
    )
    rng = np.random.default_rng(seed)
    q = rng.uniform((0, 0, -math.pi), (24, 24, math.pi), (200, 3))
    if name == "disc":
        q[:, 2] = 0.0
    elif headings is not None:
        q[::2, 2], q[1::2, 2] = headings
    valid = checker.valid(q)
    assume(valid[::2].any() and valid[1::2].any())
    ends = np.array([q[::2][valid[::2]][0], q[1::2][valid[1::2]][0]])
    lattices = scheduled(checker, ends, 0.8)
    found = [lattices.first_path(3)]
    found += [lattices.other_path(rng, 100.0) for _ in range(3)]
    lattices.views = len(schedule.VIEWS)
    found += [lattices.other_path(rng, 100.0) for _ in range(3)]
    for states in found:
        if len(states):
            judge(checker.world, checker.robot, *ends, states)
            assert checker.motions_valid(states[:-1], states[1:]).all()


def test_the_first_look_needs_no_costs_to_go(judge: Judge, recorder: type[Recorder]) -> None:
    checker, first = StateChecker(WALL, CAR), LEVELS[0]
    low = ACROSS - (0.0, 5.0, 0.0)
    lattices = scheduled(checker, low)
    states = lattices.first_path()
    judge(WALL, CAR, *low, states)
    assert len(states) > 2
    assert lattices.level == 1
    # One search, from the start, guided by the straight distance alone.
    assert first.cells == 0
    assert lattices.to_go(0, True).cost.size == 0
    (search,) = recorder.seen
    assert search[:3] == (0.5 / first.fineness, first.headings, low[0].tobytes())
    assert search[3] <= first.nodes


def test_every_level_is_looked_at_in_turn_from_both_ends(recorder: type[Recorder]) -> None:
    recorder.blind = ACROSS
    lattices = scheduled(StateChecker(WALL, CAR), ACROSS)
    assert lattices.first_path(len(LEVELS)).shape == (0, 3)
    # Without costs to go there is nothing to learn from the other end.
    expected = [
        (0.5 / level.fineness, level.headings, begin.tobytes())
        for level in LEVELS
        for begin in (ACROSS if level.cells else ACROSS[:1])
    ]
    assert [search[:3] for search in recorder.seen] == expected


def test_strides_find_the_first_path_and_single_steps_the_cheap_ones(recorder: type[Recorder]) -> None:
    lattices = scheduled(StateChecker(WALL, CAR), ACROSS)
    assert len(lattices.first_path(len(LEVELS))) > 2
    assert all(recorder.multi_steps)
    first = len(recorder.multi_steps)
    assert len(lattices.other_path(np.random.default_rng(0), 100.0)) > 2
    assert recorder.multi_steps[first:] == [False]


def test_levels_begin_with_what_is_at_hand_and_grow() -> None:
    assert [level.cells > 0 for level in LEVELS] == [False] + [True] * (len(LEVELS) - 1)
    assert [level.nodes for level in LEVELS] == sorted(level.nodes for level in LEVELS)
    assert all(level.fineness > 0.0 and level.headings > 1 for level in LEVELS)
    # Else the first search would never be given up.
    assert LEVELS[0].nodes > schedule.PATIENCE
    assert 0 < schedule.AT_FIRST < schedule.AT_MOST < len(LEVELS)


@pytest.mark.parametrize("end", [0, 1])
def test_ways_are_found_from_either_end(judge: Judge, recorder: type[Recorder], end: int) -> None:
    recorder.blind = ACROSS[1 - end]
    checker = StateChecker(WALL, CAR)
    states = scheduled(checker, ACROSS).first_path(len(LEVELS))
    judge(WALL, CAR, ACROSS[0], ACROSS[1], states)
    assert checker.motions_valid(states[:-1], states[1:]).all()
    assert recorder.seen[-1][2] == ACROSS[end].tobytes()


def test_half_a_turn_on_the_way_back_is_another_motion(judge: Judge, monkeypatch: pytest.MonkeyPatch) -> None:
    # Beside a wall there is room to turn one way only: half a turn goes counter-clockwise, there and back.
    robot = Robot.polygon([(-0.3, -0.3), (3.0, -0.3), (3.0, 0.3), (-0.3, 0.3)])
    world = World("beside", (0, 0, 20, 20), (Rectangle((10.0, 3.9), 20.0, 1.0),))
    checker = StateChecker(world, robot)
    up, down = np.array([10.0, 5.0, 0.0]), np.array([10.0, 5.0, math.pi])
    assert checker.motion_valid(up, down)
    assert not checker.motion_valid(down, up)

    class Turning(Lattice):
        def find_path(self, start: FloatArray, goal: FloatArray, to_go: Any, **options: Any) -> tuple[FloatArray, int]:
            return np.array([start, goal]), 2

    monkeypatch.setattr(schedule, "Lattice", Turning)
    # Forward it is taken as found; backward it would lead through the wall, and is dropped.
    judge(world, robot, up, down, scheduled(checker, np.array([up, down])).first_path())
    lattices = scheduled(checker, np.array([down, up]))
    lattices.views = len(schedule.VIEWS)
    assert len(lattices.other_path(np.random.default_rng(0), 100.0)) == 0


@pytest.mark.parametrize("robot", [CAR, Robot.disc(0.4)])
@pytest.mark.parametrize("shut_in", [0, 1])
def test_who_is_shut_in_is_looked_for_once_at_each_fineness(
    recorder: type[Recorder], robot: Robot, shut_in: int
) -> None:
    ring = tuple(
        Rectangle((10.0 + 3.0 * math.cos(a), 10.0 + 3.0 * math.sin(a)), 1.0, 3.0, a)
        for a in np.linspace(0.0, 2.0 * math.pi, 10, endpoint=False)
    )
    checker = StateChecker(World("ring", (0, 0, 20, 20), ring), robot)
    ends = np.array([[10.0, 10.0, 0.0], [2.0, 2.0, 0.0]])
    lattices = scheduled(checker, ends if shut_in == 0 else ends[::-1])
    for _ in range(len(LEVELS) + 3):
        assert lattices.first_path().shape == (0, 3)
    assert lattices.level == len(LEVELS)
    exhausted = [search[:3] for search in recorder.seen if search[4]]
    assert len(exhausted) == len(set(exhausted))
    # From one end or the other every kind of lattice is exhausted; without costs to go nothing is told by that.
    fine = {(0.5 / level.fineness, level.headings) for level in LEVELS if level.cells}
    if robot is not CAR:
        # Positions lie closer where no headings are told apart.
        fine = {(0.5 * size, 1) for size, _ in fine}
    assert {kind[:2] for kind in exhausted} == fine
    assert lattices.shut_in
    # A large search from the other end follows none that has run dry.
    large = {level.fineness for level in LEVELS if level.nodes >= schedule.LARGE}
    small = {level.fineness for level in LEVELS if level.nodes < schedule.LARGE}
    scale = 0.5 if robot is CAR else 0.25
    for fineness in large - small:
        found = [search[2] for search in recorder.seen if search[:1] == (scale / fineness,) and search[4]]
        assert len(found) == len({search[1] for search in recorder.seen if search[:1] == (scale / fineness,)})
    # And none is looked at again after that.
    kinds = [search[:3] for search in recorder.seen]
    for i, search in enumerate(recorder.seen):
        assert not (search[4] and search[:3] in kinds[i + 1 :])


@pytest.mark.parametrize("seconds", [0.0, -1.0, -math.inf])
def test_without_time_nothing_is_searched(recorder: type[Recorder], seconds: float) -> None:
    lattices = scheduled(StateChecker(WALL, CAR), ACROSS, seconds=seconds)
    assert lattices.first_path(len(LEVELS)).shape == (0, 3)
    assert lattices.other_path(np.random.default_rng(0), 100.0).shape == (0, 3)
    assert recorder.seen == []


def test_a_search_that_the_time_ends_does_not_count_as_exhausted(
    recorder: type[Recorder], monkeypatch: pytest.MonkeyPatch
) -> None:
    # Two levels in turn that look over the same lattice.
    monkeypatch.setattr(schedule, "LEVELS", (LEVELS[-1], LEVELS[-1]))
    seconds = iter([math.inf, 0.0, 0.0])
    lattices = LatticeSchedule(
        motion_of(StateChecker(WALL, CAR)), np.array(ACROSS), 0.5, lambda: next(seconds, math.inf)
    )
    # Time to begin, none to search: too few nodes to come around the wall.
    assert lattices._search(LEVELS[-1], True).shape == (0, 3)
    assert lattices.expanded == CLOCK_EVERY
    # With more time, the same lattice is looked at again.
    assert len(lattices.first_path()) > 2
    assert recorder.seen[1][:3] == recorder.seen[0][:3]


def test_a_search_given_up_for_want_of_progress_is_repeated_with_a_better_guide(
    recorder: type[Recorder], monkeypatch: pytest.MonkeyPatch
) -> None:
    # A pocket that the straight distance leads into, larger than patience lasts.
    pocket = (Rectangle((10.0, 10.0), 1.0, 16.0), Rectangle((6.0, 2.5), 9.0, 1.0), Rectangle((6.0, 17.5), 9.0, 1.0))
    guided = next(level for level in LEVELS if level.cells)
    monkeypatch.setattr(schedule, "LEVELS", (guided._replace(cells=0), guided))
    lattices = scheduled(StateChecker(World("pocket", (0, 0, 20, 20), pocket), CAR), ACROSS)
    assert len(lattices.first_path()) == 0
    first = recorder.seen[0]
    # It came nearer on the 4 m to the wall: fewer nodes than patience lasts.
    assert schedule.PATIENCE < first[3] < 2 * schedule.PATIENCE < guided.nodes
    assert len(lattices.first_path()) > 2
    assert recorder.seen[1][:3] == first[:3]


def test_other_looks_find_other_ways_around(judge: Judge) -> None:
    # Above, where the robot may pass, it is tighter and longer; below it is the shortest path.
    checker = StateChecker(WALL, CAR)
    lattices, rng = scheduled(checker, ACROSS), np.random.default_rng(0)
    below = cost(np.array([ACROSS[0], [9.2, 4.5, 0.0], [10.8, 4.5, 0.0], ACROSS[1]]))
    known = cost(np.array([ACROSS[0], [9.2, 17.5, 0.0], [10.8, 17.5, 0.0], ACROSS[1]]))
    costs = []
    for _ in range(2 * len(schedule.VIEWS) + 2):
        states = lattices.other_path(rng, known)
        assert len(states)
        costs.append(judge(WALL, CAR, ACROSS[0], ACROSS[1], states))
        assert costs[-1] <= schedule.DETOUR * known + 1e-6
    # Better than the way that is known, by going around the other side.
    assert 0.9 * below < min(costs) < 1.05 * below < known
    # What is shorter than any way there is keeps the search from all of them.
    assert len(lattices.other_path(rng, 0.7 * below)) == 0


def test_looks_are_repeatable() -> None:
    world = random_world(3, 40, size=24.0, radii=(0.5, 2.0))
    q = np.random.default_rng(0).uniform((0, 0, -math.pi), (24, 24, math.pi), (200, 3))
    found = []
    for _ in range(2):
        checker = StateChecker(world, ROBOTS["L"])
        ends = q[checker.valid(q)][:2]
        lattices, rng = scheduled(checker, ends, 0.7), np.random.default_rng(5)
        found.append([lattices.first_path(4), *(lattices.other_path(rng, 60.0) for _ in range(3))])
    assert any(len(states) for states in found[0])
    for one, other in zip(*found, strict=True):
        assert np.array_equal(one, other)


def test_a_lattice_search_that_is_stopped_ends_the_planning_in_order() -> None:
    stops = iter([False] * 3)
    found = LandmarkPlanner(WALL, CAR, seed=0).plan(ACROSS[0], ACROSS[1], 20.0, stop=lambda: next(stops, True))
    assert found.status in ("solved", "timeout"), found.status
    none = LandmarkPlanner(WALL, CAR, seed=0).plan(ACROSS[0], ACROSS[1], 20.0, stop=lambda: True)
    assert none.status == "timeout"
    assert none.path is None
