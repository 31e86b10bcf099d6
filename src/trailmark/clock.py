"""The clock that compiled searches look at, so that they end in time by themselves.

:func:`now` reads what ``time.perf_counter`` reads, without the interpreter: about 0.1 µs. It stands still on Windows,
which has no ``clock_gettime``: searches then end by their number of nodes alone.
"""

from __future__ import annotations

import sys
from typing import Any, NamedTuple

import numpy as np
from numba.core import types

from trailmark.compiled import njit

__all__ = ["CLOCK_EVERY", "Deadline", "now"]

CLOCK_EVERY = 32
"""Nodes that a search takes between two looks at the clock: certifying their motions takes far longer than a look."""

KIND: int = 8 if sys.platform == "darwin" else 1
"""What ``time.perf_counter`` reads, as ``clock_gettime`` numbers it: CLOCK_UPTIME_RAW on macOS or CLOCK_MONOTONIC."""


class Deadline(NamedTuple):
    """When to end.

    Attributes:
        seconds: reading of the clock.
        kind: of the clock, as ``clock_gettime`` numbers it.
    """

    seconds: float
    kind: int

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the deadline that is so many seconds from now; they may be infinite."""
        return cls(now(KIND) + seconds, KIND)


if sys.platform == "win32":

    @njit(cache=True)
    def now(kind: int) -> float:
        """Return a time before all others."""
        return -np.inf

else:
    # numba's own types are typed in part: this is a function of C's library, called from compiled code alone.
    _pointer: Any = types.CPointer(types.int64)  # type: ignore[no-untyped-call]
    _clock_gettime: Any = types.ExternalFunction("clock_gettime", types.int32(types.int32, _pointer))

    @njit(cache=True)
    def now(kind: int) -> float:
        """Return the reading of a clock, in seconds."""
        reading = np.empty(2, np.int64)
        _clock_gettime(kind, reading.ctypes)
        return float(reading[0] + 1e-9 * reading[1])
