"""What the properties are about: any footprint, moving in any of the ways there are, in any world."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from tests.helpers.oracles import Oracle, motion_states
from tests.helpers.worlds import ROBOTS, random_states, random_world, short_motions, star_polygon

from trailmark import Disc, KeepOutZone, Robot, StateChecker, se2
from trailmark.motion import CurveMotion, Motion, motion_of
from trailmark.se2 import FloatArray
from trailmark.trajectories import path_of

__all__ = ["DRIVES", "Case", "cases", "driven", "longest_step", "motions", "near_contact"]

DRIVES: dict[str, Callable[[Robot, float], Robot]] = {
    "any way": lambda robot, _: robot,
    "differential": lambda robot, _: robot.differential(),
    "differential, both ways": lambda robot, _: robot.differential(reverse=True),
    "car": lambda robot, radius: robot.steered(radius),
    "car, forwards": lambda robot, radius: robot.steered(radius, reverse=False),
}
"""Robots by how they move, of a footprint and a turning radius (metres)."""


class Case(NamedTuple):
    """A robot in a world.

    Attributes:
        checker: of the world with its keep-out zones, and the robot.
        motion: how it moves.
        oracle: shapely's word.
        size: how large the world is against one of 25 m.
        rng: drawn from by the property.
    """

    checker: StateChecker
    motion: Motion
    oracle: Oracle
    size: float
    rng: np.random.Generator


@st.composite
def cases(draw: st.DrawFn, *origins: tuple[float, float], drives: tuple[str, ...] = tuple(DRIVES)) -> Case:
    """Draw worlds of discs, polygons with holes, boundary, keep-out zone; of 1, 25 and 1,000 m, near and far away."""
    seed, size = draw(st.integers(0, 2**32 - 1)), draw(st.sampled_from([1.0, 1.0, 0.04, 40.0]))
    rng = np.random.default_rng(seed)
    world = random_world(
        seed,
        draw(st.sampled_from([0, 3, 15, 40])),
        size=25.0 * size,
        radii=(0.1 * size, 3.0 * size),
        discs=0.3,
        holes=0.3,
        boundary=draw(st.booleans()),
        origin=draw(st.sampled_from([(0.0, 0.0), *origins])),
    )
    if draw(st.booleans()):
        place = random_states(world, 1, rng)[0]
        zone = KeepOutZone(star_polygon(rng, (float(place[0]), float(place[1])), 2.0 * size))
        world = replace(world, zones=(zone,))
    name = draw(st.sampled_from([*ROBOTS, "random"]))
    if name == "disc":
        footprint = Robot.disc(float(rng.uniform(0.05, 1.0)) * size)
    elif name == "random":
        x, y = rng.uniform(-1.0, 1.0, 2) * size
        footprint = Robot(star_polygon(rng, (float(x), float(y)), float(rng.uniform(0.1, 1.2)) * size))
    else:
        footprint = Robot.polygon(size * ROBOTS[name].outline.vertices)
    robot = DRIVES[draw(st.sampled_from(drives))](footprint, 1.5 * size).keeping(
        draw(st.sampled_from([0.0, 0.1 * size]))
    )
    cell = draw(st.sampled_from([None, 0.1, 2.0]))
    checker = StateChecker(world, robot, cell=None if cell is None else cell * size)
    return Case(checker, motion_of(checker), Oracle(checker.world, robot), size, rng)


def near_contact(case: Case, n: int) -> FloatArray:
    """Return configurations, of which about a third all but touch: by bisection between a free and a blocked one."""
    checker, rng = case.checker, case.rng
    q = random_states(checker.world, n, rng, case.size)
    valid = checker.valid(q)
    m = min(int(valid.sum()), int((~valid).sum()), n // 4)
    free, blocked = q[valid][:m], q[~valid][:m]
    for _ in range(int(rng.integers(10, 40))):
        middle = 0.5 * (free + blocked)
        ok = checker.valid(middle)
        free[ok], blocked[~ok] = middle[ok], middle[~ok]
    return np.concatenate([q, free, blocked])


def motions(case: Case, n: int) -> tuple[FloatArray, FloatArray]:
    """Return valid starts and ends, at most n: any, turns in place, half turns and shifts without a turn."""
    a, b = short_motions(case.checker.world, 6 * n, case.rng, 6.0 * case.size)
    kind = case.rng.integers(0, 8, len(a))
    b[kind == 0, :2] = a[kind == 0, :2]
    b[kind == 1, 2] = se2.wrap(a[kind == 1, 2] + math.pi)
    b[kind == 2, 2] = a[kind == 2, 2]
    # Ahead, as most are on paths.
    b[kind > 5, 2] = se2.wrap(a[kind > 5, 2] + 0.3 * (b[kind > 5, 2] - a[kind > 5, 2]))
    valid = case.checker.valid(a) & case.checker.valid(b)
    return a[valid][:n], b[valid][:n]


def driven(motion: Motion, a: FloatArray, b: FloatArray, samples: int) -> FloatArray:
    """Return places along motions from a to b, each (n, 3), by formulas of the tests: shape (n, m, 3)."""
    if isinstance(motion, CurveMotion):
        lengths = motion.steering.lengths(a, b)
        return np.asarray(motion.steering.states(a, b, lengths[:, None] * np.linspace(0.0, 1.0, samples)))
    if motion.checker.robot.drive == "differential":
        rows = [path_of(motion, np.array(ends)).states for ends in zip(a, b, strict=True)]
        # A turn, a drive, a turn: of those that take fewer, the last one again.
        stops = np.array([np.concatenate([row, row[[-1] * (4 - len(row))]]) for row in rows])
        pieces = [motion_states(stops[:, k], stops[:, k + 1], samples // 3) for k in range(3)]
        return np.concatenate(pieces, axis=1)
    return motion_states(a, b, samples)


def longest_step(robot: Robot, states: FloatArray) -> FloatArray:
    """Return how far any point of the robot moves at most between two places next to each other, (n,)."""
    moved = se2.difference(states[:, :-1].reshape(-1, 3), states[:, 1:].reshape(-1, 3)).reshape(len(states), -1, 3)
    reach = 0.0 if isinstance(robot.footprint, Disc) else robot.circumradius
    return np.asarray(1.02 * (np.hypot(moved[..., 0], moved[..., 1]) + reach * np.abs(moved[..., 2])).max(axis=1))
