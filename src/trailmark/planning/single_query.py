"""One query: solved in a model of the world, and its path checked in the form in which it is returned."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from trailmark.planning.followed import Passed, vertices_of
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.query import Clock, OnProgress, Query
from trailmark.planning.result import PlanResult, Status
from trailmark.planning.solve import solve
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray

__all__ = ["GAP", "answer_query"]

GAP = 1e-4
"""A path within a ten-thousandth of the optimum is as good as any."""

TRIES = 3
"""Attempts at a query, should the paths that are found not pass the final check."""


def answer_query(
    model: WorldModel,
    start: ArrayLike,
    goal: ArrayLike,
    time_limit: float,
    *,
    max_rounds: int | None = None,
    on_progress: OnProgress | None = None,
    stop: Callable[[], bool] | None = None,
    gap: float = GAP,
    known: FloatArray | None = None,
) -> PlanResult:
    """Return the answer to a query; whoever calls holds the lock of the model's roadmap.

    Args:
        model: of the world.
        start: configuration, shape (3,).
        goal: configuration, shape (3,).
        time_limit: seconds, above 0.
        max_rounds: rounds of landmarks at most; as many as there is time for by default.
        on_progress: called after every step and with every better path.
        stop: asked between steps whether to end early, as if the time were up.
        gap: end as soon as the path is proven to cost no more than (1 + gap) times the optimum.
        known: states, shape (n, 3), of a path of certified motions between the motion's ends, to begin with.

    Raises:
        ConfigurationError: start or goal is not valid.
    """
    begin = perf_counter()
    ends = model.valid_pair(start, goal)
    shared, settings = model.shared, model.settings
    if shared.to_place > 0:
        by = begin + settings.build_share * time_limit
        shared.place(shared.to_place, lambda: -np.inf if stop is not None and stop() else by - perf_counter())
    status: Status = "timeout"
    for _ in range(TRIES):
        incumbent = Incumbent(model.motion, ends[0], ends[1], begin)
        query = Query(
            shared.roadmap,
            model.relaxation,
            model.rng,
            incumbent,
            Clock(begin, time_limit, stop),
            settings,
            gap=gap,
            max_rounds=max_rounds,
            on_progress=None if on_progress is None else model.verification.progress(on_progress, ends),
        )
        status = solve(query, model.bound, known)
        path = incumbent.path()
        if path is None or model.verification.certified(path, ends):
            break
        # Whatever is wrong may be in the roadmap, or in what was known.
        shared.reset()
        status, path, known = "timeout", None, None
    build, shared.build_seconds = shared.build_seconds, 0.0
    if path is not None:
        model.passed = Passed(vertices_of(model.motion, path), model.checker)
    return model.verification.result(incumbent, status, path, shared.roadmap, build)
