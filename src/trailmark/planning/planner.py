"""LandmarkPlanner: landmarks by K-means, a roadmap over them, its shortest path, shortened."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.landmarks.informed import Band
from trailmark.path import Path
from trailmark.planning.result import PlanProgress, PlanResult, Status
from trailmark.planning.shortening import shorten
from trailmark.planning.warmup import warm_up
from trailmark.roadmap import Roadmap
from trailmark.world import Robot, World

__all__ = ["LandmarkPlanner"]

OnProgress = Callable[[PlanProgress], None]

WIDENINGS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.5)
"""How much longer than the relaxed shortest way a band's ways may be, round by round; then without limit."""

MAX_LANDMARKS = 20_000
"""Most landmarks that may be asked for: clustering more takes longer than anybody waits."""

LLOYD_STEPS = 3
"""Steps of K-means in a round; :meth:`LandmarkPlanner.build` iterates to the end up to CONVERGED_LANDMARKS."""
CONVERGED_LANDMARKS = 2_000

SAMPLES_PER_LANDMARK = 5
FIRST_LANDMARKS = 120
GROWTH = 1.4
"""Each round places this many times the landmarks of the one before."""

ROUNDS_PER_GRID = 2
"""Rounds without a path after which the relaxed problem is looked at on a grid twice as fine."""

BRIDGE_MISSES, BRIDGE_TRIES = 6, 40
"""Attempts that bring the parts no closer before the next round of landmarks; configurations tried at each place."""

FIRST_SWEEPS, PROMISING = 5, 1.03
"""Another path is shortened to the end only if this many sweeps bring it within this factor of the best cost."""

PATIENCE = 4
"""Rounds without a gain of IMPROVEMENT after which a path counts as settled."""
IMPROVEMENT = 1e-3


