"""LandmarkPlanner: landmarks by K-means, a roadmap over them, its shortest path, shortened."""

from __future__ import annotations

from collections.abc import Callable, Sized
from functools import cached_property
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import callback, number, one_of, truth, whole
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError, WorldError, as_raised
from trailmark.landmarks import Relaxation
from trailmark.motion import kind_of, motion_of
from trailmark.planning.batch import BatchSolver, for_each
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.proofs import LowerBound
from trailmark.planning.query import Clock, OnProgress, Query
from trailmark.planning.result import PlanResult
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.shared_roadmap import SharedRoadmap
from trailmark.planning.solve import solve
from trailmark.planning.verification import Verification
from trailmark.planning.warmup import warm_up, warm_up_queries
from trailmark.roadmap import Roadmap
from trailmark.world import Robot, World

__all__ = ["LandmarkPlanner"]

MAX_LANDMARKS = 200_000
"""Most landmarks that may be asked for: more take longer than anybody waits."""

TRIES = 3
"""Attempts at a query, should the paths that are found not pass the final check."""

MAX_WORKERS = 1024
"""Most threads that answer queries, however many are asked for."""

GAP = 1e-4
"""A path within a ten-thousandth of the optimum is as good as any."""

PROOF_SHARE = 0.25
"""Of the time left: what making lower bounds ready for many queries may take of it."""


