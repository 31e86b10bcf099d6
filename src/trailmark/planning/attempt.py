"""Attempt: how one query is answered, round by round."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.landmarks import Relaxation, k_means_landmarks
from trailmark.landmarks.informed import Band
from trailmark.motion import TranslationMotion
from trailmark.planning.background import BackgroundProof
from trailmark.planning.bridge import Bridge
from trailmark.planning.claims import contradicted, grid_separates
from trailmark.planning.disc_way import disc_way
from trailmark.planning.drives import drives_from
from trailmark.planning.general import SAMPLES_PER_LANDMARK
from trailmark.planning.incident import report_incident
from trailmark.planning.lower_bound import SECONDS_A_WAY, LowerBound
from trailmark.planning.recall import Recall
from trailmark.planning.result import PlanProgress, Status
from trailmark.planning.scout import AT_FIRST, AT_MOST, AT_SECOND, Scout
from trailmark.planning.shortening import shorten
from trailmark.planning.straightening import without_needless
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

KEPT = 2_000
"""Nodes up to which the planner's roadmap takes in what queries bring that it might answer without."""

WORSE, LONGER = 1.03, 1.3
"""Times the best path's cost: what the roadmap knows is about as good up to the first, once it is shortened; what is
looked for in it may be longer at first, up to the second."""

DUPLICATE = 0.05
"""Of the inscribed disc's radius: a landmark that lies nearer to a node that is joined already is not added."""

SECONDS_A_RELAXED_CELL, SECONDS_AN_EDGE, SECONDS_A_DRIVE = 1.5e-6, 5e-6, 1e-4
"""What a cell of the relaxed problem, a node or an edge of the roadmap that a search looks at, and a configuration
reached by a car's drive may take."""

LONGEST_DRIVE = 0.1
"""Turning radii: drives of the first round; those of later ones are half as long each time."""

DRIVES, DRIVEN_LANDMARKS = 6000, 80
"""Configurations that drives from one part of the roadmap reach at first, and landmarks among them."""

AT_LEISURE = 1_000
"""Nodes and edges of the roadmap looked at before landmarks are placed."""

