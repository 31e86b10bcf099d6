"""The stages of one query, in the order of docs/explanation/method.md, and the check of what they find."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np
import shapely
from numpy.typing import ArrayLike

from trailmark.collision.certify import BUDGET
from trailmark.landmarks.band import Band
from trailmark.motion import TranslationMotion
from trailmark.planning.grid_path import shortest_grid_path
from trailmark.planning.incumbent import Budget, OnProgress, vertices_of
from trailmark.planning.lattice_schedule import AT_FIRST, AT_MOST, AT_SECOND, LatticeSchedule
from trailmark.planning.model import Passed, WorldModel
from trailmark.planning.placement import Placement, Rounds, improve
from trailmark.planning.prover import Prover
from trailmark.planning.query import Query
from trailmark.planning.result import PlanResult, Status
from trailmark.planning.shortening import with_fewer_vertices, without_needless
from trailmark.proofs import LowerBound
from trailmark.proofs.background import in_time
from trailmark.proofs.mesh import shortest_point_path, triangulated
from trailmark.proofs.region import Stop, ellipse, free_region
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["FIRST_BUDGET", "ORDER", "RoadmapLookup", "Stages", "disc_path", "known_path", "plan_single", "solve"]

TRIES = 3
"""Attempts at a query, should the paths that are found not pass the final check."""

SHORT = 200
"""Cells of a relaxed path up to which it counts as short: a close look at each costs less than larger lattices."""

RELAXING = 2e-6
"""Seconds for each cell of the relaxed problem, rather too many."""

PROOF_SHARE = 0.25
"""Of the time left that a proof may be expected to take while much else is left to do."""

PROOF_WAIT = 3.0
"""Times the time that a query has taken so far, for which a proof of infeasibility comes first once that is likely."""

WORTH_SHORTENING = 1.3
"""Times the best path's cost up to which one of the roadmap, which is not shortened, is worth it."""

FEWER_COST = 0.01
"""By which share a part of a path may cost more if vertices are left out, where it costs more near obstacles."""

ABOUT_AS_GOOD = 1.03
"""Times the best path's cost up to which a path that the planner's own roadmap knows is about as good."""


def plan_single(
    model: WorldModel,
    start: ArrayLike,
    goal: ArrayLike,
    budget: Budget,
    *,
    on_progress: OnProgress | None = None,
    known: FloatArray | None = None,
) -> PlanResult:
    """Return the answer to a query from one configuration to another; the caller holds the lock of the roadmap.

    Raises:
        ConfigurationError: start or goal is not valid.
    """
    ends, shared = model.valid_pair(start, goal), model.shared
    if shared.to_place > 0:
        later = (1.0 - model.settings.build_share) * budget.limit
        shared.place(shared.to_place, lambda: budget.seconds_left() - later)
    told = None if on_progress is None else model.verification.progress(on_progress, ends)
    for _ in range(TRIES):
        query = Query(model, ends, budget, told)
        status = solve(query, model.bound, known)
        path = query.incumbent.path()
        if path is None or model.verification.certified(path, ends):
            break
        # Whatever is wrong may be in the roadmap, or in what was known.
        shared.reset()
        status, path, known = "timeout", None, None
    build, shared.build_seconds = shared.build_seconds, 0.0
    if path is not None:
        model.passed = Passed(vertices_of(model.motion, path), model.checker)
    return model.verification.result(query.incumbent, status, path, shared.roadmap, build)


def solve(query: Query, bound: LowerBound | None, known: FloatArray | None = None) -> Status:
    """Lead a query through the stages, until one of them ends it or its path is good enough; return its status."""
    with Prover(query, bound) as proofs:
        stages = Stages(query, proofs, known)
        for name, stage in ORDER:
            if (not name or query.settings.uses(name)) and (stage(stages) or query.close_enough):
                break
        return stages.conclude()


