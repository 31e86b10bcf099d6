"""Goals of OMPL's as trailmark's: a state, a state with a threshold, or several states."""

# Tested by tests/ompl_bridge/test_goals.py.

from __future__ import annotations

from typing import Any

from ompl import base as ob

from trailmark.errors import ConfigurationError
from trailmark.goals import Goal
from trailmark.ompl_bridge.states import configuration

__all__ = ["goals_in"]

EXACT = 1e-6
"""Thresholds up to which a goal counts as its state alone; OMPL's own default is the rounding of a double."""

SPARE = 1e-9
"""Share of a threshold that rounding may take."""


def goals_in(goal: Any, *, straight: bool) -> tuple[Goal, ...] | None:
    """Return the goals of a problem; None if it has none, or but one state.

    A threshold is a distance, ‖Δxy‖ + 0.5·|Δθ| in an ``SE2StateSpace``: half of it goes to the position and half to the
    heading, so that no more is allowed than OMPL allows. In a car's space goals count as their states alone.

    Args:
        goal: of a ``ProblemDefinition``.
        straight: whether distances are those of an ``SE2StateSpace``.

    Raises:
        ConfigurationError: a goal of another kind, or a ``GoalStates`` without states.
    """
    if goal is None:
        return None
    # GoalLazySamples, which is one, draws in a thread of its own and would wait for Python for ever.
    several = isinstance(goal, ob.GoalStates) and type(goal).__name__ != "GoalLazySamples"
    if not (several or isinstance(goal, ob.GoalState)):
        raise ConfigurationError(f"goal: expected a GoalState or GoalStates, got {type(goal).__name__}")
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
