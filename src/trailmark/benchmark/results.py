"""Results: the content of a results database as arrays, problem by problem, and a few figures of it for the shell."""

from __future__ import annotations

import itertools
import json
import math
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.record import MEASURED, Status
from trailmark.benchmark.store import APPLICATION, BUSY, VERSION
from trailmark.errors import FormatError, TrailmarkError

__all__ = ["Curve", "Problem", "Results", "Runs", "differences", "failure_lines", "load_results", "summary_rows"]

FloatArray = NDArray[np.float64]
Curve = tuple[FloatArray, FloatArray]
"""Seconds, ascending, and the cost of the best path so far; both of shape (n,)."""

ALLOWED = "expected a results database that 'trailmark benchmark' wrote"
NUMBERS = tuple(name for name, kind in MEASURED.items() if kind != "TEXT")


@dataclass(frozen=True)
class Runs:
    """All runs of one planner on one problem, in the order of their seeds.

    Attributes:
        columns: for each numeric column of the table ``runs`` an array of shape (n,), NaN where it is null.
        ids: the runs' keys, shape (n,).
        failures: why a run gave no answer or was refused, None where it did neither; n of them.
        curves: the best cost over time of each run; n of them, of which any may be empty.
    """

    columns: Mapping[str, FloatArray]
    ids: NDArray[np.int64]
    failures: Sequence[str | None]
    curves: Sequence[Curve]

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    @cached_property
    def claimed(self) -> NDArray[np.bool_]:
        """Which runs the planner calls solved, exactly; shape (n,)."""
        return np.asarray(self["solved"] == 1.0)

    @cached_property
    def success(self) -> NDArray[np.bool_]:
        """Which of them the referee calls correct too: only these count as solved; shape (n,)."""
        return np.asarray(self.claimed & (self["correct_solution"] == 1.0))

    @property
    def refused(self) -> int:
        """How many paths the planner called solutions and the referee did not."""
        return int((self.claimed & ~self.success).sum())

    @cached_property
    def first_times(self) -> FloatArray:
        """Seconds to the first solution, shape (n,); infinity for a failed run."""
        # A planner that tells only of its end had its first solution no later.
        return np.minimum(self._of_solved("time"), self._of_solved("time_to_first_solution"))

    @cached_property
    def costs(self) -> FloatArray:
        """Cost of the returned path (metres), shape (n,); infinity for a failed run."""
        return self._of_solved("solution_length")

    @cached_property
    def simplified_costs(self) -> FloatArray:
        """Cost of the path after the common simplifier, shape (n,); infinity where there is none."""
        return self._of_solved("simplified_solution_length")

    @property
    def best_costs(self) -> FloatArray:
        """The lower of :attr:`costs` and :attr:`simplified_costs`, shape (n,)."""
        return np.minimum(self.costs, self.simplified_costs)

    def _of_solved(self, name: str) -> FloatArray:
        return np.where(self.success & ~np.isnan(self[name]), self[name], np.inf)

    def endings(self) -> dict[str, int]:
        """Return how many runs ended without success, by how they ended; most frequent first."""
        counts = Counter(_ending(status) for status in self["status"][~self.claimed])
        counts.update({"refused by the referee": self.refused} if self.refused else {})
        return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


@dataclass(frozen=True)
class Problem:
    """One experiment of the database: a world, a robot, a query, and the limits of a run.

    Attributes:
        key: the experiment's id.
        name: for people; it ends in ``difference``.
        difference: what sets it apart from other experiments of its name; empty where the name does.
        time_limit: seconds a run.
        memory_limit: MB a run; None if there is none.
        wanted: runs asked for, of each planner.
        facts: every other column, and what ``setup`` holds, one level deep.
        runs: for each planner that has any.
    """

    key: int
    name: str
    difference: str
    time_limit: float
    memory_limit: float | None
    wanted: int
    facts: Mapping[str, Any]
    runs: Mapping[str, Runs]

    @cached_property
    def best_cost(self) -> float:
        """Cost of the best path that the referee accepted, of any planner, simplified or not; infinity without any."""
        return min((float(runs.best_costs.min()) for runs in self.runs.values()), default=float("inf"))


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
        names = _planner_names(db)
        settings = {names[key]: text or "" for key, text in db.execute("SELECT id, settings FROM plannerConfigs")}
        rows = db.execute(
            "SELECT id, name, timelimit, memorylimit, runcount, version, hostname, cpuinfo, date, seed, setup "
            "FROM experiments ORDER BY id"
        ).fetchall()
        apart = differences((row[0], str(row[1] or f"problem {row[0]}"), row[10]) for row in rows)
        problems = [_problem(db, row, names, apart[row[0]]) for row in rows]
    done = [problem for problem in problems if problem.runs]
    if not done:
        raise StoreError(f"{file}: holds no finished run; expected a database with at least one")
    present = {planner for problem in done for planner in problem.runs}
    planners = [name for name in names.values() if name in present]
    empty = [problem.name for problem in problems if not problem.runs]
    return Results(file, done, planners, {name: settings[name] for name in planners}, empty)


