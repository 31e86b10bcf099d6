"""The search for a way, in a thread beside the sensing: a robot that stands still goes on to see."""

# Tested by tests/exploration/test_explorer.py.

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from threading import Event
from time import perf_counter
from typing import NamedTuple

from trailmark.planning.result import PlanResult

__all__ = ["Found", "WaySearch"]

WAIT = 0.03
"""Seconds that a search is waited for at least: most ways are found sooner, and others are asked for at the next
reading."""

Then = Callable[[PlanResult], list[str]]


class Found(NamedTuple):
    """What came of a search."""

    result: PlanResult
    then: Then
    """To go on with; returns what happened."""
    revision: int
    """Of the map that was searched."""


class WaySearch:
    """Looks for one way at a time.

    Attributes:
        seconds: that searches have taken since this was last set to 0.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._stopped, self._threads = Event(), ThreadPoolExecutor(1, "looking for a way")
        self._current: tuple[Future[PlanResult], Then, int] | None = None

    @property
    def is_on(self) -> bool:
        """Whether what comes of a search has not been asked for yet."""
        return self._current is not None

    def begin(self, plan: Callable[[], PlanResult], then: Then, revision: int) -> None:
        """Begin to look for a way.

        Args:
            plan: looks for it.
            then: to go on with; returns what happened.
            revision: of the map that is searched.
        """

        def timed() -> PlanResult:
            begin = perf_counter()
            try:
                return plan()
            finally:
                self.seconds += perf_counter() - begin

        self._current = self._threads.submit(timed), then, revision

    def outcome(self, until: float) -> Found | None:
        """Return what came of the search; None if that is not known by then (``perf_counter``), or soon at least."""
        assert self._current is not None  # noqa: S101 # the caller has looked
        future, then, revision = self._current
        wait([future], max(until - perf_counter(), WAIT))
        if not future.done():
            return None
        self._current = None
        return Found(future.result(), then, revision)

    def is_stopped(self) -> bool:
        """Return whether no way is looked for any longer."""
        return self._stopped.is_set()

    def stop(self) -> None:
        """Look for no way any longer."""
        self._stopped.set()
        self._threads.shutdown()
