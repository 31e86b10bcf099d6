"""Results: the content of a results database as arrays, problem by problem."""

from __future__ import annotations

import json
import math
import os
import sqlite3
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.record import Status
from trailmark.benchmark.store import BUSY, check_schema, errors_in_one_line
from trailmark.errors import FormatError

__all__ = ["Curve", "Problem", "Results", "Runs", "load_results"]

FloatArray = NDArray[np.float64]
Curve = tuple[FloatArray, FloatArray]
"""Seconds, ascending, and the cost of the best path so far; both of shape (n,)."""

ALLOWED = "expected a results database that 'trailmark benchmark' wrote"
COLUMNS = (
    *("seed", "status", "solved", "correct_solution"),
    *("time", "time_to_first_solution", "solution_length", "simplified_solution_length"),
)


@dataclass(frozen=True)
class Runs:
    """All runs of one planner on one problem, in the order of their seeds.

    Attributes:
        seeds: shape (n,).
        statuses: OMPL's numbers for how they ended, 0 where none is known; shape (n,).
        claimed: which of them the planner calls solved, exactly; shape (n,).
        success: which of these the referee calls correct too: only these count as solved; shape (n,).
        first_times: seconds to the first solution, infinity for a failed run; shape (n,).
        costs: of the returned path (metres), infinity for a failed run; shape (n,).
        simplified_costs: of the path after the common simplifier, infinity where there is none; shape (n,).
        failures: why a run gave no answer or was refused, None where it did neither; n of them.
        curves: the best cost over time of each run; n of them, of which any may be empty.
    """

    seeds: FloatArray
    statuses: FloatArray
    claimed: NDArray[np.bool_]
    success: NDArray[np.bool_]
    first_times: FloatArray
    costs: FloatArray
    simplified_costs: FloatArray
    failures: Sequence[str | None]
    curves: Sequence[Curve]

    def __len__(self) -> int:
        return len(self.failures)

    @property
    def refused(self) -> int:
        """How many paths the planner called solutions and the referee did not."""
        return int((self.claimed & ~self.success).sum())

    @property
    def best_costs(self) -> FloatArray:
        """The lower of :attr:`costs` and :attr:`simplified_costs`, shape (n,)."""
        return np.minimum(self.costs, self.simplified_costs)

    def endings(self) -> dict[str, int]:
        """Return how many runs ended without success, by how they ended; most frequent first."""
        known = {int(status): status.description.lower() for status in Status}
        counts = Counter(known.get(int(status), "unknown status") for status in self.statuses[~self.claimed])
        counts.update({"refused by the referee": self.refused} if self.refused else {})
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


@dataclass(frozen=True)
class Problem:
    """One experiment of the database: a world, a robot, a query, and the limits of a run.

    Attributes:
        name: for people, different from all others.
        time_limit: seconds a run.
        memory_limit: MB a run; None if there is none.
        wanted: runs asked for, of each planner.
        facts: every other column, and what ``setup`` holds, one level deep.
        runs: for each planner that has any.
    """

    name: str
    time_limit: float
    memory_limit: float | None
    wanted: int
    facts: Mapping[str, Any]
    runs: Mapping[str, Runs]

    @cached_property
    def best_cost(self) -> float:
        """Cost of the best path that the referee accepted, of any planner, simplified or not; infinity without any."""
        return min((float(runs.best_costs.min()) for runs in self.runs.values()), default=math.inf)


@dataclass(frozen=True)
class Results:
    """What a results database holds.

    Attributes:
        file: the database.
        problems: in the order in which they were begun; those without a run are left out.
        planners: names, in the order of the problems' tables; each occurs in at least one problem.
        settings: what is known of each planner's settings, by its name.
        empty: names of problems that no run is finished of.
    """

    file: Path
    problems: Sequence[Problem]
    planners: Sequence[str]
    settings: Mapping[str, str] = field(default_factory=dict)
    empty: Sequence[str] = ()

    @property
    def runs(self) -> int:
        """How many runs there are in all."""
        return sum(len(runs) for problem in self.problems for runs in problem.runs.values())