def _problem(db: sqlite3.Connection, row: tuple[Any, ...], names: Mapping[int, str], apart: str) -> Problem:
    key, name, time_limit, memory_limit, wanted = row[:5]
    name = f"{name or f'problem {key}'}{apart and f' ({apart})'}"
    facts: dict[str, Any] = dict(zip(("version", "hostname", "cpuinfo", "date", "seed"), row[5:10], strict=True))
    facts["setup"] = _json_object(row[10])
    curves: dict[int, list[tuple[float, float]]] = {}
    progress = "SELECT runid, time, best_cost FROM progress WHERE runid IN (SELECT id FROM runs WHERE experimentid = ?)"
    for run, seconds, cost in db.execute(f"{progress} ORDER BY runid, time", (key,)):
        if cost is not None:
            curves.setdefault(run, []).append((seconds, cost))
    by_planner: dict[str, list[tuple[Any, ...]]] = {}
    columns = ", ".join(("plannerid", "id", "failure", *NUMBERS))
    query = f"SELECT {columns} FROM runs WHERE experimentid = ? ORDER BY plannerid, seed, id"  # noqa: S608  # our own names
    for run_row in db.execute(query, (key,)):
        by_planner.setdefault(names.get(run_row[0], f"planner {run_row[0]}"), []).append(run_row[1:])
    runs = {planner: _runs(found, curves) for planner, found in by_planner.items()}
    return Problem(key, name, apart, float(time_limit), memory_limit, int(wanted or 0), facts, runs)


def _runs(rows: Sequence[tuple[Any, ...]], curves: Mapping[int, list[tuple[float, float]]]) -> Runs:
    table = np.array([row[2:] for row in rows], dtype=np.float64).reshape(len(rows), len(NUMBERS))
    ids = np.array([row[0] for row in rows], dtype=np.int64)
    steps = [np.array(curves.get(int(i), []), dtype=np.float64).reshape(-1, 2) for i in ids]
    columns = {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(NUMBERS)}
    return Runs(columns, ids, [row[1] for row in rows], [(step[:, 0], step[:, 1]) for step in steps])


def _planner_names(db: sqlite3.Connection) -> dict[int, str]:
    """Return a name for each planner's id, in the order of the ids; one that occurs twice gets its id behind it."""
    rows = db.execute("SELECT id, name FROM plannerConfigs ORDER BY id").fetchall()
    names = [str(name) for _, name in rows]
    return {key: str(name) if names.count(str(name)) == 1 else f"{name} ({key})" for key, name in rows}


def _ending(status: float) -> str:
    try:
        return Status(int(status)).description.lower()
    except ValueError:  # also a status that is not there: NaN
        return "unknown status"


def _json_object(text: object) -> dict[str, Any]:
    try:
        return _as_mapping(json.loads(str(text)))
    except ValueError:
        return {}


def _as_mapping(data: Any) -> dict[str, Any]:
    return data if isinstance(data, dict) else {}


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """Open the database for reading, check its schema, and report SQLite's errors in one line."""
    if not file.is_file():
        raise FormatError(file, f"{'is no file' if file.exists() else 'does not exist'}; {ALLOWED}")
    try:
        with file.open("rb") as opened:
            head = opened.read(16)
    except OSError as error:
        raise FormatError(file, f"cannot be read: {error.strerror}") from None
    if head and head != b"SQLite format 3\0":
        raise FormatError(file, f"not an SQLite database; {ALLOWED}")
    try:
        with closing(_connect(file)) as db:
            _check_schema(db, file)
            yield db
    except TrailmarkError:
        raise
    except (TypeError, ValueError, OverflowError) as error:
        raise StoreError(f"{file}: a cell holds what its column does not: {error}; {ALLOWED}") from None
    except sqlite3.Error as error:
        problem = "locked by another program" if "locked" in str(error) else str(error)
        raise StoreError(f"{file}: cannot be read: {problem}; {ALLOWED}") from None


def _connect(file: Path) -> sqlite3.Connection:
    address = file.resolve().as_uri()
    try:
        db = sqlite3.connect(f"{address}?mode=ro", uri=True, timeout=BUSY)
        db.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.OperationalError:
        # A benchmark that was killed leaves a journal, which only a writer may roll back.
        db = sqlite3.connect(f"{address}?mode=rw", uri=True, timeout=BUSY)
    return db


