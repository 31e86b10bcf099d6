"""The clock of compiled searches: it reads what Python's does."""

from __future__ import annotations

import time

from trailmark.clock import KIND, now


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
