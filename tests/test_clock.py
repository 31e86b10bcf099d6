"""The clock of compiled searches: it reads what Python's does."""

from __future__ import annotations

import math
import time

from trailmark.clock import KIND, Deadline, now


def test_it_reads_what_perf_counter_reads() -> None:
    now(KIND)
    for _ in range(100):
        before = time.perf_counter()
        between = now(KIND)
        assert before - 1e-6 <= between <= time.perf_counter() + 1e-6


def test_it_reads_a_threads_processor_time() -> None:
    now(time.CLOCK_THREAD_CPUTIME_ID)
    before = time.thread_time()
    between = now(time.CLOCK_THREAD_CPUTIME_ID)
    assert before - 1e-6 <= between <= time.thread_time() + 1e-6


def test_a_deadline_lies_so_many_seconds_ahead() -> None:
    before = time.perf_counter()
    deadline = Deadline.after(2.0)
    assert before + 2.0 - 1e-6 <= deadline.seconds <= time.perf_counter() + 2.0 + 1e-6
    assert Deadline.after(math.inf).seconds == math.inf
    assert Deadline.after(-math.inf).seconds == -math.inf