class LandmarkPlanner:
    """Plans paths for one robot in one world, over a roadmap that grows with its queries.

    What the roadmap does not answer is first sought over a lattice of configurations
    (:class:`trailmark.planning.lattice.search.Lattice`), guided by costs to go that shun tight places, from both ends
    and on ever finer lattices; that mostly gives a first path.

    The rest goes in rounds. The relaxed problem (the robot's inscribed disc on a grid) says where short
    paths are likely; valid configurations drawn there are clustered by K-means; the centres, repaired to valid
    configurations, join the roadmap as landmarks; a lazy search finds the shortest path of certified motions.
    While there is none, each round draws from a wider band and places more landmarks, in the end over all that
    the robot might reach: a path that exists with some room is found with probability one as time goes on. Once
    there is a path it is shortened; each round looks for another way around over a lattice and places more
    landmarks where a better path might run, until the path settles or the time is up. A disc robot's shortest path
    is computed instead (:func:`trailmark.planning.disc_path.disc_path`), where there is time for it.

    A robot with a turning radius is a car: its roadmap is made of Reeds-Shepp curves, or Dubins curves if it does not
    reverse (:mod:`trailmark.curves`); costs are the curves' lengths, a path is a :class:`trailmark.curves.CurvePath`.
    It goes without lattices: in tight places short drives lead on (:mod:`trailmark.planning.hybrid_astar`).

    Args:
        world: obstacles and bounds.
        robot: footprint; the world's own robot if None.
        seed: the same seed gives the same paths, as long as no time limit cuts in; None draws one.
        landmarks: landmarks spread over all free space before the first query; by default none, since every
            query places its own.
        checker: one that is there already for this world and robot; without ``robot``, its robot counts.
        settings: numbers that a person may change; by default those that the benchmarks were run with.
        warm: load the compiled kernels now (:func:`trailmark.planning.warmup.warm_up`), so that no query pays for it.

    Raises:
        WorldError: neither ``robot`` nor ``world.robot`` is given.
        ConfigurationError: ``landmarks`` below 1 or above MAX_LANDMARKS, a negative seed, a checker for another world
            or robot; for arguments of another kind too.
    """

    def __init__(
        self,
        world: World,
        robot: Robot | None = None,
        *,
        seed: int | None = None,
        landmarks: int | None = None,
        checker: StateChecker | None = None,
        settings: PlannerSettings | None = None,
        warm: bool = True,
    ) -> None:
        if landmarks is not None:
            landmarks = whole(landmarks, "landmarks:", 1, MAX_LANDMARKS)
        self.world = one_of(world, World, "world:", hint=" (World.load reads one)", error=WorldError)
        if checker is not None:
            one_of(checker, StateChecker, "checker:").require_for(world, robot)
        self.seed = int(np.random.default_rng().integers(2**31)) if seed is None else whole(seed, "seed:", 0)
        self.settings = one_of(PlannerSettings() if settings is None else settings, PlannerSettings, "settings:")
        self._warm = truth(warm, "warm:")
        moving = robot if robot is not None else checker.robot if checker is not None else world.robot
        if self._warm and moving is not None:
            warm_up(kind_of(one_of(moving, Robot, "robot:", error=WorldError)))
        begin = perf_counter()
        self.checker = StateChecker(world, robot) if checker is None else checker
        self.robot = self.checker.robot
        self.motion = motion_of(self.checker)
        self._verification = Verification(self.checker, self.motion, self.seed)
        self._landmarks = landmarks
        self._rng = np.random.default_rng(self.seed)
        self._shared = SharedRoadmap(self.motion, self._rng, self.settings, landmarks or 0)
        self._shared.build_seconds = perf_counter() - begin

    @property
    def roadmap(self) -> Roadmap:
        """The roadmap of the queries so far; ``roadmap.graph`` is a networkx graph."""
        return self._shared.roadmap

    @as_raised
    def build(self, landmarks: int | None = None) -> Roadmap:
        """Spread landmarks over all free space, join them to the roadmap, and return it.

        Args:
            landmarks: how many; by default as many as given to the planner, else 200.

        Raises:
            ConfigurationError: ``landmarks`` below 1, or no free space to place them in.
        """
        k = self._landmarks or 200 if landmarks is None else whole(landmarks, "landmarks:", 1, MAX_LANDMARKS)
        with self._shared.lock:
            self._shared.place(k)
        return self.roadmap

    @as_raised
    def plan(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        time_limit: float = 1.0,
        *,
        max_iterations: int | None = None,
        on_progress: OnProgress | None = None,
        stop: Callable[[], bool] | None = None,
        gap: float = GAP,
    ) -> PlanResult:
        """Return a path from start to goal, or why there is none.

        Args:
            start: configuration (x, y, theta), shape (3,).
            goal: configuration, shape (3,).
            time_limit: seconds, half of which may go into landmarks that were asked for and are not spread yet; that
                and making the planner, which reads the world, are not counted in what a first path takes. Kept to
                about 5 % or 20 ms, whichever is more.
            max_iterations: rounds of landmarks at most; with a generous time limit the answer then depends on
                the seed alone.
            on_progress: called after every step and with every better path.
            stop: asked between steps whether to end early, as if the time were up.
            gap: end as soon as the path is proven to cost no more than (1 + gap) times the optimum.

        Raises:
            ConfigurationError: start or goal is not valid, the time limit is not above 0, or the gap is negative.
        """
        gap = number(gap, "gap:", minimum=0.0, infinite=True)
        time_limit, max_iterations = _limits(time_limit, max_iterations)
        callback(on_progress, "on_progress:")
        callback(stop, "stop:")
        with self._shared.lock:
            return self._plan(start, goal, time_limit, max_iterations, on_progress, stop, gap)

    def _plan(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        time_limit: float,
        max_iterations: int | None,
        on_progress: OnProgress | None,
        stop: Callable[[], bool] | None,
        gap: float,
    ) -> PlanResult:
        begin = perf_counter()
        ends = self._valid_pair(start, goal)
        shared = self._shared
        if shared.to_place > 0:
            by = begin + self.settings.build_share * time_limit
            shared.place(shared.to_place, lambda: -np.inf if stop is not None and stop() else by - perf_counter())
        for _ in range(TRIES):
            incumbent = Incumbent(self.motion, ends[0], ends[1], begin)
            query = Query(
                self.roadmap,
                self.relaxation,
                self._rng,
                incumbent,
                Clock(begin, time_limit, stop),
                self.settings,
                gap=gap,
                max_rounds=max_iterations,
                on_progress=None if on_progress is None else self._verification.progress(on_progress, ends),
            )
            status, path = solve(query, self.bound), incumbent.path()
            if path is None or self._verification.certified(path, ends):
                break
            # Whatever is wrong may be in the roadmap.
            shared.reset()
            status, path = "timeout", None
        build, shared.build_seconds = shared.build_seconds, 0.0
        return self._verification.result(incumbent, status, path, self.roadmap, build)

    @as_raised
    def plan_many(
        self,
        starts: ArrayLike,
        goals: ArrayLike,
        time_limit: float = 1.0,
        *,
        workers: int = 1,
        max_iterations: int | None = None,
        bounds: bool = True,
        on_progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> list[PlanResult]:
        """Return the answers to many queries, in their order; the roadmap is kept.

        Without a roadmap, one is built first that spreads over all free space, as dense as the world asks for. Each
        query is then answered on the roadmap as it is, in milliseconds, and changes nothing in it; several threads may
        ask one planner at once. Only queries that the roadmap does not answer are planned by :meth:`plan`, one after
        the other, which lets it grow. As long as no time limit cuts in, the answers depend on the seed and on what was
        asked before, not on ``workers``.

        The call takes n times the limit of a query at most. Half of that may go into building; what is not built by
        then is built by later calls. Queries that there is no time left for are answered with ``timeout``.

        Args:
            starts: configurations (x, y, theta), shape (n, 3).
            goals: as many.
            time_limit: seconds for each query, and, times n, for all of them with what is built for them.
            workers: threads that answer queries; the compiled parts run side by side.
            max_iterations: rounds of landmarks at most, for the queries that the roadmap does not answer.
            bounds: prove a lower bound for each query, about a millisecond, where there is time to make that ready;
                else the straight distance is reported.
            on_progress: called in this thread with the number of queries answered and of all; 0 and all while the
                roadmap is built.
            stop: asked between steps whether to end early, as if the time were up.

        Raises:
            ConfigurationError: a start or goal is not valid, their numbers differ, or an option is out of range.
        """
        time_limit, max_iterations = _limits(time_limit, max_iterations)
        workers = min(whole(workers, "workers:", 1), MAX_WORKERS)
        callback(on_progress, "on_progress:")
        callback(stop, "stop:")
        if all(isinstance(q, Sized) and len(q) == 0 for q in (starts, goals)):
            return []
        if self._warm:
            # Else what they compile, on a machine's first use, would take up the limit.
            warm_up_queries(kind_of(self.robot))
        begin = perf_counter()
        ends = self._valid_ends(starts, goals)
        count = len(ends)
        results: list[PlanResult | None] = [None] * count
        deadline = begin + time_limit * count

        def seconds_left() -> float:
            return -np.inf if stop is not None and stop() else deadline - perf_counter()

        def report() -> None:
            if on_progress is not None:
                on_progress(0, count)

        if count:
            later = (1.0 - self.settings.build_share) * time_limit * count
            snapshot = self._shared.snapshot(lambda: self.relaxation, lambda: seconds_left() - later, report)
            bound = self._bound_of_all(ends[0], seconds_left()) if bounds else None
            solver = BatchSolver(snapshot, bound, self.settings, self.seed)

            def answer(i: int) -> None:
                if (left := seconds_left()) <= 0.0:
                    return
                found = solver.answer(i, ends[i, 0], ends[i, 1], min(time_limit, left))
                path = found.path()
                if path is not None and self._verification.certified(path, ends[i]):
                    results[i] = self._verification.result(found, "solved", path, self.roadmap, 0.0)

            for_each(answer, count, workers, on_progress)
        for i, (start, goal) in enumerate(ends):
            if results[i] is None:
                left, nodes = seconds_left(), len(self.roadmap)
                if left <= 0.0:
                    nothing = Incumbent(self.motion, start, goal, perf_counter())
                    results[i] = self._verification.result(nothing, "timeout", None, self.roadmap, 0.0)
                    continue
                results[i] = self.plan(start, goal, min(time_limit, left), max_iterations=max_iterations, stop=stop)
                self._shared.learnt |= len(self.roadmap) > nodes
        return [result for result in results if result is not None]

    def _valid_pair(self, start: ArrayLike, goal: ArrayLike) -> se2.FloatArray:
        """Return start and goal, shape (2, 3), both valid."""
        ends = [se2.configurations(start, name="start"), se2.configurations(goal, name="goal")]
        if all(q.ndim == 1 for q in ends):
            pair = np.array(ends)
            if self.checker.states_free(pair).all():
                return pair
        # Says what is wrong with which.
        return np.array([self.checker.require_valid(q, name) for q, name in zip(ends, ("start", "goal"), strict=True)])

    def _valid_ends(self, starts: ArrayLike, goals: ArrayLike) -> se2.FloatArray:
        """Return starts and goals, shape (n, 2, 3), all valid."""
        rows = [np.atleast_2d(se2.configurations(q, name=name)) for q, name in ((starts, "starts"), (goals, "goals"))]
        if rows[0].shape != rows[1].shape:
            raise ConfigurationError(f"goals: expected {len(rows[0])}, as many as starts, got {len(rows[1])}")
        # FCL, which decides what touches, is one thread's at a time.
        with self._shared.lock:
            for states, name in zip(rows, ("start", "goal"), strict=True):
                for i in np.flatnonzero(~self.checker.valid(states)):
                    self.checker.require_valid(states[i], f"{name} {i}")
        return np.stack(rows, axis=1)

    def _bound_of_all(self, ends: se2.FloatArray, seconds: float) -> LowerBound | None:
        """Return what proves lower bounds, with all computed that queries share; None if that may take too long."""
        with self._shared.lock:
            if self.bound.seconds(*ends) > PROOF_SHARE * seconds:
                return None
            self.bound.of(*ends)
            return self.bound

    @cached_property
    def bound(self) -> LowerBound:
        """Proves lower bounds; what it computes is kept from query to query."""
        return LowerBound(self.world, self.robot, self.checker.grid)

    @cached_property
    def relaxation(self) -> Relaxation:
        """The relaxed problem's grid, kept from query to query."""
        return Relaxation(self.checker)


def _limits(time_limit: float, max_iterations: int | None) -> tuple[float, int | None]:
    """Return the limits of a query, checked."""
    seconds = number(time_limit, "time limit:", above=0.0, infinite=True, unit="s")
    return seconds, None if max_iterations is None else whole(max_iterations, "max iterations:", 1)
