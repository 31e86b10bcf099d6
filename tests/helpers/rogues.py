"""Planners that misbehave, named ``tests.helpers.rogues:NAME`` to the benchmark."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from typing import Any

import numpy as np


def honest(checker: Any, start: Any, goal: Any, limit: float, seed: int) -> Any:
    """Go straight, as tests choose problems where that is right; take a while."""
    time.sleep(0.02)
    return np.array([start, goal])


def better(checker: Any, start: Any, goal: Any, limit: float, seed: int, report: Any) -> Any:
    """Come by a detour, then by a shorter way, then by a worse one, and return the straight one."""
    for height in (4.0, 2.0, 3.0):
        report([start, [5.0, height, 0.0], goal])
        time.sleep(0.01)
    return np.array([start, goal])


def dawdle(checker: Any, start: Any, goal: Any, limit: float, seed: int, report: Any) -> Any:
    """Report a detour in time, and return the straight way when it is over."""
    report([start, [5.0, 2.0, 0.0], goal])
    time.sleep(limit + 0.2)
    return np.array([start, goal])


def abort(*args: Any) -> None:
    os.abort()


def crash(*args: Any) -> None:
    ctypes.string_at(0)


def hang(*args: Any) -> None:
    # Also what an orderly end would be asked for with.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    while True:
        time.sleep(0.1)


def eat(*args: Any) -> Any:
    held = []
    while True:
        held.append(np.ones(2**20))


def fail(*args: Any) -> None:
    raise ValueError("no idea\nat all")


def leave(*args: Any) -> None:
    os._exit(7)


def turn_back(checker: Any, start: Any, goal: Any, limit: float, seed: int) -> Any:
    """Set the clock back, so that the solution comes before the start."""
    from trailmark.benchmark import run

    run.perf_counter = lambda: time.perf_counter() - 100.0  # type: ignore[attr-defined]  # which it imports
    return np.array([start, goal])


def run_ahead(checker: Any, start: Any, goal: Any, limit: float, seed: int) -> Any:
    """Set the clock ahead by less than the limit."""
    from trailmark.benchmark import run

    run.perf_counter = lambda: time.perf_counter() + 0.9  # type: ignore[attr-defined]  # which it imports
    return np.array([start, goal])


def lie(checker: Any, start: Any, goal: Any, limit: float, seed: int) -> Any:
    """Stop short of the goal and call it a solution."""
    return np.array([start, (np.asarray(start) + goal) / 2.0])


def stray(checker: Any, start: Any, goal: Any, limit: float, seed: int) -> Any:
    """Leave the world on the way."""
    return np.array([start, [5.0, -3.0, 0.0], goal])


def shout(checker: Any, start: Any, goal: Any, limit: float, seed: int) -> Any:
    """Print what must not be taken for an answer, through C as well."""
    sys.stdout.write('{"status": 6}\n')
    sys.stdout.flush()
    os.write(1, b'{"ready": 1}\n')
    return None


PREPARING = 3.4
"""Seconds: longer than a run of a tenth of a second may last."""


def prepared_plan(checker: Any, start: Any, goal: Any, limit: float, seed: int, *, prepared: str) -> Any:
    """Take what was prepared, for which the clock does not run."""
    assert prepared == "ready"
    return [start, goal]


def _prepare(checker: Any) -> str:
    time.sleep(PREPARING)
    return "ready"


prepared_plan.prepare = _prepare  # type: ignore[attr-defined]  # what the benchmark calls before its clock starts
