"""Processes that ask: one may die or hang of what it is asked, and another takes its place."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from time import perf_counter
from typing import Any, NamedTuple

__all__ = ["Outcome", "Worker", "run_all"]


class Outcome(NamedTuple):
    """What became of a task.

    Attributes:
        task: what was to be done.
        value: what came back; None if nothing did.
        problem: ``crash`` or ``hang``, else None.
        asking: what was being asked then, if it had been said.
    """

    task: Any
    value: Any
    problem: str | None = None
    asking: Any = None


class Worker:
    """A process that answers tasks one after the other, started anew once it is lost.

    Args:
        work: a function of a module's top level, called with a task and the file to keep questions in.
        asking: that file.
        seconds: time for a task at most.
    """

    def __init__(self, work: Callable[[Any, Path], Any], asking: Path, seconds: float) -> None:
        self.work, self.asking, self.seconds = work, asking, seconds
        self._process: Any = None
        self._pipe: Connection | None = None

    def do(self, task: Any) -> Outcome:
        """Do a task."""
        if self._process is None or not self._process.is_alive():
            self._start()
        assert self._pipe is not None
        self.asking.unlink(missing_ok=True)
        problem = "hang"
        try:
            self._pipe.send(task)
            if self._pipe.poll(self.seconds):
                return Outcome(task, self._pipe.recv())
        except (EOFError, OSError):
            problem = "crash"
        self.close()
        asking = pickle.loads(self.asking.read_bytes()) if self.asking.exists() else None  # noqa: S301  our own file
        return Outcome(task, None, problem, asking)

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process = None

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self.work, self.asking), daemon=True)
        self._process.start()
        # Else the pipe stays open when the process dies.
        theirs.close()


def _serve(pipe: Connection, work: Callable[[Any, Path], Any], asking: Path) -> None:
    while True:
        try:
            task = pipe.recv()
        except (EOFError, KeyboardInterrupt):
            return
        pipe.send(work(task, asking))


def run_all(
    work: Callable[[Any, Path], Any], tasks: Iterable[Any], workers: int, folder: Path, seconds: float
) -> Iterator[tuple[Outcome, float]]:
    """Yield what becomes of each task and the seconds it took, as they end; tasks are taken as workers come free."""
    free: SimpleQueue[Worker] = SimpleQueue()
    all_workers = [Worker(work, folder / f"asking-{i}.pickle", seconds) for i in range(workers)]
    for worker in all_workers:
        free.put(worker)

    def do(task: Any) -> tuple[Outcome, float]:
        worker, begin = free.get(), perf_counter()
        try:
            return worker.do(task), perf_counter() - begin
        finally:
            free.put(worker)

    waiting: set[Future[tuple[Outcome, float]]] = set()
    try:
        with ThreadPoolExecutor(workers) as threads:
            for task in tasks:
                waiting.add(threads.submit(do, task))
                if len(waiting) >= workers:
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while waiting:
                done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
    finally:
        for worker in all_workers:
            worker.close()
