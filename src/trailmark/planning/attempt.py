"""Attempt: how one query is answered, round by round."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.landmarks import Relaxation, k_means_landmarks
from trailmark.landmarks.informed import Band
from trailmark.path import Path
from trailmark.planning.background import BackgroundProof
from trailmark.planning.bridge import Bridge
from trailmark.planning.claims import contradicted, grid_separates
from trailmark.planning.disc_way import disc_way
from trailmark.planning.general import SAMPLES_PER_LANDMARK
from trailmark.planning.headings import turned_evenly
from trailmark.planning.incident import report_incident
from trailmark.planning.lower_bound import SECONDS_A_WAY, LowerBound
from trailmark.planning.result import PlanProgress, Status
from trailmark.planning.scout import AT_FIRST, AT_MOST, AT_SECOND, Scout
from trailmark.planning.shortening import shorten
from trailmark.roadmap import Roadmap

__all__ = ["LLOYD_STEPS", "Attempt", "OnProgress"]

OnProgress = Callable[[PlanProgress], None]

WIDENINGS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.5)
"""How much longer than the relaxed shortest way a band's ways may be, round by round; then without limit."""

LLOYD_STEPS = 3
"""Steps of K-means in a round."""

FIRST_LANDMARKS = 120
GROWTH = 1.4
"""Each round places this many times the landmarks of the one before."""

SHORT = 200
"""Cells of a relaxed way up to which it counts as short."""

ROUNDS_PER_GRID = 2
"""Rounds without a path after which the relaxed problem is looked at on a grid twice as fine."""

SWEEPS, FIRST_SWEEPS, PROMISING = 40, 5, 1.03
"""Sweeps of shortening at most; another path gets all only if the first few bring it within this factor of the best."""

POLISHING = 10
"""Sweeps with added vertices that the best path gets in each round."""

KEPT = 5_000
"""Nodes up to which the planner's roadmap takes in landmarks of queries that are answered without them."""

PROOF_SHARE, LAST_SHARE = 0.25, 0.6
"""Shares of the time left that a proof may be expected to take, before much else is left to do and after that."""

PATIENCE = 16
"""Rounds without a gain of IMPROVEMENT after which a path counts as settled."""
IMPROVEMENT = 3e-4


