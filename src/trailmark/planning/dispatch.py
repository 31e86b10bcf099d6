"""Any query, wherever it starts and whatever its goal is: planned, with relaxed clearance if wanted, or replanned."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.planning.escape import plan_out_of_zones, way_out, without_paths
from trailmark.planning.goals import plan_to_goals
from trailmark.planning.incumbent import Budget, Incumbent, OnProgress, vertices_of
from trailmark.planning.model import WorldModel, WorldModels, zones_at
from trailmark.planning.pipeline import plan_single
from trailmark.planning.reasons import explained
from trailmark.planning.replanning import MIN_SECONDS, Replanner, ReplanOptions, as_replan
from trailmark.planning.result import PlanResult, ReplanResult, Status
from trailmark.planning.space_time import MovingObstacles, SpaceTimeReplanner
from trailmark.planning.through import Stops, plan_through
from trailmark.se2 import FloatArray
from trailmark.trajectories import Path, path_of
from trailmark.world.goals import Ends, ReachedGoal, goals_of

__all__ = ["plan_any", "plan_explained", "replan"]

R = TypeVar("R", bound=PlanResult)

TOLERANCE = 1e-3
"""Metres: clearances that differ by less are not told apart."""

SPARE = 2e-6
"""Metres less than an end has, since a motion that comes no nearer than that to being too near is certified."""

WAY_SHARE = 0.3
"""Of the time limit, for the way out of an obstacle."""

PROBE_SHARE = 0.25
"""Of the time left, for finding a path that keeps one clearance; of all, what is left for the best one's path."""


def plan_any(
    model: WorldModel, start: ArrayLike, goal: Ends | Stops, budget: Budget, *, on_progress: OnProgress | None = None
) -> PlanResult:
    """Return the answer to one query; whoever calls holds the lock of the model's roadmap.

    Raises:
        ConfigurationError: start or goal is not valid; a start in keep-out zones is, if it is without them.
    """
    state = se2.configurations(start, name="start", by_hand=True)
    if isinstance(goal, Stops):
        if not zones_at(model.checker, state):
            model.checker.require_valid(state, "start")
        return plan_through(model, state, goal, budget, plan_any, on_progress)
    goals = goals_of(goal)
    plan: Any = plan_single if goals is None else plan_to_goals
    zones = zones_at(model.checker, start)
    if not zones:
        result: PlanResult = plan(model, start, goal if goals is None else goals, budget, on_progress=on_progress)
        return result
    if goals is None:
        end = model.checker.require_valid(goal, "goal")  # type: ignore[arg-type]  # an array then
        return plan_out_of_zones(model, zones, start, end, budget, plan, on_progress)
    # Without the zones, those in them would be the nearest.
    poses = [each.configuration for each in goals]
    outside = [i for i, pose in enumerate(poses) if pose is None or model.checker.valid(pose)]
    if not outside:
        model.checker.require_valid(poses[0] or (), "goal 0")
    left = tuple(goals[i] for i in outside)
    result = plan_out_of_zones(model, zones, start, left, budget, plan, on_progress)
    if result.goal is None:
        return result
    return replace(result, goal=replace(result.goal, index=outside[result.goal.index]))


def plan_explained(
    model: WorldModel,
    start: ArrayLike,
    goal: Ends | Stops,
    budget: Budget,
    *,
    relax: bool = False,
    escape: bool = False,
    on_progress: OnProgress | None = None,
) -> PlanResult:
    """Return the answer to one query, and why there is no path; those that let the roadmap grow take turns.

    Raises:
        ConfigurationError: start or goal is not valid.
    """
    with model.shared.lock:
        relax = relax and model.checker.robot.clearance > 0.0
        state = se2.configurations(start, name="start", by_hand=True)
        if state.ndim == 1 and not model.checker.valid(state):
            # A relaxed clearance may be what the start lacks.
            bare = model.keeping(0.0) if relax else model
            zones = zones_at(bare.checker, state)
            if not (bare.without(zones) if zones else bare).checker.valid(state):
                how = {"relax": relax, "on_progress": None if on_progress is None else without_paths(on_progress)}
                return _plan_out_of_obstacle(model, bare.checker, state, goal, budget, escape, **how)
        if relax:
            return _plan_relaxed(model, start, goal, budget, on_progress)
        return _explained(model, start, goal, plan_any(model, start, goal, budget, on_progress=on_progress), budget)


def _explained(
    model: WorldModel, start: ArrayLike, goal: Ends | Stops, result: PlanResult, budget: Budget
) -> PlanResult:
    """Return a result with why there is no path; of one through several places, why there is none for its last leg."""
    if not isinstance(goal, Stops):
        return explained(model, start, goal, result, budget)
    if result.path is not None or not result.legs:
        return result
    leg = result.legs[-1]
    why = explained(model, np.array(leg.start), leg.target, leg, budget)
    return replace(result, reason=f"{result.reason}: {why.reason}", nearest=why.nearest)