class LandmarkPlanner:
    """Plans paths for one robot in one world, over a roadmap that grows with its queries.

    A query is answered in rounds. The relaxed problem (the robot's inscribed disc on a grid) says where short
    paths are likely; valid configurations drawn there are clustered by K-means; the centres, repaired to valid
    configurations, join the roadmap as landmarks; a lazy search finds the shortest path of certified motions.
    While there is none, each round draws from a wider band and places more landmarks, in the end over all that
    the robot might reach: a path that exists with some room is found with probability one as time goes on. Once
    there is a path it is shortened, and more landmarks are placed where a better one might run, until the path
    settles or the time is up.

    Args:
        world: obstacles and bounds.
        robot: footprint; the world's own robot if None.
        seed: the same seed gives the same paths, as long as no time limit cuts in; None draws one.
        landmarks: landmarks spread over all free space before the first query; by default none, since every
            query places its own.
        checker: one that is there already for this world and robot.
        warm: load the compiled kernels now (:func:`trailmark.planning.warmup.warm_up`), so that no query pays for it.

    Raises:
        WorldError: neither ``robot`` nor ``world.robot`` is given.
        ConfigurationError: ``landmarks`` below 1 or above MAX_LANDMARKS, a negative seed.
    """

    def __init__(
        self,
        world: World,
        robot: Robot | None = None,
        *,
        seed: int | None = None,
        landmarks: int | None = None,
        checker: StateChecker | None = None,
        warm: bool = True,
    ) -> None:
        if landmarks is not None and not 1 <= landmarks <= MAX_LANDMARKS:
            raise ConfigurationError(f"landmarks: {landmarks} given, allowed: 1 to {MAX_LANDMARKS}")
        if seed is not None and seed < 0:
            raise ConfigurationError(f"seed: {seed} given, allowed: 0 or more")
        self.world = world
        self.seed = int(np.random.default_rng().integers(2**31)) if seed is None else int(seed)
        if warm:
            warm_up()
        begin = perf_counter()
        self.checker = StateChecker(world, robot) if checker is None else checker
        self.robot = self.checker.robot
        self.roadmap = Roadmap(self.checker)
        self._build_time = perf_counter() - begin
        self._landmarks = landmarks
        self._rng = np.random.default_rng(self.seed)
        self._relaxation: Relaxation | None = None

    def build(self, landmarks: int | None = None) -> Roadmap:
        """Spread landmarks over all free space, join them to the roadmap, and return it.

        Args:
            landmarks: how many; by default as many as given to the planner, else 200.

        Raises:
            ConfigurationError: ``landmarks`` below 1, or no free space to place them in.
        """
        begin = perf_counter()
        k = landmarks if landmarks is not None else self._landmarks or 200
        if not 1 <= k <= MAX_LANDMARKS:
            raise ConfigurationError(f"landmarks: {k} given, allowed: 1 to {MAX_LANDMARKS}")
        samples = free_samples(self.checker, SAMPLES_PER_LANDMARK * k, method="halton", random_state=self._rng)
        if len(samples) == 0:
            raise ConfigurationError(f"world {self.world.name!r}: no free place for the robot was found")
        self.roadmap.add(self._cluster(samples, k, None if k <= CONVERGED_LANDMARKS else LLOYD_STEPS))
        self._build_time += perf_counter() - begin
        return self.roadmap

    def plan(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        time_limit: float = 1.0,
        *,
        max_iterations: int | None = None,
        on_progress: OnProgress | None = None,
    ) -> PlanResult:
        """Return a path from start to goal, or why there is none.

        Args:
            start: configuration (x, y, theta), shape (3,).
            goal: configuration, shape (3,).
            time_limit: seconds; checked between steps of some ten milliseconds each.
            max_iterations: rounds of landmarks at most; with a generous time limit the answer then depends on
                the seed alone.
            on_progress: called after every step.

        Raises:
            ConfigurationError: start or goal is not valid, or the time limit is not above 0.
        """
        if not time_limit > 0.0:
            raise ConfigurationError(f"time limit: {time_limit} s given, allowed: more than 0")
        if max_iterations is not None and max_iterations < 1:
            raise ConfigurationError(f"max iterations: {max_iterations} given, allowed: 1 or more")
        begin = perf_counter()
        ends = (self.checker.require_valid(start, "start"), self.checker.require_valid(goal, "goal"))
        build = self._build_time
        if self._landmarks is not None and len(self.roadmap) == 0:
            self.build()
            build = self._build_time
        attempt = _Attempt(self, ends[0], ends[1], begin, time_limit, max_iterations, on_progress)
        status, states = attempt.run()
        self._build_time = 0.0
        return self._result(attempt, status, states, build)

    @property
    def relaxation(self) -> Relaxation:
        """The relaxed problem's grid, kept from query to query."""
        if self._relaxation is None:
            self._relaxation = Relaxation(self.checker)
        return self._relaxation

    def _cluster(self, samples: se2.FloatArray, k: int, steps: int | None) -> se2.FloatArray:
        """Cluster samples into k landmarks; heading differences count as far as they move the robot."""
        radius = self.checker.footprint.sweep_radius
        return k_means_landmarks(samples, k, radius=radius, steps=steps, random_state=self._rng)

    def _result(self, attempt: _Attempt, status: Status, states: se2.FloatArray | None, build: float) -> PlanResult:
        path = None if states is None else Path(states)
        clearance = None
        if path is not None:
            # Between the states too: as fine as a tenth of the inscribed disc, at most 2,000 places.
            step = max(0.1 * self.robot.inscribed_disc.radius, path.cost / 2000.0)
            clearance = float(np.min(self.checker.clearance(path.resample(step).states)))
        return PlanResult(
            status=status,
            path=path,
            seed=self.seed,
            lower_bound=None if status == "infeasible" else float(se2.distance(attempt.start, attempt.goal)),
            first_cost=attempt.first_cost,
            min_clearance=clearance,
            landmarks=len(self.roadmap),
            edges=int(np.count_nonzero(self.roadmap.status)),
            history=tuple(attempt.history),
            time={
                "load": 0.0,
                "build": build,
                "first_solution": attempt.history[0][0] if attempt.history else None,
                "total": perf_counter() - attempt.begin,
            },
        )


