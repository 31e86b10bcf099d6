"""LatticeSchedule: searches from both ends, level by level, while there is time; other paths; what is not repeated."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.helpers.oracles import judge
from tests.helpers.trials import few
from tests.helpers.worlds import ROBOTS, random_world

from trailmark.collision import StateChecker
from trailmark.motion import motion_of
from trailmark.planning import lattice_schedule as schedule
from trailmark.planning.lattice_schedule import LatticeSchedule
from trailmark.search.lattice import Lattice
from trailmark.shapes import Rectangle
from trailmark.world import Robot, World

FloatArray = NDArray[np.float64]


def scheduled(checker: StateChecker, ends: FloatArray, cell: float = 0.5, seconds: float = math.inf) -> LatticeSchedule:
    return LatticeSchedule(motion_of(checker), np.array(ends), cell, lambda: seconds)


@pytest.mark.slow
@settings(max_examples=few(20))
@given(
    name=st.sampled_from(sorted(ROBOTS)),
    world=st.integers(0, 5),
    seed=st.integers(0, 1000),
    headings=st.sampled_from([None, (0.0, math.pi), (math.pi, 0.0), (math.pi / 2, -math.pi / 2), (math.pi, math.pi)]),
)
def test_paths_are_certified_and_repeatable(
    name: str, world: int, seed: int, headings: tuple[float, float] | None
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

    def searched() -> list[FloatArray]:
        lattices, rng = scheduled(checker, ends, 0.8), np.random.default_rng(seed)
        found = [lattices.first_path(3)]
        for views in (0, len(schedule.VIEWS)):
            lattices.views = views
            found += [lattices.other_path(rng, 100.0) for _ in range(3)]
        return found

    for states, again in zip(searched(), searched(), strict=True):
        assert np.array_equal(states, again)
        if len(states):
            judge(checker.world, checker.robot, *ends, states)
            assert checker.motions_valid(states[:-1], states[1:]).all()


def test_half_a_turn_on_the_way_back_is_another_motion(monkeypatch: pytest.MonkeyPatch) -> None:
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
