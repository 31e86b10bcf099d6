"""Prover: lower bounds and infeasibility, looked for in threads of their own beside the search for a path.

The kernels and shapely release Python's global lock, so that on a machine with a second core neither waits for the
other. Nothing that is planned depends on it but when planning ends.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread
from time import perf_counter
from typing import Any, Generic, Self, TypeVar

import numpy as np

from trailmark.landmarks.band import Band
from trailmark.planning.proofs.bound import LowerBound
from trailmark.planning.proofs.claims import grid_separates
from trailmark.planning.proofs.enclosure import enclosed
from trailmark.planning.proofs.region import Stop
from trailmark.planning.query import Query

__all__ = ["Background", "Prover", "in_time"]

POLLING = 0.01
"""Seconds between two looks at the clock, and whether to stop, while a proof is waited for."""

CELLS = 1_000_000
"""Taken at most in a proof with headings: a few seconds."""

GRACE = 0.01
"""Seconds for whoever is told to stop, to hand over what is known."""

T = TypeVar("T")


class Background(Generic[T]):
    """Something that is looked for in a thread of its own, until it is found or no longer wanted.

    Args:
        look: finds it, unless the function that it is given says to stop.
        name: of the thread.
    """

    def __init__(self, look: Callable[[Stop], T], name: str) -> None:
        self._look, self._found, self._error = look, list[T](), list[Exception]()
        self._unwanted = Event()
        self._thread = Thread(target=self._run, name=name)

    def _run(self) -> None:
        try:
            self._found.append(self._look(self._unwanted.is_set))
        except Exception as error:  # it is raised where the result is asked for
            self._error.append(error)

    def begin(self) -> Self:
        """Begin to look."""
        self._thread.start()
        return self

    def wait(self, seconds: float) -> None:
        """Wait for it, so long at most."""
        self._thread.join(min(seconds, 1e6))

    @property
    def running(self) -> bool:
        """Whether it is still looked for."""
        return self._thread.is_alive()

    def found(self) -> T | None:
        """Return what was found; None while it is looked for."""
        if self._error:
            raise self._error[0]
        return self._found[0] if self._found else None

    def cancel(self) -> None:
        """Let it end at its next look, without waiting for that: within 10 ms, or as soon as shapely returns."""
        self._unwanted.set()

    def end(self) -> None:
        """Stop looking, and wait for that."""
        self.cancel()
        # An exception may have arrived while the thread began: one that has not begun to run cannot be waited for.
        if self._thread.is_alive():
            self._thread.join()


def in_time(seconds: float, look: Callable[[Stop], T], name: str = "in time") -> T | None:
    """Return what a function finds within some seconds, or as soon as it is told to stop then; else None."""
    task = Background(look, name)
    try:
        task.begin().wait(seconds)
    finally:
        task.cancel()
    task.wait(GRACE)
    return task.found()


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