class Stages:
    """The stages of one query; each returns whether nothing is left to do after it."""

    def __init__(self, query: Query, proofs: Prover, known: FloatArray | None) -> None:
        self.query, self.proofs, self.given = query, proofs, known
        self.lookup = RoadmapLookup(query.roadmap, *query.ends)
        self.lattices: LatticeSchedule | None = None
        # A lattice's steps are not a car's.
        if query.motion.has_lattice and query.settings.uses("lattice"):
            self.lattices = LatticeSchedule(
                query.motion, query.ends, query.relaxation.size, query.seconds_left, query.settings.without
            )
        self.rounds: Rounds | None = None
        self.known = self.exact = False

    def direct(self) -> bool:
        """Take the direct motion: mostly nothing is cheaper."""
        query = self.query
        if query.motion.motions_between_valid(query.ends[:1], query.ends[1:])[0]:
            query.submit(query.ends)
            if query.motion.direct_is_best or query.incumbent.optimal:
                query.roadmap_cost = query.incumbent.cost
                return True
        if self.given is not None:
            query.submit(self.given)
        return False

    def roadmap(self) -> bool:
        """Take what the roadmap of earlier queries knows over edges that are certified already."""
        self.query.submit_known(self.lookup.search_free_edges())
        self.known = self.query.solved
        return False

    def smallest_lattice(self) -> bool:
        """Search the smallest lattice: in a large grid map a first path comes long before the shortest."""
        if not self.known:
            self._search_lattices(1)
        return False

    def grid_path(self) -> bool:
        """Find a disc's shortest path in a grid map, and prove that it is."""
        bound = self.proofs.bound
        self.exact = bound is not None and shortest_grid_path(self.query, bound.tangents)
        return self.exact

    def lattices_first(self) -> bool:
        """Search lattices of several resolutions, from both ends: most first paths come from here."""
        if not self.query.solved and self.lattices is not None:
            self.query.report("looking for a first path")
            self._search_lattices(AT_FIRST - 1)
        return False

    def relaxed_problem(self) -> bool:
        """Route the largest inscribed disc over a grid, which says where short paths are likely, or that none is."""
        query = self.query
        needed = RELAXING * query.relaxation.rows * query.relaxation.columns
        if query.seconds_left() <= needed:
            if self.lattices is not None:
                self._search_lattices(AT_MOST - self.lattices.level)
            # Without a path, and with time for nothing else, it is looked at all the same if the limit allows for it.
            if query.solved or query.budget.is_up() or needed > query.budget.limit:
                return True
        begin = perf_counter()
        band = Band(query.checker, query.relaxation, *query.ends)
        self.rounds = Rounds(query, self.proofs, Placement(query, band), self.lattices, perf_counter() - begin)
        return False

    def closer_look(self) -> bool:
        """Look for a first path without landmarks: over finer lattices on a long way, and a disc's shortest path."""
        query, proofs, rounds = self.query, self.proofs, self._rounds()
        if not rounds.may_succeed():
            return False
        far = self.lattices is not None and rounds.band.shortest > SHORT * rounds.band.relaxation.size
        if far:
            proofs.begin_in_background()
            self._search_lattices(AT_SECOND - AT_FIRST)
        if not query.solved and not proofs.in_background:
            # What a disc proves, the proof with headings that has begun mostly proves sooner.
            proofs.bound_below(PROOF_SHARE)
        if far and rounds.may_succeed():
            self._search_lattices(AT_MOST - AT_SECOND)
        if rounds.may_succeed():
            self._offer_disc_path()
        if not query.solved:
            query.submit_known(self.lookup.search(BEFORE_LANDMARKS))
        return False

    def landmarks(self) -> bool:
        """Place landmarks in rounds until there is a path."""
        self._rounds().run()
        return False

    def bounds(self) -> bool:
        """Prove what can be: that there is no path, or how much one costs at least."""
        query, band = self.query, self._rounds().band
        self.proofs.conclude(band)
        if not query.solved:
            return True
        if not np.isfinite(band.shortest):
            # The grid claims that there is no path, which is thereby refuted; it is no guide.
            query.incumbent.raise_bound(np.inf)
            return True
        self.proofs.bound_below(PROOF_SHARE)
        return False

    def consult_roadmap(self) -> bool:
        """See whether the roadmap of earlier queries knows a path about as good; let it grow if it knows none."""
        query, rounds = self.query, self._rounds()
        if self.known or rounds.count:
            return False
        # A path of the roadmap may cost more at first, since it is shortened.
        limit = WORTH_SHORTENING * query.incumbent.cost
        query.submit_known(self.lookup.search_for_better(limit, query.seconds_left()))
        room = len(query.roadmap) < query.settings.max_kept_nodes
        if query.roadmap_cost == np.inf and self.lookup.complete and room and not query.budget.is_up():
            placement = rounds.placement
            placement.place(query.roadmap, placement.widening(), query.settings.first_landmarks)
        return False

    def improvement(self) -> bool:
        """Better the path: a disc's is computed, others by further rounds until it settles; then bound its cost."""
        query, rounds = self.query, self._rounds()
        if not self._offer_disc_path() and query.settings.uses("improvement"):
            improve(query, rounds.placement, self.lattices, rounds.landmarks)
        self.proofs.bound_below(query.settings.last_proof_share)
        return True

    def conclude(self) -> Status:
        """Return the status; leave out needless vertices, and have the roadmap learn what it did not know.

        A path along tangents is taken as it is; with more vertices than it keeps, the roadmap does not learn it.
        """
        query, incumbent = self.query, self.query.incumbent
        if incumbent.states is None:
            return "infeasible" if incumbent.infeasible else "timeout"
        if not self.exact:
            fewer = np.asarray(without_needless(query.motion.kind, incumbent.states, BUDGET))
            query.offer(fewer)
            objective = query.motion.objective
            if objective is not None and objective.clearance > 0.0:
                # On ground that is slightly cheaper beside every line, no vertex is quite needless.
                fewer = with_fewer_vertices(query.motion, fewer, FEWER_COST)
                incumbent.cost = max(incumbent.cost, query.motion.cost_of(fewer))
            incumbent.states = fewer
        # Once it is large, it only learns paths where it knows none at all.
        unknown = query.roadmap_cost == np.inf and self.lookup.complete
        most = query.settings.max_kept_nodes
        wanted = (len(query.roadmap) < most or unknown) and len(incumbent.states) <= most
        if query.roadmap_cost > ABOUT_AS_GOOD * incumbent.cost and wanted:
            query.roadmap.add_path(incumbent.states)
        return "solved"

    def _rounds(self) -> Rounds:
        assert self.rounds is not None  # noqa: S101  # stages after the relaxed problem
        return self.rounds

    def _search_lattices(self, levels: int) -> None:
        """Look for a first path over lattices, level by level, and over the planner's own roadmap beside them."""
        query, proofs, lattices = self.query, self.proofs, self.lattices
        for _ in range(levels if lattices is not None else 0):
            if lattices is None or query.solved or query.budget.is_up() or proofs.infeasible():
                return
            query.submit(lattices.first_path())
            if not query.solved:
                query.submit_known(self.lookup.search(int(BESIDE * lattices.expanded)))
            if lattices.search_exhausted and not query.solved:
                proofs.wait(PROOF_WAIT * (perf_counter() - query.budget.begin))

    def _offer_disc_path(self) -> bool:
        """Offer the shortest path of a disc; return False if there is no time for it, or none is found."""
        query, proofs = self.query, self.proofs
        wanted = query.settings.uses("disc-path") and not query.close_enough and proofs.bound is not None
        if not (wanted and isinstance(query.motion, TranslationMotion)) or query.motion.weighted:
            return False
        query.report("cutting free space into triangles")
        radius, (start, goal) = query.checker.robot.inscribed_disc.radius, query.ends[:, :2]
        world, most = query.checker.world, query.incumbent.cost
        seconds = DISC_PATH_SHARE * query.seconds_left()
        bends = in_time(seconds, lambda stop: disc_path(world, radius, start, goal, most, stop))
        if bends is None:
            return False
        states = np.column_stack([bends, np.zeros(len(bends))])
        if len(bends) == 0 or not query.motion.motions_between_valid(states[:-1], states[1:]).all():
            return False
        query.offer(states)
        query.offer(query.shortened(states))
        return True


