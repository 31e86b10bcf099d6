"""Why there is no path: which end is at fault and by how much, where the robot is shut in, or what ended the search."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.goals import Ends, Goal, goals_of
from trailmark.planning.reach import Ways, narrow_clause, reach
from trailmark.planning.result import PlanResult
from trailmark.planning.world_model import WorldModel, zones_at
from trailmark.se2 import FloatArray

__all__ = ["explained"]

SHARE, BEYOND, LEAST = 0.2, 0.05, 0.02
"""Of the time limit: for saying why at most, and of that beyond the limit, or so many seconds if that is more."""

MOST_SECONDS = 5.0
"""For saying why, whatever the limit."""

HEADINGS, DRAWN = 8, 40
"""Configurations of a goal that are looked at: so many headings at its nearest position, and so many drawn."""

NAMED = 8
"""Goals that are spoken of one by one."""


def explained(
    model: WorldModel,
    start: ArrayLike,
    goal: Ends,
    result: PlanResult,
    begin: float,
    limit: float,
    *,
    stop: Callable[[], bool] | None = None,
    max_rounds: int | None = None,
    **_others: Any,
) -> PlanResult:
    """Return a result with why there is no path; one with a path, as it is.

    Args:
        model: of the world.
        start: of the query, shape (3,).
        goal: of the query.
        result: its answer.
        begin: reading of ``time.perf_counter`` at which the query began, seconds.
        limit: seconds that it had.
        stop: asked whether it was to end early.
        max_rounds: rounds of landmarks that it had; other options of it make no difference.
    """
    if result.path is not None:
        return result
    now, stopped = perf_counter(), stop is not None and stop()
    over_time = now - begin >= limit
    ended = ""
    if result.status == "timeout":
        if stopped:
            ended = f"planning was told to stop after {now - begin:.3g} s"
        elif over_time:
            ended = f"the time limit of {limit:g} s is up"
        elif max_rounds is not None:
            ended = f"no path was found in {max_rounds} rounds of landmarks"
        else:
            ended = f"nothing is left to try after {now - begin:.3g} s of {limit:g} s"
    seconds = min(SHARE * limit, max(begin + limit - now, BEYOND * limit, LEAST), MOST_SECONDS)
    reasons = [text for text in (ended, result.reason) if text]
    if not stopped:
        reasons += _reasons(model, start, goal, result.status == "infeasible", now + seconds, stop)
    time = {**result.time, "total": (result.time["total"] or 0.0) + perf_counter() - now}
    return replace(result, reason="; ".join(reasons) or "it is proven that no path exists", time=time)


def _reasons(
    model: WorldModel,
    start: ArrayLike,
    goal: Ends,
    infeasible: bool,
    deadline: float,
    stop: Callable[[], bool] | None,
) -> Iterator[str]:
    """Yield what is wrong with each goal, and with the ways there, as far as there is time to tell."""
    state = se2.configurations(start)
    goals = goals_of(goal)
    # Zones that a path may leave close no way.
    zones = zones_at(model.checker, state)
    outside = model.without(zones) if zones else model
    region = outside.bound.seconds_for_parts()

    def over() -> bool:
        return perf_counter() + region > deadline or (stop is not None and stop())

    several = () if goals is None else goals
    ends: Sequence[FloatArray | Goal]
    ends = [se2.configurations(goal)] if goals is None else several[:NAMED]  # type: ignore[arg-type]  # an array then
    found: dict[str, list[str]] = {}
    for i, each in enumerate(ends):
        name = "the goal" if len(several) <= 1 else f"goal {i}"
        free, end = _free_end(model, state, each, deadline) if isinstance(each, Goal) else (True, each)
        if not free:
            at = ", ".join(f"{v:.4g}" for v in end)
            nowhere = f"{name} is free nowhere" if infeasible else f"nothing free was found in {name}"
            yield f"{nowhere}: even at ({at}) the robot {model.checker.fault(end)}"
            continue
        if not over() and (fault := _way_fault(outside, state, end, infeasible, over, deadline)):
            found.setdefault(fault, []).append(name)
    for fault, names in found.items():
        yield fault if len(several) <= 1 else f"{', '.join(names)}: {fault}"
    if len(several) > NAMED:
        yield f"and so on for {len(several) - NAMED} goals more"


def _way_fault(
    model: WorldModel, start: FloatArray, end: FloatArray, infeasible: bool, over: Callable[[], bool], deadline: float
) -> str:
    """Return why there is no way to a valid configuration, in a clause; empty if that is not known."""
    found = reach(
        model.checker, start, end, infeasible=infeasible, over=over, seconds=max(0.0, deadline - perf_counter())
    )
    if found.why or over():
        return found.why
    ways = Ways(model.checker, start, end, over)
    return ways.touching() or narrow_clause(ways).removeprefix("; ")


def _free_end(model: WorldModel, start: FloatArray, goal: Goal, deadline: float) -> tuple[bool, FloatArray]:
    """Return whether a free configuration of a goal is found, and that, or the one that overlaps least, shape (3,)."""
    if goal.configuration is not None:
        states = np.array([goal.configuration])
    else:
        turned = np.repeat(goal.nearest(start), HEADINGS, axis=0)
        turned[:, 2] += 2.0 * np.pi * np.arange(HEADINGS) / HEADINGS
        states = np.vstack([goal.nearest(turned), goal.draw(np.random.default_rng(model.seed), DRAWN)])
    free = model.checker.states_free(states)
    if free.any():
        return True, np.array(states[np.argmax(free)])
    return False, model.checker.nearest_to_valid(states, lambda: perf_counter() > deadline)
