"""Work in a thread beside the sensing: a robot that stands still goes on to see."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from threading import Event
from time import perf_counter
from typing import TypeVar

__all__ = ["Background", "Result"]

WAIT = 0.03
"""Seconds that work is waited for at least: most ways are found sooner, and others are asked for at the next reading.
"""

Result = TypeVar("Result")


class Background:
    """Does one piece of work at a time: the search for a way, or the division of the map's cells.

    Attributes:
        seconds: that work has taken since this was last set to 0.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._stopped, self._threads = Event(), ThreadPoolExecutor(1, "exploration")
        self._current: Future[Callable[[], list[str]]] | None = None

    @property
    def is_on(self) -> bool:
        """Whether what comes of the work has not been asked for yet."""
        return self._current is not None

    def begin(self, work: Callable[[], Result], then: Callable[[Result], list[str]]) -> None:
        """Begin a piece of work.

        Args:
            work: does it.
            then: to go on with what came of it; returns what happened.
        """

        def timed() -> Callable[[], list[str]]:
            begin = perf_counter()
            try:
                return partial(then, work())
            finally:
                self.seconds += perf_counter() - begin

        self._current = self._threads.submit(timed)

    def outcome(self, until: float) -> Callable[[], list[str]] | None:
        """Return what goes on with what came of the work, and returns what happened.

        None if it is not known by then (``perf_counter``), or soon at least.
        """
        future = self._current
        assert future is not None  # noqa: S101 # the caller has looked
        wait([future], max(until - perf_counter(), WAIT))
        if not future.done():
            return None
        self._current = None
        return future.result()

    def is_stopped(self) -> bool:
        """Return whether no work is done any longer."""
        return self._stopped.is_set()

    def stop(self) -> None:
        """Do no work any longer."""
        self._stopped.set()
        self._threads.shutdown()
