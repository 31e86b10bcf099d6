"""Solve: how one query is answered. It reads as docs/explanation/method.md does."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from trailmark.landmarks.band import Band
from trailmark.planning.disc_path import shortest_disc_path
from trailmark.planning.grids.grid_path import shortest_grid_path
from trailmark.planning.improvement import improve
from trailmark.planning.lattice.schedule import AT_FIRST, LatticeSchedule
from trailmark.planning.placement import Placement
from trailmark.planning.proofs import AnyBound, LowerBound
from trailmark.planning.proofs.prover import Prover
from trailmark.planning.query import Query
from trailmark.planning.result import Status
from trailmark.planning.roadmap_lookup import RoadmapLookup
from trailmark.planning.rounds import Rounds
from trailmark.planning.solving_steps import (
    answer,
    consult_roadmap,
    search_closely,
    search_lattices,
    time_for_relaxed_problem,
)
from trailmark.se2 import FloatArray

__all__ = ["solve"]


def solve(query: Query, bound: AnyBound | None, known_path: FloatArray | None = None) -> Status:
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
        if isinstance(bound, LowerBound) and shortest_grid_path(query, bound.tangents):
            return answer(query, lookup, needless=False)
        known = query.solved
        if not known and lattices is not None:
            query.report("looking for a first path")
            search_lattices(lattices, AT_FIRST, query, lookup, proofs)
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
