"""Signals that wait: an exception between two lines of numba's leaves its tables, and then the process, broken."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["signals_wait"]

_SIGNALS = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM", "SIGVTALRM", "SIGPROF", "SIGUSR1", "SIGUSR2")
    if hasattr(signal, name)
)
"""Those of which handlers raise exceptions: each costs a microsecond, for each kernel that is loaded."""


@contextmanager
def signals_wait() -> Iterator[None]:
    """Call Python's handlers of signals that arrive meanwhile (Ctrl-C) at the end; a second time, at once."""
    handlers: dict[signal.Signals, Callable[[int, FrameType | None], Any]] = {}
    waiting: list[signal.Signals] = []

    def wait(number: int, frame: FrameType | None) -> None:
        arrived = signal.Signals(number)
        if arrived in waiting:
            handlers[arrived](number, frame)
        else:
            waiting.append(arrived)

    try:
        if threading.current_thread() is threading.main_thread():  # Python runs handlers in no other
            for number in _SIGNALS:
                handler = signal.getsignal(number)
                if callable(handler):
                    handlers[number] = handler
                    signal.signal(number, wait)
        yield
    finally:
        for number in reversed(handlers):  # of Ctrl-C, which may arrive right here, last
            signal.signal(number, handlers[number])
        for number in waiting:
            handlers[number](number, sys._getframe())
