"""Pace: what a unit of work takes on this machine, so that what would end too late is not begun."""

from __future__ import annotations

from functools import cache
from time import perf_counter

__all__ = ["Pace"]

REFERENCE_LOOP = 4.0e-4
"""Seconds that the loop of :func:`_slowness` takes where the first guesses of paces were measured."""

LEARNING_RATE = 0.5
"""Weight of the newest measurement: on a machine that others use as well, what was true a minute ago may not be now."""

MAX_SLOWER = 3.0
"""Times the first guess that is believed at most: a process that was suspended for a while is not slow ever after."""

MIN_EXPECTED = 2e-3
"""Seconds of expected work below which nothing is learnt: there the fixed costs of a call outweigh the work."""

_paces: list[Pace] = []


class Pace:
    """Seconds that a unit of work takes: at first a guess for this machine, then what was measured.

    One object serves all planners of a process; threads may use it at once, and may lose a measurement by that. What is
    measured while kernels are compiled says nothing: :meth:`forget_all` follows.

    Args:
        guess: seconds for a unit on a machine whose loop takes REFERENCE_LOOP.
    """

    def __init__(self, guess: float) -> None:
        self._guess = guess
        self._measured: float | None = None
        _paces.append(self)

    @classmethod
    def forget_all(cls) -> None:
        """Go back to the first guess of every pace."""
        for pace in _paces:
            pace._measured = None

    def seconds(self, units: float) -> float:
        """Return what so much work is expected to take, seconds."""
        rate = self._guess * _slowness() if self._measured is None else self._measured
        return rate * units

    def note(self, units: float, seconds: float) -> None:
        """Learn what so much work took, seconds."""
        first = self._guess * _slowness()
        if units * first < MIN_EXPECTED:
            return
        before, slowest = self.seconds(1.0), MAX_SLOWER * first
        self._measured = before + LEARNING_RATE * (min(seconds / units, slowest) - before)


@cache
def _slowness() -> float:
    """Return how many times as long as on the reference machine a loop takes here: the shortest of three runs."""
    taken = []
    for _ in range(3):
        begin, total = perf_counter(), 0
        for i in range(10_000):
            total += i & 7
        taken.append(perf_counter() - begin)
    return min(taken) / REFERENCE_LOOP