def _plan_out_of_obstacle(
    model: WorldModel,
    checker: StateChecker,
    start: FloatArray,
    goal: Ends | Stops,
    budget: Budget,
    escape: bool,
    **how: Any,
) -> PlanResult:
    """Return a path that begins with the way out of what the robot stands in, if it may ``escape``.

    Raises:
        ConfigurationError: it may not; the message says how deep it is in there, and how far the way out is.
    """
    out = way_out(checker, start, WAY_SHARE * budget.limit)
    problem = f"the robot ({checker.robot.describe()}) {checker.fault(start)}"
    if not escape:
        far = "no way out was found" if out is None else f"the way out is {Path(out).length:.3g} m long"
        at = ", ".join(f"{value:g}" for value in start)
        raise ConfigurationError(f"start ({at}) is not valid: {problem}; {far} (escape: begin with it)")
    if out is None:
        ends = np.array([start, start])
        return _nothing(model, ends, "timeout", f"{problem}, and no motion leads out along which it gets no deeper")
    rest = plan_explained(model, out[-1], goal, budget.part(budget.seconds_left()), **how)
    if rest.path is None:
        return replace(rest, reason=f"{problem}; from where it is free: {rest.reason}", nearest=Path(out))
    time = {**rest.time, "total": perf_counter() - budget.begin}
    return replace(_led_out(model, out, rest, rest.path), time=time)


def _led_out(model: WorldModel, out: FloatArray, rest: R, path: Path) -> R:
    """Return the answer to a query from where the robot is free, with the way out (n, 3) before its path."""
    motion = model.motion
    states = np.vstack([out, vertices_of(motion, path)[1:]])
    whole = path_of(motion, motion.whole_states(states, out[0], path.states[-1]))
    first = path_of(motion, out)
    cost = motion.whole_cost(motion.cost_of(out), out[0], out[-1])
    return replace(
        rest,
        path=model.verification.followed_by_lines(whole, leaves=True),
        lower_bound=None,
        charged=None if rest.charged is None else rest.charged + cost,
        min_clearance=0.0,
        start=tuple(out[0].tolist()),
        escape=len(first) - 1,
    )


def _plan_relaxed(
    model: WorldModel, start: ArrayLike, goal: Ends | Stops, budget: Budget, on_progress: OnProgress | None
) -> PlanResult:
    """Return a path that keeps what the model's robot is to keep, or as much of it as a bisection finds a path for.

    A clearance is too large if an end does not have it, if it is proven that no path keeps it, or if none is found in a
    quarter of the time left. The result's ``clearance_bound`` is the least that is proven to be too large; where every
    one that was refused is, its ``clearance`` is no more than TOLERANCE below.
    """
    wanted, bare = model.checker.robot.clearance, model.keeping(0.0)
    if zones_at(bare.checker, start):
        return plan_any(bare, start, goal, budget, on_progress=on_progress)
    ends = [bare.checker.require_valid(start, "start")]
    if isinstance(goal, Stops):
        fixed = [(goal.configuration(i), goal.name(i)) for i in range(len(goal.places))]
        ends += [bare.checker.require_valid(q, name) for q, name in fixed if q is not None]
    elif goals_of(goal) is None:
        ends.append(bare.checker.require_valid(goal, "goal"))  # type: ignore[arg-type]  # no goals: a configuration
    # No path keeps more than its ends have.
    bound = min(wanted, *bare.checker.clearance(np.array(ends), cap=wanted).tolist())
    best, first_time = None, None
    low, high = 0.0, bound
    kept = wanted if bound == wanted else max(0.0, bound - SPARE)
    while True:
        probe, left = model.keeping(kept), budget.seconds_left()
        try:
            result = plan_any(probe, start, goal, budget.part(PROBE_SHARE * left, np.inf), on_progress=on_progress)
        except ConfigurationError:
            # An end cannot keep this clearance.
            if kept == 0.0:
                raise
            result = None
        if result is not None and result.path is not None:
            best, low = probe, kept
            first_time = first_time or perf_counter() - budget.begin
        elif result is None or result.status == "infeasible":
            bound = min(bound, kept)
        if best is not probe:
            high = kept
        # Whether there is a path at all comes second.
        kept = 0.5 * (low + high) if best is not None else 0.0
        if high == 0.0 or high - low <= TOLERANCE or left < PROBE_SHARE * budget.limit or budget.is_up():
            break
    # The first path is known to its roadmap.
    last = best or bare
    result = plan_any(last, start, goal, budget.part(budget.seconds_left()), on_progress=on_progress)
    result = _explained(last, start, goal, result, budget)
    time = {**result.time, "total": perf_counter() - budget.begin, "first_solution": first_time}
    return replace(result, clearance_bound=bound, time=time)


