"""Deadlines that compiled searches look at, so that they end in time by themselves.

A kernel reads no clock: it looks at an array, which a thread writes to once the time is over. Kernels that are given a
deadline release the interpreter's lock, or the thread waits.
"""

from __future__ import annotations

import heapq
import math
import os
import threading
import weakref
from collections import deque
from contextlib import suppress
from itertools import count
from time import perf_counter, sleep
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.jit import njit

__all__ = ["CLOCK_EVERY", "Deadline", "over"]

CLOCK_EVERY = 32
"""Nodes that a search takes between two looks at its deadline."""


SHORTEST = 1e-4
"""Seconds: shorter deadlines have passed at once, before the thread could know of them."""

LATE = 5e-3
"""Seconds by which a deadline may be late."""

LONGEST_LOOK = 0.5
"""Seconds after which the thread looks whether anybody still waits for a deadline."""

Entry = tuple[float, int, "weakref.ref[NDArray[np.int64]]"]
"""When, in which order, and what is set."""


class Deadline(NamedTuple):
    """When to end.

    Attributes:
        shown: (2,), whether the time is over, and how often a kernel looked.
        beside: 1, where looks are counted.
    """

    shown: NDArray[np.int64]
    beside: int

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the deadline that is so many seconds from now; they may be infinite."""
        shown = np.array([seconds <= SHORTEST, 0], np.int64)
        if SHORTEST < seconds < math.inf:
            _watch.add(perf_counter() + seconds, shown)
        return cls(shown, 1)


@njit(numbers=True)
def over(deadline: Deadline) -> bool:
    """Return whether a deadline has passed."""
    # What is written to a place that is known only when it runs may be what is read next: the compiler must not take
    # it that nobody else writes there, and read it once.
    deadline.shown[deadline.beside] += 1
    return bool(deadline.shown[0] != 0)


class _Watch:
    """A thread that sets what deadlines show, each at its time, and ends once nobody looks at any.

    It looks by itself whether there are new ones: to wake it takes as long as a short search, and a plan makes a
    hundred. Nothing here needs a lock of Python's, which an exception might leave taken.
    """

    def __init__(self) -> None:
        self._new: deque[Entry] = deque()
        self._numbers = count()
        self._thread: threading.Thread | None = None

    def add(self, time: float, shown: NDArray[np.int64]) -> None:
        """Set an array at a time, as ``time.perf_counter`` reads it, if it is there then."""
        self._new.append((time, next(self._numbers), weakref.ref(shown)))
        # One that an exception kept from beginning is not alive. Where two are started, either takes some.
        if (thread := self._thread) is None or not thread.is_alive():
            self._thread = threading.Thread(target=self._run, name="trailmark deadlines", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        waiting: list[Entry] = []
        looked = perf_counter()
        while True:
            while self._new:
                with suppress(IndexError):  # another thread took it
                    heapq.heappush(waiting, self._new.popleft())
            now = perf_counter()
            while waiting and waiting[0][0] <= now:
                shown = heapq.heappop(waiting)[2]()
                if shown is not None:
                    shown[0] = 1
                    del shown
            if now - looked > LONGEST_LOOK:
                looked = now
                waiting = [entry for entry in waiting if entry[2]() is not None]
                heapq.heapify(waiting)
                if not waiting:
                    # Who tells of another now starts another thread, unless it is seen here.
                    self._thread = None
                    if not self._new:
                        return
            sleep(max(0.0, min(LATE, waiting[0][0] - now)) if waiting else LATE)


_watch = _Watch()


def _watch_anew() -> None:
    """A forked process has none of its parent's threads."""
    global _watch
    _watch = _Watch()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_watch_anew)
