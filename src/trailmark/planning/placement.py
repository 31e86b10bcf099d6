"""Landmarks of one query: placed where short paths are likely, in rounds, joined to a roadmap and searched for a path.

Then rounds of improvement: other ways around, and landmarks where better paths might run. And the published landmarks
(:mod:`trailmark.landmarks.paper`) as nodes at which a robot can stand, with paths over them.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError
from trailmark.landmarks import k_means_landmarks, repair_centres
from trailmark.landmarks.band import Band
from trailmark.landmarks.paper import algorithm_2
from trailmark.path import Path
from trailmark.planning.hybrid_astar import Targets, drive_to, hybrid_astar
from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.proofs.prover import Prover
from trailmark.planning.query import PROMISING, Incumbent, Query
from trailmark.planning.verification import Verification
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = [
    "DUPLICATE",
    "LLOYD_STEPS",
    "Placement",
    "Redriving",
    "Rounds",
    "improve",
    "path_over_landmarks",
    "published_landmarks",
]

DUPLICATE = 0.05
"""Shares of the inscribed disc's radius: a landmark nearer than that to a joined node is hardly another place."""

LLOYD_STEPS = 3
"""Of K-means: more move the centres by little."""

WIDENINGS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.5)
"""How much longer than the relaxed shortest path a band's paths may be, round by round; then without limit."""

ROUNDS_PER_GRID = 2
"""Rounds without a path after which the relaxed problem is looked at on cells half as large."""

FINER = 5.0
"""Times as long as before the relaxed problem takes on cells half as large."""

MISSES, TRIES, CLOSER = 6, 40, 0.95
"""Bridges in a row that bring the parts of a roadmap no closer before it is given up; configurations tried at each
place; and the share of the smallest distance so far that counts as closer."""

LONGEST_DRIVE, DRIVE_LANDMARKS = 0.1, 80
"""Turning radii: a car's first drives in a tight place, half as long in each later round; landmarks kept of them."""


class Placement:
    """Places landmarks for one query, in the band where short paths are likely."""

    def __init__(self, query: Query, band: Band) -> None:
        self.query, self.band = query, band
        # What the last landmarks took, seconds each.
        self._seconds = 0.0

    def place(self, roadmap: Roadmap, widening: float, count: int) -> None:
        """Join landmarks to a roadmap, if there is time for it."""
        # The more landmarks, the longer each takes.
        if self._seconds * self.query.settings.landmark_growth * count > self.query.seconds_left():
            return
        begin = perf_counter()
        apart = DUPLICATE * self.query.checker.robot.inscribed_disc.radius
        roadmap.add(roadmap.fresh(self._landmarks(widening, count), apart))
        self._seconds = (perf_counter() - begin) / count

    def _landmarks(self, widening: float, count: int) -> FloatArray:
        """Return so many valid configurations, shape (n, 3), or fewer."""
        query, settings = self.query, self.query.settings
        samples = settings.samples_per_landmark * count
        if settings.placement == "none":
            return np.empty((0, 3))
        if settings.placement == "paper":
            return published_landmarks(query.checker, query.ends[0], samples, count, query.rng)
        widening = widening if settings.uses("bands") else np.inf
        if settings.placement == "samples":
            return self.band.samples(count, widening, query.rng)
        drawn, radius = self.band.samples(samples, widening, query.rng), query.motion.radius
        return k_means_landmarks(drawn, count, radius=radius, steps=LLOYD_STEPS, random_state=query.rng)

    def widening(self) -> float:
        """Return how much longer than the relaxed shortest path the paths may be that better the best one."""
        longest = float(self.query.motion.longest(self.query.incumbent.cost))
        return max(0.02, longest / max(self.band.shortest, 1e-9) - 1.0)

    def search(self, roadmap: Roadmap, nodes: NDArray[np.int64], banned: NDArray[np.bool_] | None = None) -> None:
        """Submit a roadmap's shortest path between two nodes; one without banned ones, (n,), whatever it costs."""
        query, (start, goal) = self.query, nodes.tolist()
        to_go = roadmap.distances_to(goal)
        if not query.solved:
            # The relaxed problem leads to a first path soon; it may overestimate, so what betters one goes without.
            to_go = np.maximum(to_go, self.band.costs_to_goal(roadmap.configurations))
        limit = query.incumbent.cost if banned is None else np.inf
        found = roadmap.shortest_path(
            start, goal, to_go=to_go, banned=banned, limit=limit, seconds=query.seconds_left()
        )
        query.submit(roadmap.configurations[found.nodes])


