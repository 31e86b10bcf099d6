"""Solve: how one query is answered. It reads as docs/explanation/method.md does."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from trailmark.collision.certify import BUDGET
from trailmark.landmarks.band import Band
from trailmark.planning.disc_path import shortest_disc_path
from trailmark.planning.grids.grid_path import shortest_grid_path
from trailmark.planning.improvement import improve
from trailmark.planning.lattice.schedule import AT_FIRST, AT_MOST, AT_SECOND, LatticeSchedule
from trailmark.planning.placement import Placement
from trailmark.planning.proofs import LowerBound
from trailmark.planning.proofs.prover import Prover
from trailmark.planning.query import Query
from trailmark.planning.result import Status
from trailmark.planning.roadmap_lookup import RoadmapLookup
from trailmark.planning.rounds import Rounds
from trailmark.planning.shortening import without_needless
from trailmark.se2 import FloatArray

__all__ = ["answer", "consult_roadmap", "search_closely", "search_lattices", "solve", "time_for_relaxed_problem"]


def solve(query: Query, bound: LowerBound | None, known_path: FloatArray | None = None) -> Status:
    """Answer a query; its incumbent holds the path and what is proven.

    Args:
        query: with valid ends.
        bound: proves lower bounds; None proves none.
        known_path: states, shape (n, 3), of a path of certified motions to begin with.
    """
    lookup = RoadmapLookup(query.roadmap, *query.ends)
    lattices = None
    if query.motion.has_lattice and query.settings.uses("lattice"):
        # A lattice's steps are not a car's.
        lattices = LatticeSchedule(
            query.motion, query.ends, query.relaxation.size, query.seconds_left, query.settings.without
        )
    query.expanded = lambda: lookup.expanded + (0 if lattices is None else lattices.expanded)
    with Prover(query, bound) as proofs:
        if query.motion.motions_between_valid(query.ends[:1], query.ends[1:])[0]:
            query.take(query.ends)
            if query.motion.direct_is_best or query.incumbent.optimal:
                query.known_cost = query.incumbent.cost
                return answer(query, lookup)
        if known_path is not None:
            query.take(known_path)
        query.take_known(lookup.search_free_edges())
        known = query.solved
        if not known and lattices is not None:
            # The smallest search of all: in a large grid map a first path comes long before the shortest.
            search_lattices(lattices, 1, query, lookup, proofs)
        if bound is not None and shortest_grid_path(query, bound.tangents):
            return answer(query, lookup, needless=False)
        if not query.solved and lattices is not None:
            query.report("looking for a first path")
            search_lattices(lattices, AT_FIRST - 1, query, lookup, proofs)
        if not time_for_relaxed_problem(query, lattices, lookup, proofs):
            return answer(query, lookup)
        begin = perf_counter()
        band = Band(query.checker, query.relaxation, *query.ends)
        taken = perf_counter() - begin
        placement = Placement(query, band)
        rounds = Rounds(query, proofs, placement, lattices, taken)
        if rounds.may_succeed():
            search_closely(query, rounds, lattices, lookup, proofs)
            rounds.run()
        proofs.conclude(band)
        if not query.solved:
            return answer(query, lookup)
        if not np.isfinite(band.shortest):
            # The grid claims that there is no path, which is thereby refuted; it is no guide.
            query.incumbent.claim(np.inf)
            return answer(query, lookup)
        settings = query.settings
        proofs.bound_below(settings.proof_share)
        if not (known or rounds.count or query.close_enough):
            consult_roadmap(query, lookup, placement)
        if not shortest_disc_path(query, proofs) and settings.uses("improvement"):
            improve(query, placement, lattices, rounds.landmarks)
        proofs.bound_below(settings.last_proof_share)
        return answer(query, lookup)


# --- The steps of :mod:`trailmark.planning.solve` that take more than a line.

SHORT = 200
"""Cells of a relaxed path up to which it counts as short: a close look at each costs less than larger lattices."""

RELAXING = 2e-6
"""Seconds for each cell of the relaxed problem, rather too many."""

PROOF_WAIT = 3.0
"""Times the time that a query has taken so far, for which a proof of infeasibility comes first once that is likely."""

ABOUT_AS_GOOD = 1.03
"""Times the best path's cost up to which a path that the planner's own roadmap knows is about as good."""


def search_lattices(
    lattices: LatticeSchedule, levels: int, query: Query, lookup: RoadmapLookup, proofs: Prover
) -> None:
    """Look for a first path over lattices, level by level, and over the planner's own roadmap beside them."""
    for _ in range(levels):
        if query.solved or query.clock.is_up() or proofs.infeasible():
            return
        query.take(lattices.first_path())
        if not query.solved:
            query.take_known(lookup.search_beside(lattices.expanded))
        if lattices.shut_in and not query.solved:
            proofs.wait(PROOF_WAIT * (perf_counter() - query.clock.begin))