class Attempt:
    """One query under way: its ends, its best path so far, its clock.

    Args:
        roadmap: where to search first, and to leave what joins the ends.
        relaxation: the relaxed problem's grid.
        rng: source of randomness.
        ends: valid start and goal, shape (2, 3).
        begin: reading of ``time.perf_counter`` that times are counted from, seconds.
        time_limit: seconds.
        max_iterations: rounds of landmarks at most.
        on_progress: called after every step and with every better path.
        stop: asked between steps whether to end early.
        bound: proves lower bounds in this world.
        gap: how far above the proven lower bound a path may be to end the search, as a share of it.

    Attributes:
        start: shape (3,).
        goal: shape (3,).
        begin: as given.
        first_cost: the first path's cost, metres.
        history: (seconds, cost in metres) of each better path.
        nearest: without a path, the states (n, 3) of one from the start to where it comes nearest to the goal.
        lower_bound: proven lower bound on any path's cost, metres; infinite if it proves that there is none.
    """

    def __init__(
        self,
        roadmap: Roadmap,
        relaxation: Relaxation,
        rng: np.random.Generator,
        ends: se2.FloatArray,
        *,
        begin: float,
        time_limit: float,
        max_iterations: int | None,
        on_progress: OnProgress | None,
        stop: Callable[[], bool] | None = None,
        bound: LowerBound | None = None,
        gap: float = 0.0,
    ) -> None:
        self.checker, self.roadmap, self.relaxation, self.rng = roadmap.checker, roadmap, relaxation, rng
        self.start, self.goal = ends
        self.begin, self.deadline = begin, begin + time_limit
        self.rounds_left = max_iterations
        self.on_progress, self.stop = on_progress, stop
        self.nearest: se2.FloatArray | None = None
        self.bound, self.gap = bound, gap
        self.lower_bound = self._least_cost()
        self._proven = bound is None
        # Whether something that was claimed turned out to be wrong.
        self._refuted = False
        self._cutting = 0.0
        self._refining = 0.0
        self._proof: BackgroundProof | None = None
        self.turning = self.roadmap.turning
        self._turned = se2.ROTATION_WEIGHT * abs(float(se2.difference(self.start, self.goal)[2]))
        self.best: se2.FloatArray | None = None
        self.best_cost = np.inf
        self.first_cost: float | None = None
        self.history: list[tuple[float, float]] = []

    def run(self) -> tuple[Status, se2.FloatArray | None]:
        """Return the status and the best path's states, shape (n, 3), or None."""
        try:
            return self._run()
        finally:
            if self._proof is not None:
                self._proof.end()

    def _run(self) -> tuple[Status, se2.FloatArray | None]:
        ends = self._ends()
        if self._straight(ends):
            # Nothing is shorter.
            self._offer(ends)
            return self._answer()
        # Not before there is need: joining the ends to an empty roadmap would only hold up the first path.
        nodes = self.roadmap.add(ends) if len(self.roadmap) else None
        if nodes is not None:
            self._search(self.roadmap, None, nodes)
        known, scout = self.best is not None, self._scout(ends)
        if not known and scout is not None:
            self._report("looking for a first path")
            self._take(scout.look(AT_FIRST))
        if nodes is None:
            nodes = self.roadmap.add(ends)
        if self.best is not None and self._time_left() <= 0.0:
            self.roadmap.add_path(self.best, int(nodes[0]), int(nodes[1]))
            return self._answer()
        band = Band(self.checker, self.relaxation, ends[0], ends[1])
        rounds = self._place(band, scout, nodes)
        if self._may_exist(band):
            self._prove(LAST_SHARE)
            if self._proof is not None:
                # With rounds at their end and time to spare the answer must not depend on who is faster.
                self._proof.wait(self._time_left())
        if self.best is None:
            return self._without_path(band), None
        if not np.isfinite(band.shortest):
            # The grid says that there is none; it is no guide.
            self._claim(np.inf)
            self.roadmap.add_path(self.best, int(nodes[0]), int(nodes[1]))
            return self._answer()
        self._prove(PROOF_SHARE)
        if self.best is not None and not (known or rounds or self._close_enough()) and len(self.roadmap) < KEPT:
            self._grow(self.roadmap, band, self._widening(band), FIRST_LANDMARKS)
        self._improve(band, ends, int(FIRST_LANDMARKS * GROWTH**rounds), scout)
        self._prove(LAST_SHARE)
        if self.best is not None:
            self.roadmap.add_path(self.best, int(nodes[0]), int(nodes[1]))
        return self._answer()

    def _ends(self) -> se2.FloatArray:
        """Return start and goal as the roadmap knows them: a disc robot at heading 0 only."""
        ends = np.array([self.start, self.goal])
        if not self.turning:
            ends[:, 2] = 0.0
        return ends

    def _straight(self, ends: se2.FloatArray) -> bool:
        """Return whether a single motion leads from start to goal."""
        return bool(self.checker.motions_between_valid(ends[:1], ends[1:])[0])

    def _scout(self, ends: se2.FloatArray) -> Scout | None:
        """Return what looks for ways over lattices."""
        return Scout(self.checker, ends[0], ends[1], self.relaxation.size, self._time_left)

    def _place(self, band: Band, scout: Scout | None, nodes: NDArray[np.int64]) -> int:
        """Place landmarks round by round while there is no path; return the number of rounds."""
        if self.best is None and np.isfinite(band.shortest):
            self._look_closely(band, scout)
        rounds = 0
        while self._may_exist(band) and self._go_on("placing landmarks"):
            guides = self._guides(band, rounds)
            if not self._may_exist(band):
                break
            self.roadmap.add(guides)
            ε = WIDENINGS[rounds] if rounds < len(WIDENINGS) else np.inf
            self._grow(self.roadmap, band, ε, int(FIRST_LANDMARKS * GROWTH**rounds))
            self._search(self.roadmap, band, nodes)
            if self.best is None and self._time_left() > 0.0:
                self._join(band, nodes, rounds)
            rounds += 1
            if self.best is not None:
                break
            self.nearest = self._approach(nodes)
            if rounds % ROUNDS_PER_GRID == 0:
                # What keeps failing may need a closer look, or be impossible.
                self._prove(PROOF_SHARE)
                self._prove_aside()
                self._refine(band)
            if scout is not None:
                self._take(scout.look())
        return rounds

    def _refine(self, band: Band) -> None:
        """Look at the relaxed problem on cells half as large, if there is time: it takes some five times as long."""
        begin = perf_counter()
        if 5.0 * self._refining < self._time_left() and band.refine():
            self._refining = perf_counter() - begin

    def _may_exist(self, band: Band) -> bool:
        """Return whether a path is still sought and not proven not to exist."""
        return (
            self.best is None
            and not self._disproven()
            and bool(np.isfinite(band.shortest))
            and bool(np.isfinite(self.lower_bound))
        )

    def _look_closely(self, band: Band, scout: Scout | None) -> None:
        """Look for a first path without landmarks."""
        # A close look at each cell of a short way costs less than larger lattices.
        far = band.shortest > SHORT * band.relaxation.size
        if scout is not None and far:
            self._prove_aside()
            self._take(scout.look(AT_SECOND - AT_FIRST))
        if self.best is None:
            self._prove(PROOF_SHARE)
        if scout is not None and far and self._may_exist(band):
            self._take(scout.look(AT_MOST - AT_SECOND))
        if self._may_exist(band):
            self._disc_way()

    def _guides(self, band: Band, rounds: int) -> se2.FloatArray:
        """Return valid configurations along the relaxed shortest way, shape (n, 3)."""
        guides, whole = band.guides(self.rng)
        # Cells larger than the disc may have led to where it does not fit.
        coarse = rounds == 0 and not whole and band.relaxation.size > band.relaxation.radius
        if coarse and band.refine() and np.isfinite(band.shortest):
            guides, _ = band.guides(self.rng)
        return guides

    def _join(self, band: Band, nodes: NDArray[np.int64], rounds: int) -> None:
        """Place landmarks where the start's and the goal's parts of the roadmap end, while they grow together."""
        bridge = Bridge(self.roadmap, band, nodes, self.rng)
        while self.best is None and bridge.promising and self._time_left() > 0.0:
            self.roadmap.add(bridge.landmarks())
            self._search(self.roadmap, band, nodes)

    def _grow(self, roadmap: Roadmap, band: Band, widening: float, landmarks: int) -> None:
        """Cluster samples of the band into landmarks and join them to a roadmap."""
        samples = band.samples(SAMPLES_PER_LANDMARK * landmarks, widening, self.rng)
        if len(samples):
            # Heading differences count as far as they move the robot.
            radius = self.checker.footprint.sweep_radius
            roadmap.add(k_means_landmarks(samples, landmarks, radius=radius, steps=LLOYD_STEPS, random_state=self.rng))

    def _approach(self, nodes: NDArray[np.int64]) -> se2.FloatArray:
        """Return the states of the shortest path from the start to the node, of those reached, nearest to the goal."""
        start, goal = int(nodes[0]), int(nodes[1])
        q = self.roadmap.configurations
        reached = np.flatnonzero(self.roadmap.shortest_path(start, goal).reached)
        last = int(reached[np.argmin(se2.distance(q[reached], q[goal]))])
        states = np.array(q[self.roadmap.shortest_path(start, last).nodes])
        if not self.turning:
            states[:, 2] = self.start[2]
        return states

    def _search(
        self, roadmap: Roadmap, band: Band | None, nodes: NDArray[np.int64], banned: NDArray[np.bool_] | None = None
    ) -> None:
        """Offer a roadmap's shortest path, shortened."""
        # The relaxed way guides to a first path soon; it may overestimate, so what betters a path is sought without.
        to_go = band.costs_to_goal(roadmap.configurations) if band is not None and self.best is None else None
        limit = np.inf if banned is not None else self.best_cost
        found = roadmap.shortest_path(int(nodes[0]), int(nodes[1]), to_go=to_go, banned=banned, limit=limit).nodes
        self._take(roadmap.configurations[found])

    def _take(self, states: se2.FloatArray) -> None:
        """Offer a path, if there is one, and what shortening makes of it."""
        if len(states) == 0:
            return
        if self.best is None:
            self._offer(states)
        states = self._shortened(states, FIRST_SWEEPS)
        if Path(states).cost < PROMISING * self.best_cost:
            self._offer(self._shortened(states))

    def _shortened(self, states: se2.FloatArray, sweeps: int = SWEEPS, *, splitting: bool = False) -> se2.FloatArray:
        """Return a path made shorter, with added vertices or without."""
        return shorten(self.checker, states, self.rng, sweeps=sweeps, splitting=splitting, stop=self._is_over)

    def _is_over(self) -> bool:
        return self._time_left() <= 0.0

    def _improve(self, band: Band, ends: se2.FloatArray, landmarks: int, scout: Scout | None) -> None:
        """Look for other ways around, place landmarks where better paths might run and search again, while it helps.

        This goes on in a roadmap of its own, so that the planner's stays small enough for many queries; what
        comes of it, the path, is added to the planner's, and so are some landmarks around it.
        """
        if self._disc_way():
            return
        settled = 0
        roadmap = type(self.roadmap)(self.checker)
        nodes = roadmap.add(ends)
        marked = np.zeros(0, dtype=np.int64)
        while settled < PATIENCE and self.best is not None and not self._close_enough() and self._go_on("improving"):
            before = self.best_cost
            way = np.empty((0, 3)) if scout is None else scout.look_again(self.rng, self.best_cost)
            if len(way):
                way = self._shortened(way, FIRST_SWEEPS)
                # What it passes joins the landmarks: parts of it may be better than the best path's.
                roadmap.add_path(way, int(nodes[0]), int(nodes[1]))
                if Path(way).cost < PROMISING * self.best_cost:
                    self._offer(self._shortened(way))
            self._grow(roadmap, band, self._widening(band), landmarks)
            # Once without the best path's own vertices, for the other ways around the obstacles ...
            banned = np.zeros(len(roadmap), dtype=np.bool_)
            banned[marked] = True
            self._search(roadmap, band, nodes, banned)
            # ... and once with them, for what can be put together from both.
            if self._time_left() > 0.0:
                marked = np.concatenate([marked, roadmap.add_path(self.best, int(nodes[0]), int(nodes[1]))])
                self._search(roadmap, band, nodes)
            if self._time_left() > 0.0:
                self._offer(self._shortened(self.best, POLISHING, splitting=True))
            settled = settled + 1 if before - self.best_cost < IMPROVEMENT * before else 0

    def _disc_way(self) -> bool:
        """Offer the shortest way of a disc robot; return False if there is no time for it, or it is not found."""
        if self.turning or self.bound is None or self._close_enough():
            return False
        # Its region takes longer to make than the bound's, which has fewer corners.
        if 1.2 * self._seconds_to_cut() > self._time_left():
            return False
        self._report("cutting free space into triangles")
        radius = self.checker.robot.inscribed_disc.radius
        way = disc_way(self.checker.world, radius, self.start[:2], self.goal[:2], self.best_cost, self._time_left)
        states = np.column_stack([way, np.zeros(len(way))])
        if len(way) == 0 or not self.checker.motions_between_valid(states[:-1], states[1:]).all():
            return False
        self._offer(states)
        self._offer(self._shortened(states))
        return True

    def _widening(self, band: Band) -> float:
        """Return how much longer than the relaxed shortest way a better path's ways may be."""
        return max(0.02, self.best_cost / max(band.shortest, 1e-9) - 1.0)

    def _prove(self, share: float) -> None:
        """Prove a lower bound if that is expected to take no more than a share of the time left."""
        if self.bound is None or self._proven:
            return
        if self._seconds_to_cut() < share * self._time_left():
            self._proven = True
            self._claim(self.bound.of(self.start, self.goal, self._whole_cost()).cost)

    def _claim(self, bound: float) -> None:
        """Take a lower bound over, unless a path that is known costs less: then nothing is claimed any more."""
        self.lower_bound = max(self.lower_bound, bound)
        if self.best is None or not contradicted(self.lower_bound, self._whole_cost()):
            return
        problem = f"a lower bound of {self.lower_bound:g} m is above the cost of a path, {self._whole_cost():g} m"
        report_incident(problem, self.checker.world, self.checker.robot, self.start, self.goal)
        self.lower_bound, self._proven, self._refuted = self._least_cost(), True, True

    def _least_cost(self) -> float:
        """Return what the way would cost without obstacles, metres."""
        return float(se2.distance(self.start, self.goal))

    def _without_path(self, band: Band) -> Status:
        """Return what there is to say without a path; a claim of the relaxed problem's grid is proven anew."""
        if self._may_exist(band):
            return "timeout"
        if np.isfinite(self.lower_bound):
            if grid_separates(band.relaxation, band.to_goal, self.start, self.goal):
                self.lower_bound = np.inf
            else:
                self._prove(LAST_SHARE)
        return self._answer()[0]

    def _prove_aside(self) -> None:
        """Begin to look for a proof, with headings, that no path exists; searches end once it is found."""
        if self.best is None and self._proof is None and self.bound is not None and self.turning:
            # Known first, so that an exception in between does not leave it running.
            self._proof = BackgroundProof(self.checker, self.start, self.goal, max(0.0, self._time_left()))
            self._proof.begin()

    def _disproven(self) -> bool:
        """Return whether it is proven by now that no path exists."""
        if self._refuted or self._proof is None or not self._proof.found:
            return False
        self._claim(np.inf)
        return not self._refuted

    def _seconds_to_cut(self) -> float:
        """Return what cutting free space into triangles is expected to take, at first."""
        if self.bound is not None:
            seconds = self.bound.seconds(self.start, self.goal, self._whole_cost())
            # The better the path, the less there is to cut. Once that is done, what it took is known no more.
            self._cutting = seconds if seconds > SECONDS_A_WAY else max(self._cutting, seconds)
        return self._cutting

    def _close_enough(self) -> bool:
        """Return whether the best path is proven to be within the gap."""
        if self.best is None or not self._proven:
            return False
        return self._whole_cost() <= (1.0 + self.gap) * self.lower_bound + 1e-9

    def _offer(self, states: se2.FloatArray) -> None:
        """Keep a path if it is the best so far."""
        cost = self._cost(states)
        if cost >= self.best_cost:
            return
        self.best, self.best_cost = states, cost
        self._claim(self.lower_bound)
        if self.first_cost is None:
            self.first_cost = self._whole_cost()
            if self._proof is not None:
                self._proof.cancel()
        self.history.append((perf_counter() - self.begin, self._whole_cost()))
        self._report("shortening")

    def _cost(self, states: se2.FloatArray) -> float:
        """Return the cost of a path as the roadmap knows it: a disc robot's without headings."""
        steps = se2.difference(states[:-1], states[1:])
        cost = float(np.hypot(steps[:, 0], steps[:, 1]).sum())
        return cost + se2.ROTATION_WEIGHT * float(np.abs(steps[:, 2]).sum()) if self.turning else cost

    def _whole_cost(self) -> float:
        """Return the best path's cost, a disc robot's turning included; infinite without a path."""
        return self.best_cost if self.turning else self.best_cost + self._turned

    def _with_headings(self, states: se2.FloatArray) -> se2.FloatArray:
        """Return the path with the ends' headings; a disc robot turns evenly along it, which costs the least."""
        return states if self.turning else turned_evenly(states, self.start, self.goal)

    def _path(self, states: se2.FloatArray) -> Path:
        """Return the path of these states."""
        return Path(states)

    def _answer(self) -> tuple[Status, se2.FloatArray | None]:
        if self.best is not None:
            return "solved", self._with_headings(self.best)
        return ("timeout" if np.isfinite(self.lower_bound) else "infeasible"), None

    def _go_on(self, phase: str) -> bool:
        """Report, and say whether another round may begin."""
        self._report(phase)
        if self.rounds_left is not None:
            self.rounds_left -= 1
            if self.rounds_left < 0:
                return False
        return self._time_left() > 0.0

    def _time_left(self) -> float:
        if self._disproven() or (self.stop is not None and self.stop()):
            return -np.inf
        return self.deadline - perf_counter()

    def _report(self, phase: str) -> None:
        if self.on_progress is None:
            return
        path = None if self.best is None else self._path(self._with_headings(self.best))
        nearest = None if self.nearest is None or path is not None else self._path(self.nearest)
        cost = None if path is None else self._whole_cost()
        self.on_progress(PlanProgress(perf_counter() - self.begin, phase, len(self.roadmap), cost, path, nearest))
