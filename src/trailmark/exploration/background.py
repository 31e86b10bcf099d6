"""Work in a thread beside the sensing: a robot that stands still goes on to see."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from threading import Event
from time import perf_counter
from types import FrameType
from typing import TypeVar

__all__ = ["Background", "Result", "postponed_interrupts"]

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


@contextmanager
def postponed_interrupts() -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether Ctrl-C was pressed, which interrupts nothing; a second one does as before.

    An interrupt between any two lines would leave the map and the planner's world at odds. In threads other than the
    main one, which Ctrl-C never interrupts, the function always says no.
    """
    received = list[int]()
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    # SIGTERM likewise where somebody made an exception of it, as the shell command does; else it ends the process.
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    handlers = {n: handler for n, handler in before.items() if callable(handler)}

    def receive(number: int, frame: FrameType | None) -> None:
        received.append(number)
        if len(received) > 1:
            handlers[signal.Signals(number)](number, frame)

    for number in handlers:
        signal.signal(number, receive)
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