def time_for_relaxed_problem(
    query: Query, lattices: LatticeSchedule | None, lookup: RoadmapLookup, proofs: Prover
) -> bool:
    """Return whether there is time to look at the relaxed problem; spend it on other lattices if not."""
    needed = RELAXING * query.relaxation.rows * query.relaxation.columns
    if query.seconds_left() > needed:
        return True
    if lattices is not None:
        search_lattices(lattices, AT_MOST - lattices.level, query, lookup, proofs)
    # Without a path, and with time for nothing else, it is looked at all the same if the limit allows for it.
    return not query.solved and not query.clock.is_up() and needed <= query.clock.limit


def search_closely(
    query: Query, rounds: Rounds, lattices: LatticeSchedule | None, lookup: RoadmapLookup, proofs: Prover
) -> None:
    """Look for a first path without landmarks: over finer lattices on a long way, and where a disc's shortest is."""
    far = lattices is not None and rounds.band.shortest > SHORT * rounds.band.relaxation.size
    if far and lattices is not None:
        proofs.begin_in_background()
        search_lattices(lattices, AT_SECOND - AT_FIRST, query, lookup, proofs)
    if not query.solved and not proofs.in_background:
        # What a disc proves, the proof with headings that has begun mostly proves sooner.
        proofs.bound_below(query.settings.proof_share)
    if far and lattices is not None and rounds.may_succeed():
        search_lattices(lattices, AT_MOST - AT_SECOND, query, lookup, proofs)
    if rounds.may_succeed():
        shortest_disc_path(query, proofs)
    if not query.solved:
        query.take_known(lookup.search_before_landmarks())


def consult_roadmap(query: Query, lookup: RoadmapLookup, placement: Placement) -> None:
    """See whether the planner's own roadmap knows a path about as good; let it grow there if it knows none at all."""
    # A path of the roadmap may cost more at first, since it is shortened.
    limit = query.settings.worth_shortening * query.incumbent.cost
    query.take_known(lookup.search_for_better(limit, query.seconds_left()))
    room = len(query.roadmap) < query.settings.max_kept_nodes
    if query.known_cost == np.inf and lookup.complete and room and not query.clock.is_up():
        placement.place(query.roadmap, placement.widening(), query.settings.first_landmarks)


def answer(query: Query, lookup: RoadmapLookup, *, needless: bool = True) -> Status:
    """Return the status; leave out needless vertices, and have the planner's own roadmap learn what it did not know.

    Without needless vertices, a path is taken as it is; with more of them than it keeps, the roadmap does not learn it.
    """
    incumbent = query.incumbent
    if incumbent.states is None:
        return "infeasible" if incumbent.infeasible else "timeout"
    if needless:
        fewer = np.asarray(without_needless(query.motion.kind, incumbent.states, BUDGET))
        query.offer(fewer)
        incumbent.states = fewer
    # Once it is large, it only learns paths where it knows none at all.
    unknown = query.known_cost == np.inf and lookup.complete
    most = query.settings.max_kept_nodes
    wanted = (len(query.roadmap) < most or unknown) and len(incumbent.states) <= most
    if query.known_cost > ABOUT_AS_GOOD * incumbent.cost and wanted:
        query.roadmap.add_path(incumbent.states)
    return "solved"
