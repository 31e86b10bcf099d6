"""Signals that arrive while a kernel runs: an exception where Python called it, and never the end of the process."""

from __future__ import annotations

import pytest
from tests.support.forks import Forks
from tests.support.trials import few

SCRIPT = """
import os, signal, sys, threading, time
from typing import NamedTuple
import numpy as np
from trailmark.clock import KIND, now
from trailmark.compiled import njit

class Pair(NamedTuple):
    values: np.ndarray
    seconds: float

class Nested(NamedTuple):
    first: Pair
    second: Pair

@njit(nogil=True)
def busy(values, seconds):
    # Until it is told that the signal was sent.
    end = now(KIND) + seconds
    while values[1] == 0.0 and now(KIND) < end:
        values[0] += 1.0

@njit(nogil=True)
def array(values, seconds):
    busy(values, seconds)
    return values.copy()

@njit(nogil=True)
def named(values, seconds):
    busy(values, seconds)
    return Pair(values, seconds)

@njit(nogil=True)
def nested(values, seconds):
    busy(values, seconds)
    return 1.0, Nested(Pair(values.copy(), seconds), Pair(values, seconds)), values

@njit(nogil=True)
def error(values, seconds):
    busy(values, seconds)
    raise ValueError("expected more")

values = np.zeros(3)

def interrupt():
    time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.05)  # another thread may get it
    values[1] = 1.0

def call(seconds):
    try:
        return kernel(values, seconds)
    except ValueError as e:
        return str(e)

for kernel in (array, named, nested, error):
    expected = call(0.0)
    for _ in range(ROUNDS):
        values[1] = 0.0
        thread = threading.Thread(target=interrupt)
        try:
            thread.start()
            kernel(values, 60.0)
            sys.exit("the kernel returned")
        except KeyboardInterrupt:
            pass
        thread.join()
    assert type(call(0.0)) is type(expected)
    print(kernel.__name__, "sound", flush=True)
"""


@pytest.mark.slow
def test_ctrl_c_while_a_kernel_runs_is_raised_when_it_returns(forks: Forks) -> None:
    run = forks.run(["-c", SCRIPT.replace("ROUNDS", str(few(3)))], timeout=120.0)
    said = [f"{kernel} sound" for kernel in ("array", "named", "nested", "error")]
    assert (run.returncode, run.stdout.splitlines()) == (0, said), run.stderr[-500:]