RECALL_MOST, RECALL_SHARE = 20_000, 0.05
"""Nodes and edges looked at for a better path at most, and the share of the time left that this may take."""

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
        effort: nodes and edges that searches took until then.
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
        self.begin, self.deadline, self.limit = begin, begin + time_limit, time_limit
        # What the last sweep of shortening took, and the last landmarks, each.
        self._sweeping = self._growing = 0.0
        self.rounds_left = max_iterations
        self.on_progress, self.stop = on_progress, stop
        self.nearest: se2.FloatArray | None = None
        self.bound, self.gap = bound, gap
        self.motion = roadmap.motion
        self.lower_bound = self.motion.least_cost(self.start, self.goal)
        self._proven = bound is None
        # Whether something that was claimed turned out to be wrong.
        self._refuted = False
        self._cutting = 0.0
        self._refining = 0.0
        self._proof: BackgroundProof | None = None
        self.sought = roadmap
        self.recall = Recall(roadmap, self.start, self.goal)
        self.scout: Scout | None = None
        self._known_cost = np.inf
        self.best: se2.FloatArray | None = None
        self.best_cost = np.inf
        self.first_cost: float | None = None
        self.effort = 0
        self.history: list[tuple[float, float]] = []

    def run(self) -> tuple[Status, se2.FloatArray | None]:
        """Return the status and the best path's states, shape (n, 3), or None."""
        try:
            return self._run()
        finally:
            if self._proof is not None:
                self._proof.end()

    def _run(self) -> tuple[Status, se2.FloatArray | None]:
        ends = self.motion.ends(self.start, self.goal)
        if self.motion.motions_between_valid(ends[:1], ends[1:])[0]:
            # Nothing is shorter.
            self._offer(ends)
            self._known_cost = self.best_cost
            return self._answer()
        self.recall = Recall(self.roadmap, *ends)
        scout = self.scout = self._scout(ends)
        self._take_known(self.recall.look_at_once())
        known = self.best is not None
        if not known and scout is not None:
            self._report("looking for a first path")
            self._look(scout, AT_FIRST)
        if self._too_late_for_cells(scout):
            return self._answer()
        begin = perf_counter()
        band = Band(self.checker, self.relaxation, ends[0], ends[1])
        self._refining = perf_counter() - begin
        rounds = self._place(band, scout, ends)
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
            return self._answer()
        self._prove(PROOF_SHARE)
        if not (known or rounds or self._close_enough()):
            self._look_again(band)
        self._improve(band, ends, int(FIRST_LANDMARKS * GROWTH**rounds), scout)
        self._prove(LAST_SHARE)
        return self._answer()

    def _look(self, scout: Scout, levels: int) -> None:
        """Look for a first path over lattices, and over the roadmap beside them."""
        for _ in range(levels):
            self._take(scout.look())
            if self.best is None:
                self._take_known(self.recall.look_beside(scout.taken))
            if self.best is not None or self._time_left() <= 0.0:
                return

    def _too_late_for_cells(self, scout: Scout | None) -> bool:
        """Return whether there is no time left to look at the relaxed problem; spend it on other lattices then."""
        grid = self.relaxation
        needed = SECONDS_A_RELAXED_CELL * grid.rows * grid.columns
        if self._time_left() > needed:
            return False
        while self.best is None and scout is not None and scout.level < AT_MOST and self._time_left() > 0.0:
            self._look(scout, 1)
        # Without a path, and with time for nothing else, it is looked at all the same if the limit allows for it.
        return self.best is not None or self._time_left() <= 0.0 or needed > self.limit

    def _look_again(self, band: Band) -> None:
        """See what the roadmap knows that is about as good as the path; let it grow there if it knows nothing."""
        budget = int(min(RECALL_MOST, max(0.0, RECALL_SHARE * self._time_left() / SECONDS_AN_EDGE)))
        self._take_known(self.recall.look_again(LONGER * self.best_cost, budget))
        if self._known_cost == np.inf and self.recall.complete and len(self.roadmap) < KEPT and not self._is_over():
            self._grow(self.roadmap, band, self._widening(band), FIRST_LANDMARKS)

    def _learn(self) -> None:
        """Add the path to the roadmap, if that knows none about as good; once it is large, if it knows none at all."""
        if self.best is None or self._known_cost <= WORSE * self.best_cost:
            return
        if len(self.roadmap) < KEPT or (self._known_cost == np.inf and self.recall.complete):
            self.roadmap.add_path(self.best)

    def _scout(self, ends: se2.FloatArray) -> Scout | None:
        """Return what looks for paths over lattices, whose steps are not a car's."""
        if not self.motion.moves_anywhere:
            return None
        return Scout(self.checker, ends[0], ends[1], self.relaxation.size, self._time_left)

    def _place(self, band: Band, scout: Scout | None, ends: se2.FloatArray) -> int:
        """Place landmarks round by round while there is no path; return the number of rounds."""
        if self.best is None and np.isfinite(band.shortest):
            self._look_closely(band, scout)
            if self.best is None:
                self._take_known(self.recall.look(AT_LEISURE))
        if not self._may_exist(band):
            return 0
        if len(self.roadmap) >= KEPT:
            # What is tried for this query alone would only hold up others.
            self.sought = Roadmap(self.checker, self.motion)
        nodes = self.sought.ends(ends)
        rounds = 0
        while self._may_exist(band) and self._go_on("placing landmarks"):
            guides = self._guides(band, rounds)
            if not self._may_exist(band):
                break
            self.sought.add(self._fresh(self.sought, guides))
            ε = WIDENINGS[rounds] if rounds < len(WIDENINGS) else np.inf
            self._grow(self.sought, band, ε, int(FIRST_LANDMARKS * GROWTH**rounds))
            self._search(self.sought, band, nodes)
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
            self._look(scout, AT_SECOND - AT_FIRST)
        if self.best is None:
            self._prove(PROOF_SHARE)
        if scout is not None and far and self._may_exist(band):
            self._look(scout, AT_MOST - AT_SECOND)
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
        if not self.motion.moves_anywhere:
            self._drive(band, nodes, LONGEST_DRIVE * self.motion.radius * 0.5**rounds, DRIVES << min(rounds, 6))
            return
        bridge = Bridge(self.sought, band, nodes, self.rng)
        while self.best is None and bridge.promising and self._time_left() > 0.0:
            self.sought.add(bridge.landmarks())
            self._search(self.sought, band, nodes)

    def _drive(self, band: Band, nodes: NDArray[np.int64], step: float, most: int) -> None:
        """Drive on from what the start leads to, and towards what leads to the goal, and search again."""
        self._report("driving")
        band.widen(np.inf)
        for reverse in (False, True):
            most = int(min(most, max(0.0, self._time_left()) / SECONDS_A_DRIVE))
            reached = np.flatnonzero(self.sought.reached(int(nodes[int(reverse)]), reverse=reverse))
            found = drives_from(
                self.motion,
                band.relaxation,
                band.from_start if reverse else band.to_goal,
                self.sought.configurations[reached],
                reverse=reverse,
                step=step,
                most=most,
                landmarks=DRIVEN_LANDMARKS,
                rng=self.rng,
            )
            parents = np.concatenate([reached, len(self.sought) + np.arange(len(found.parents))])[found.parents]
            self.sought.add_tree(found.configurations, parents, reverse=reverse)
            self._search(self.sought, band, nodes)
            if self.best is not None or self._time_left() <= 0.0:
                return

    def _grow(self, roadmap: Roadmap, band: Band, widening: float, landmarks: int) -> None:
        """Cluster samples of the band into landmarks and join them to a roadmap."""
        if self._growing * landmarks > self._time_left():
            return
        begin = perf_counter()
        samples = band.samples(SAMPLES_PER_LANDMARK * landmarks, widening, self.rng)
        if len(samples):
            centres = k_means_landmarks(
                samples, landmarks, radius=self.motion.radius, steps=LLOYD_STEPS, random_state=self.rng
            )
            roadmap.add(self._fresh(roadmap, centres))
        self._growing = (perf_counter() - begin) / landmarks

    def _fresh(self, roadmap: Roadmap, q: se2.FloatArray) -> se2.FloatArray:
        """Return the configurations without those that are hardly another place than a node that is joined already."""
        return roadmap.fresh(q, DUPLICATE * self.checker.robot.inscribed_disc.radius)

    def _approach(self, nodes: NDArray[np.int64]) -> se2.FloatArray:
        """Return the states of the shortest path from the start to the node, of those reached, nearest to the goal."""
        start, goal, sought = int(nodes[0]), int(nodes[1]), self.sought
        q = sought.configurations
        reached = np.flatnonzero(sought.reached(start))
        last = int(reached[np.argmin(se2.distance(q[reached], q[goal]))])
        states = np.array(q[sought.shortest_path(start, last).nodes])
        return self.motion.whole_states(states, self.start, np.array([*states[-1, :2], self.start[2]]))

    def _search(
        self, roadmap: Roadmap, band: Band | None, nodes: NDArray[np.int64], banned: NDArray[np.bool_] | None = None
    ) -> None:
        """Offer a roadmap's shortest path, shortened."""
        # The relaxed way guides to a first path soon; it may overestimate, so what betters a path is sought without.
        to_go = roadmap.distances_to(int(nodes[1]))
        if band is not None and self.best is None:
            to_go = np.maximum(to_go, band.costs_to_goal(roadmap.configurations))
        limit = np.inf if banned is not None else self.best_cost
        found = roadmap.shortest_path(
            int(nodes[0]), int(nodes[1]), to_go=to_go, banned=banned, limit=limit, seconds=self._time_left()
        )
        self._take(roadmap.configurations[found.nodes])

    def _take(self, states: se2.FloatArray) -> float:
        """Offer a path, if there is one, and what shortening makes of it; return that one's cost, metres."""
        if len(states) == 0:
            return np.inf
        if self.best is None:
            self._offer(states)
        states = self._shortened(states, FIRST_SWEEPS)
        if self._cost(states) < PROMISING * self.best_cost:
            states = self._shortened(states)
            self._offer(states)
        return self._cost(states)

    def _take_known(self, states: se2.FloatArray) -> None:
        """Offer a path that the roadmap knows."""
        self._known_cost = min(self._known_cost, self._take(states))

    def _shortened(self, states: se2.FloatArray, sweeps: int = SWEEPS, *, splitting: bool = False) -> se2.FloatArray:
        """Return a path made shorter, with added vertices or without."""
        # A vertex more costs a curve more than it gains.
        splitting = splitting and self.motion.moves_anywhere
        return shorten(self.motion, states, self.rng, sweeps=sweeps, splitting=splitting, stop=self._no_sweep())

    def _is_over(self) -> bool:
        return self._time_left() <= 0.0

    def _no_sweep(self) -> Callable[[], bool]:
        """Return what tells before each sweep of shortening whether it would come to its end too late."""
        last: float | None = None

        def too_late() -> bool:
            nonlocal last
            now = perf_counter()
            if last is not None:
                self._sweeping = now - last
            last = now
            return self._time_left() <= self._sweeping

        return too_late

    def _improve(self, band: Band, ends: se2.FloatArray, landmarks: int, scout: Scout | None) -> None:
        """Look for other ways around, place landmarks where better paths might run and search again, while it helps.

        This goes on in a roadmap of its own, so that the planner's stays small enough for many queries; what
        comes of it, the path, is added to the planner's, and so are some landmarks around it.
        """
        if self._disc_way():
            return
        settled = 0
        roadmap = Roadmap(self.checker, self.motion)
        nodes = roadmap.add(ends)
        marked = np.zeros(0, dtype=np.int64)
        while settled < PATIENCE and self.best is not None and not self._close_enough() and self._go_on("improving"):
            before = self.best_cost
            way = np.empty((0, 3)) if scout is None else scout.look_again(self.rng, self.best_cost)
            if len(way):
                way = self._shortened(way, FIRST_SWEEPS)
                # What it passes joins the landmarks: parts of it may be better than the best path's.
                roadmap.add_path(way)
                if self._cost(way) < PROMISING * self.best_cost:
                    self._offer(self._shortened(way))
            self._grow(roadmap, band, self._widening(band), landmarks)
            # Once without the best path's own vertices, for the other ways around the obstacles ...
            banned = np.zeros(len(roadmap), dtype=np.bool_)
            banned[marked] = True
            self._search(roadmap, band, nodes, banned)
            # ... and once with them, for what can be put together from both.
            if self._time_left() > 0.0:
                marked = np.concatenate([marked, roadmap.add_path(self.best)[1:-1]])
                self._search(roadmap, band, nodes)
            if self._time_left() > 0.0:
                self._offer(self._shortened(self.best, POLISHING, splitting=True))
            settled = settled + 1 if before - self.best_cost < IMPROVEMENT * before else 0

    def _disc_way(self) -> bool:
        """Offer the shortest way of a disc robot; return False if there is no time for it, or it is not found."""
        if not isinstance(self.motion, TranslationMotion) or self.bound is None or self._close_enough():
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

    def _without_needless(self, states: se2.FloatArray) -> se2.FloatArray:
        """Return a path without the vertices that it does without."""
        return np.asarray(without_needless(self.motion.kind, states))

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
        least = self.motion.least_cost(self.start, self.goal)
        self.lower_bound, self._proven, self._refuted = least, True, True

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
        disc = isinstance(self.motion, TranslationMotion)
        if self.best is None and self._proof is None and self.bound is not None and not disc:
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
            self.effort = self.recall.taken + (0 if self.scout is None else self.scout.taken)
            if self._proof is not None:
                self._proof.cancel()
        self.history.append((perf_counter() - self.begin, self._whole_cost()))
        self._report("shortening")

    def _cost(self, states: se2.FloatArray) -> float:
        """Return the cost of a path as the roadmap knows it: a disc robot's without headings."""
        return self.motion.cost_of(states)

    def _whole_cost(self) -> float:
        """Return the best path's cost, a disc robot's turning included; infinite without a path."""
        return self.motion.whole_cost(self.best_cost, self.start, self.goal)

    def _with_headings(self, states: se2.FloatArray) -> se2.FloatArray:
        """Return the path with the ends' headings."""
        return self.motion.whole_states(states, self.start, self.goal)

    def _answer(self) -> tuple[Status, se2.FloatArray | None]:
        if self.best is not None:
            fewer = self._without_needless(self.best)
            self._offer(fewer)
            self.best = fewer
            self._learn()
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
        path = None if self.best is None else self.motion.path(self._with_headings(self.best))
        nearest = None if self.nearest is None or path is not None else self.motion.path(self.nearest)
        cost = None if path is None else self._whole_cost()
        self.on_progress(PlanProgress(perf_counter() - self.begin, phase, len(self.roadmap), cost, path, nearest))