class Rounds:
    """Looks for a first path by landmarks: each round draws from a wider band and places more of them.

    Attributes:
        count: rounds so far.
        landmarks: that the next round places.
    """

    def __init__(
        self, query: Query, proofs: Prover, placement: Placement, lattices: LatticeSchedule | None, refining: float
    ) -> None:
        self.query, self.proofs, self.placement, self.lattices = query, proofs, placement, lattices
        self.band = placement.band
        self.count, self.landmarks = 0, query.settings.first_landmarks
        self._refining = refining

    def may_succeed(self) -> bool:
        """Return whether a path is still sought and not proven not to exist."""
        return not self.query.solved and bool(np.isfinite(self.band.shortest)) and not self.proofs.infeasible()

    def run(self) -> None:
        """Place landmarks, round by round, until there is a path, it is proven that there is none, or time is up."""
        query, settings = self.query, self.query.settings
        if not self.may_succeed():
            return
        # What is tried for this query alone would hold up others in a roadmap that is large already.
        large = len(query.roadmap) >= settings.max_kept_nodes
        roadmap = Roadmap(query.checker, query.motion) if large else query.roadmap
        nodes = roadmap.ends(query.ends)
        while self.may_succeed() and query.begin_round("placing landmarks"):
            if len(roadmap) > settings.max_query_nodes:
                roadmap = Roadmap(query.checker, query.motion)
                nodes = roadmap.ends(query.ends)
            if settings.placement != "none":
                self._place_landmarks(roadmap, nodes)
            elif self.lattices is None or self.lattices.exhausted:
                return
            self.count += 1
            self.landmarks = int(min(self.landmarks * settings.landmark_growth, settings.max_query_nodes))
            if not self.may_succeed():
                return
            query.incumbent.nearest = _nearest_approach(query, roadmap, nodes)
            if self.count % ROUNDS_PER_GRID == 0:
                # What keeps failing may need a closer look, or be impossible: little else is left to do.
                self.proofs.bound_below(settings.last_proof_share)
                self.proofs.begin_in_background()
                begin = perf_counter()
                if FINER * self._refining < query.seconds_left() and self.band.refine():
                    self._refining = perf_counter() - begin
            if self.lattices is not None:
                query.submit(self.lattices.first_path())

    def _place_landmarks(self, roadmap: Roadmap, nodes: NDArray[np.int64]) -> None:
        """Let the roadmap grow by landmarks, a car's by drives too, and search it for a path between two nodes."""
        query = self.query
        widening = WIDENINGS[self.count] if self.count < len(WIDENINGS) else np.inf
        self.placement.place(roadmap, widening, self.landmarks)
        if self.may_succeed():
            self.placement.search(roadmap, nodes)
        if query.motion.moves_anywhere and query.settings.uses("bridges"):
            self._bridge(roadmap, nodes)
        if not query.motion.has_lattice and query.settings.uses("hybrid-astar"):
            for reverse in (False, True):
                if self.may_succeed() and not query.budget.is_up():
                    self._drive(roadmap, nodes, reverse=reverse)

    def _bridge(self, roadmap: Roadmap, nodes: NDArray[np.int64]) -> None:
        """Place landmarks where the start's and the goal's parts of the roadmap end, while they grow together."""
        from scipy.spatial import cKDTree

        query, band, (start, goal) = self.query, self.band, nodes.tolist()
        nearest, misses = np.full(3, np.inf), 0
        while misses < MISSES and self.may_succeed() and not query.budget.is_up():
            q = roadmap.configurations
            ahead, behind = q[roadmap.reached(start)], q[roadmap.reached(goal, reverse=True)]
            one, other = (se2.embed(part, query.motion.radius) for part in (ahead, behind))
            pairs = np.asarray(cKDTree(other).query(one)[1])
            gaps = np.linalg.norm(one - other[pairs], axis=1)
            near, first, last = int(np.argmin(gaps)), band.nearest_to_goal(ahead), band.nearest_to_start(behind)
            apart = np.array(
                [gaps[near], band.costs_to_goal(ahead[[first]])[0], band.costs_to_start(behind[[last]])[0]]
            )
            misses = 0 if (apart < CLOSER * nearest).any() else misses + 1
            nearest = np.minimum(nearest, apart)
            # Where the parts come closest to one another, and to their ends on the relaxed way: the first tells of gaps
            # in the headings, the others of gaps in the way.
            places = (ahead[near], behind[pairs[near]], ahead[first], behind[last])
            reach = band.relaxation.size * 2.0 ** query.rng.uniform(0.0, 4.0)
            roadmap.add(np.concatenate([band.samples_near(place, reach, TRIES, query.rng) for place in places]))
            self.placement.search(roadmap, nodes)

    def _drive(self, roadmap: Roadmap, nodes: NDArray[np.int64], *, reverse: bool) -> None:
        """Drive on from what the start leads to, or towards what leads to the goal, and search again."""
        query, band = self.query, self.band
        query.report("driving")
        band.widen(np.inf)
        reached = np.flatnonzero(roadmap.reached(int(nodes[int(reverse)]), reverse=reverse))
        found = hybrid_astar(
            query.motion,
            band.relaxation,
            band.from_start if reverse else band.to_goal,
            roadmap.configurations[reached],
            reverse=reverse,
            step=LONGEST_DRIVE * query.motion.radius * 0.5**self.count,
            most=query.settings.drives << min(self.count, 6),
            landmarks=DRIVE_LANDMARKS,
            rng=query.rng,
            seconds=query.seconds_left(),
        )
        parents = np.concatenate([reached, len(roadmap) + np.arange(len(found.parents))])[found.parents]
        roadmap.add_tree(found.configurations, parents, reverse=reverse)
        self.placement.search(roadmap, nodes)


