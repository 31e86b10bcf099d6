"""Rounds of landmarks: while there is no path, each draws from a wider band and places more of them."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.landmarks.band import Band
from trailmark.planning.hybrid_astar import hybrid_astar
from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.placement import Placement
from trailmark.planning.proofs.prover import Prover
from trailmark.planning.query import Query
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["Bridge", "Rounds"]

WIDENINGS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.5)
"""How much longer than the relaxed shortest path a band's paths may be, round by round; then without limit."""

FINER = 5.0
"""Times as long as before the relaxed problem takes on cells half as large."""


class Rounds:
    """Looks for a first path by landmarks.

    Args:
        query: under way.
        proofs: asked when rounds keep failing.
        placement: of landmarks, in the query's band.
        lattices: looked over between rounds; None for a car.
        refining: seconds that the relaxed problem took.

    Attributes:
        count: rounds so far.
        landmarks: that the next round places.
    """

    def __init__(
        self, query: Query, proofs: Prover, placement: Placement, lattices: LatticeSchedule | None, refining: float
    ) -> None:
        self.query, self.proofs, self.placement, self.lattices = query, proofs, placement, lattices
        self.band: Band = placement.band
        self.count, self.landmarks = 0, query.settings.first_landmarks
        self._refining = refining
        # What is tried for this query alone would hold up others in a roadmap that is large already.
        large = len(query.roadmap) >= query.settings.max_kept_nodes
        self.roadmap = Roadmap(query.checker, query.motion) if large else query.roadmap

    def may_succeed(self) -> bool:
        """Return whether a path is still sought and not proven not to exist."""
        return not self.query.solved and bool(np.isfinite(self.band.shortest)) and not self.proofs.infeasible()

    def run(self) -> None:
        """Place landmarks, round by round, until there is a path, it is proven that there is none, or time is up."""
        query, settings = self.query, self.query.settings
        nodes = self.roadmap.ends(query.ends)
        while self.may_succeed() and query.begin_round("placing landmarks"):
            if len(self.roadmap) > settings.max_query_nodes:
                self.roadmap = Roadmap(query.checker, query.motion)
                nodes = self.roadmap.ends(query.ends)
            if settings.placement != "none":
                self._place_landmarks(nodes)
            elif self.lattices is None or self.lattices.exhausted:
                return
            self.count += 1
            self.landmarks = int(min(self.landmarks * settings.landmark_growth, settings.max_query_nodes))
            if not self.may_succeed():
                return
            query.incumbent.nearest = self._nearest_approach(nodes)
            if self.count % settings.rounds_per_grid == 0:
                # What keeps failing may need a closer look, or be impossible: little else is left to do.
                self.proofs.bound_below(settings.last_proof_share)
                self.proofs.begin_in_background()
                self._refine()
            if self.lattices is not None:
                query.take(self.lattices.first_path())

    def _place_landmarks(self, nodes: NDArray[np.int64]) -> None:
        """Let the roadmap grow by landmarks of all kinds, and search it for a path between two nodes."""
        query, settings = self.query, self.query.settings
        widening = WIDENINGS[self.count] if self.count < len(WIDENINGS) else np.inf
        self.placement.place(self.roadmap, widening, self.landmarks)
        if not self.may_succeed():
            return
        self.placement.search(self.roadmap, nodes)
        if query.motion.moves_anywhere and settings.uses("bridges"):
            self._bridge(nodes)
        if not query.motion.has_lattice and settings.uses("hybrid-astar"):
            self._drive(nodes)

    def _refine(self) -> None:
        """Look at the relaxed problem on cells half as large, if there is time."""
        begin = perf_counter()
        if FINER * self._refining < self.query.seconds_left() and self.band.refine():
            self._refining = perf_counter() - begin

    def _bridge(self, nodes: NDArray[np.int64]) -> None:
        """Place landmarks where the start's and the goal's parts of the roadmap end, while they grow together."""
        query, bridge = self.query, Bridge(self.roadmap, self.band, nodes, self.query.rng)
        while bridge.promising and self.may_succeed() and not query.clock.is_up():
            self.roadmap.add(bridge.landmarks())
            self.placement.search(self.roadmap, nodes)

    def _drive(self, nodes: NDArray[np.int64]) -> None:
        """Drive on from what the start leads to, and towards what leads to the goal, and search again."""
        query, settings, roadmap, band = self.query, self.query.settings, self.roadmap, self.band
        step = settings.longest_drive * query.motion.radius * 0.5**self.count
        most = settings.drives << min(self.count, 6)
        for reverse in (False, True):
            if query.solved or query.clock.is_up():
                return
            query.report("driving")
            band.widen(np.inf)
            reached = np.flatnonzero(roadmap.reached(int(nodes[int(reverse)]), reverse=reverse))
            found = hybrid_astar(
                query.motion,
                band.relaxation,
                band.from_start if reverse else band.to_goal,
                roadmap.configurations[reached],
                reverse=reverse,
                step=step,
                most=most,
                landmarks=settings.drive_landmarks,
                rng=query.rng,
                seconds=query.seconds_left(),
            )
            parents = np.concatenate([reached, len(roadmap) + np.arange(len(found.parents))])[found.parents]
            roadmap.add_tree(found.configurations, parents, reverse=reverse)
            self.placement.search(roadmap, nodes)

    def _nearest_approach(self, nodes: NDArray[np.int64]) -> FloatArray:
        """Return the states of the shortest path from the start to the node, of those reached, nearest to the goal."""
        (start, goal), roadmap, query = nodes.tolist(), self.roadmap, self.query
        q = roadmap.configurations
        reached = np.flatnonzero(roadmap.reached(start))
        last = int(reached[np.argmin(se2.distance(q[reached], q[goal]))])
        states = np.array(q[roadmap.shortest_path(start, last).nodes])
        begin = query.incumbent.start
        return query.motion.whole_states(states, begin, np.array([*states[-1, :2], begin[2]]))


