"""Runner: makes the runs that are not in the database yet, and stores each as soon as it ends."""

from __future__ import annotations

import itertools
import platform
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from dataclasses import dataclass, field
from datetime import UTC, datetime
from time import perf_counter
from typing import Any, NamedTuple

from trailmark.benchmark.environment import cpu_name, source_digest, versions
from trailmark.benchmark.errors import WorkerError
from trailmark.benchmark.planners import OWN_SPACING, native_peer, settings_of, spacing_of
from trailmark.benchmark.problems import Job, Problem
from trailmark.benchmark.record import RunRecord
from trailmark.benchmark.store import Store
from trailmark.benchmark.workers import Pool, run_job

__all__ = ["Benchmark", "Tally"]

MAX_TRIES = 3
"""Times that a job is handed out, should its worker get lost."""

REPORT_PERIOD = 0.2
"""Seconds between two reports of progress while no run ends."""


@dataclass
class Tally:
    """The progress of a benchmark.

    Attributes:
        total: runs asked for.
        done: of them in the database, those of earlier calls included.
        made: of them by this call of :meth:`Benchmark.run`.
        failed: of these, how many have no correct solution.
        latest: planner of the run that came in last.
        left: seconds until the end, estimated from the runs so far; None before the first.
    """

    total: int
    done: int = 0
    made: int = 0
    failed: int = 0
    latest: str = ""
    left: float | None = None


class _Run(NamedTuple):
    """A run to be made: its place in the database, what its job is made of, and how often it was handed out."""

    experiment: int
    planner: int
    problem: Problem
    name: str
    seed: int
    tries: int = 1


@dataclass
class Benchmark:
    """Problems, planners and limits; all planners get the same seeds.

    Attributes:
        problems: what to solve.
        planners: names, as :func:`trailmark.benchmark.planners.read_planners` returns them.
        runs: of each planner on each problem.
        time_limit: seconds a run.
        memory_limit: MB a run.
        seed: of the first run; the next ones count up.
        resolution: metres, of the discrete baseline; None is each planner's own, at which refusals are rare.
    """

    problems: Sequence[Problem]
    planners: Sequence[str]
    runs: int
    time_limit: float
    memory_limit: float
    seed: int = 0
    resolution: float | None = None
    _last: tuple[str, str] = field(default=("", ""), repr=False)

    def run(self, store: Store, pool: Pool, on_progress: Callable[[Tally], None] = lambda tally: None) -> Tally:
        """Make the runs that are missing and return the tally.

        However this ends, each run that came in is in the database.

        Raises:
            StoreError: the database holds runs made under other conditions, or cannot be written.
            WorkerError: workers do not start, or the same run cost several of them.
        """
        missing, tally = self._missing(store)
        pending: dict[Future[dict[str, Any]], _Run] = {}
        begin = perf_counter()
        on_progress(tally)
        try:
            while missing or pending:
                while missing and len(pending) < 2 * pool.slots():
                    run = missing.popleft()
                    pending[pool.executor.submit(run_job, self._job(run))] = run
                done, _ = wait(pending, timeout=REPORT_PERIOD, return_when=FIRST_COMPLETED)
                for future in done:
                    if not self._store_result(store, future, pending[future], tally):
                        missing.append(pending[future]._replace(tries=pending[future].tries + 1))
                    # Only now: an interrupt before leaves it to be stored below.
                    del pending[future]
                if tally.made:
                    tally.left = (perf_counter() - begin) / tally.made * (tally.total - tally.done)
                on_progress(tally)
        except BaseException:
            for future, run in pending.items():
                if future.done() and not future.cancelled() and future.exception() is None:
                    self._store_result(store, future, run, tally)
                future.cancel()
            raise
        return tally

    def _missing(self, store: Store) -> tuple[deque[_Run], Tally]:
        """Return the runs to be made, problem by problem, and in each seed by seed through all planners."""
        planners = {name: store.planner(name, settings_of(name)) for name in self.planners}
        missing: deque[_Run] = deque()
        total = len(self.problems) * len(planners) * self.runs
        for problem in self.problems:
            experiment = self._experiment(store, problem)
            finished = store.finished(experiment)
            missing.extend(
                _Run(experiment, planners[name], problem, name, seed)
                for seed, name in itertools.product(range(self.seed, self.seed + self.runs), planners)
                if (planners[name], seed) not in finished
            )
        return missing, Tally(total, done=total - len(missing))

    def _job(self, run: _Run) -> Job:
        problem = run.problem
        if self._last[0] != problem.key:  # runs on a problem follow one another
            self._last = problem.key, problem.text
        return {
            "text": self._last[1],
            "planner": run.name,
            "seed": run.seed,
            "time_limit": self.time_limit,
            "memory_limit": self.memory_limit,
            "resolution": self.resolution or spacing_of(run.name, problem.robot),
        }

    def _experiment(self, store: Store, problem: Problem) -> int:
        peer, cpu = native_peer(), cpu_name()
        found = versions() | (peer.native_versions() if peer is not None else {})
        return store.experiment(
            identity={
                "problem": problem.key,
                "objective": problem.objective,
                "resolution": self.resolution or OWN_SPACING,
                "time_limit": self.time_limit,
                "memory_limit": self.memory_limit,
            },
            conditions={**found, "processor": cpu},
            facts={
                "world": problem.world.name,
                "query": problem.query.name,
                "start": list(problem.query.start),
                "goal": list(problem.query.pose()),
                "robot": problem.robot.describe(),
                "text": problem.text,
                "system": platform.platform(),
                "source": source_digest(),
                "isolation": "a process of its own for each run, forked from a warm one; its start is no one's time",
            },
            name=problem.name,
            timelimit=self.time_limit,
            memorylimit=self.memory_limit,
            runcount=self.runs,
            version=f"trailmark {found['trailmark']}, OMPL {found['ompl']}",
            hostname=platform.node(),
            cpuinfo=cpu,
            date=datetime.now(UTC).isoformat(sep=" ", timespec="seconds"),
            seed=self.seed,
        )

    def _store_result(self, store: Store, future: Future[dict[str, Any]], run: _Run, tally: Tally) -> bool:
        """Write a run that came in and return True; return False if its worker was lost and it is to be repeated."""
        try:
            record = RunRecord.from_json(future.result())
        except WorkerError:
            raise
        except (Exception, CancelledError) as error:  # executors report a lost worker in different ways
            if run.tries >= MAX_TRIES:
                raise WorkerError(
                    f"planner {run.name}, seed {run.seed}: lost {MAX_TRIES} times with its worker: {error}"
                ) from None
            return False
        if store.add(run.experiment, run.planner, record):
            tally.done += 1
            tally.made += 1
            tally.failed += not record.correct_solution
            tally.latest = run.name
        return True