def _check_schema(db: sqlite3.Connection, file: Path) -> None:
    application = db.execute("PRAGMA application_id").fetchone()[0]
    version = db.execute("PRAGMA user_version").fetchone()[0]
    tables = {name for (name,) in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if not tables:
        raise StoreError(f"{file}: an empty database, {ALLOWED}")
    if application != APPLICATION:
        raise StoreError(f"{file}: an SQLite database of another program; {ALLOWED}")
    if version != VERSION:
        raise StoreError(f"{file}: expected schema version {VERSION}, got {version}")
    for missing in sorted({"experiments", "plannerConfigs", "runs", "progress"} - tables):
        raise StoreError(f"{file}: the table {missing!r} is missing; {ALLOWED}")
    columns = {row[1] for row in db.execute("PRAGMA table_info(runs)")}
    for absent in sorted({"id", "experimentid", "plannerid", *MEASURED} - columns):
        raise StoreError(f"{file}: the table 'runs' has no column {absent!r}; {ALLOWED}")


_WORDS = {"time_limit": "limit {} s", "memory_limit": "{} MB", "resolution": "resolution {} m", "problem": "problem {}"}


def differences(experiments: Iterable[tuple[int, str, str | None]]) -> dict[int, str]:
    """Return for each experiment what sets it apart from others of its name; empty where the name alone does.

    Args:
        experiments: id, name, and the column ``setup``, whose ``identity`` tells problem and limits.
    """
    rows = [(key, name, _as_mapping(_json_object(setup).get("identity"))) for key, name, setup in experiments]
    alike: dict[str, list[Mapping[str, Any]]] = {}
    for _, name, own in rows:
        alike.setdefault(name, []).append(own)
    found: dict[int, str] = {}
    for key, name, own in rows:
        fields = [f for f in _WORDS if len({json.dumps(identity.get(f)) for identity in alike[name]}) > 1]
        words = ", ".join(_WORDS[f].format(_value(own.get(f))) for f in fields)
        same = sum(all(identity.get(f) == own.get(f) for f in _WORDS) for identity in alike[name])
        number = f"no. {key}" if same > 1 else ""
        found[key] = ", ".join(filter(None, [words, number]))
    return found


def _value(value: object) -> str:
    return value[:8] if isinstance(value, str) else f"{value:g}" if isinstance(value, int | float) else "unknown"


def summary_rows(results: Results, planners: Sequence[str]) -> list[tuple[str, ...]]:
    """Return a header and a row for each planner, over all its runs.

    ``correct`` counts what the referee accepts, ``refused`` what the planner called a solution and is none. Of the
    correct runs: the median time to the first solution, and the medians of cost and of cost after the simplifier, each
    as a multiple of the problem's best known. Experiments of one name that differ, in their time limit say, have
    rows of their own.
    """
    groups: dict[str, list[Problem]] = {}
    for problem in results.problems:
        groups.setdefault(problem.difference, []).append(problem)
    rows: list[tuple[str, ...]] = [("planner", "correct", "refused", "first solution", "cost", "simplified")]
    for planner, (difference, problems) in itertools.product(planners, groups.items()):
        found = [
            (problem.runs[planner], problem.best_cost or math.nan) for problem in problems if planner in problem.runs
        ]
        if not found:
            continue
        correct, count = sum(int(runs.success.sum()) for runs, _ in found), sum(len(runs) for runs, _ in found)
        name, refused = planner + (difference and f" ({difference})"), sum(runs.refused for runs, _ in found)
        first = _median([runs.first_times for runs, _ in found], "{:.3f} s")
        cost = _median([runs.costs / best for runs, best in found], "x {:.3f}")
        simplified = _median([runs.simplified_costs / best for runs, best in found], "x {:.3f}")
        rows.append((name, f"{correct}/{count}", str(refused), first, cost, simplified))
    return rows


def failure_lines(results: Results, planners: Sequence[str]) -> list[str]:
    """Return a line for each planner whose runs gave reasons for failing: the most frequent reason, and how often."""
    lines = []
    for planner in planners:
        found = [problem.runs[planner] for problem in results.problems if planner in problem.runs]
        reasons = Counter(" ".join(reason.split()) for runs in found for reason in runs.failures if reason)
        for reason, count in reasons.most_common(1):
            lines.append(f"{planner}: {count} of {sum(len(runs) for runs in found)} runs: {reason}")
    return lines


def _median(values: Sequence[FloatArray], form: str) -> str:
    """Return the median of the finite values as words."""
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    return form.format(np.median(known)) if len(known) else "-"