ORDER: tuple[tuple[str, Callable[[Stages], bool]], ...] = (
    ("", Stages.direct),
    ("roadmap", Stages.roadmap),
    ("lattice", Stages.smallest_lattice),
    ("disc-path", Stages.grid_path),
    ("lattice", Stages.lattices_first),
    ("", Stages.relaxed_problem),
    ("", Stages.closer_look),
    ("landmarks", Stages.landmarks),
    ("", Stages.bounds),
    ("roadmap", Stages.consult_roadmap),
    ("", Stages.improvement),
)
"""The stages, by the names under which settings leave them out (:data:`trailmark.planning.settings.STAGES`); those
without a name belong to every query."""


# --- What the planner's own roadmap knows of a query, within a share of what the other searches take.

FIRST_BUDGET = 128
"""Nodes expanded before all other searches, over edges known to be free: takes less time than the first lattice."""

BESIDE, REPEAT = 0.5, 2.0
"""Of what the other searches expanded, what may be expanded beside them; a search that this has ended begins again with
so many times as much."""

WEIGHT = 1.5
"""Of the lower bound in the search: a first path may cost so many times the roadmap's shortest."""

BEFORE_LANDMARKS = 1_000
"""Nodes and edges expanded before landmarks are placed."""

LAST_BUDGET, LAST_SHARE, LAST_NEIGHBOURS = 20_000, 0.05, 64
"""For a better path: nodes and edges expanded at most, the share of the time left, and nodes tried near an end."""

