"""What is looked for in a thread of its own: proofs, beside the search for a path.

The kernels and shapely release Python's global lock, so that on a machine with a second core neither waits for the
other.
"""

from __future__ import annotations

from collections.abc import Callable
from threading import Event, Thread
from typing import Generic, Self, TypeVar

from trailmark.proofs.region import Stop

__all__ = ["Background", "in_time"]

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
