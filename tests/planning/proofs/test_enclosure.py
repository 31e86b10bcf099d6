"""Enclosures are proven where there is no way, and never where there is one."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as tried
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from tests.helpers.cell_oracle import free_somewhere
from tests.helpers.oracle import Oracle, motion_states
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few, trials

from trailmark import se2
from trailmark.benchmark.public.graded import corner_ends
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.planning import LandmarkPlanner
from trailmark.planning.proofs.enclosure import enclosed, enclosure
from trailmark.planning.settings import PlannerSettings
from trailmark.shapes import Polygon, Rectangle
from trailmark.world import Robot, World

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


def test_its_cells_hold_one_end_and_not_the_other() -> None:
    ends = np.array([(2.0, 2.0, 0.3), (9.0, 2.0, 2.0)])
    proof = enclosure(StateChecker(wall_with_gap(0.6), ROBOTS["L"]), *ends, seconds=SECONDS)
    assert proof is not None
    poses = np.column_stack([se2.transform(ends, proof.pivot[None])[:, 0], ends[:, 2]])
    off = np.abs(se2.difference(proof.centers[None], poses[:, None]))
    inside = (off <= proof.extents * (1.0 + 1e-9)).all(axis=-1).any(axis=-1)
    assert inside.tolist() == [proof.end == 0, proof.end == 1]


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
    assert ends is not None
    return StateChecker(world), np.array(ends[0]), np.array(ends[1])


@pytest.mark.slow
def test_pockets_of_clutter_are_closed(pocket: tuple[StateChecker, NDArray[np.float64], NDArray[np.float64]]) -> None:
    assert proven(*pocket)


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
@given(st.integers(0, 2**32 - 1), st.sampled_from(["rectangle", "L", "offset", "star"]))
@tried(max_examples=few(4, of=2))
def test_nothing_is_claimed_where_a_grid_has_a_way(seed: int, name: str) -> None:
    robot = ROBOTS[name]
    world = random_world(seed, 9, size=8.0, radii=(0.4, 1.6), discs=0.3)
    oracle = Oracle(world, robot)
    labels, states = _grid(oracle)
    largest = np.argmax(np.bincount(labels[labels >= 0])) if (labels >= 0).any() else -1
    ends = np.flatnonzero((labels == largest) & (labels >= 0))
    if len(ends) < 2:
        return
    rng = np.random.default_rng(seed)
    checker = StateChecker(world, robot)
    for _ in range(2):
        start, goal = states[rng.choice(ends, 2, replace=False)]
        assert not enclosed(checker, start, goal, seconds=0.3)


def _grid(oracle: Oracle) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return configurations on a grid and which of its parts each belongs to, -1 if it collides."""
    n, turns = 20, 16
    x, y = (np.linspace(0.2, 7.8, n) for _ in range(2))
    theta = np.arange(turns) * 2.0 * np.pi / turns - np.pi + 0.1
    states = np.stack(np.meshgrid(x, y, theta, indexing="ij"), axis=-1).reshape(-1, 3)
    free = ~oracle.collides(states)
    index = np.arange(len(states)).reshape(n, n, turns)
    pairs = [(index[:-1], index[1:]), (index[:, :-1], index[:, 1:]), (index, np.roll(index, -1, axis=2))]
    edges = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in pairs])
    edges = edges[free[edges].all(axis=1)]
    between = motion_states(states[edges[:, 0]], states[edges[:, 1]], 6)
    edges = edges[~oracle.collides(between.reshape(-1, 3)).reshape(len(edges), -1).any(axis=1)]
    near: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    labels = np.full(len(states), -1, np.int64)
    for label, seed in enumerate(np.flatnonzero(free).tolist()):
        if labels[seed] >= 0:
            continue
        labels[seed], queue = label, deque([seed])
        while queue:
            for other in near.get(queue.popleft(), []):
                if labels[other] < 0:
                    labels[other] = label
                    queue.append(other)
    return labels, states


@pytest.mark.slow
def test_time_stop_and_budget_end_it(pocket: tuple[StateChecker, NDArray[np.float64], NDArray[np.float64]]) -> None:
    begin = process_time()
    assert not enclosed(*pocket, seconds=0.03)
    assert process_time() - begin < 0.15
    assert not enclosed(*pocket, stop=lambda: True)
    assert not enclosed(*pocket, budget=2000)


def test_discs_are_left_to_the_triangles_and_bad_ends_are_told() -> None:
    assert not enclosed(StateChecker(wall_with_gap(0.5), Robot.disc(0.4)), (2.0, 2.0, 0.0), (9.0, 2.0, 0.0))
    with pytest.raises(ConfigurationError, match="goal"):
        enclosed(StateChecker(wall_with_gap(0.5), ROBOTS["L"]), (2.0, 2.0, 0.0), (9.0, math.nan, 0.0))
    with pytest.raises(ConfigurationError, match="start: expected shape"):
        enclosed(StateChecker(wall_with_gap(0.5), ROBOTS["L"]), np.zeros((2, 3)), (9.0, 2.0, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6])
def test_very_thin_robots_in_large_worlds_end_in_time(width: float) -> None:
    world = World("large", (-900.0, 0.0, 100.0, 1000.0), (Rectangle((0.0, 500.0), 2.0, 1100.0),))
    checker = StateChecker(world, Robot.rectangle(3.0, width))
    begin = process_time()
    assert not enclosed(checker, (-50.0, 500.0, 0.0), (-60.0, 500.0, 1.0), seconds=0.1)
    assert process_time() - begin < 0.5


def test_ends_that_are_not_valid_prove_nothing() -> None:
    checker = StateChecker(wall_with_gap(2.0), ROBOTS["rectangle"])
    assert not enclosed(checker, (5.5, 0.3, 0.0), (9.0, 2.0, 0.0), seconds=1.0)
    assert not enclosed(checker, (9.0, 2.0, 0.0), (-3.0, 2.0, 0.0), seconds=1.0)
