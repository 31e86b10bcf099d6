"""Many queries on one roadmap: most are answered on it as it is, side by side; the others let it grow one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision.certify import BUDGET
from trailmark.errors import ConfigurationError
from trailmark.goals import Ends, Goal, goals_of
from trailmark.planning.dispatch import plan_explained
from trailmark.planning.model import WorldModel
from trailmark.planning.pipeline import WORTH_SHORTENING
from trailmark.planning.proofs import LowerBound
from trailmark.planning.query import Budget, Incumbent
from trailmark.planning.result import PlanResult
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.shortening import shorten, without_needless
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.se2 import FloatArray

__all__ = ["BatchSolver", "for_each", "plan_batch"]

FIRST_WEIGHT = 1.5
"""Of the lower bound in the search for a first path, which may cost so many times the shortest: half the time."""

FIRST_SWEEPS = 3
"""Of shortening, before other paths are looked for."""

OTHER_PATHS, CLOSE = 2, 0.01
"""Paths looked for that avoid the tightest places of those before; and the share of the optimum within which a path is
proven to be so near to it that no other is sought."""

PLACES = 64
"""Places along a path, about, at which its clearance is computed to find the tightest."""


class BatchSolver:
    """Answers queries on a roadmap's snapshot."""

    def __init__(
        self, snapshot: RoadmapSnapshot, bound: LowerBound | None, settings: PlannerSettings, seed: int
    ) -> None:
        self.snapshot, self.checker, self.motion = snapshot, snapshot.checker, snapshot.motion
        self.bound, self.settings, self.seed = bound, settings, seed

    def answer(self, index: int, start: FloatArray, goal: FloatArray, time_limit: float) -> Incumbent:
        """Return the answer to a query, which depends on nothing but its ends, its index and the seed.

        Args:
            index: of the query, >= 0.
            start: valid, shape (3,).
            goal: valid, shape (3,).
            time_limit: seconds after which a path is shortened no further.
        """
        motion, rng = self.motion, np.random.default_rng([self.seed, index])
        answer = Incumbent(motion, start, goal, perf_counter())
        deadline, ends = answer.begin + time_limit, motion.ends(start, goal)
        first = self.snapshot.find_path(ends[0], ends[1], weight=FIRST_WEIGHT)
        if first is None:
            return answer
        answer.offer(first)
        if len(first) == 2 and (motion.direct_is_best or answer.optimal):
            return answer
        if not motion.direct_is_best and motion.motions_between_valid(ends[:1], ends[1:])[0]:
            answer.offer(ends)

        def seconds_left() -> float:
            return deadline - perf_counter()

        def shortened(states: FloatArray, sweeps: int) -> FloatArray:
            return shorten(motion, states, rng, sweeps=sweeps, seconds_left=seconds_left)

        shortest = self.snapshot.find_path(ends[0], ends[1])
        best = shortened(first if shortest is None else shortest, FIRST_SWEEPS)
        answer.offer(best)
        left = seconds_left()
        if self.bound is not None:
            answer.raise_bound(self.bound.of(start, goal, answer.whole_cost, lambda: seconds_left() < 0.5 * left).cost)
        other, closed = best, np.empty((0, 3))
        for _ in range(OTHER_PATHS):
            if answer.whole_cost <= (1.0 + CLOSE) * answer.lower_bound or seconds_left() < 0.0:
                break
            # Another path is one that avoids the tightest place of those before.
            closed = np.vstack([closed, self._tightest_place(other)])
            found = self.snapshot.find_path(ends[0], ends[1], closed=closed)
            if found is None or motion.cost_of(found) > WORTH_SHORTENING * motion.cost_of(best):
                break
            other = shortened(found, FIRST_SWEEPS)
            answer.offer(other)
            if motion.cost_of(other) < motion.cost_of(best):
                best = other
        best = np.asarray(without_needless(motion.kind, shortened(best, self.settings.sweeps), BUDGET))
        answer.offer(best)
        # It costs no more, but for rounding.
        answer.states = best
        return answer

    def _tightest_place(self, states: FloatArray) -> FloatArray:
        """Return a disc x, y, radius (metres), shape (1, 3), around the place where a path's clearance is smallest."""
        path = self.motion.path(states)
        places = path.resample(max(path.cost / PLACES, 1e-9)).states
        reach = self.checker.robot.circumradius
        clearance = np.asarray(self.checker.clearance(places, cap=4.0 * reach))
        # The ends cannot be avoided.
        from_ends = np.minimum(*(np.hypot(*(places[:, :2] - q[:2]).T) for q in (states[0], states[-1])))
        tight = int(np.argmin(np.where(from_ends > clearance + 2.0 * reach, clearance, np.inf)))
        radius = min(clearance[tight] + reach, 0.9 * from_ends[tight])
        return np.array([[*places[tight, :2], radius]])


