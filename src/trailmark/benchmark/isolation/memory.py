"""MemoryPeak: the heap that a run takes. A forked process shares most of its pages, so its size would tell little."""

from __future__ import annotations

import ctypes
import resource
from functools import lru_cache
from pathlib import Path
from typing import Any

__all__ = ["MemoryPeak", "address_space", "heap_in_use"]

MB = 2.0**20


class MemoryPeak:
    """The largest heap in use at any measurement, above that at the beginning.

    Attributes:
        highest: MB.
    """

    def __init__(self) -> None:
        self._begin = heap_in_use()
        self.highest = 0.0

    def measure(self) -> None:
        """Take note of the heap in use now."""
        self.highest = max(self.highest, heap_in_use() - self._begin)


def heap_in_use() -> float:
    """Return the MB that ``malloc`` has handed out in all arenas; what OMPL, numpy and Python's larger objects hold."""
    info = _mallinfo()()
    return float(info.uordblks + info.hblkhd) / MB


def address_space() -> int:
    """Return the bytes that this process has mapped."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    return pages * resource.getpagesize()


class _Information(ctypes.Structure):
    """``struct mallinfo2`` of malloc.h."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()  # noqa: SIM905  # as there
    )


@lru_cache(maxsize=1)
def _mallinfo() -> Any:
    try:
        function = ctypes.CDLL(None).mallinfo2
    except AttributeError:  # glibc before 2.33, other C libraries: nothing is counted
        return _Information
    function.restype = _Information
    return function