def load_results(file: Path) -> Results:
    """Read a results database.

    Raises:
        FormatError: the file is missing or no SQLite database.
        StoreError: a database of another schema, damaged, locked, or without a finished run.
    """
    with _opened(file) as db:
        planners = db.execute("SELECT id, name, settings FROM plannerConfigs ORDER BY id").fetchall()
        often = Counter(name for _, name, _ in planners)
        # One that occurs twice, with other settings, gets its id behind it.
        names = {key: str(name) if often[name] == 1 else f"{name} ({key})" for key, name, _ in planners}
        rows = db.execute(
            "SELECT id, name, timelimit, memorylimit, runcount, version, hostname, cpuinfo, date, seed, setup "
            "FROM experiments ORDER BY id"
        ).fetchall()
        often = Counter(row[1] for row in rows)
        problems = [_problem(db, row, names, alike=often[row[1]] > 1) for row in rows]
    done = [problem for problem in problems if problem.runs]
    if not done:
        raise StoreError(f"{file}: holds no finished run; expected a database with at least one")
    present = {planner for problem in done for planner in problem.runs}
    settings = {names[key]: text or "" for key, _, text in planners if names[key] in present}
    return Results(file, done, list(settings), settings, [problem.name for problem in problems if not problem.runs])


def _problem(db: sqlite3.Connection, row: tuple[Any, ...], names: Mapping[int, str], *, alike: bool) -> Problem:
    """Return a problem with its runs; one of several that are named alike has its limits and number in its name."""
    key, name, time_limit, memory_limit, wanted = row[:5]
    limits = f" (no. {key}: {time_limit:g} s, {memory_limit or math.inf:g} MB)" if alike else ""
    facts: dict[str, Any] = dict(zip(("version", "hostname", "cpuinfo", "date", "seed"), row[5:10], strict=True))
    facts["setup"] = _json_object(row[10])
    progress = "SELECT runid, time, best_cost FROM progress WHERE runid IN (SELECT id FROM runs WHERE experimentid = ?)"
    steps = np.array(db.execute(f"{progress} AND best_cost NOTNULL ORDER BY runid, time", (key,)).fetchall(), float)
    columns = ", ".join(("plannerid", "id", "failure", *COLUMNS))
    query = f"SELECT {columns} FROM runs WHERE experimentid = ? ORDER BY plannerid, seed, id"  # noqa: S608  # our own names
    runs = {
        names.get(planner, f"planner {planner}"): _runs(list(found), steps.reshape(-1, 3))
        for planner, found in groupby(db.execute(query, (key,)), key=lambda found: found[0])
    }
    return Problem(f"{name or 'problem'}{limits}", float(time_limit), memory_limit, int(wanted or 0), facts, runs)


def _runs(rows: Sequence[tuple[Any, ...]], steps: FloatArray) -> Runs:
    seeds, statuses, solved, correct, end, first, cost, simplified = np.array([row[3:] for row in rows], dtype=float).T
    success = (solved == 1.0) & (correct == 1.0)
    # Not known is infinite; a planner that tells only of its end had its first solution no later.
    end, first, cost, simplified = (
        np.where(success & ~np.isnan(column), column, np.inf) for column in (end, first, cost, simplified)
    )
    ids = np.array([row[1] for row in rows], dtype=float)
    begins, ends = (np.searchsorted(steps[:, 0], ids, side) for side in ("left", "right"))
    curves = [(steps[a:b, 1], steps[a:b, 2]) for a, b in zip(begins, ends, strict=True)]
    why = [row[2] for row in rows]
    times = np.minimum(end, first)
    return Runs(seeds, np.nan_to_num(statuses), solved == 1.0, success, times, cost, simplified, why, curves)


def _json_object(text: object) -> dict[str, Any]:
    try:
        found = json.loads(str(text))
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """Open the database for reading, and check its schema."""
    if not file.is_file():
        raise FormatError(file, f"{'is no file' if file.exists() else 'does not exist'}; {ALLOWED}")
    if not os.access(file, os.R_OK):
        raise FormatError(file, "cannot be read: permission denied")
    with errors_in_one_line(file, ALLOWED), closing(_connect(file)) as db:
        if not check_schema(db, file):
            raise StoreError(f"{file}: an empty database; {ALLOWED}")
        yield db


def _connect(file: Path) -> sqlite3.Connection:
    address = file.resolve().as_uri()
    try:
        db = sqlite3.connect(f"{address}?mode=ro", uri=True, timeout=BUSY)
        db.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.OperationalError:
        # A benchmark that was killed leaves a journal, which only a writer may roll back.
        db = sqlite3.connect(f"{address}?mode=rw", uri=True, timeout=BUSY)
    return db
