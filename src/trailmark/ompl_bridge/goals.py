"""Goals of OMPL's as trailmark's: a state, a state with a threshold, several states, or a region of any kind."""

from __future__ import annotations

from typing import Any

import numpy as np
from ompl import base as ob

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.ompl_bridge.states import configuration, write_state
from trailmark.world.goals import Goal

__all__ = ["goals_in", "is_one_state"]

EXACT = 1e-6
"""Thresholds up to which a goal counts as its state alone; OMPL's own default is the rounding of a double."""

STATES, DRAWS = 32, 20_000
"""States of a region that are planned to, and how many are drawn at random to find them."""

SPARE = 1e-9
"""Share of a threshold that rounding may take."""


def is_one_state(goal: Any) -> bool:
    """Return whether a goal of OMPL's is a state without a tolerance worth the name."""
    return isinstance(goal, ob.GoalState) and goal.getThreshold() <= EXACT


def goals_in(goal: Any, checker: StateChecker, *, straight: bool) -> tuple[Goal, ...] | None:
    """Return the goals of a problem; None if it has none, or but one state.

    Of a region, states are drawn: by itself if it can, else at random, of which those are kept that satisfy it.

    A threshold is a distance, ‖Δxy‖ + 0.5·|Δθ| in an ``SE2StateSpace``: half of it goes to the position and half to the
    heading, so that no more is allowed than OMPL allows. In a car's space goals count as their states alone.

    Args:
        goal: of a ``ProblemDefinition``.
        checker: tells which states are valid.
        straight: whether distances are those of an ``SE2StateSpace``.

    Raises:
        ConfigurationError: ``GoalLazySamples``, a ``GoalStates`` without states, a region in which no valid state was
            found.
    """
    if goal is None:
        return None
    # GoalLazySamples, which is one, draws in a thread of its own and would wait for Python for ever.
    if type(goal).__name__ == "GoalLazySamples":
        raise ConfigurationError("goal: expected a goal that draws no states of its own accord, got GoalLazySamples")
    several = isinstance(goal, ob.GoalStates)
    if not (several or isinstance(goal, ob.GoalState)):
        return _drawn(goal, checker)
    threshold = goal.getThreshold() * (1.0 - SPARE) if straight else 0.0
    if not several and threshold <= EXACT:
        return None
    count = goal.getStateCount() if several else 1
    if count == 0:
        raise ConfigurationError("goal: expected a GoalStates with states, got none")
    tolerance = threshold if threshold > EXACT else 0.0
    # Copies, drawn in their order: a state that the bindings hand out may be freed twice.
    copy, goals = goal.getSpaceInformation().allocState(), []
    for _ in range(count):
        goal.sampleGoal(copy)
        pose = tuple(configuration(copy).tolist())
        goals.append(Goal(pose, position_tolerance=0.5 * tolerance, heading_tolerance=tolerance))
    return tuple(goals)


def _drawn(goal: Any, checker: StateChecker) -> tuple[Goal, ...]:
    """Return valid states that satisfy a goal, as many as STATES."""
    copy, goals = goal.getSpaceInformation().allocState(), list[Goal]()
    xmin, ymin, xmax, ymax = checker.world.bounds
    q = np.random.default_rng(0).uniform((xmin, ymin, -np.pi), (xmax, ymax, np.pi), (DRAWS, 3))
    if isinstance(goal, ob.GoalSampleableRegion):
        for row in q[: 4 * STATES]:
            goal.sampleGoal(copy)
            row[:] = configuration(copy)
        q = q[: 4 * STATES]
    for row in q[checker.valid(q)]:
        write_state(copy, row)
        if goal.isSatisfied(copy):
            goals.append(Goal(tuple(row.tolist())))
            if len(goals) == STATES:
                break
    if not goals:
        raise ConfigurationError(f"goal: expected a region that holds valid states, found none of {len(q):,} drawn")
    return tuple(goals)