NONE = np.empty((0, 3))


def known_path(roadmap: Roadmap, ends: FloatArray) -> FloatArray:
    """Return a path between ends, (2, 3), over edges known to be free, shape (n, 3); (0, 3) if none is found soon."""
    return RoadmapLookup(roadmap, *ends).search_free_edges()


class RoadmapLookup:
    """Searches a roadmap for a query's path, shape (n, 3), (0, 3) if none is found; adds nothing to it.

    Attributes:
        expanded: motions, nodes and undecided edges so far.
        complete: whether all is known that can be: a path was found, or the roadmap has none.
    """

    def __init__(self, roadmap: Roadmap, start: FloatArray, goal: FloatArray) -> None:
        self.roadmap, self.start, self.goal = roadmap, start, goal
        self.expanded = self._last_budget = 0
        self.complete = len(roadmap) == 0

    def search_free_edges(self) -> FloatArray:
        """Search over edges known to be free, a little."""
        return NONE if self.complete else self._find(weight=WEIGHT, budget=FIRST_BUDGET, checking=False)

    def search(self, budget: int) -> FloatArray:
        """Search over all edges, until so many nodes and edges were expanded in all."""
        left = budget - self.expanded
        if self.complete or left <= REPEAT * self._last_budget:
            return NONE
        self._last_budget = left
        return self._find(weight=WEIGHT, budget=left)

    def search_for_better(self, limit: float, seconds_left: float) -> FloatArray:
        """Search for a path that costs ``limit`` (metres) at most, in a share of the time left."""
        if len(self.roadmap) == 0 or seconds_left <= 0.0:
            return NONE
        seconds = LAST_SHARE * seconds_left
        return self._find(limit=limit, budget=LAST_BUDGET, seconds=seconds, neighbours=LAST_NEIGHBOURS)

    def _find(self, **options: float) -> FloatArray:
        found = self.roadmap.find_path(self.start, self.goal, **options)  # type: ignore[arg-type]  # each of its kind
        self.expanded, self.complete = self.expanded + found.expanded, found.complete
        return found.states


# --- The shortest path of a disc, exact but for the chords that stand for round corners.

DISC_PATH_SHARE = 0.5
"""Of the time left that it may take."""

SPARE = 3e-3
"""Share of its radius by which the disc is made larger: a motion along contact itself would take forever to certify."""


def disc_path(
    world: World,
    radius: float,
    start: FloatArray,
    goal: FloatArray,
    most: float,
    stop: Stop | None = None,
) -> FloatArray:
    """Return the bends of a disc's shortest path, shape (k, 2), metres; (0, 2) if none is found.

    The obstacles are grown by the radius, with corners cut from outside, so that the disc is free all along. It errs on
    the safe side: a way through a gap hardly wider than the disc, or from a place in contact, may be missed.

    Source: Cui, Harabor & Grastien, "Compromise-free pathfinding on a navigation mesh", IJCAI 2017.
    """
    within = ellipse(start, goal, most) if np.isfinite(most) else shapely.box(*world.bounds)
    try:
        region = free_region(world, (1.0 + SPARE) * radius, within, inner=True, stop=stop)
    except (shapely.errors.GEOSException, TimeoutError):
        return np.empty((0, 2))
    for part in shapely.get_parts(region):
        if shapely.intersects_xy(part, [start[0], goal[0]], [start[1], goal[1]]).all():
            mesh = triangulated(part)
            length, path = (np.inf, np.empty((0, 2))) if mesh is None else shortest_point_path(mesh, start, goal)
            return path if np.isfinite(length) else np.empty((0, 2))
    return np.empty((0, 2))