def replan(models: WorldModels, start: ArrayLike, goal: Ends, path: Path, options: ReplanOptions) -> ReplanResult:
    """Return the answer of :meth:`trailmark.LandmarkPlanner.replan`, whose arguments these are.

    With goals, the path being followed is replanned to where it ends if a goal holds that; where none does, or no path
    leads there any more, the cheapest of the goals is planned to. Lower bounds hold for one end alone and are left out
    unless that is done.

    Raises:
        ConfigurationError: start or goal is no configuration, or there is none to go to.
    """
    goals = goals_of(goal)
    if goals is None:
        return _replan_single(models, start, goal, path, options)  # type: ignore[arg-type]  # an array then
    end, found = path.states[-1], None
    held = [i for i, each in enumerate(goals) if each.contains(end)]
    if held:
        found = _replan_single(models, start, end, path, options)
        if found.path is not None:
            i = min(held, key=lambda i: goals[i].cost)
            reached = ReachedGoal(i, (float(end[0]), float(end[1]), float(end[2])), goals[i].cost)
            return replace(found, lower_bound=None, goal=reached, target=goals)
    model, reason = (
        models.full,
        "the path leads to another goal" if found is None else "the path to its goal is blocked",
    )
    with model.shared.lock:
        # A first path will do, unless there is time for better ones.
        gap = 0.0 if options.improvement > 0.0 else np.inf
        budget = Budget(max(options.seconds_left(), MIN_SECONDS), gap=gap)
        try:
            return as_replan(explained(model, start, goals, plan_any(model, start, goals, budget), budget), reason)
        except ConfigurationError:
            if found is None:
                raise
            return found


def _replan_single(
    models: WorldModels, start: ArrayLike, goal: ArrayLike, path: Path, options: ReplanOptions
) -> ReplanResult:
    """Return the path to follow from here on to one configuration."""
    ends = np.array([_configuration(start, "start"), _configuration(goal, "goal")])
    in_time = None
    # A car gives way by manoeuvres, which are not sought: what an obstacle sweeps is occupied for it.
    if options.speed is not None and models.world.moving and models.motion.moves_anywhere:
        model = models.standing
        with model.shared.lock:
            if model.checker.states_free(ends).all():
                moving = MovingObstacles.of([each for each in models.world.moving if each], model.checker.footprint)
                query = SpaceTimeReplanner(Replanner(model, ends[0], ends[1], options), moving, options.speed)
                in_time = query.answer(path)
                if in_time.path is not None or options.seconds_left() <= 0.0 or query.ends_are_swept():
                    return in_time
    model = models.full
    with model.shared.lock:
        found = _replan_in(model, ends, path, options)
    # What no obstacle ever sweeps is clear of all of them at any time.
    return found if in_time is None or (found.path is not None and not found.escape) else in_time


def _replan_in(model: WorldModel, ends: FloatArray, path: Path, options: ReplanOptions) -> ReplanResult:
    """Return the path to follow from here on in one model, whose lock is held; it leads out of what it starts in."""
    start, goal = ends
    free = model.checker.states_free(ends)
    if free.all():
        return Replanner(model, start, goal, options).answer(path)
    if free[1] and (zones := zones_at(model.checker, start)) and model.without(zones).checker.valid(start):

        def resume(q: FloatArray, budget: Budget) -> ReplanResult:
            return Replanner(model, q, goal, replace(options, deadline=budget.begin + budget.limit)).answer(path)

        budget = Budget(max(options.seconds_left(), MIN_SECONDS))
        out_of = plan_out_of_zones(model, zones, start, goal, budget, plan_single, rest=resume)
        names = " and ".join(zones)
        reason = f"no path out of {names} was found" if out_of.path is None else f"the path leaves {names} first"
        return replace(as_replan(out_of, ""), reason=reason)
    end, name = (ends[0], "robot") if free[1] else (goal, "goal")
    problem = f"the {name} {model.checker.fault(end)}"
    if not free[1] or not options.escape:
        return _nothing(model, ends, "infeasible", problem)
    out = way_out(model.checker, start, WAY_SHARE * options.seconds_left())
    if out is None:
        return _nothing(model, ends, "timeout", f"{problem}, and no way out was found")
    rest = Replanner(model, out[-1], goal, options).answer(path)
    if rest.path is None:
        return replace(rest, reason=f"{problem}; from where it is free: {rest.reason}", nearest=Path(out))
    return replace(_led_out(model, out, rest, rest.path), kept=False, reason=f"{problem}: the path leads out first")


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
