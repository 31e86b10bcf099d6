"""LandmarkPlanner: landmarks by K-means, a roadmap over them, its shortest path, shortened."""

from __future__ import annotations

from collections.abc import Callable, Sized
from dataclasses import replace
from functools import cached_property
from threading import RLock
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import callback, number, one_of, truth, whole
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError, WorldError, as_raised
from trailmark.landmarks import Relaxation
from trailmark.motion import kind_of, motion_of
from trailmark.path import Path
from trailmark.planning.batch import BatchSolver, each
from trailmark.planning.error_report import report_error
from trailmark.planning.final_check import FinalCheck
from trailmark.planning.growth import grow_general, spread_landmarks
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.proofs import LowerBound
from trailmark.planning.proofs.claims import contradicted
from trailmark.planning.query import Clock, OnProgress, Query
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.solve import solve
from trailmark.planning.warmup import warm_up, warm_up_queries
from trailmark.roadmap import Roadmap
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.world import Robot, World

__all__ = ["LandmarkPlanner"]

MAX_LANDMARKS = 200_000
"""Most landmarks that may be asked for: more take longer than anybody waits."""

TRIES = 3
"""Attempts at a query, should the paths that are found not stand the last look."""

MAX_WORKERS = 1024
"""Most threads that answer queries, however many are asked for."""

GAP = 1e-4
"""A path within a ten-thousandth of the optimum is as good as any."""

BUILD_SHARE = 0.5
"""Of the time limit: what spreading landmarks over all free space may take of it."""

PROOF_SHARE = 0.25
"""Of the time left: what making lower bounds ready for many queries may take of it."""

FEW = 50
"""Places along a path at which its clearance is looked at first."""

