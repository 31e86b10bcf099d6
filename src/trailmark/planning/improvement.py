"""Improvement: other ways around, and landmarks where better paths might run, until the best path settles."""

from __future__ import annotations

import numpy as np

from trailmark.curves import CurvePath
from trailmark.landmarks.band import Band
from trailmark.planning.hybrid_astar import Targets, drive_to
from trailmark.planning.lattice.schedule import LatticeSchedule
from trailmark.planning.placement import Placement
from trailmark.planning.query import Query
from trailmark.roadmap import Roadmap

__all__ = ["Redriving", "improve"]


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
    redriving = Redriving(query, placement.band) if query.motion.charged and settings.uses("redriving") else None
    on_best, without_gain = np.zeros(0, dtype=np.int64), 0
    while without_gain < settings.patience and not query.close_enough and query.begin_round("improving"):
        before = incumbent.cost
        if redriving is not None:
            redriving.run()
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


# --- Redriving: a car's path with fewer changes of direction, by hybrid A* from its tight end to the path itself.

CELLS = 0.25
"""Edge of a cell as a share of the longest drive: where little room is left, what a change gains is a few cells."""

LEVELS = 2
"""Runs, each with drives half as long as the one before; then about as long as in the last one."""

TRIES = 2
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
        step = query.settings.redrive_step * motion.radius * 0.5**level
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
            most=query.settings.redrive_nodes >> 2 * (LEVELS - 1 - level),
            limit=query.incumbent.cost,
            seconds=query.seconds_left(),
        )
        if target < 0:
            return
        rest = beyond[target]
        found = np.concatenate([rest[:-1], knots] if reverse else [knots, rest[1:]])
        if motion.motions_between_valid(found[:-1], found[1:]).all():
            for _ in range(TRIES):
                query.offer(query.shortened(found))
