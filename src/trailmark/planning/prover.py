"""Prover: lower bounds and infeasibility, looked for in threads of their own beside the search for a path.

The kernels and shapely release Python's global lock, so that on a machine with a second core neither waits for the
other. Nothing that is planned depends on it but when planning ends.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any, Self

import numpy as np

from trailmark.landmarks.band import Band
from trailmark.planning.query import Query
from trailmark.proofs.background import Background
from trailmark.proofs.bound import LowerBound
from trailmark.proofs.claims import grid_separates
from trailmark.proofs.enclosure import enclosed

__all__ = ["Prover"]

POLLING = 0.01
"""Seconds between two looks at the clock, and whether to stop, while a proof is waited for."""

CELLS = 1_000_000
"""Taken at most in a proof with headings: a few seconds."""


class Prover:
    """What can be proven about one query; use it as a context, which ends what runs in the background.

    Args:
        query: under way.
        bound: proves lower bounds in this world; None proves none.
    """

    def __init__(self, query: Query, bound: LowerBound | None) -> None:
        self.query, self.bound = query, bound
        query.incumbent.bounded = bound is None
        self._bounding: Background[float] | None = None
        self._enclosing: Background[bool] | None = None
        self._waited = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._bounding is not None:
            self._bounding.cancel()
        if self._enclosing is not None:
            self._enclosing.end()

    def bound_below(self, share: float) -> None:
        """Prove a lower bound beside whatever comes next, waited for as long as a share of the time left at most.

        A world of many corners is waited for from the second call on. What is not done then is given up.
        """
        query, incumbent, bound = self.query, self.query.incumbent, self.bound
        if bound is None or incumbent.bounded:
            return
        again = self._bounding is not None
        if self._bounding is None:
            ends, cost = (incumbent.start, incumbent.goal), incumbent.whole_cost
            # Known first, so that an exception in between does not leave it running.
            self._bounding = Background(lambda stop: bound.of(*ends, cost, stop).cost, "lower bound")
            self._bounding.begin()
        if again or not bound.takes_long:
            self._wait_for(self._bounding, share * query.seconds_left())
        if again and self._bounding.running:
            # Part of a bound is one, too.
            self._bounding.cancel()
            self._bounding.wait(POLLING)
        found = self._bounding.found()
        incumbent.bounded = again or found is not None
        if found is not None:
            incumbent.raise_bound(found)

    def begin_in_background(self) -> None:
        """Begin to look for a proof, with headings, that no path exists; a disc has none."""
        query, incumbent = self.query, self.query.incumbent
        wanted = self.bound is not None and query.motion.turns and query.settings.uses("background-proof")
        if query.solved or self._enclosing is not None or not wanted:
            return
        ends, seconds = (incumbent.start, incumbent.goal), max(0.0, query.seconds_left())
        self._enclosing = Background(
            lambda stop: enclosed(query.checker, *ends, seconds=seconds, stop=stop, budget=CELLS),
            "proof of infeasibility",
        )
        self._enclosing.begin()

    @property
    def in_background(self) -> bool:
        """Whether a proof is, or was, looked for in the background."""
        return self._enclosing is not None

    def wait(self, seconds: float) -> None:
        """Wait, once, for what runs in the background, so long at most: a search beside it would slow it down."""
        if self._enclosing is not None and not self._waited:
            self._waited = True
            self._wait_for(self._enclosing, seconds)

    def _wait_for(self, proof: Background[Any], seconds: float = np.inf) -> None:
        until = perf_counter() + seconds
        while proof.running and self.query.seconds_left() > 0.0 and perf_counter() < until:
            proof.wait(POLLING)

    def infeasible(self) -> bool:
        """Return whether it is proven by now that there is no path."""
        if self._enclosing is not None:
            if self.query.solved:
                self._enclosing.cancel()
            elif self._enclosing.found():
                self.query.incumbent.raise_bound(np.inf)
        return self.query.incumbent.infeasible

    def conclude(self, band: Band | None) -> None:
        """Prove that there is no path, after all else: with time to spare the answer must not depend on who is faster.

        Args:
            band: of the relaxed problem; None if it was not looked at.
        """
        query = self.query
        if query.solved or band is None or self.infeasible():
            return
        self.bound_below(query.settings.last_proof_share)
        if np.isfinite(band.shortest):
            if self._enclosing is not None:
                self._wait_for(self._enclosing)
                self.infeasible()
        elif grid_separates(band.relaxation, band.to_goal, query.incumbent.start, query.incumbent.goal):
            query.incumbent.raise_bound(np.inf)