OUTGROWN = 1.1
"""Times as many nodes as when it was made ready for queries, and the roadmap is made ready anew."""


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
    landmarks where a better path might run, until the path settles or the time is up. A disc robot's shortest way
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
        self._last_look = FinalCheck(world, self.robot)
        self.roadmap = self._new_roadmap()
        self._build_time = perf_counter() - begin
        self._landmarks = landmarks
        # Of those given, how many are not spread yet.
        self._to_place = landmarks or 0
        self._rng = np.random.default_rng(self.seed)
        self._relaxation: Relaxation | None = None
        # Held by whoever lets the roadmap grow; those who only read do without.
        self._growing = RLock()
        # What they read, and whether the roadmap has learnt since what it did not know.
        self._kept: RoadmapSnapshot | None = None
        self._learnt = False
        # Whether landmarks have been spread over all free space.
        self._spread = False

    @as_raised
    def build(self, landmarks: int | None = None) -> Roadmap:
        """Spread landmarks over all free space, join them to the roadmap, and return it.

        Args:
            landmarks: how many; by default as many as given to the planner, else 200.

        Raises:
            ConfigurationError: ``landmarks`` below 1, or no free space to place them in.
        """
        k = self._landmarks or 200 if landmarks is None else whole(landmarks, "landmarks:", 1, MAX_LANDMARKS)
        with self._growing:
            self._place(k)
        return self.roadmap

    def _place(
        self, k: int, seconds_left: Callable[[], float] = lambda: np.inf, told: Callable[[], object] | None = None
    ) -> None:
        """Spread landmarks over all free space, as many as there is time for; some more the next time."""
        begin = perf_counter()
        placed = spread_landmarks(self.roadmap, self.motion.radius, k, self._rng, seconds_left=seconds_left, told=told)
        self._to_place = max(0, self._to_place - placed)
        self._spread |= placed == k
        self._build_time += perf_counter() - begin

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
        with self._growing:
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
        build = self._build_time
        if self._to_place > 0:
            by = begin + BUILD_SHARE * time_limit
            self._place(self._to_place, lambda: -np.inf if stop is not None and stop() else by - perf_counter())
            build = self._build_time
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
                on_progress=None if on_progress is None else self._looked_at(on_progress, ends),
            )
            status, path = solve(query, self.bound), incumbent.path()
            if path is None or self._is_certified(path, ends):
                break
            # Whatever is wrong may be in the roadmap.
            self.roadmap, self._kept, self._spread = self._new_roadmap(), None, False
            status, path = "timeout", None
        self._build_time = 0.0
        return self._result(incumbent, status, path, build)

    def _new_roadmap(self) -> Roadmap:
        return Roadmap(self.checker, self.motion)

    def _is_certified(self, path: Path, ends: se2.FloatArray) -> bool:
        """Return whether a path stands the last look; report it as trailmark's own error if it does not."""
        fault = self._last_look.fault(path, *ends)
        if fault is not None:
            states = path.knots if isinstance(path, CurvePath) else path.states
            details = {"seed": self.seed, "states": states.tolist()}
            report_error(f"a path that was found is not free: {fault}", self.world, self.robot, *ends, **details)
        return fault is None

    def _looked_at(self, on_progress: OnProgress, ends: se2.FloatArray) -> OnProgress:
        """Return a callback that hands on paths only once they stood the last look."""
        passed: Path | None = None

        def hand_on(progress: PlanProgress) -> None:
            nonlocal passed
            path = progress.path
            if path is not None and path != passed:
                if self._last_look.fault(path, *ends) is None:
                    passed = path
                else:
                    # At the end it is reported, unless a better path has taken its place.
                    progress = replace(progress, path=None, cost=None)
            on_progress(progress)

        return hand_on

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

        def told() -> None:
            if on_progress is not None:
                on_progress(0, count)

        if count:
            later = (1.0 - BUILD_SHARE) * time_limit * count
            graph = self._ready(lambda: seconds_left() - later, told)
            kept = BatchSolver(graph, self._bound_of_all(ends[0], seconds_left()) if bounds else None, self.seed)

            def answer(i: int) -> None:
                if (left := seconds_left()) <= 0.0:
                    return
                found = kept.answer(i, ends[i, 0], ends[i, 1], min(time_limit, left))
                path = found.path()
                if path is not None and self._is_certified(path, ends[i]):
                    results[i] = self._result(found, "solved", path, 0.0)

            each(answer, count, workers, on_progress)
        for i, (start, goal) in enumerate(ends):
            if results[i] is None:
                left, nodes = seconds_left(), len(self.roadmap)
                if left <= 0.0:
                    nothing = Incumbent(self.motion, start, goal, perf_counter())
                    results[i] = self._result(nothing, "timeout", None, 0.0)
                    continue
                results[i] = self.plan(start, goal, min(time_limit, left), max_iterations=max_iterations, stop=stop)
                self._learnt |= len(self.roadmap) > nodes
        return [result for result in results if result is not None]

    def _valid_pair(self, start: ArrayLike, goal: ArrayLike) -> se2.FloatArray:
        """Return start and goal, shape (2, 3), both valid."""
        ends = [se2.configurations(start, name="start"), se2.configurations(goal, name="goal")]
        if any(q.ndim != 1 for q in ends) or not self.checker.valid(ends).all():
            # Says what is wrong with which.
            ends = [self.checker.require_valid(q, name) for q, name in zip(ends, ("start", "goal"), strict=True)]
        return np.array(ends)

    def _valid_ends(self, starts: ArrayLike, goals: ArrayLike) -> se2.FloatArray:
        """Return starts and goals, shape (n, 2, 3), all valid."""
        rows = [np.atleast_2d(se2.configurations(q, name=name)) for q, name in ((starts, "starts"), (goals, "goals"))]
        if rows[0].shape != rows[1].shape:
            raise ConfigurationError(f"{len(rows[0])} starts and {len(rows[1])} goals given, allowed: as many")
        # FCL, which decides what touches, is one thread's at a time.
        with self._growing:
            for states, name in zip(rows, ("start", "goal"), strict=True):
                for i in np.flatnonzero(~self.checker.valid(states)):
                    self.checker.require_valid(states[i], f"{name} {i}")
        return np.stack(rows, axis=1)

    def _ready(
        self, seconds_left: Callable[[], float] = lambda: np.inf, told: Callable[[], object] | None = None
    ) -> RoadmapSnapshot:
        """Return the roadmap made ready for queries, as it is now or was not long ago; build one if there is none."""
        if (kept := self._kept) is not None and not self._outgrown(kept):
            return kept
        with self._growing:
            if self._kept is None or self._outgrown(self._kept):
                begin, graph = perf_counter(), None
                if self._to_place > 0:
                    self._place(self._to_place, seconds_left, told)
                    begin = perf_counter()
                elif not self._spread:
                    _, graph, self._spread = grow_general(
                        self.roadmap, self.relaxation, self._rng, seconds_left=seconds_left, told=told
                    )
                self._kept = RoadmapSnapshot(self.roadmap) if graph is None else graph
                self._learnt = False
                self._build_time += perf_counter() - begin
            return self._kept

    def _outgrown(self, kept: RoadmapSnapshot) -> bool:
        return self._learnt or not self._spread or len(self.roadmap) > OUTGROWN * len(kept)

    def _bound_of_all(self, ends: se2.FloatArray, seconds: float) -> LowerBound | None:
        """Return what proves lower bounds, with all computed that queries share; None if that may take too long."""
        with self._growing:
            if self.bound.seconds(*ends) > PROOF_SHARE * seconds:
                return None
            self.bound.of(*ends)
            return self.bound

    @cached_property
    def bound(self) -> LowerBound:
        """Proves lower bounds; what it computes is kept from query to query."""
        return LowerBound(self.world, self.robot, self.checker.grid)

    @property
    def relaxation(self) -> Relaxation:
        """The relaxed problem's grid, kept from query to query."""
        if self._relaxation is None:
            self._relaxation = Relaxation(self.checker)
        return self._relaxation

    def _nearest(self, incumbent: Incumbent) -> Path | None:
        """Return the path that ends nearest to the goal, if one was found and it stands the last look."""
        if incumbent.nearest is None:
            return None
        path = self.motion.path(incumbent.nearest)
        return path if self._is_certified(path, np.array([incumbent.start, path.states[-1]])) else None

    def _lower_bound(self, incumbent: Incumbent, path: Path | None) -> float:
        """Return the bound that was proven; one above a path's cost is reported as an error instead."""
        if path is None or not contradicted(incumbent.lower_bound, path.cost):
            return incumbent.lower_bound
        ends = np.array([incumbent.start, incumbent.goal])
        problem = f"a lower bound of {incumbent.lower_bound:g} m is above the cost of a path, {path.cost:g} m"
        states = path.knots if isinstance(path, CurvePath) else path.states
        report_error(problem, self.world, self.robot, *ends, seed=self.seed, states=states.tolist())
        return self.motion.least_cost(*ends)

    def _result(self, incumbent: Incumbent, status: Status, path: Path | None, build: float) -> PlanResult:
        clearance = None
        if path is not None:
            # Between the states too: as fine as a tenth of the inscribed disc, at most 2,000 places.
            step = max(0.1 * self.robot.inscribed_disc.radius, path.cost / 2000.0)
            places = path.resample(step).states
            # Only what is nearer than at the first few of them matters elsewhere, which is sooner told.
            some = float(np.min(self.checker.clearance(places[:: max(1, len(places) // FEW)])))
            clearance = float(np.min(self.checker.clearance(places, cap=some)))
        return PlanResult(
            status=status,
            path=path,
            seed=self.seed,
            lower_bound=None if status == "infeasible" else self._lower_bound(incumbent, path),
            first_cost=incumbent.first_cost,
            min_clearance=clearance,
            landmarks=len(self.roadmap),
            edges=int(np.count_nonzero(self.roadmap.status)),
            nearest=None if path is not None else self._nearest(incumbent),
            history=tuple(incumbent.history),
            time={
                "load": 0.0,
                "build": build,
                "first_solution": incumbent.history[0][0] if incumbent.history else None,
                "total": perf_counter() - incumbent.begin,
            },
        )


def _limits(time_limit: float, max_iterations: int | None) -> tuple[float, int | None]:
    """Return the limits of a query, checked."""
    seconds = number(time_limit, "time limit:", above=0.0, infinite=True, unit="s")
    return seconds, None if max_iterations is None else whole(max_iterations, "max iterations:", 1)
