"""Executors: threads here, each with its own worker process, or a Dask cluster; one interface for both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, NamedTuple

from trailmark.benchmark.errors import WorkerError
from trailmark.benchmark.isolation.worker import stop_workers

__all__ = ["Pool", "cluster", "local"]

ANSWER_LIMIT = 5.0
"""Seconds in which a scheduler has to answer."""


class Pool(NamedTuple):
    """Where jobs are run.

    Attributes:
        executor: takes them.
        slots: tells how many may run at once, now.
    """

    executor: Executor
    slots: Callable[[], int]


@contextmanager
def local(workers: int) -> Iterator[Pool]:
    """Run jobs in worker processes on this machine, which end with the block."""
    executor = ThreadPoolExecutor(workers, thread_name_prefix="trailmark-worker")
    try:
        yield Pool(executor, lambda: workers)
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        stop_workers()
        executor.shutdown()


@contextmanager
def cluster(address: str, *, answer_limit: float = ANSWER_LIMIT) -> Iterator[Pool]:
    """Run jobs on the workers of a Dask cluster, on each as many at once as it has threads.

    Args:
        address: of its scheduler.
        answer_limit: seconds to wait for the scheduler, when it is first asked and at the end.

    Raises:
        WorkerError: Dask is not installed, or no scheduler answers at the address.
    """
    try:
        from distributed import Client
    except ImportError:
        raise WorkerError(
            "--scheduler needs Dask: pip install 'distributed>=2024.8' (what pip install 'trailmark[cluster]' adds)"
        ) from None
    try:
        client: Any = Client(address, timeout=answer_limit, set_as_default=False)  # type: ignore[no-untyped-call]  # Dask's own
    except (OSError, ValueError, TimeoutError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise WorkerError(
            f"scheduler {address!r} does not answer: {reason}; expected the address of a running Dask "
            "scheduler, such as tcp://host:8786"
        ) from None
    try:
        yield Pool(client.get_executor(retries=3), lambda: max(1, sum(client.nthreads().values())))
    finally:
        client.close(timeout=answer_limit)