def _nearest_approach(query: Query, roadmap: Roadmap, nodes: NDArray[np.int64]) -> FloatArray:
    """Return the states of the shortest path from the start to the node, of those reached, nearest to the goal."""
    start, goal = nodes.tolist()
    q = roadmap.configurations
    reached = np.flatnonzero(roadmap.reached(start))
    last = int(reached[np.argmin(se2.distance(q[reached], q[goal]))])
    states, begin = np.array(q[roadmap.shortest_path(start, last).nodes]), query.incumbent.start
    return query.motion.whole_states(states, begin, np.array([*states[-1, :2], begin[2]]))


def improve(query: Query, placement: Placement, lattices: LatticeSchedule | None, landmarks: int) -> None:
    """Better the best path until it is settled, proven to be good enough, or the time is up.

    This goes on in a roadmap of its own, so that the planner's stays small enough for many queries.
    """
    settings, incumbent = query.settings, query.incumbent
    roadmap = Roadmap(query.checker, query.motion)
    nodes = roadmap.add(query.ends)
    redriving = Redriving(query, placement.band) if query.motion.charged and settings.uses("redriving") else None
    on_best, without_gain = np.zeros(0, dtype=np.int64), 0
    while without_gain < settings.patience and not query.close_enough and query.begin_round("improving"):
        before = incumbent.cost
        if redriving is not None:
            redriving.run()
        if lattices is not None and settings.uses("other-ways"):
            # What such a path passes joins the roadmap: parts of it may be better.
            other = lattices.other_path(query.rng, incumbent.cost)
            if len(other):
                other = query.shortened(other, settings.first_sweeps)
                roadmap.add_path(other)
                if query.motion.cost_of(other) < PROMISING * incumbent.cost:
                    query.offer(query.shortened(other))
        placement.place(roadmap, placement.widening(), landmarks)
        # Once without the best path's own vertices, for the other ways around the obstacles ...
        banned = np.zeros(len(roadmap), dtype=np.bool_)
        banned[on_best] = True
        placement.search(roadmap, nodes, banned)
        # ... and once with them, for what can be put together from both.
        if incumbent.states is not None and not query.budget.is_up():
            on_best = np.concatenate([on_best, roadmap.add_path(incumbent.states)[1:-1]])
            placement.search(roadmap, nodes)
        if incumbent.states is not None and not query.budget.is_up():
            query.offer(query.shortened(incumbent.states, settings.polishing_sweeps, splitting=True))
        without_gain = without_gain + 1 if before - incumbent.cost < settings.least_gain * before else 0


