"""Relaxed clearance: where no path is found that keeps what is asked for, one that keeps as much as there is."""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.errors import ConfigurationError
from trailmark.goals import Ends, goals_of
from trailmark.planning.answer import answer
from trailmark.planning.reasons import explained
from trailmark.planning.result import PlanResult
from trailmark.planning.world_model import WorldModel, zones_at

__all__ = ["answer_in_turn", "answer_relaxed"]

TOLERANCE = 1e-3
"""Metres: clearances that differ by less are not told apart."""

SPARE = 2e-6
"""Metres less than an end has, since a motion that comes no nearer than that to being too near is certified."""

LEAST_TIME = 1e-3
"""Seconds that a query is given at least."""

PROBE_SHARE = 0.25
"""Of the time left, for finding a path that keeps one clearance; of all, what is left for the best one's path."""


def answer_in_turn(
    model: WorldModel, start: ArrayLike, goal: Ends, seconds: float, *, relax: bool = False, **options: Any
) -> PlanResult:
    """Return the answer to one query, relaxed or not; those that let the roadmap grow take turns."""
    with model.shared.lock:
        if relax and model.checker.robot.clearance > 0.0:
            return answer_relaxed(model, start, goal, seconds, **options)
        begin = perf_counter()
        result = answer(model, start, goal, seconds, **options)
        return explained(model, start, goal, result, begin, seconds, **options)


def answer_relaxed(model: WorldModel, start: ArrayLike, goal: Ends, time_limit: float, **options: Any) -> PlanResult:
    """Return a path that keeps what the model's robot is to keep, or as much of it as a bisection finds a path for.

    A clearance is too large if an end does not have it, if it is proven that no path keeps it, or if none is found in a
    quarter of the time left. The result's ``clearance_bound`` is the least that is proven to be too large; where every
    one that was refused is, its ``clearance`` is no more than TOLERANCE below.

    Args:
        model: of the world, with a robot that keeps a clearance.
        start: configuration, shape (3,).
        goal: configuration, shape (3,), or goals.
        time_limit: seconds for all.
        options: of that function.

    Raises:
        ConfigurationError: start or goal is not valid even without a clearance.
    """
    begin, wanted = perf_counter(), model.checker.robot.clearance
    stop = options.get("stop") or (lambda: False)
    bare = model.keeping(0.0).checker
    if zones_at(bare, start):
        return answer(model.keeping(0.0), start, goal, time_limit, **options)
    ends = [bare.require_valid(start, "start")]
    if goals_of(goal) is None:
        ends.append(bare.require_valid(goal, "goal"))  # type: ignore[arg-type]  # no goals: a configuration
    # No path keeps more than its ends have.
    bound = min(wanted, *bare.clearance(np.array(ends), cap=wanted).tolist())
    best, first_time = None, None
    low, high = 0.0, bound
    kept = wanted if bound == wanted else max(0.0, bound - SPARE)
    while True:
        probe, left = model.keeping(kept), begin + time_limit - perf_counter()
        result = _first_path(probe, start, goal, PROBE_SHARE * left, options)
        if result is not None and result.path is not None:
            best, low = probe, kept
            first_time = first_time or perf_counter() - begin
        elif result is None or result.status == "infeasible":
            bound = min(bound, kept)
        if best is not probe:
            high = kept
        # Whether there is a path at all comes second.
        kept = 0.5 * (low + high) if best is not None else 0.0
        ended = high == 0.0 or high - low <= TOLERANCE
        if ended or left < PROBE_SHARE * time_limit or stop():
            break
    # The first path is known to its roadmap.
    left = begin + time_limit - perf_counter()
    last = best or model.keeping(0.0)
    result = answer(last, start, goal, max(left, LEAST_TIME), **options)
    result = explained(last, start, goal, result, begin, time_limit, **options)
    time = {**result.time, "total": perf_counter() - begin, "first_solution": first_time}
    return replace(result, clearance_bound=bound, time=time)


def _first_path(
    model: WorldModel, start: ArrayLike, goal: Ends, seconds: float, options: dict[str, Any]
) -> PlanResult | None:
    """Return the answer with the first path found; None if an end cannot keep the clearance."""
    try:
        return answer(model, start, goal, max(seconds, LEAST_TIME), **options | {"gap": np.inf})
    except ConfigurationError:
        if model.checker.robot.clearance == 0.0:
            raise
        return None
