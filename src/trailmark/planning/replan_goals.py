"""Replanning to goals: the path being followed is kept or repaired as long as it leads to one of them."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from trailmark.errors import ConfigurationError
from trailmark.goals import Ends, Goal, ReachedGoal, goals_of
from trailmark.path import Path
from trailmark.planning.answer import answer
from trailmark.planning.models import WorldModels
from trailmark.planning.reasons import explained
from trailmark.planning.replan_query import ReplanOptions, answer_replan
from trailmark.planning.replanning import MIN_SECONDS, as_replan
from trailmark.planning.result import ReplanResult

__all__ = ["replan_to"]


def replan_to(models: WorldModels, start: ArrayLike, goal: Ends, path: Path, options: ReplanOptions) -> ReplanResult:
    """Return what :func:`answer_replan` does, for goals too.

    With goals, the path being followed is replanned to where it ends if a goal holds that; where none does, or no path
    leads there any more, the cheapest of the goals is planned to. Lower bounds hold for one end alone and are left out
    unless that is done.

    Raises:
        ConfigurationError: start or goal is no configuration, or there is none to go to.
    """
    goals = goals_of(goal)
    if goals is None:
        return answer_replan(models, start, goal, path, options)  # type: ignore[arg-type]  # an array then
    end, found = path.states[-1], None
    held = [i for i, each in enumerate(goals) if each.contains(end)]
    if held:
        found = answer_replan(models, start, end, path, options)
        if found.path is not None:
            i = min(held, key=lambda i: goals[i].cost)
            reached = ReachedGoal(i, (float(end[0]), float(end[1]), float(end[2])), goals[i].cost)
            return replace(found, lower_bound=None, goal=reached, target=goals)
    try:
        return _planned(models, start, goals, options, found)
    except ConfigurationError:
        if found is None:
            raise
        return found


def _planned(
    models: WorldModels, start: ArrayLike, goals: tuple[Goal, ...], options: ReplanOptions, found: ReplanResult | None
) -> ReplanResult:
    """Return the path to the cheapest of the goals, in place of one that leads to none of them any more."""
    model, seconds = models.full, max(options.deadline - perf_counter(), MIN_SECONDS)
    reason = "the path leads to another goal" if found is None else "the path to its goal is blocked"
    with model.shared.lock:
        # A first path will do, unless there is time for better ones.
        gap = 0.0 if options.improvement > 0.0 else np.inf
        begin = perf_counter()
        result = answer(model, start, goals, seconds, gap=gap)
        return as_replan(explained(model, start, goals, result, begin, seconds), reason)
