"""Signals that arrive while a kernel runs: an exception where Python called it, and never the end of the process."""

from __future__ import annotations

import subprocess
import sys

import pytest

SCRIPT = """
import os, signal, sys, threading, time
from typing import NamedTuple
import numpy as np
from trailmark.compiled import njit

class Pair(NamedTuple):
    values: np.ndarray
    n: int

class Nested(NamedTuple):
    first: Pair
    second: Pair

@njit(nogil=True)
def busy(values, n):
    # Linear congruential numbers, which no compiler works out in advance.
    x = n
    for _ in range(n):
        x = (x * 1103515245 + 12345) & 0x7FFFFFFF
    values[0] = x
    return x

@njit(nogil=True)
def array(values, n):
    busy(values, n)
    return values.copy()

@njit(nogil=True)
def named(values, n):
    busy(values, n)
    return Pair(values, n)

@njit(nogil=True)
def nested(values, n):
    busy(values, n)
    return 1.0, Nested(Pair(values.copy(), n), Pair(values, n)), values

@njit(nogil=True)
def error(values, n):
    busy(values, n)
    raise ValueError("expected more")

kernel, values = globals()[sys.argv[1]], np.zeros(3)

def interrupt():
    time.sleep(0.05)
    os.kill(os.getpid(), signal.SIGINT)

def call(n):
    try:
        return kernel(values, n)
    except ValueError as e:
        return str(e)

expected = call(10)
begun = time.perf_counter()
call(10_000_000)
n = int(10_000_000 * 0.2 / (time.perf_counter() - begun))
for _ in range(3):
    thread = threading.Thread(target=interrupt)
    thread.start()
    try:
        kernel(values, n)
        sys.exit("the kernel returned")
    except KeyboardInterrupt:
        pass
    thread.join()
assert type(call(10)) is type(expected)
print("sound")
"""


@pytest.mark.parametrize("kernel", ["array", "named", "nested", "error"])
def test_ctrl_c_while_a_kernel_runs_is_raised_when_it_returns(kernel: str) -> None:
    run = subprocess.run([sys.executable, "-c", SCRIPT, kernel], capture_output=True, text=True, timeout=120)
    assert (run.returncode, run.stdout.strip()) == (0, "sound"), run.stderr[-500:]
