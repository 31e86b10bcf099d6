"""Density: lines through zones and past obstacles cost what dense sampling by shapely says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.helpers.oracles import sampled_cost
from tests.helpers.trials import trials

from trailmark import CostZone, Disc, Objective, Polygon, Rectangle, Robot, SpeedZone, StateChecker, World
from trailmark.motion import Motion, motion_of
from trailmark.motion.density import line_cost, sort_in_place
from trailmark.world.zones import Zone

OBSTACLES = (
    Disc((3.0, 3.0), 0.5),
    Rectangle((7.0, 6.0), 2.0, 1.0, 0.4),
    Polygon(np.array([(1, 7), (3, 7.5), (1.5, 9)], dtype=float)),
)
NON_CONVEX = [(4.0, 1.0), (9.0, 1.0), (9.0, 5.0), (8.0, 5.0), (8.0, 2.0), (5.0, 2.0), (5.0, 5.0), (4.0, 5.0)]
ZONES: tuple[Zone, ...] = (
    CostZone(Polygon(np.array(NON_CONVEX, dtype=float)), 3.0),
    CostZone(Polygon(np.array([(0, 0), (6, 0), (6, 6)], dtype=float)), 0.5),
    SpeedZone(Polygon(np.array([(2, 2), (8, 2), (8, 8), (2, 8)], dtype=float)), 0.25),
)


def world_with(zones: tuple[Zone, ...] = ZONES, offset: float = 0.0) -> World:
    assert offset == 0.0 or not zones
    return World("w", (0.0, 0.0, 10.0, 10.0), OBSTACLES, Robot.disc(0.2), zones=zones)


def weighted(world: World, objective: Objective) -> Motion:
    motion = motion_of(StateChecker(world), objective=objective)
    assert motion.weighted
    return motion


@pytest.mark.parametrize("objective", [Objective(), Objective.of("time"), Objective(0.7, 1.3, 2.0, decay=0.3)])
def test_lines_cost_what_sampling_says(objective: Objective) -> None:
    world, rng = world_with(), np.random.default_rng(1)
    motion = weighted(world, objective)
    for _ in trials(25):
        ends = np.column_stack([rng.uniform(0.05, 9.95, (2, 2)), np.zeros(2)])
        cost, error = motion.cost_within(ends)
        sampled = sampled_cost(world, objective, ends)
        # Sampling errs where a line crosses a border, by a step of a millimetre each.
        assert cost == pytest.approx(sampled, abs=error + 0.05)
        assert error <= 5e-3 * cost
        planned = motion.cost_of(ends)
        assert planned == pytest.approx(cost, rel=0.05)


def test_the_error_is_a_bound_on_the_error() -> None:
    """Along a line past a disc the integral is known by much finer pieces."""
    world = world_with(())
    motion = weighted(world, Objective(clearance=5.0))
    kind = motion.kind
    for y in np.linspace(0.1, 9.9, 7):
        rough, fine = (line_cost(kind.density, kind.grid, kind.field, 0.1, y, 9.9, y, t) for t in (0.1, 1e-4))
        assert abs(rough[0] - fine[0]) <= rough[1] + fine[1]


def test_the_least_density_is_below_every_density() -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        zones = []
        for _ in range(rng.integers(1, 6)):
            x, y, size = rng.uniform(0.0, 8.0), rng.uniform(0.0, 8.0), rng.uniform(0.5, 6.0)
            square = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
            zones.append(CostZone(Polygon(np.array(square, dtype=float)), float(rng.uniform(0.1, 3.0))))
        world = world_with(tuple(zones))
        motion = weighted(world, Objective(clearance=1.0))
        for _ in range(30):
            ends = np.column_stack([rng.uniform(0.0, 10.0, (2, 2)), np.zeros(2)])
            length = float(np.hypot(*(ends[1] - ends[0])[:2]))
            assert motion.density.least * length <= sum(motion.cost_within(ends)) + 1e-9


@given(st.lists(st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0, 1.0]), max_size=60), st.integers(0, 60))
def test_the_first_values_are_sorted_and_the_others_left_alone(numbers: list[float], count: int) -> None:
    count = min(count, len(numbers))
    values = np.array(numbers, dtype=np.float64)
    sort_in_place(values, count)
    assert values.tolist() == sorted(numbers[:count]) + numbers[count:]
