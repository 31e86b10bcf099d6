"""Deadlines: what they show changes at their time, and not before."""

from __future__ import annotations

import math
import os
import threading
import time

import numpy as np
import pytest

from trailmark.clock import Deadline, _watch, over
from trailmark.jit import njit


def test_a_deadline_passes_at_its_time_and_not_before() -> None:
    begun = time.perf_counter()
    late, soon = Deadline.after(0.4), Deadline.after(0.1)
    for deadline, seconds in ((soon, 0.1), (late, 0.4)):
        while not deadline.shown[0]:
            assert time.perf_counter() - begun < seconds + 30.0
            time.sleep(0.001)
        assert time.perf_counter() - begun >= seconds


def test_what_is_over_shows_it_at_once_and_what_is_infinite_never() -> None:
    assert Deadline.after(0.0).shown[0]
    assert Deadline.after(-math.inf).shown[0]
    endless = Deadline.after(math.inf)
    assert not endless.shown[0]
    assert endless.shown.dtype == np.int64


@njit(nogil=True)
def _looks(deadline: Deadline) -> int:
    memory, n = np.zeros(2), 0
    while not over(deadline):
        memory[0] += 1.0
        n += 1
    return n + int(memory[0] < 0.0)


def test_a_kernel_that_does_nothing_else_sees_it_pass() -> None:
    _looks(Deadline.after(0.0))
    begun = time.perf_counter()
    assert _looks(Deadline.after(0.1)) > 1000
    assert 0.1 <= time.perf_counter() - begun < 30.0


def test_a_thread_that_an_exception_kept_from_beginning_is_started_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(thread: threading.Thread) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("trailmark.clock._watch", type(_watch)())
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", interrupted)
        with pytest.raises(KeyboardInterrupt):
            Deadline.after(0.05)
    deadline, begun = Deadline.after(0.05), time.monotonic()
    while not deadline.shown[0]:
        assert time.monotonic() < begun + 30.0
        time.sleep(0.001)


def test_once_nobody_looks_at_a_deadline_no_thread_waits_for_it() -> None:
    deadline = Deadline.after(1000.0)
    assert any(thread.name == "trailmark deadlines" for thread in threading.enumerate())
    del deadline
    end = time.perf_counter() + 30.0
    while any(thread.name == "trailmark deadlines" for thread in threading.enumerate()):
        assert time.perf_counter() < end
        time.sleep(0.01)
    again = Deadline.after(0.05)
    while not again.shown[0]:
        assert time.perf_counter() < end
        time.sleep(0.001)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_forked_process_has_deadlines_of_its_own() -> None:
    Deadline.after(0.01)
    child = os.fork()
    if child == 0:
        deadline, begun = Deadline.after(0.01), time.perf_counter()
        while not deadline.shown[0] and time.perf_counter() - begun < 20.0:
            time.sleep(0.001)
        os._exit(0 if deadline.shown[0] else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
