"""Plans whose work is counted, and pairs of places that no straight motion joins."""

from __future__ import annotations

from contextlib import ExitStack
from time import thread_time
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from trailmark import LandmarkPlanner, PlanResult
from trailmark.landmarks import free_samples
from trailmark.planning import incumbent as incumbent_module
from trailmark.planning import query as query_module
from trailmark.planning import single_query as planner_module
from trailmark.planning.proofs import LowerBound
from trailmark.planning.query import Query
from trailmark.planning.result import Status
from trailmark.planning.solve import solve

__all__ = ["Asked", "ask", "random_pairs"]

FloatArray = NDArray[np.float64]


class Asked(NamedTuple):
    """What came of one query.

    Attributes:
        result: the answer.
        effort: nodes and edges that searches took until the first path, or in all.
    """

    result: PlanResult
    effort: int


def ask(planner: LandmarkPlanner, start: FloatArray, goal: FloatArray, limit: float, **options: Any) -> Asked:
    """Plan, and count the work; times are the thread's own, which other programs do not disturb."""
    queries: list[Query] = []

    def counted(query: Query, bound: LowerBound | None, known: FloatArray | None = None) -> Status:
        queries.append(query)
        return solve(query, bound, known)

    with ExitStack() as stack:
        stack.enter_context(patch.object(planner_module, "solve", counted))
        for module in (planner_module, query_module, incumbent_module):
            stack.enter_context(patch.object(module, "perf_counter", thread_time))
        result = planner.plan(start, goal, limit, **options)
    (query,) = queries
    return Asked(result, query.effort if query.incumbent.history else query.expanded())


def random_pairs(planner: LandmarkPlanner, n: int, seed: int) -> FloatArray:
    """Return n starts and goals, shape (n, 2, 3), that the relaxed problem may join, and no straight motion does."""
    pairs, have, rng = [np.empty((0, 2, 3))], 0, np.random.default_rng(seed)
    relaxation = planner.relaxation
    while have < n:
        q = free_samples(planner.checker, 4 * (n - have) + 64, random_state=rng)
        reached = relaxation.component(q[0])
        q = q[reached[relaxation.cells(relaxation.disc_centers(q))]]
        q = q[: len(q) // 2 * 2].reshape(-1, 2, 3)
        found = q[~planner.checker.motions_between_valid(q[:, 0], q[:, 1])]
        pairs.append(found)
        have += len(found)
    return np.concatenate(pairs)[:n]
