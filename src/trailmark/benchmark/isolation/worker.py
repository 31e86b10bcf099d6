"""Worker: a handle on one zygote process, and ``run_job``, which any ``concurrent.futures.Executor`` can run."""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from time import perf_counter
from typing import Any

from trailmark.benchmark.errors import WorkerError
from trailmark.benchmark.record import RunRecord

__all__ = ["Worker", "run_job", "stop_workers"]

START_LIMIT = 180.0
"""Seconds that a zygote may take until it is ready; on a machine's first use the kernels are compiled."""

SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""So that runs side by side do not take each other's cores, and so that forking is safe."""

Answer = dict[str, Any]


class Worker:
    """One zygote process, started when the first job comes and again whenever it died."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._sent: list[str] = []
        self._pending = b""
        self._stopped = False
        self._running = threading.RLock()

    @property
    def pid(self) -> int | None:
        """The zygote's process id; None while it is not running."""
        return None if self._process is None else self._process.pid

    def run(self, job: Mapping[str, Any]) -> Answer:
        """Return a job's answer, as fields of a :class:`~trailmark.benchmark.record.RunRecord`.

        Raises:
            WorkerError: the zygote died over it, twice, or does not start.
        """
        with self._running:
            return self._run(job)

    def stop(self, *, for_good: bool = True) -> None:
        """End the zygote and the run under way."""
        self._stopped = self._stopped or for_good
        process, self._process = self._process, None
        if process is None:
            return
        if process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()  # which the zygote takes for its end, and its child's
        try:
            process.wait(2.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        # Whoever reads from it comes to its end now.
        with self._running:
            if process.stdout is not None:
                process.stdout.close()

    def _run(self, job: Mapping[str, Any]) -> Answer:
        for _ in range(2):
            self._start()
            begin = perf_counter()
            # The zygote keeps the problems; the text is sent once.
            message = dict(job)
            if job["problem"] in self._sent:
                del message["text"]
            try:
                self._send(message)
                answer = self._receive(None)
            except (OSError, EOFError):
                self.stop(for_good=False)
                continue
            if "without its text" in str(answer.get("failure")):
                self._sent.clear()
                continue
            self._sent.append(str(job["problem"]))
            record = RunRecord.from_json(answer)
            spent = (record.time or 0.0) + (record.simplification_time or 0.0) + float(answer.get("preparing", 0.0))
            record.overhead = max(0.0, perf_counter() - begin - spent)
            return record.to_json()
        raise WorkerError(f"planner {job['planner']}, seed {job['seed']}: the worker process died over it twice")

    def _start(self) -> None:
        if self._stopped:
            raise WorkerError("the worker was stopped")
        if self._process is not None and self._process.poll() is None:
            return
        self.stop(for_good=False)
        self._sent, self._pending = [], b""
        environment = os.environ | dict.fromkeys(SINGLE_THREADED, "1")
        stderr_file = tempfile.TemporaryFile()  # noqa: SIM115  # closed below, with the process started
        self._process = subprocess.Popen(  # this interpreter and a module of our own
            # -P: a file of the user's in the working directory must not take a library's place.
            [sys.executable, "-P", "-m", "trailmark.benchmark.isolation.zygote"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=stderr_file,
            env=environment,
            start_new_session=True,  # Ctrl-C is for us, not for it
        )
        with stderr_file:
            try:
                ready = "ready" in self._receive(START_LIMIT)
            except (OSError, EOFError):
                ready = False
            if not ready:
                self.stop(for_good=False)
                stderr_file.seek(0)
                lines = stderr_file.read().decode(errors="replace").strip().splitlines()[-1:] or ["no message"]
                raise WorkerError(
                    f"a worker process does not start: {lines[0][:300]}; expected an environment in which "
                    f"'{sys.executable} -m trailmark.benchmark.isolation.zygote' runs"
                )

    def _send(self, message: Answer) -> None:
        assert self._process is not None  # noqa: S101  # started by run
        assert self._process.stdin is not None  # noqa: S101  # asked for as a pipe
        self._process.stdin.write((json.dumps(message) + "\n").encode())
        self._process.stdin.flush()

    def _receive(self, limit: float | None) -> Answer:
        """Return the next answer.

        Raises:
            EOFError: the zygote is gone, or nothing came within ``limit`` seconds.
        """
        process = self._process
        if process is None or process.stdout is None:
            raise EOFError
        handle = process.stdout.fileno()
        deadline = None if limit is None else perf_counter() + limit
        while b"\n" not in self._pending:
            left = None if deadline is None else max(0.0, deadline - perf_counter())
            if not select.select([handle], [], [], left)[0]:
                raise EOFError
            chunk = os.read(handle, 1 << 16)
            if not chunk:
                raise EOFError
            self._pending += chunk
        line, _, self._pending = self._pending.partition(b"\n")
        answer: Answer = json.loads(line)
        return answer


_mine = threading.local()
_all: list[Worker] = []


def run_job(job: Mapping[str, Any]) -> Answer:
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
