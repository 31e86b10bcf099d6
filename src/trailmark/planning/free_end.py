"""The end of a path, moved within its goal as long as that makes the path cheaper."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trailmark.goals import Goal
from trailmark.motion import Motion
from trailmark.planning.shortening import shorten
from trailmark.se2 import FloatArray

__all__ = ["with_free_end"]

LAST = 6
"""Vertices at a path's end from which a motion to another place in the goal is tried."""

ROUNDS = 12
"""Times that the end is moved, and the path shortened after it, at most."""

SWEEPS = 3
"""Of shortening after each."""

STEPS = 24
"""Random places around the end that are tried for a car, and for others where the nearest place is not free."""

LEAST_GAIN = 1e-4
"""Share of the cost below which a gain is not worth another round."""


def with_free_end(
    motion: Motion, states: FloatArray, goal: Goal, rng: np.random.Generator, seconds_left: Callable[[], float]
) -> FloatArray:
    """Return a path that ends where in its goal it costs least, as far as that is found; shape (m, 3).

    Args:
        motion: what leads from one state to the next, and certifies it.
        states: of a path of certified motions, shape (n, 3), whose last state the goal holds.
        goal: where it may end; for a robot whose heading makes no difference, headings are left as they are.
        rng: source of randomness.
        seconds_left: asked before each round.
    """
    reach = goal.disc[1] + 0.1 * motion.checker.robot.circumradius
    for _ in range(ROUNDS):
        if len(states) < 2 or seconds_left() <= 0.0:
            break
        before = motion.cost_of(states)
        moved = _end_moved(motion, states, goal, rng, reach)
        reach = 0.5 * reach if moved is None else reach
        if moved is not None:
            states = shorten(motion, moved, rng, sweeps=SWEEPS, seconds_left=seconds_left)
        elif reach < LEAST_GAIN * max(before, 1e-9):
            break
        elif motion.moves_anywhere and motion.cost_of(states) > (1.0 - LEAST_GAIN) * before:
            # Where a robot may move in any direction, the nearest place was tried, and is the best there is.
            reach = min(reach, 0.25 * before)
    return states


def _end_moved(
    motion: Motion, states: FloatArray, goal: Goal, rng: np.random.Generator, reach: float
) -> FloatArray | None:
    """Return the path with another, cheaper end, from one of its last vertices; None if none was found."""
    along = np.concatenate([[0.0], np.cumsum(motion.costs(states[:-1], states[1:]))])
    first = max(0, len(states) - 1 - LAST)
    vertices = states[first:-1]
    end, theta = states[-1], None if motion.turns else states[-1, 2]
    around = end + rng.uniform(-1.0, 1.0, (STEPS, 3)) * np.array([reach, reach, min(np.pi, reach)])
    nearest = goal.nearest(vertices)
    # Part of the way there, where all of it is not free.
    between = end + 0.5 * (nearest - end)
    places = np.vstack([nearest, goal.nearest(np.vstack([between, around]))])
    if theta is not None:
        places[:, 2] = theta
    starts = np.repeat(np.arange(first, len(states) - 1), len(places))
    ends = np.tile(places, (len(vertices), 1))
    cost = along[starts] + motion.costs(states[starts], ends)
    limit = along[-1] - 1e-9 * max(1.0, along[-1])
    for k in np.argsort(cost)[: 2 * STEPS]:
        if cost[k] >= limit:
            return None
        free = motion.checker.states_free(ends[k : k + 1])[0]
        if free and motion.motions_between_valid(states[starts[k]][None], ends[k : k + 1])[0]:
            keep = states[: starts[k] + 1]
            same = np.array_equal(keep[-1], ends[k])
            return keep if same and len(keep) > 1 else np.vstack([keep, ends[k]])
    return None