# --- Bridge: landmarks where the parts of a roadmap that start and goal belong to come closest.

MISSES, TRIES = 6, 40
"""Attempts in a row that bring the parts no closer before it is given up; configurations tried at each place."""

CLOSER = 0.95
"""Share of the smallest distance so far that counts as closer."""


class Bridge:
    """Grows the start's and the goal's parts of a roadmap towards each other.

    Args:
        roadmap: without a path yet.
        band: where short paths are likely.
        nodes: of start and goal.
        rng: source of randomness.
    """

    def __init__(self, roadmap: Roadmap, band: Band, nodes: NDArray[np.int64], rng: np.random.Generator) -> None:
        self.roadmap, self.band, self.rng = roadmap, band, rng
        self.start, self.goal = int(nodes[0]), int(nodes[1])
        self._misses, self._nearest = 0, np.full(3, np.inf)

    @property
    def promising(self) -> bool:
        """Whether the parts have come closer lately."""
        return self._misses < MISSES

    def landmarks(self) -> se2.FloatArray:
        """Return valid configurations, shape (n, 3), around the places where the parts might be joined."""
        q, band = self.roadmap.configurations, self.band
        ahead = q[self.roadmap.reached(self.start)]
        behind = q[self.roadmap.reached(self.goal, reverse=True)]
        near, far, gap = self._closest(ahead, behind)
        first, last = band.nearest_to_goal(ahead), band.nearest_to_start(behind)
        apart = np.array([gap, band.costs_to_goal(ahead[[first]])[0], band.costs_to_start(behind[[last]])[0]])
        self._misses = 0 if (apart < CLOSER * self._nearest).any() else self._misses + 1
        self._nearest = np.minimum(self._nearest, apart)
        # Where the two parts come closest, and where each comes closest to its end on the relaxed way: the first
        # tells of gaps in the headings, the others of gaps in the way.
        places = (ahead[near], behind[far], ahead[first], behind[last])
        reach = band.relaxation.size * 2.0 ** self.rng.uniform(0.0, 4.0)
        return np.concatenate([band.samples_near(place, reach, TRIES, self.rng) for place in places])

    def _closest(self, ahead: se2.FloatArray, behind: se2.FloatArray) -> tuple[int, int, float]:
        """Return the indices of the closest pair of two sets of configurations, and their distance (metres)."""
        from scipy.spatial import cKDTree

        one, other = (se2.embed(q, self.roadmap.motion.radius) for q in (ahead, behind))
        pairs = cKDTree(other).query(one)[1]
        gaps = np.linalg.norm(one - other[pairs], axis=1)
        near = int(np.argmin(gaps))
        return near, int(pairs[near]), float(gaps[near])
