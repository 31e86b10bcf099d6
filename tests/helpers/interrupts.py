"""Interrupts: an exception between any two lines of given files, as Ctrl-C or a user's callback may bring it.

>>> for k in range(lines_run(["roadmap/roadmap.py"], action)):
...     interrupted(["roadmap/roadmap.py"], action, k)
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection
from pathlib import Path
from types import FrameType
from typing import Any

import trailmark

__all__ = ["interrupted", "lines_run", "places_run"]

SOURCE = Path(trailmark.__file__).parent


def lines_run(files: Collection[str], action: Callable[[], object]) -> int:
    """Return how many lines of the files (paths below the package) an action runs, in this thread."""
    return len(places_run(files, action))


def places_run(files: Collection[str], action: Callable[[], object]) -> list[tuple[str, int]]:
    """Return the lines that an action runs, one after the other: file and number."""
    counter = _Tracer(files, None, KeyboardInterrupt)
    counter.run(action)
    return counter.places


def interrupted(
    files: Collection[str], action: Callable[[], object], k: int, error: type[BaseException] = KeyboardInterrupt
) -> bool:
    """Raise ``error`` before the k-th line (from 0 on) of the files that an action runs; return whether it got there.

    What the action makes of the exception is its own affair; another one than ``error`` comes through.
    """
    tracer = _Tracer(files, k, error)
    try:
        tracer.run(action)
    except error:
        if not tracer.raised:
            raise
    return tracer.raised


class _Tracer:
    def __init__(self, files: Collection[str], k: int | None, error: type[BaseException]) -> None:
        self.files = {str(SOURCE / file) for file in files}
        missing = [file for file in self.files if not Path(file).is_file()]
        if missing:
            raise FileNotFoundError(missing[0])
        self.k, self.error = k, error
        self.raised = False
        self.places: list[tuple[str, int]] = []

    def run(self, action: Callable[[], object]) -> None:
        before = sys.gettrace()
        sys.settrace(self._enter)
        try:
            action()
        finally:
            sys.settrace(before)

    def _enter(self, frame: FrameType, event: str, argument: object) -> Any:
        return self._line if frame.f_code.co_filename in self.files else None

    def _line(self, frame: FrameType, event: str, argument: object) -> Any:
        if event == "line" and not self.raised:
            if len(self.places) == self.k:
                self.raised = True
                raise self.error
            self.places.append((frame.f_code.co_filename, frame.f_lineno))
        return self._line