def for_each(
    work: Callable[[int], None], count: int, workers: int, on_progress: Callable[[int, int], None] | None
) -> None:
    """Call ``work`` with 0 to ``count`` - 1, in threads; ``on_progress`` in this one, with how many are done."""
    if workers == 1:
        for i in range(count):
            work(i)
            if on_progress is not None:
                on_progress(i + 1, count)
        return
    with ThreadPoolExecutor(workers, thread_name_prefix="trailmark") as threads:
        try:
            for i, _ in enumerate(threads.map(work, range(count))):
                if on_progress is not None:
                    on_progress(i + 1, count)
        except BaseException:
            threads.shutdown(cancel_futures=True)
            raise


def plan_batch(
    model: WorldModel,
    starts: ArrayLike,
    goals: ArrayLike | Sequence[Ends],
    time_limit: float,
    *,
    rounds: int | None,
    workers: int,
    bounds: bool,
    on_progress: Callable[[int, int], None] | None,
    stop: Callable[[], bool] | None,
) -> list[PlanResult]:
    """Return the answers of :meth:`trailmark.LandmarkPlanner.plan_many`, whose arguments these are.

    Raises:
        ConfigurationError: a start or goal is not valid, or their numbers differ.
    """
    begin = perf_counter()
    ends, sets = _ends_of(model, starts, goals)
    count, settings, shared = len(ends), model.settings, model.shared
    deadline = begin + time_limit * count
    results: list[PlanResult | None] = [None] * count

    def seconds_left() -> float:
        return -np.inf if stop is not None and stop() else deadline - perf_counter()

    def report() -> None:
        if on_progress is not None:
            on_progress(0, count)

    # A start in keep-out zones, the only one that is not valid, is led out first.
    with shared.lock:
        alone = {*sets, *np.flatnonzero(~np.asarray(model.checker.valid(ends[:, 0]))).tolist()}
    together = [i for i in range(count) if i not in alone]

    later = (1.0 - settings.build_share) * time_limit * count
    snapshot = shared.snapshot(lambda: model.relaxation, lambda: seconds_left() - later, report)
    bound = model.bound_of_all(ends[together[0]], seconds_left()) if bounds and together else None
    solver = BatchSolver(snapshot, bound, settings, model.seed)
    verification, roadmap = model.verification, shared.roadmap

    def answer(i: int) -> None:
        if i in alone or (left := seconds_left()) <= 0.0:
            return
        found = solver.answer(i, ends[i, 0], ends[i, 1], min(time_limit, left))
        path = found.path()
        if path is not None and verification.certified(path, ends[i]):
            results[i] = verification.result(found, "solved", path, roadmap)

    for_each(answer, count, workers, on_progress)
    for i, (start, goal) in enumerate(ends):
        if results[i] is not None:
            continue
        left, nodes = seconds_left(), len(shared.roadmap)
        if left <= 0.0:
            nothing = Incumbent(model.motion, start, goal, perf_counter())
            result = verification.result(nothing, "timeout", None, shared.roadmap)
            results[i] = replace(result, reason="the time of all queries was up before this one's turn")
            continue
        target: Any = sets.get(i, goal)
        budget = Budget(min(time_limit, left), stop=stop, rounds=rounds)
        results[i] = plan_explained(model, start, target, budget)
        shared.outdated |= len(shared.roadmap) > nodes
    return [result for result in results if result is not None]


def _ends_of(
    model: WorldModel, starts: ArrayLike, goals: ArrayLike | Sequence[Ends]
) -> tuple[FloatArray, dict[int, tuple[Goal, ...]]]:
    """Return the starts and goals of queries, shape (n, 2, 3), and the goals of those that have no configuration.

    In the place of their goal these have their start.
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
