"""Redriving: a car's path with fewer changes of direction, by hybrid A* from its tight end to the path itself."""

from __future__ import annotations

import numpy as np

from trailmark.curves import CurvePath
from trailmark.landmarks.band import Band
from trailmark.planning.drive_tree import Targets
from trailmark.planning.hybrid_astar import drive_to
from trailmark.planning.query import Query

__all__ = ["Redriving"]

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
