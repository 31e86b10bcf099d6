"""One line on stderr that says that kernels are being compiled, and for how long it may go on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from time import perf_counter
from typing import Any

from numba.core import event

__all__ = ["CompilingReport", "compiling_for", "report", "report_once"]

_uses: list[str] = []


def report(line: str) -> None:
    """Print one line on stderr, the only way to reach whoever uses a library."""
    if sys.stderr is not None:
        print(f"trailmark: {line}", file=sys.stderr, flush=True)  # noqa: T201  # as said above


@cache
def report_once(line: str) -> None:
    """Print one line on stderr, once in a process."""
    report(line)


@contextmanager
def compiling_for(use: str) -> Iterator[None]:
    """Let the report say what kernels that the block compiles are for."""
    _uses.append(use)
    try:
        yield
    finally:
        _uses.pop()


class CompilingReport(event.Listener):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """Says that kernels are being compiled, once it has gone on for a while; again after a pause.

    Args:
        report: takes the line.
        clock: returns seconds.

    Attributes:
        after: seconds of compiling before it is reported.
        pause: seconds without compiling after which compiling is reported again.
    """

    after = 1.0
    pause = 30.0

    def __init__(self, report: Callable[[str], None] = report, clock: Callable[[], float] = perf_counter) -> None:
        self._report, self._clock = report, clock
        self._begun = self._last = -self.pause
        self._reported = self._reported_before = False

    def on_start(self, event: Any) -> None:
        """Take note that numba begins to compile a function."""
        module, now = event.data["dispatcher"].py_func.__module__, self._clock()
        if not module.startswith("trailmark"):
            return
        if now - self._last > self.pause:
            self._begun, self._reported = now, False
        self._last = now
        if not self._reported and now - self._begun > self.after:
            line = f"compiling the kernels for {_uses[-1] if _uses else module}: up to a minute"
            if not self._reported_before:
                line += ", once on this machine ('trailmark warmup' compiles all of them)"
            self._reported = self._reported_before = True
            self._report(line)

    def on_end(self, event: Any) -> None:
        """Take note that numba has compiled a function."""
        self._last = self._clock()
