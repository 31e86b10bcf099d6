"""Deadlines that compiled searches look at, so that they end in time by themselves.

A kernel reads no clock: it looks at an array, which a thread writes to once the time is over (read by kernels, hence
trailmark.jit counts this file). Kernels that are given a deadline release the interpreter's lock, or the thread waits.
"""

from __future__ import annotations

import heapq
import math
import os
import threading
from contextlib import suppress
from itertools import count
from queue import Empty, SimpleQueue
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["CLOCK_EVERY", "Deadline"]

CLOCK_EVERY = 32
"""Nodes that a search takes between two looks at its deadline."""


class Deadline(NamedTuple):
    """When to end.

    Attributes:
        passed: (1,), whether the time is over.
    """

    passed: NDArray[np.bool_]

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the deadline that is so many seconds from now; they may be infinite."""
        passed = np.array([seconds <= 0.0])
        if 0.0 < seconds < math.inf:
            _watch.add(perf_counter() + seconds, passed)
        return cls(passed)


class _Watch:
    """A thread that sets what deadlines show, each at its time.

    It is told of them through a queue without a lock of Python's, which an exception might leave taken.
    """

    def __init__(self) -> None:
        self._new: SimpleQueue[tuple[float, int, NDArray[np.bool_]]] = SimpleQueue()
        self._numbers = count()
        self._thread: threading.Thread | None = None

    def add(self, time: float, passed: NDArray[np.bool_]) -> None:
        """Set an array at a time, as ``time.perf_counter`` reads it."""
        self._new.put((time, next(self._numbers), passed))
        if self._thread is None:  # where two are started, either takes some
            self._thread = threading.Thread(target=self._run, name="trailmark deadlines", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        waiting: list[tuple[float, int, NDArray[np.bool_]]] = []
        while True:
            left = min(waiting[0][0] - perf_counter(), threading.TIMEOUT_MAX) if waiting else None
            with suppress(Empty):
                heapq.heappush(waiting, self._new.get(timeout=None if left is None else max(left, 0.0)))
            while waiting and waiting[0][0] <= perf_counter():
                heapq.heappop(waiting)[2][0] = True


_watch = _Watch()


def _watch_anew() -> None:
    """A forked process has none of its parent's threads."""
    global _watch
    _watch = _Watch()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_watch_anew)
