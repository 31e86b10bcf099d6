"""Many queries on one kept roadmap: each is answered without changing it, by any number of threads at once."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from time import perf_counter

import numpy as np

from trailmark import se2
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.proofs import LowerBound
from trailmark.planning.shortening import shorten
from trailmark.planning.straightening import without_needless
from trailmark.roadmap.snapshot import RoadmapSnapshot

__all__ = ["BatchSolver", "each"]

HASTE = 1.5
"""How many times as long as the roadmap's shortest the first path may be, which is found in half the time."""

FIRST_SWEEPS, SWEEPS = 3, 40
"""Sweeps of shortening before other ways are looked at, and of the best one at most."""

OTHERS = 2
"""Other ways looked at, each without the tightest place of those before."""

CLOSE = 0.01
"""A path proven to be this near the optimum, as a share of it, needs no other ways looked at."""

LONGER = 1.3
"""An other way is worth shortening if it is at most this many times as long as the best path."""

PLACES = 64
"""Places along a path at which its clearance is looked at, about."""


class BatchSolver:
    """Answers queries on a roadmap as it was when it was made ready; nothing in it changes.

    Args:
        graph: the roadmap, ready for queries.
        bound: proves lower bounds; None leaves it at the straight distance.
        seed: of the shortening.
    """

    def __init__(self, graph: RoadmapSnapshot, bound: LowerBound | None, seed: int) -> None:
        self.graph, self.checker, self.bound, self.seed = graph, graph.checker, bound, seed

    def answer(self, index: int, start: se2.FloatArray, goal: se2.FloatArray, time_limit: float) -> Incumbent:
        """Return the answer to a query, which depends on nothing but its ends, its index and the seed.

        Args:
            index: of the query, >= 0.
            start: valid, shape (3,).
            goal: valid, shape (3,).
            time_limit: seconds after which a path is shortened no further.
        """
        graph, motion = self.graph, self.graph.motion
        answer = Incumbent(motion, start, goal, perf_counter())
        ends = motion.ends(start, goal)
        found = graph.find_path(ends[0], ends[1], weight=HASTE)
        if found is None:
            return answer
        answer.offer(found)
        if len(found) == 2:
            # Nothing is shorter than the straight motion.
            return answer
        shortest = graph.find_path(ends[0], ends[1])
        if shortest is not None:
            found = shortest
        rng = np.random.default_rng([self.seed, index])
        deadline = answer.begin + time_limit

        def late() -> bool:
            return perf_counter() > deadline

        best = shorten(motion, found, rng, sweeps=FIRST_SWEEPS, stop=late)
        answer.offer(best)
        if self.bound is not None and self.bound.seconds(start, goal, answer.whole_cost) < deadline - perf_counter():
            answer.claim(self.bound.of(start, goal, answer.whole_cost).cost)
        closed = np.empty((0, 3))
        for _ in range(OTHERS):
            if answer.whole_cost <= (1.0 + CLOSE) * answer.lower_bound or late():
                break
            closed = np.vstack([closed, self._tightest(best if len(closed) == 0 else found)])
            other = graph.find_path(ends[0], ends[1], closed=closed)
            if other is None or motion.cost_of(other) > LONGER * motion.cost_of(best):
                break
            found = shorten(motion, other, rng, sweeps=FIRST_SWEEPS, stop=late)
            answer.offer(found)
            if motion.cost_of(found) < motion.cost_of(best):
                best = found
        best = shorten(motion, best, rng, sweeps=SWEEPS, stop=late)
        best = np.asarray(without_needless(motion.kind, best))
        answer.offer(best)
        # It costs no more, but for rounding.
        answer.states = best
        return answer

    def _tightest(self, states: se2.FloatArray) -> se2.FloatArray:
        """Return a disc x, y, radius (metres), shape (1, 3), that closes a path's way where it is tightest."""
        path = self.graph.motion.path(states)
        places = path.resample(max(path.cost / PLACES, 1e-9)).states
        reach = self.checker.robot.circumradius
        room = np.asarray(self.checker.clearance(places, cap=4.0 * reach))
        # The ends cannot be gone round.
        apart = np.minimum(*(np.hypot(*(places[:, :2] - q[:2]).T) for q in (states[0], states[-1])))
        tight = int(np.argmin(np.where(apart > room + 2.0 * reach, room, np.inf)))
        return np.array([[*places[tight, :2], min(room[tight] + reach, 0.9 * apart[tight])]])


def each(work: Callable[[int], None], count: int, workers: int, on_progress: Callable[[int, int], None] | None) -> None:
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
