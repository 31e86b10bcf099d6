"""Improvement: other ways around, and landmarks where better paths might run, until the best path settles."""

from __future__ import annotations

import numpy as np

from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.placement import Placement
from trailmark.planning.query import Query
from trailmark.roadmap import Roadmap

__all__ = ["improve"]


def improve(query: Query, placement: Placement, lattices: LatticeSchedule | None, landmarks: int) -> None:
    """Better the best path until it is settled, proven to be good enough, or the time is up.

    This goes on in a roadmap of its own, so that the planner's stays small enough for many queries.

    Args:
        query: with a path.
        placement: of landmarks.
        lattices: searched for other ways around; None for a car.
        landmarks: placed in each round.
    """
    settings, incumbent = query.settings, query.incumbent
    roadmap = Roadmap(query.checker, query.motion)
    nodes = roadmap.add(query.ends)
    on_best, without_gain = np.zeros(0, dtype=np.int64), 0
    while without_gain < settings.patience and not query.close_enough and query.begin_round("improving"):
        before = incumbent.cost
        if lattices is not None and settings.uses("other-ways"):
            _another_way_around(query, roadmap, lattices)
        placement.place(roadmap, placement.widening(), landmarks)
        # Once without the best path's own vertices, for the other ways around the obstacles ...
        banned = np.zeros(len(roadmap), dtype=np.bool_)
        banned[on_best] = True
        placement.search(roadmap, nodes, banned)
        # ... and once with them, for what can be put together from both.
        if incumbent.states is not None and not query.clock.is_up():
            on_best = np.concatenate([on_best, roadmap.add_path(incumbent.states)[1:-1]])
            placement.search(roadmap, nodes)
        if incumbent.states is not None and not query.clock.is_up():
            query.offer(query.shortened(incumbent.states, settings.polishing_sweeps, splitting=True))
        without_gain = without_gain + 1 if before - incumbent.cost < settings.least_gain * before else 0


def _another_way_around(query: Query, roadmap: Roadmap, lattices: LatticeSchedule) -> None:
    """Look for another path over a lattice; what it passes joins the roadmap: parts of it may be better."""
    path = lattices.other_path(query.rng, query.incumbent.cost)
    if len(path):
        path = query.shortened(path, query.settings.first_sweeps)
        roadmap.add_path(path)
        if query.motion.cost_of(path) < query.settings.promising * query.incumbent.cost:
            query.offer(query.shortened(path))
