"""Prover: lower bounds and infeasibility, asked for in one place, as far as there is time for them.

The kernels on both sides release Python's global lock, so that on a machine with a second core neither waits for the
other. Nothing that is planned depends on it but when planning ends.
"""

from __future__ import annotations

from threading import Event, Thread
from time import perf_counter
from typing import Self

import numpy as np

from trailmark.collision import StateChecker
from trailmark.landmarks.band import Band
from trailmark.planning.proofs import AnyBound, enclosed
from trailmark.planning.proofs.claims import grid_separates
from trailmark.planning.query import Query
from trailmark.se2 import FloatArray

__all__ = ["BackgroundProof", "Prover"]

POLLING = 0.01
"""Seconds between two looks at the clock, and whether to stop, while a proof is waited for."""


class Prover:
    """What can be proven about one query; use it as a context, which ends what runs in the background.

    Args:
        query: under way.
        bound: proves lower bounds in this world; None proves none.
    """

    def __init__(self, query: Query, bound: AnyBound | None) -> None:
        self.query, self.bound = query, bound
        query.incumbent.bounded = bound is None
        self._background: BackgroundProof | None = None
        self._seconds, self._waited = 0.0, False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        if self._background is not None:
            self._background.end()

    def seconds(self) -> float:
        """Return what a lower bound is expected to take, seconds; once the region is made, what it was."""
        if self.bound is not None:
            # The better the path, the less there is to do. Once it is done, what it took is known no more.
            seconds = self._seconds_left_of(self.bound)
            self._seconds = seconds if self.bound.seconds_for_region() > 0.0 else max(self._seconds, seconds)
        return self._seconds

    def _seconds_left_of(self, bound: AnyBound) -> float:
        incumbent = self.query.incumbent
        return bound.seconds(incumbent.start, incumbent.goal, incumbent.whole_cost)

    def bound_below(self, share: float) -> None:
        """Prove a lower bound, once, if that is expected to take no more than a share of the time left.

        If it is not, what is known from the world before it changed is made use of. Where there is no path yet, the
        region is made first if that alone takes no longer: an end may turn out to lie in a small part of it, which is
        soon proven to be shut in.
        """
        query, incumbent = self.query, self.query.incumbent
        if self.bound is None or incumbent.bounded:
            return
        seconds = share * query.seconds_left()
        expected = self.seconds()
        if seconds <= expected and not query.solved and self.bound.seconds_for_region() < seconds:
            self.bound.make_region(query.seconds_left())
            expected, seconds = self._seconds_left_of(self.bound), share * query.seconds_left()
        if not expected < seconds:
            incumbent.claim(self.bound.known(incumbent.start, incumbent.goal))
            return
        incumbent.bounded = True
        ends, left = (incumbent.start, incumbent.goal), query.seconds_left()
        incumbent.claim(self.bound.of(*ends, incumbent.whole_cost, seconds, left).cost)

    def begin_in_background(self) -> None:
        """Begin to look for a proof, with headings, that no path exists; a disc has none."""
        query = self.query
        if query.solved or self._background is not None or not query.motion.turns:
            return
        if not query.settings.uses("background-proof"):
            return
        if self.bound is not None:
            incumbent = query.incumbent
            # Known first, so that an exception in between does not leave it running.
            seconds = max(0.0, query.seconds_left())
            self._background = BackgroundProof(query.checker, incumbent.start, incumbent.goal, seconds)
            self._background.begin()

    def wait(self, seconds: float) -> None:
        """Wait, once, for what runs in the background, so long at most: a search beside it would slow it down."""
        if self._background is None or self._waited:
            return
        self._waited = True
        self._wait_for(self._background, seconds)

    def _wait_for(self, proof: BackgroundProof, seconds: float = np.inf) -> None:
        until = perf_counter() + seconds
        while proof.running and self.query.seconds_left() > 0.0 and perf_counter() < until:
            proof.wait(POLLING)

    @property
    def in_background(self) -> bool:
        """Whether a proof is, or was, looked for in the background."""
        return self._background is not None

    def infeasible(self) -> bool:
        """Return whether it is proven by now that there is no path."""
        if self._background is not None:
            if self.query.solved:
                self._background.cancel()
            elif self._background.found:
                self.query.incumbent.claim(np.inf)
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
            if self._background is not None:
                self._wait_for(self._background)
                self.infeasible()
        elif grid_separates(band.relaxation, band.to_goal, query.incumbent.start, query.incumbent.goal):
            query.incumbent.claim(np.inf)


# --- Background: a proof that no path exists, looked for while planning goes on looking for one.

CELLS = 1_000_000
"""Taken at most: a few seconds."""


class BackgroundProof:
    """Looks for a proof, in a thread of its own, until it is found, cannot be found, or is no longer wanted.

    Args:
        checker: decides what is valid.
        start: valid configuration, shape (3,).
        goal: valid configuration, shape (3,).
        seconds: time at most.

    Attributes:
        found: whether it is proven that there is no path.
    """

    def __init__(self, checker: StateChecker, start: FloatArray, goal: FloatArray, seconds: float) -> None:
        self.found = False
        self._query = (checker, start, goal)
        self._seconds = seconds
        self._unwanted = Event()
        self._thread = Thread(target=self._look, name="proof of infeasibility", daemon=True)

    def begin(self) -> None:
        """Begin to look."""
        self._thread.start()

    def wait(self, seconds: float) -> None:
        """Wait for an answer, so long at most."""
        self._thread.join(seconds)

    @property
    def running(self) -> bool:
        """Whether it is still looked for."""
        return self._thread.is_alive()

    def cancel(self) -> None:
        """Let it end within some ten milliseconds, without waiting for that."""
        self._unwanted.set()

    def end(self) -> None:
        """Stop looking."""
        self.cancel()
        if self._thread.ident is not None:
            self._thread.join()

    def _look(self) -> None:
        checker, start, goal = self._query
        self.found = enclosed(checker, start, goal, seconds=self._seconds, stop=self._unwanted.is_set, budget=CELLS)
