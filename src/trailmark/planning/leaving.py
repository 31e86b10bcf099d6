"""Queries that start in keep-out zones, which the robot may leave.

The path begins with the shortest certified way out, along which the robot is never deeper in any of these zones and
clear of all else (:mod:`trailmark.planning.escape`). Each zone is closed once it is left; from where the robot is out
of all, the query is planned as any other.

Lower bounds, and proofs that there is no path, are those of the world without these zones, in which a path that is
allowed is one too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.planning.escape import ways_out_of_zones
from trailmark.planning.followed import vertices_of
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.query import OnProgress
from trailmark.planning.result import PlanProgress, PlanResult
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray

__all__ = ["leave"]

WAYS_SHARE, TRY_SHARE, REST_SHARE = 0.5, 0.2, 0.8
"""Of the time, for the first way out; of what is left then, to find any path from where a way out ends, and for the
best one from there, before a lower bound is proven."""

WAYS = 5
"""Ways out that are tried: beside a zone there may be no room to go on."""

MIN_SECONDS = 1e-3
"""That planning has at least."""


def leave(
    model: WorldModel,
    zones: tuple[str, ...],
    start: ArrayLike,
    goal: Any,
    time_limit: float,
    plan: Callable[..., PlanResult],
    rest: Callable[..., PlanResult] | None = None,
    on_progress: OnProgress | None = None,
    **options: Any,
) -> tuple[PlanResult, int]:
    """Return the answer to a query that starts in keep-out zones, and how many motions of its path lead out of them.

    Whoever calls holds the lock of the model's roadmap.

    Args:
        model: of the world.
        zones: the names of those that the start lies in (:func:`trailmark.planning.world_model.zones_at`).
        start: configuration, shape (3,).
        goal: what ``plan`` takes for one; in no keep-out zone, if it is one configuration.
        time_limit: seconds, above 0.
        plan: answers a query that starts in no zone: a model, start, goal, time limit and options.
        rest: answers the query from where the robot is out: start, goal and time limit; by ``plan`` if None, and a
            lower bound is proven then.
        on_progress: called after every step.
        options: of ``plan``.

    Raises:
        ConfigurationError: the start is not valid, these zones left aside.
    """
    begin, without = perf_counter(), model.without(zones)
    state = without.checker.require_valid(start, "start")
    stop, last, out = options.get("stop"), None, state[None]
    watched = None if on_progress is None else _without_paths(on_progress)

    def fresh(model: WorldModel, start: FloatArray, goal: Any, seconds: float, **more: Any) -> PlanResult:
        return plan(model, start, goal, seconds, on_progress=watched, **(options | more))

    def seconds_left(share: float = 1.0) -> float:
        return -np.inf if stop is not None and stop() else begin + share * time_limit - perf_counter()

    def go_on(q: FloatArray, share: float, **more: Any) -> PlanResult:
        left = max(share * seconds_left(), MIN_SECONDS)
        return fresh(model, q, goal, left, **more) if rest is None else rest(q, goal, left)

    ways = list[FloatArray]()
    for out in ways_out_of_zones(
        model.motion, without.motion, zones, state, lambda: seconds_left(1.0 if ways else WAYS_SHARE)
    ):
        ways.append(out)
        last = go_on(out[-1], TRY_SHARE, gap=np.inf)
        if last.path is not None or len(ways) == WAYS or seconds_left() <= 0.0:
            break
    if last is not None and (last.path is None or rest is None):
        out = out if last.path is not None else ways[0]
        better = go_on(out[-1], REST_SHARE)
        last = better if better.path is not None else last
    path = None
    if last is not None and last.path is not None:
        ends = np.array([state, last.path.states[-1]])
        incumbent = Incumbent(without.motion, ends[0], ends[1], begin)
        incumbent.offer(np.vstack([out, vertices_of(model.motion, last.path)[1:]]))
        path = incumbent.path()
        if path is not None and not without.verification.certified(path, ends):
            path = None
    if path is None or rest is None:
        proven = fresh(without, state, goal, max(seconds_left(), MIN_SECONDS))
    if path is None:
        nothing = replace(proven, path=None, first_cost=None, min_clearance=None, history=(), goal=None)
        if proven.status == "infeasible":
            return nothing, 0
        named = ", ".join(zones)
        reason = f"no certified way out of {named} was found"
        if ways:
            reason = f"no path was found from where the certified ways out of {named} end"
        return replace(nothing, status="timeout", reason=reason), 0
    assert last is not None  # noqa: S101 # a path was found
    answer = without.verification.result(incumbent, "solved", path, model.shared.roadmap, last.time["build"] or 0.0)
    assert answer.path is not None  # noqa: S101 # as above
    whole = model.verification.followed_by_lines(answer.path, leaves=True)
    bound = incumbent.lower_bound if rest is not None else proven.lower_bound
    # In a zone there is no clearance.
    answer = replace(
        answer, path=whole, goal=last.goal, lower_bound=bound, world=model.checker.world, min_clearance=0.0
    )
    return answer, len(model.motion.path(out)) - 1


def _without_paths(on_progress: OnProgress) -> OnProgress:
    """Return a callback that hands on how far planning is, but no path, which may come back into a zone."""

    def hand_on(progress: PlanProgress) -> None:
        on_progress(replace(progress, path=None, cost=None, nearest=None))

    return hand_on
