"""Background: a proof that no path exists, looked for while planning goes on looking for one.

The kernels on both sides release Python's global lock, so that on a machine with a second core neither waits for the
other. Nothing that is planned depends on it but when planning ends.
"""

from __future__ import annotations

from threading import Event, Thread

from trailmark.collision import StateChecker
from trailmark.planning.proofs import enclosed
from trailmark.se2 import FloatArray

__all__ = ["BackgroundProof"]

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
