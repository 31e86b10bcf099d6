"""Compiling in two processes side by side: numba compiles one kernel at a time in each."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from numba.core import event

__all__ = ["compiled_side_by_side", "help_compiling"]

PROGRAM = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from trailmark.compiled.side_by_side import help_compiling
help_compiling()
"""
"""What the second process runs; it finds modules where this one does, whatever lies in the working directory."""

_alone = True
"""Whether no second process compiles for this one, or this one for another."""


@contextmanager
def compiled_side_by_side(jobs: Sequence[Callable[[], object]]) -> Iterator[None]:
    """Let a second process do jobs in the reverse order, from when the block begins to compile until it ends.

    The block does the same jobs in their order. What one process compiles the other finds in the cache, and waits for
    it if it is not ready (:meth:`trailmark.compiled.cache.KernelCache.only_one_process`). Where there is one processor
    only, or no second process can be started, the block does everything.

    Args:
        jobs: without arguments, to be pickled; a second process that fails in one of them ends.
    """
    global _alone
    if not _alone or (os.cpu_count() or 1) < 2:
        yield
        return
    helper = _Helper(jobs)
    _alone = False
    try:
        with event.install_listener("numba:compile", helper):
            yield
    finally:
        _alone = True
        helper.end()


def help_compiling() -> None:
    """Do the jobs whose pickle comes from stdin, as the second process."""
    global _alone
    _alone = False
    for job in pickle.load(sys.stdin.buffer):  # noqa: S301  # from the process that started this one
        job()


class _Helper(event.Listener):  # type: ignore[misc,unused-ignore]  # numba ships types in part
    """Starts the second process when numba compiles the first kernel."""

    def __init__(self, jobs: Sequence[Callable[[], object]]) -> None:
        self._jobs = jobs
        self._process: subprocess.Popen[bytes] | None = None
        self._begun = False

    def on_start(self, event: Any) -> None:
        if self._begun:
            return
        self._begun = True
        with suppress(OSError):
            self._process = subprocess.Popen(  # noqa: S603  # our own program
                [sys.executable, "-c", PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            with self._process.stdin as pipe:  # type: ignore[union-attr]  # it is a pipe
                pipe.write(pickle.dumps(sys.path) + pickle.dumps(list(reversed(self._jobs))))

    def on_end(self, event: Any) -> None:
        pass

    def end(self) -> None:
        """End the second process: whatever it may still do has been done."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait()