def published_landmarks(
    checker: StateChecker, start: FloatArray, points: int, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return Algorithm 2's landmarks, each at its widest heading, shape (k, 3); (0, 3) if it finds no free points.

    The world is known here, so the obstacles' boxes are those of their true outlines. A centre at which the robot
    cannot stand gives way to the nearest point at which it can.

    Args:
        checker: world and robot.
        start: where the robot begins, shape (3,); what boxes enclose, seen from there, is left out.
        points: drawn.
        count: landmarks.
        rng: source of randomness.
    """
    corners = [np.reshape(shape.bounding_box(), (2, 2)) for shape in checker.world.obstacles]
    try:
        found = algorithm_2(corners, checker.world.bounds, points, count, random_state=rng, robot=start[:2])
        return repair_centres(checker, found.centres, found.samples[~found.forbidden]).configurations
    except ConfigurationError:
        # Boxes cover nearly all, or the robot can stand at none of the points.
        return np.empty((0, 3))


def path_over_landmarks(
    checker: StateChecker, landmarks: FloatArray, start: ArrayLike, goal: ArrayLike, *, seed: int = 0
) -> tuple[Roadmap, Path | None]:
    """Return the roadmap of landmarks, start and goal, and its shortest path; None if no certified edges lead there.

    Each node is joined to its nearest neighbours, as many as PRM* asks for. The path is neither shortened nor improved.

    Args:
        checker: world and robot.
        landmarks: valid configurations, shape (k, 3).
        start: shape (3,).
        goal: shape (3,).
        seed: named in the report of an error.

    Raises:
        ConfigurationError: start or goal is not valid.
    """
    ends = np.array([checker.require_valid(q, name) for q, name in ((start, "start"), (goal, "goal"))])
    roadmap = Roadmap(checker)
    roadmap.add(landmarks)
    nodes = roadmap.ends(roadmap.motion.ends(*ends)).tolist()
    roadmap.certify_all()
    found = roadmap.shortest_path(*nodes).nodes
    incumbent = Incumbent(roadmap.motion, ends[0], ends[1], perf_counter())
    if len(found):
        incumbent.offer(roadmap.configurations[found])
    path = incumbent.path()
    if path is not None and not Verification(checker, roadmap.motion, seed).certified(path, ends):
        path = None
    return roadmap, path


# --- Redriving: a car's path with fewer changes of direction, by hybrid A* from its tight end to the path itself.

CELLS, STEP, NODES = 0.25, 0.07, 32
"""Edge of a cell as a share of the longest drive: where little room is left, what a change gains is a few cells;
turning radii of the first drives, half as long from the second time on; and times as many configurations reached at
most as settings have for drives."""

LEVELS = 2
"""Runs, each with drives half as long as the one before; then about as long as in the last one."""

SHORTENED = 2
"""Times that what drives lead to is shortened: chance decides which changes of direction go."""


class Redriving:
    """Drives from one end of the best path to its other states, at first each time in smaller steps.

    Args:
        query: with a path of a car.
        band: of the query.
    """

    def __init__(self, query: Query, band: Band) -> None:
        self.query, self.band = query, band
        self._rounds = self._runs = 0

    def run(self) -> None:
        """Offer what the best drives make of the path, from the end with more changes of direction beside it.

        In rounds 1, 2, 4, 8, ... of improvement: it takes longer than all else does in one.
        """
        query, motion, states = self.query, self.query.motion, self.query.incumbent.states
        path = None if states is None else motion.path(states)
        if states is None or not isinstance(path, CurvePath) or path.cusps < 2:
            return
        self._rounds += 1
        if self._rounds & (self._rounds - 1):
            return
        signed = path.curves.signed_lengths
        pieces = signed[signed != 0.0]
        changes = np.diff(np.sign(pieces)) != 0.0
        # On the mean, where along the path they are.
        reverse = bool(np.cumsum(np.abs(pieces))[:-1][changes].mean() >= 0.5 * path.length)
        inner = range(len(states) - 1) if reverse else range(1, len(states))
        beyond = [states[: k + 1] if reverse else states[k:] for k in inner]
        rows = [signed[max(k - 1, 0)][::-1] if reverse else signed[min(k, len(signed) - 1)] for k in inner]
        first = [
            np.sign(row[row != 0.0][:1]).sum() if len(part) > 1 else 0.0 for row, part in zip(rows, beyond, strict=True)
        ]
        targets = Targets(states[list(inner)], np.array([motion.cost_of(part) for part in beyond]), np.array(first))
        self.band.widen(np.inf)
        level = min(self._runs, LEVELS - 1)
        step = STEP * motion.radius * 0.5**level
        if self._runs >= LEVELS:
            # Other cells and other drives.
            step *= query.rng.uniform(0.7, 1.3)
        self._runs += 1
        knots, target = drive_to(
            motion,
            self.band.relaxation,
            self.band.from_start if reverse else self.band.to_goal,
            states[-1] if reverse else states[0],
            targets,
            reverse=reverse,
            step=step,
            cell=CELLS * step,
            most=NODES * query.settings.drives >> 2 * (LEVELS - 1 - level),
            limit=query.incumbent.cost,
            seconds=query.seconds_left(),
        )
        if target < 0:
            return
        rest = beyond[target]
        found = np.concatenate([rest[:-1], knots] if reverse else [knots, rest[1:]])
        if motion.motions_between_valid(found[:-1], found[1:]).all():
            for _ in range(SHORTENED):
                query.offer(query.shortened(found))
