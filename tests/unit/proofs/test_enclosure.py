"""Enclosures are proven, and places shut off, where there is no way, and never where there is one."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from tests.helpers.oracles import free_somewhere
from tests.helpers.trials import few, trials
from tests.helpers.worlds import ROBOTS, random_world

from trailmark import ConfigurationError, LandmarkPlanner, PlannerSettings, Robot, StateChecker, World
from trailmark.benchmark.public.graded import corner_ends
from trailmark.proofs.background import Background, in_time
from trailmark.proofs.enclosure import enclosed, enclosure, shut_off
from trailmark.shapes import Polygon, Rectangle

SECONDS = 20.0
"""More than any proof here takes, on a slow machine."""


def wall_with_gap(gap: float) -> World:
    """Two rooms of 5 x 5 m, and a gap in the wall of 1 m between them."""
    side = 0.5 * (5.0 - gap)
    walls = [Rectangle((5.5, y), 1.0, side) for y in (0.5 * side, 5.0 - 0.5 * side)]
    return World("rooms", (0.0, 0.0, 11.0, 5.0), tuple(walls))


def proven(checker: StateChecker, start: ArrayLike, goal: ArrayLike) -> bool:
    """Whether there is an enclosure; its rim is looked at by shapely, place by place."""
    proof = enclosure(checker, start, goal, seconds=SECONDS)
    if proof is not None:
        rim = proof.rim_centers, proof.rim_extents, proof.pivot
        assert not free_somewhere(checker.world, checker.robot, *rim)
    return proof is not None


@pytest.mark.slow
@pytest.mark.parametrize("robot", [ROBOTS["rectangle"], Robot.rectangle(1.4, 1.0), ROBOTS["L"]])
def test_a_gap_too_narrow_is_closed(robot: Robot) -> None:
    # The L passes where one of its arms does, and its other arm follows.
    width = 0.96 - (0.4 if robot is ROBOTS["L"] else 0.0)
    assert proven(StateChecker(wall_with_gap(width), robot), (2.0, 2.0, 0.3), (9.0, 2.0, 2.0))


@pytest.mark.parametrize("gap", [1.0, 1.01])
def test_a_gap_just_wide_enough_is_not(gap: float) -> None:
    checker = StateChecker(wall_with_gap(gap), ROBOTS["rectangle"])
    # It ends by itself long before.
    assert not enclosed(checker, (2.0, 2.5, 0.0), (9.0, 2.5, 0.0), seconds=2.0)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "closed"), [(1.0, False), (1.15, True)])
def test_a_rod_passes_a_corner_up_to_its_known_length(share: float, closed: bool) -> None:
    # A rod of no width passes from a corridor of width a into one of width b up to (a^2/3 + b^2/3)^3/2. One of some
    # width passes no more than that along its middle does, and at least what that does in corridors narrower by it.
    a, b, width = 1.0, 1.4, 0.1
    less = 0.0 if closed else width
    longest = ((a - less) ** (2 / 3) + (b - less) ** (2 / 3)) ** 1.5
    robot = Robot.rectangle(share * longest - less, width)
    corridor = Polygon(np.array([(0, 0), (8, 0), (8, a), (b, a), (b, 8), (0, 8)], dtype=np.float64))
    world = World("corner", (0.0, 0.0, 8.0, 8.0), boundary=corridor)
    checker, start = StateChecker(world, robot), (5.5, 0.5 * a, 0.0)
    assert enclosed(checker, start, (0.5 * b, 5.5, -0.5 * math.pi), seconds=SECONDS) is closed
    # The end that goes first stays the first: nothing that passes turns round in such corridors.
    assert closed or enclosed(checker, start, (0.5 * b, 5.5, 0.5 * math.pi), seconds=SECONDS)


@pytest.fixture(scope="module")
def pocket() -> tuple[StateChecker, NDArray[np.float64], NDArray[np.float64]]:
    """A world of much clutter, as the benchmarks have it, and two ends; the inscribed disc passes out of the pocket."""
    world = replace(random_world(500_104, 500), robot=ROBOTS["L"])
    ends = corner_ends(world, np.random.default_rng(104))
    return StateChecker(world), np.array(ends[0]), np.array(ends[1])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["L", "thin"])
def test_nothing_is_claimed_where_the_planner_finds_a_path(name: str) -> None:
    # The planner asks for enclosures itself: a false one would keep it from its path.
    settings, found = PlannerSettings(without=("background-proof",)), 0
    for seed in trials(2, of=2):
        world = random_world(seed, 50, size=30.0, radii=(0.5, 3.0), discs=0.2)
        planner = LandmarkPlanner(world, ROBOTS[name], seed=seed, settings=settings)
        q = np.random.default_rng(seed).uniform((0, 0, -np.pi), (30, 30, np.pi), (400, 3))
        q = q[planner.checker.valid(q)]
        for start, goal in zip(q[:2], q[2:4], strict=True):
            if planner.plan(start, goal, 20.0, gap=np.inf).status == "solved":
                found += 1
                assert not enclosed(planner.checker, start, goal, seconds=1.0)
    assert found > 1


@pytest.mark.slow
def test_time_stop_and_budget_end_it(pocket: tuple[StateChecker, NDArray[np.float64], NDArray[np.float64]]) -> None:
    assert not enclosed(*pocket, seconds=0.03)
    assert not enclosed(*pocket, stop=lambda: True)
    assert not enclosed(*pocket, budget=2000)


def test_ends_that_are_not_valid_prove_nothing() -> None:
    checker = StateChecker(wall_with_gap(2.0), ROBOTS["rectangle"])
    assert not enclosed(checker, (5.5, 0.3, 0.0), (9.0, 2.0, 0.0), seconds=1.0)
    assert not enclosed(checker, (9.0, 2.0, 0.0), (-3.0, 2.0, 0.0), seconds=1.0)


PLACES = np.stack(np.meshgrid(np.arange(0.25, 11.0, 0.5), np.arange(0.25, 5.0, 0.5)), axis=-1).reshape(-1, 2)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "start"), [("rectangle", (2.0, 2.0, 0.3)), ("offset", (9.0, 2.0, 0.3))])
def test_all_of_a_room_is_shut_off_at_once(name: str, start: tuple[float, float, float]) -> None:
    checker = StateChecker(wall_with_gap(0.5), ROBOTS[name])
    around = np.array([11.0 - start[0], 2.0])
    shut = shut_off(checker, np.array(start), around, PLACES, seconds=SECONDS)
    across = (PLACES[:, 0] - 5.5) * np.sign(start[0] - 5.5) < -1.0
    turns = np.column_stack([np.repeat(PLACES, 16, axis=0), np.tile(np.arange(16) * np.pi / 8.0 - 3.0, len(PLACES))])
    fits = np.asarray(checker.valid(turns)).reshape(-1, 16).any(axis=1)
    assert (across & fits).sum() > 20
    assert shut[across & fits].all()
    # Where it is itself it fits, with any heading at some distance from the walls.
    own = (np.abs(PLACES - [start[0], 2.5]) < 1.0).all(axis=1)
    assert own.any()
    assert not shut[own].any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", trials(2, of=2))
def test_no_place_is_shut_off_that_the_planner_gets_to(seed: int) -> None:
    world = random_world(seed, 20, size=8.0, radii=(0.3, 0.9), discs=0.3)
    planner, rng = LandmarkPlanner(world, ROBOTS["rectangle"], seed=seed), np.random.default_rng(seed)
    q = rng.uniform((0, 0, -np.pi), (8, 8, np.pi), (300, 3))
    q = q[planner.checker.valid(q)]
    goals = q[1 : 1 + few(16, of=2)]
    reached = [goal for goal in goals if planner.plan(q[0], goal, 1.0, max_iterations=1).status == "solved"]
    assert len(reached) > few(8, of=2)
    for goal in goals[: few(6, of=2)]:
        shut = shut_off(planner.checker, q[0], goal[:2], q[:, :2], seconds=0.5)
        assert not shut[0]
        assert not any(shut[(q == end).all(axis=1)].any() for end in reached)


ROD = Robot.rectangle(2.0, 0.3)


SLIT = World("slit", (0, 0, 8, 6), (Rectangle((4.0, 1.4), 0.5, 2.8), Rectangle((4.0, 4.6), 0.5, 2.8)), ROD)
"""A wall with a gap 0.4 m wide, which the rod gets through straight on."""


SHUT = World("shut", (0, 0, 8, 6), (*SLIT.obstacles, Rectangle((3.2, 3.0), 0.2, 1.8)), ROD)
"""The same gap with a pillar before it, which the inscribed disc gets around."""


ENDS = (np.array([1.5, 3.0, 1.5]), np.array([6.5, 3.0, 1.5]))


def others() -> int:
    return sum(thread.name == "proof of infeasibility" for thread in threading.enumerate())


def proof_of(world: World) -> Background[bool]:
    checker = StateChecker(world)
    return Background(lambda stop: enclosed(checker, *ENDS, seconds=50.0, stop=stop), "proof of infeasibility")


@pytest.mark.slow
def test_a_proof_is_found_and_none_where_there_is_a_path() -> None:
    for world, shut in ((SHUT, True), (SLIT, False)):
        proof = proof_of(world).begin()
        proof.wait(60.0)
        assert proof.found() == shut
    assert LandmarkPlanner(SLIT, seed=0).plan(*ENDS, 20.0, gap=np.inf).status == "solved"


def test_what_is_no_longer_wanted_ends_soon() -> None:
    running, unwanted = proof_of(SLIT), proof_of(SHUT)
    running.begin()
    running.cancel()
    # This one would be found, were it not for that.
    unwanted.cancel()
    unwanted.begin()
    for proof in (running, unwanted):
        proof.wait(120.0)
        assert not proof.running
        assert not proof.found()
    proof_of(SLIT).end()  # it never began
    proof = proof_of(SLIT).begin()
    proof.end()
    assert not proof.running
    assert others() == 0


def test_an_error_is_raised_where_the_result_is_asked_for() -> None:
    def fail(stop: object) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        in_time(10.0, fail)
    assert in_time(0.0, lambda stop: threading.Event().wait(0.2)) is None


def test_discs_are_left_to_the_triangles_and_bad_ends_are_told() -> None:
    assert not enclosed(StateChecker(wall_with_gap(0.5), Robot.disc(0.4)), (2.0, 2.0, 0.0), (9.0, 2.0, 0.0))
    with pytest.raises(ConfigurationError, match="goal"):
        enclosed(StateChecker(wall_with_gap(0.5), ROBOTS["L"]), (2.0, 2.0, 0.0), (9.0, math.nan, 0.0))
    with pytest.raises(ConfigurationError, match="start: expected shape"):
        enclosed(StateChecker(wall_with_gap(0.5), ROBOTS["L"]), np.zeros((2, 3)), (9.0, 2.0, 0.0))


@pytest.mark.slow
def test_a_place_with_two_headings_that_are_apart_takes_two_enclosures() -> None:
    # A slot as wide as the robot, shut at both ends: there is no turning round in it.
    walls = (
        Rectangle((3.0, 1.3), 2.4, 0.4),
        Rectangle((3.0, 2.3), 2.4, 0.4),
        *(Rectangle((x, 1.8), 0.2, 1.4) for x in (1.9, 4.1)),
    )
    checker = StateChecker(World("slot", (0.0, 0.0, 6.0, 4.0), walls), Robot.rectangle(0.9, 0.5))
    place = np.array([[3.0, 1.8]])
    assert checker.valid((3.0, 1.8, 0.0))
    assert shut_off(checker, np.array([0.7, 0.7, 0.0]), place[0], place, seconds=SECONDS).all()


def test_nothing_is_told_of_round_robots_or_without_time() -> None:
    closed = wall_with_gap(0.3)
    for robot, seconds in ((Robot.disc(0.4), SECONDS), (ROBOTS["rectangle"], 0.0)):
        checker = StateChecker(closed, robot)
        assert not shut_off(checker, np.array([2.0, 2.0, 0.0]), np.array([9.0, 2.0]), PLACES, seconds=seconds).any()