class _Attempt:
    """One query under way: its ends, its best path so far, its clock."""

    def __init__(
        self,
        planner: LandmarkPlanner,
        start: se2.FloatArray,
        goal: se2.FloatArray,
        begin: float,
        time_limit: float,
        max_iterations: int | None,
        on_progress: OnProgress | None,
    ) -> None:
        self.planner = planner
        self.checker, self.roadmap, self.rng = planner.checker, planner.roadmap, planner._rng
        self.start, self.goal = start, goal
        self.begin, self.deadline = begin, begin + time_limit
        self.rounds_left = max_iterations
        self.on_progress = on_progress
        self.turning = self.roadmap.turning
        self.best: se2.FloatArray | None = None
        self.best_cost = np.inf
        self.first_cost: float | None = None
        self.history: list[tuple[float, float]] = []

    def run(self) -> tuple[Status, se2.FloatArray | None]:
        # The relaxed problem and the roadmap know a disc robot at heading 0 only.
        ends = np.array([self.start, self.goal])
        if not self.turning:
            ends[:, 2] = 0.0
        if self.checker.motions_between_valid(ends[:1], ends[1:])[0]:
            # Nothing is shorter than the straight motion.
            self._offer(ends)
            return self._answer()
        grid = self.planner.relaxation
        band = Band(self.checker, grid, ends[0], ends[1])
        if not np.isfinite(band.shortest):
            return "infeasible", None
        nodes = self.roadmap.add(ends)
        self._search(self.roadmap, band, nodes)
        widening = 0
        landmarks = float(FIRST_LANDMARKS)
        while self.best is None and self._go_on("placing landmarks"):
            ε = WIDENINGS[widening] if widening < len(WIDENINGS) else np.inf
            self.roadmap.add(band.guides(self.rng))
            self._grow(self.roadmap, band, ε, int(landmarks))
            self._search(self.roadmap, band, nodes)
            if self.best is None:
                self._bridge(band, nodes)
            widening += 1
            finer = grid.finer() if self.best is None and widening % ROUNDS_PER_GRID == 0 else None
            if finer is not None:
                # What keeps failing may need a closer look, or be impossible.
                grid = finer
                band = Band(self.checker, grid, ends[0], ends[1])
                if not np.isfinite(band.shortest):
                    return "infeasible", None
            landmarks *= GROWTH
        self._improve(band, ends, landmarks)
        if self.best is not None:
            self.roadmap.add_path(self.best, int(nodes[0]), int(nodes[1]))
        return self._answer()

    def _grow(self, roadmap: Roadmap, band: Band, widening: float, landmarks: int) -> None:
        """Cluster samples of the band into landmarks and join them to a roadmap."""
        samples = band.samples(SAMPLES_PER_LANDMARK * landmarks, widening, self.rng)
        if len(samples):
            roadmap.add(self.planner._cluster(samples, landmarks, LLOYD_STEPS))

    def _bridge(self, band: Band, nodes: NDArray[np.int64]) -> None:
        """Place landmarks where the start's and the goal's parts of the roadmap end, while they grow together."""
        misses, nearest = 0, np.full(3, np.inf)
        while self.best is None and misses < BRIDGE_MISSES and self._time_left() > 0.0:
            q = self.roadmap.configurations
            ahead = q[self.roadmap.shortest_path(int(nodes[0]), int(nodes[1])).reached]
            behind = q[self.roadmap.shortest_path(int(nodes[1]), int(nodes[0])).reached]
            near, far, gap = self._closest(ahead, behind)
            first, last = band.nearest_to_goal(ahead), band.nearest_to_start(behind)
            apart = np.array([gap, band.costs_to_goal(ahead[[first]])[0], band.costs_to_start(behind[[last]])[0]])
            misses = 0 if (apart < 0.95 * nearest).any() else misses + 1
            nearest = np.minimum(nearest, apart)
            # Where the two parts come closest, and where each comes closest to its end on the relaxed way: the first
            # tells of gaps in the headings, the others of gaps in the way.
            places = (ahead[near], behind[far], ahead[first], behind[last])
            reach = band.relaxation.size * 2.0 ** self.rng.uniform(0.0, 4.0)
            found = [band.samples_near(place, reach, BRIDGE_TRIES, self.rng) for place in places]
            self.roadmap.add(np.concatenate(found))
            self._search(self.roadmap, band, nodes)

    def _closest(self, ahead: se2.FloatArray, behind: se2.FloatArray) -> tuple[int, int, float]:
        """Return the indices of the closest pair of two sets of configurations, and their distance (metres)."""
        from scipy.spatial import cKDTree

        radius = self.checker.footprint.sweep_radius
        found = cKDTree(se2.embed(behind, radius)).query(se2.embed(ahead, radius))
        gaps, pairs = np.asarray(found[0]), np.asarray(found[1])
        near = int(np.argmin(gaps))
        return near, int(pairs[near]), float(gaps[near])

    def _search(
        self, roadmap: Roadmap, band: Band, nodes: NDArray[np.int64], banned: NDArray[np.bool_] | None = None
    ) -> None:
        """Offer a roadmap's shortest path, shortened."""
        to_go = band.costs_to_goal(roadmap.configurations)
        limit = np.inf if banned is not None else self.best_cost
        found = roadmap.shortest_path(int(nodes[0]), int(nodes[1]), to_go=to_go, banned=banned, limit=limit).nodes
        if len(found) == 0:
            return
        states = roadmap.configurations[found]
        if self.best is None:
            self._offer(states)
            self._report("shortening")
        states = shorten(self.checker, states, self.rng, sweeps=FIRST_SWEEPS, deadline=self.deadline)
        if Path(states).cost < PROMISING * self.best_cost:
            self._offer(shorten(self.checker, states, self.rng, deadline=self.deadline))

    def _improve(self, band: Band, ends: se2.FloatArray, landmarks: float) -> None:
        """Place landmarks where better paths might run and search again, until nothing is gained any more.

        This goes on in a roadmap of its own, so that the planner's stays small enough for many queries; what
        comes of it, the path, is added to the planner's.
        """
        settled = 0
        roadmap = Roadmap(self.checker)
        nodes = roadmap.add(ends)
        marked = np.zeros(0, dtype=np.int64)
        while self.best is not None and settled < PATIENCE and self._go_on("improving"):
            before = self.best_cost
            widening = max(0.02, self.best_cost / max(band.shortest, 1e-9) - 1.0)
            self._grow(roadmap, band, widening, int(landmarks))
            # Once without the best path's own vertices, for the other ways around the obstacles ...
            banned = np.zeros(len(roadmap), dtype=np.bool_)
            banned[marked] = True
            self._search(roadmap, band, nodes, banned)
            # ... and once with them, for what can be put together from both.
            if self._time_left() > 0.0:
                marked = np.concatenate([marked, roadmap.add_path(self.best, int(nodes[0]), int(nodes[1]))])
                self._search(roadmap, band, nodes)
            if self._time_left() > 0.0:
                self._offer(shorten(self.checker, self.best, self.rng, deadline=self.deadline))
            settled = settled + 1 if before - self.best_cost < IMPROVEMENT * before else 0

    def _offer(self, states: se2.FloatArray) -> None:
        """Keep a path if it is the best so far."""
        steps = se2.difference(states[:-1], states[1:])
        cost = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        if self.turning:
            cost += se2.ROTATION_WEIGHT * float(np.abs(steps[:, 2]).sum())
        if cost >= self.best_cost:
            return
        self.best, self.best_cost = states, cost
        whole = Path(self._with_headings(states)).cost
        if self.first_cost is None:
            self.first_cost = whole
        self.history.append((perf_counter() - self.begin, whole))

    def _with_headings(self, states: se2.FloatArray) -> se2.FloatArray:
        """Return the path with the ends' headings; a disc robot turns evenly along it, which costs the least."""
        if self.turning:
            return states
        states = states.copy()
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(states[:, :2], axis=0).T))])
        share = along / along[-1] if along[-1] > 0.0 else np.linspace(0.0, 1.0, len(states))
        states[:, 2] = se2.interpolate(self.start, self.goal, share)[:, 2]
        states[0], states[-1] = self.start, self.goal
        return states

    def _answer(self) -> tuple[Status, se2.FloatArray | None]:
        return ("timeout", None) if self.best is None else ("solved", self._with_headings(self.best))

    def _go_on(self, phase: str) -> bool:
        """Report, and say whether another round may begin."""
        self._report(phase)
        if self.rounds_left is not None:
            self.rounds_left -= 1
            if self.rounds_left < 0:
                return False
        return self._time_left() > 0.0

    def _time_left(self) -> float:
        return self.deadline - perf_counter()

    def _report(self, phase: str) -> None:
        if self.on_progress is not None:
            cost = None if self.best is None else Path(self._with_headings(self.best)).cost
            self.on_progress(PlanProgress(perf_counter() - self.begin, phase, len(self.roadmap), cost))
