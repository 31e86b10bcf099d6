"""Many queries: most are answered on the roadmap as it is, side by side; the others let it grow, one after another."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.goals import Ends, Goal, goals_of
from trailmark.planning.batch import BatchSolver, for_each
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.result import PlanResult
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray

__all__ = ["answer_queries", "ends_of"]


def ends_of(
    model: WorldModel, starts: ArrayLike, goals: ArrayLike | Sequence[Ends]
) -> tuple[FloatArray, dict[int, tuple[Goal, ...]]]:
    """Return the starts and goals of queries, shape (n, 2, 3), and the goals of those that have no configuration.

    In the place of their goal these have their start.

    Raises:
        ConfigurationError: a start or goal is not valid, or their numbers differ.
    """
    several = () if isinstance(goals, np.ndarray | Goal) or not isinstance(goals, Sequence) else goals
    sets = {i: found for i, goal in enumerate(several) if (found := goals_of(goal)) is not None}
    if not sets:
        return model.valid_ends(starts, goals), sets  # type: ignore[arg-type]  # an array then
    rows = np.atleast_2d(se2.configurations(starts, name="starts"))
    if len(rows) != len(several):
        raise ConfigurationError(f"goals: expected {len(rows)}, as many as starts, got {len(several)}")
    poses = [rows[i] if i in sets else se2.configurations(several[i], name=f"goal {i}") for i in range(len(rows))]  # type: ignore[arg-type]  # an array then
    return model.valid_ends(rows, np.array(poses), sets), sets


def answer_queries(
    model: WorldModel,
    ends: FloatArray,
    sets: Mapping[int, tuple[Goal, ...]],
    begin: float,
    time_limit: float,
    *,
    plan: Callable[[FloatArray, Any, float], PlanResult],
    workers: int,
    bounds: bool,
    seed: int,
    on_progress: Callable[[int, int], None] | None,
    stop: Callable[[], bool] | None,
) -> list[PlanResult]:
    """Return the answers to queries, in their order.

    Args:
        model: of the world.
        ends: starts and goals, shape (n, 2, 3), n >= 1, valid, but that starts may lie in keep-out zones.
        sets: goals of the queries that have more than a configuration; these are planned one by one.
        begin: reading of ``time.perf_counter`` that the time is counted from.
        time_limit: seconds for each query.
        plan: answers one query that the roadmap does not answer, in so many seconds.
        workers: threads.
        bounds: whether to prove lower bounds.
        seed: of the shortening.
        on_progress: called with the number of queries answered and of all; 0 and all while the roadmap is built.
        stop: asked between steps whether to end early.
    """
    count = len(ends)
    deadline = begin + time_limit * count
    results: list[PlanResult | None] = [None] * count

    def seconds_left() -> float:
        return -np.inf if stop is not None and stop() else deadline - perf_counter()

    def report() -> None:
        if on_progress is not None:
            on_progress(0, count)

    # A start in keep-out zones, the only one that is not valid, is led out first.
    with model.shared.lock:
        alone = {*sets, *np.flatnonzero(~np.asarray(model.checker.valid(ends[:, 0]))).tolist()}
    shared = [i for i in range(count) if i not in alone]

    later = (1.0 - model.settings.build_share) * time_limit * count
    snapshot = model.shared.snapshot(lambda: model.relaxation, lambda: seconds_left() - later, report)
    bound = model.bound_of_all(ends[shared[0]], seconds_left()) if bounds and shared else None
    solver = BatchSolver(snapshot, bound, model.settings, seed)
    verification, roadmap = model.verification, model.shared.roadmap

    def answer(i: int) -> None:
        if i in alone or (left := seconds_left()) <= 0.0:
            return
        found = solver.answer(i, ends[i, 0], ends[i, 1], min(time_limit, left))
        path = found.path()
        if path is not None and verification.certified(path, ends[i]):
            results[i] = verification.result(found, "solved", path, roadmap, 0.0)

    for_each(answer, count, workers, on_progress)
    for i, (start, goal) in enumerate(ends):
        if results[i] is not None:
            continue
        left, nodes = seconds_left(), len(model.shared.roadmap)
        if left <= 0.0:
            nothing = Incumbent(model.motion, start, goal, perf_counter())
            result = verification.result(nothing, "timeout", None, model.shared.roadmap, 0.0)
            results[i] = replace(result, reason="the time of all queries was up before this one's turn")
            continue
        results[i] = plan(start, sets.get(i, goal), min(time_limit, left))
        model.shared.learnt |= len(model.shared.roadmap) > nodes
    return [result for result in results if result is not None]
