"""Workers: where jobs are run, on this machine or on a Dask cluster, through one interface, ``concurrent.futures``.

Each worker keeps a host process (:mod:`trailmark.benchmark.host`), in which each run has a process of its own. It is no
pool of :mod:`multiprocessing`, nor one built on it: their processes outlive a killed parent, are forbidden in Dask's
workers, and know no problem that stays prepared from run to run, which makes a run two and a half times as costly.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from time import perf_counter
from typing import TYPE_CHECKING, Any, NamedTuple

from trailmark.benchmark.errors import WorkerError
from trailmark.benchmark.record import RunRecord

if TYPE_CHECKING:
    from trailmark.benchmark.problems import Job

__all__ = ["Pool", "Worker", "cluster", "local", "run_job", "stop_workers"]

START_LIMIT = 180.0
"""Seconds that a host may take until it is ready; on a machine's first use the kernels are compiled."""

ANSWER_LIMIT = 5.0
"""Seconds in which a scheduler has to answer."""

SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""So that runs side by side do not take each other's cores, and so that forking is safe."""

Answer = dict[str, Any]


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
    """Run jobs in hosts on this machine, one for each of the threads that wait for them; they end with the block."""
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


_mine = threading.local()
_all: list[Worker] = []


def run_job(job: Job) -> Answer:
    """Run a job in this thread's worker: what is handed to an executor, here or on another machine."""
    if not hasattr(_mine, "worker"):
        _mine.worker = Worker()
        _all.append(_mine.worker)
    worker: Worker = _mine.worker
    return worker.run(job)


def stop_workers() -> None:
    """End all of this process's workers, with the runs under way."""
    while _all:
        _all.pop().stop()


class Worker:
    """A handle on one host process, started when the first job comes and again whenever it died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._jobs: Connection | None = None
        self._stopped = False

    @property
    def pid(self) -> int | None:
        """The host's process id; None while it is not running."""
        return None if self._process is None else self._process.pid

    def run(self, job: Job) -> Answer:
        """Return a job's answer, as fields of a :class:`~trailmark.benchmark.record.RunRecord`.

        Raises:
            ConnectionResetError: the host died over it.
            WorkerError: it does not start, or the worker was stopped.
        """
        self._start()
        assert self._jobs is not None  # noqa: S101  # just started
        begin = perf_counter()
        try:
            self._jobs.send(job)
            answer: Answer = self._answers.recv()
        except (OSError, EOFError):
            self._end()
            if self._stopped:
                raise WorkerError("the worker was stopped") from None
            raise ConnectionResetError("the worker process died") from None
        record = RunRecord.from_json(answer)
        spent = (record.time or 0.0) + (record.simplification_time or 0.0) + float(answer["preparing"])
        record.overhead = max(0.0, perf_counter() - begin - spent)
        return record.to_json()

    def stop(self) -> None:
        """End the process and the run under way, for good."""
        self._stopped = True
        self._end()

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        if self._jobs is not None:
            self._jobs.close()  # which the host takes for its end, and its child's
        try:
            process.wait(2.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _start(self) -> None:
        if self._process is not None and self._process.poll() is None:
            return
        if self._stopped:
            raise WorkerError("the worker was stopped")
        self._end()
        (theirs, self._jobs), (self._answers, replies) = (multiprocessing.Pipe(duplex=False) for _ in range(2))
        ends = theirs.fileno(), replies.fileno()
        with tempfile.TemporaryFile() as printed, theirs, replies:
            self._process = subprocess.Popen(  # noqa: S603  # this interpreter and a module of our own
                # -P: a file of the user's in the working directory must not take a library's place.
                [sys.executable, "-P", "-m", "trailmark.benchmark.host", *map(str, ends)],
                pass_fds=ends,
                stdin=subprocess.DEVNULL,
                stdout=printed,
                stderr=printed,
                env=os.environ | dict.fromkeys(SINGLE_THREADED, "1"),
                start_new_session=True,  # Ctrl-C is for us, not for it
            )
            replies.close()  # else its end would not be seen
            ready = False
            with suppress(OSError, EOFError):
                ready = self._answers.poll(START_LIMIT) and self._answers.recv() == "ready"
            printed.seek(0)
            lines = printed.read().decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
        if self._stopped:  # meanwhile
            self._end()
            raise WorkerError("the worker was stopped")
        if not ready:
            self._end()
            raise WorkerError(
                f"a worker process does not start: {lines[0][:300]}; expected an environment in which "
                f"'{sys.executable} -m trailmark.benchmark.host' runs"
            )
