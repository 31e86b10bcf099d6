"""A query for which there is a path already, and whose ends may stand in obstacles by now."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.goals import Ends, Goal, ReachedGoal, goals_of
from trailmark.path import Path
from trailmark.planning.answer import answer
from trailmark.planning.escape import way_out
from trailmark.planning.followed import vertices_of
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.leaving import leave
from trailmark.planning.models import WorldModels
from trailmark.planning.reasons import explained
from trailmark.planning.replanning import MIN_SECONDS, Replanner, ReplanOptions, as_replan
from trailmark.planning.result import ReplanResult, Status
from trailmark.planning.single_query import answer_query
from trailmark.planning.space_time import SpaceTimeReplanner
from trailmark.planning.world_model import WorldModel, zones_at
from trailmark.se2 import FloatArray

__all__ = ["ReplanOptions", "answer_replan", "replan_to"]


def answer_replan(
    models: WorldModels, start: ArrayLike, goal: ArrayLike, path: Path, options: ReplanOptions
) -> ReplanResult:
    """Return the answer of :meth:`trailmark.LandmarkPlanner.replan`, whose arguments these are.

    Raises:
        ConfigurationError: start or goal is no configuration.
    """
    in_time = None
    # A car gives way by manoeuvres, which are not sought: what an obstacle sweeps is occupied for it.
    if options.speed is not None and models.world.moving and models.motion.moves_anywhere:
        model, ends = models.standing, np.array([_configuration(start, "start"), _configuration(goal, "goal")])
        with model.shared.lock:
            if model.checker.states_free(ends).all():
                replanner = Replanner(model, ends[0], ends[1], options)
                query = SpaceTimeReplanner(replanner, models.moving, options.speed)
                in_time = query.answer(path)
                if in_time.path is not None or replanner.seconds_left() <= 0.0 or query.ends_are_swept():
                    return in_time
    model = models.full
    with model.shared.lock:
        found = _replanned(model, start, goal, path, options)
    # What no obstacle ever sweeps is clear of all of them at any time.
    return found if in_time is None or (found.path is not None and not found.escape) else in_time


def _replanned(
    model: WorldModel, start: ArrayLike, goal: ArrayLike, path: Path, options: ReplanOptions
) -> ReplanResult:
    """Return the path to follow from here on; whoever calls holds the lock of the model's roadmap.

    Args:
        model: of the world as it is.
        start: where the robot is, shape (3,).
        goal: shape (3,).
        path: being followed.
        options: how to.

    Raises:
        ConfigurationError: start or goal is no configuration.
    """
    ends = np.array([_configuration(start, "start"), _configuration(goal, "goal")])
    free = model.checker.states_free(ends)
    if free.all():
        return Replanner(model, ends[0], ends[1], options).answer(path)
    if free[1] and (zones := zones_at(model.checker, ends[0])) and model.without(zones).checker.valid(ends[0]):
        seconds = max(options.deadline - perf_counter(), MIN_SECONDS)

        def go_on(start: FloatArray, goal: FloatArray, seconds: float) -> ReplanResult:
            return Replanner(model, start, goal, replace(options, deadline=perf_counter() + seconds)).answer(path)

        left, escape = leave(model, zones, ends[0], ends[1], seconds, answer_query, go_on)
        names = " and ".join(zones)
        reason = f"no path out of {names} was found" if left.path is None else f"the path leaves {names} first"
        return replace(as_replan(left, ""), reason=reason, escape=escape)
    for end, name in ((1, "goal"), (0, "robot")):
        if not free[end]:
            problem = f"the {name} {model.checker.fault(ends[end])}"
            if end == 1 or not options.escape:
                return _nothing(model, ends, "infeasible", problem)
    out = way_out(model.checker, ends[0])
    if out is None:
        return _nothing(model, ends, "timeout", f"{problem}, and no way out was found")
    rest = Replanner(model, out[-1], ends[1], options).answer(path)
    if rest.path is None:
        return replace(rest, reason=f"{problem}; from where it is free: {rest.reason}", nearest=Path(out))
    motion = model.motion
    states = np.vstack([out, vertices_of(motion, rest.path)[1:]])
    whole = motion.path(motion.whole_states(states, ends[0], ends[1]))
    whole = model.verification.followed_by_lines(whole, leaves=True)
    return replace(
        rest,
        path=whole,
        kept=False,
        lower_bound=None,
        min_clearance=0.0,
        escape=len(motion.path(out)) - 1,
        reason=f"{problem}: the path leads out first",
    )


def _configuration(q: ArrayLike, name: str) -> FloatArray:
    state = se2.configurations(q, name=name)
    if state.ndim != 1:
        raise ConfigurationError(f"{name}: expected shape (3,), got {state.shape}")
    return state


def _nothing(model: WorldModel, ends: FloatArray, status: Status, reason: str) -> ReplanResult:
    """Return a result without a path."""
    incumbent = Incumbent(model.motion, ends[0], ends[1], perf_counter())
    result = model.verification.result(incumbent, status, None, model.shared.roadmap)
    return replace(as_replan(result, ""), reason=reason)


# --- Replanning to goals: the path being followed is kept or repaired as long as it leads to one of them.


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
