"""Store: the results database, an SQLite file in Planner Arena's schema, to which each run is written as it ends.

Planner Arena and OMPL's ``ompl_benchmark_statistics`` ask for the tables ``experiments``, ``plannerConfigs``,
``enums``, ``runs`` and ``progress``, and take any further columns of the last two as what was measured. The file is
whole at every moment: each run is one transaction that is on the disk before the next one begins. Of two programs that
want to write, the second gets an error; reading is always possible.
"""

from __future__ import annotations

import fcntl
import json
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.record import MEASURED, RunRecord, Status
from trailmark.errors import OutputError
from trailmark.formats.files import check_writable

__all__ = ["APPLICATION", "BUSY", "DDL", "ENUMS", "VERSION", "Store", "check_schema", "errors_in_one_line"]

BUSY = 5.0
"""Seconds to wait for another program that has the database locked for a moment."""


VERSION = 1
"""Of the schema, in the database's ``user_version``."""

APPLICATION = 0x74726D6B
"""``trmk``: tells trailmark's results from other SQLite files, in the database's ``application_id``."""

ENUMS = [("status", int(status), status.description) for status in Status]

DDL = (
    """CREATE TABLE experiments (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name VARCHAR(512), totaltime REAL, timelimit REAL, memorylimit REAL, runcount INTEGER, version VARCHAR(128),
    hostname VARCHAR(1024), cpuinfo TEXT, date DATETIME, seed VARCHAR(24), setup TEXT)""",
    """CREATE TABLE plannerConfigs (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    name VARCHAR(512) NOT NULL, settings TEXT)""",
    """CREATE TABLE enums (
    name VARCHAR(512), value INTEGER, description TEXT,
    PRIMARY KEY (name, value))""",
    f"""CREATE TABLE runs (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    experimentid INTEGER, plannerid INTEGER,
    {", ".join(f"{name} {kind}" for name, kind in MEASURED.items())},
    FOREIGN KEY (experimentid) REFERENCES experiments(id) ON DELETE CASCADE,
    FOREIGN KEY (plannerid) REFERENCES plannerConfigs(id) ON DELETE CASCADE)""",
    """CREATE TABLE progress (
    runid INTEGER, time REAL, best_cost REAL,
    PRIMARY KEY (runid, time),
    FOREIGN KEY (runid) REFERENCES runs(id) ON DELETE CASCADE)""",
    "CREATE UNIQUE INDEX one_run_a_seed ON runs (experimentid, plannerid, seed)",
    "CREATE UNIQUE INDEX one_name_a_planner ON plannerConfigs (name, settings)",
)


class Store:
    """The results database, open for writing.

    Args:
        path: the file; made if it is not there.
        busy: seconds to wait for another program that has locked it.

    Raises:
        StoreError: the file is no results database, of another schema, damaged, or another benchmark writes to it.
        OutputError: it cannot be written.
    """

    def __init__(self, path: Path, *, busy: float = BUSY) -> None:
        check_writable(path)
        self.path = path
        self._lock = _locked(path)
        try:
            self._db = sqlite3.connect(path, timeout=busy, isolation_level=None, check_same_thread=False)
            with self._errors_in_one_line():
                self._open()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file and let others write."""
        if hasattr(self, "_db"):
            self._db.close()
        # Only now: closing any handle on the file gives up SQLite's own locks too.
        os.close(self._lock) if self._lock >= 0 else None
        self._lock = -1

    def experiment(
        self,
        identity: Mapping[str, Any],
        conditions: Mapping[str, Any],
        facts: Mapping[str, Any],
        **columns: str | float,
    ) -> int:
        """Return the id of an experiment, a problem with its limits: of the one that is there, else of a new row.

        Args:
            identity: problem, objective, resolution, limits: runs of the same identity belong together.
            conditions: what may not change from run to run: versions of the libraries, the processor.
            facts: further information, such as the world's text.
            **columns: the table's others: ``name``, ``timelimit`` (s), ``memorylimit`` (MB), ``runcount`` (of each
                planner), ``version``, ``hostname``, ``cpuinfo``, ``date`` (ISO 8601), ``seed`` (of the first run).

        Raises:
            StoreError: the one that is there was run under other conditions.
        """
        wanted = json.dumps(dict(identity), sort_keys=True)
        setup = json.dumps({"identity": identity, "conditions": conditions, "facts": facts}, sort_keys=True)
        with self._errors_in_one_line(), self._transaction():
            # Of hundreds of experiments, each with a world's text, only the one that can be it is decoded.
            alike = self._db.execute("SELECT id, setup, runcount FROM experiments WHERE instr(setup, ?)", (wanted,))
            for row, text, runs in alike.fetchall():
                there = json.loads(text)
                if there["identity"] == json.loads(wanted):
                    self._require_same(there["conditions"], conditions)
                    most = max(runs, columns["runcount"])
                    self._db.execute("UPDATE experiments SET runcount = ? WHERE id = ?", (most, row))
                    return int(row)
            made = {**columns, "seed": str(columns["seed"]), "totaltime": 0.0, "setup": setup}
            marks = ", ".join(f":{name}" for name in made)
            done = self._db.execute(f"INSERT INTO experiments ({', '.join(made)}) VALUES ({marks})", made)  # noqa: S608  # names of our own columns
            return int(done.lastrowid or 0)

    def _require_same(self, before: Mapping[str, Any], now: Mapping[str, Any]) -> None:
        for name in sorted({*before, *now}):
            if before.get(name) != now.get(name):
                raise StoreError(
                    f"{self.path}: its runs were made with {name} {before.get(name)}, now it is "
                    f"{now.get(name)}; expected the same, or another --output"
                )

    def planner(self, name: str, settings: str) -> int:
        """Return the id of a planner with these settings, of a new row if need be."""
        with self._errors_in_one_line(), self._transaction():
            keys = name, settings
            self._db.execute("INSERT OR IGNORE INTO plannerConfigs (name, settings) VALUES (?, ?)", keys)
            found = self._db.execute("SELECT id FROM plannerConfigs WHERE name = ? AND settings = ?", keys).fetchone()
            return int(found[0])

    def finished(self, experiment: int) -> set[tuple[int, int]]:
        """Return planner id and seed of every run of an experiment that is in the database."""
        with self._errors_in_one_line():
            rows = self._db.execute("SELECT plannerid, seed FROM runs WHERE experimentid = ?", (experiment,))
            return {(int(planner), int(seed)) for planner, seed in rows}

    def add(self, experiment: int, planner: int, record: RunRecord) -> bool:
        """Write a run, on the disk when this returns; return False if one of that seed is there already."""
        values = [getattr(record, name) for name in MEASURED]
        row = [json.dumps(value, separators=(",", ":")) if isinstance(value, list) else value for value in values]
        names = ", ".join(["experimentid", "plannerid", *MEASURED])
        marks = ", ".join("?" * (len(MEASURED) + 2))
        spent = sum(t or 0.0 for t in (record.time, record.simplification_time, record.overhead))
        with self._errors_in_one_line(), self._transaction():
            done = self._db.execute(
                f"INSERT OR IGNORE INTO runs ({names}) VALUES ({marks})",  # noqa: S608  # names of our own columns
                [experiment, planner, *row],
            )
            if done.rowcount == 0:
                return False
            self._db.executemany(
                "INSERT OR REPLACE INTO progress (runid, time, best_cost) VALUES (?, ?, ?)",
                [(done.lastrowid, t, cost) for t, cost in record.curve],
            )
            self._db.execute("UPDATE experiments SET totaltime = totaltime + ? WHERE id = ?", (spent, experiment))
        return True

    def _open(self) -> None:
        self._db.execute("PRAGMA foreign_keys = ON")
        # EXTRA: also after a loss of power, what was committed is there.
        self._db.execute("PRAGMA synchronous = EXTRA")
        if not check_schema(self._db, self.path):
            with self._transaction():
                for statement in DDL:
                    self._db.execute(statement)
                self._db.executemany("INSERT INTO enums VALUES (?, ?, ?)", ENUMS)
                self._db.execute(f"PRAGMA application_id = {APPLICATION}")
                self._db.execute(f"PRAGMA user_version = {VERSION}")

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._db.execute("ROLLBACK")
            raise
        self._db.execute("COMMIT")

    def _errors_in_one_line(self) -> AbstractContextManager[None]:
        return errors_in_one_line(self.path, "expected a database of trailmark benchmark, or a new file")


def check_schema(db: sqlite3.Connection, path: Path) -> bool:
    """Return whether a database holds anything; raise StoreError if that is not what is written here."""
    application, version = (db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version"))
    tables = db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
    if (application, version, tables) == (0, 0, 0):
        return False
    if application != APPLICATION:
        raise StoreError(
            f"{path}: an SQLite database that trailmark benchmark did not write; expected one that it wrote"
        )
    if version != VERSION:
        raise StoreError(f"{path}: expected schema version {VERSION}, got version {version}")
    return True


@contextmanager
def errors_in_one_line(path: Path, expected: str) -> Iterator[None]:
    """Report errors of SQLite, and of cells of another kind, in one line."""
    try:
        yield
    except (TypeError, ValueError, OverflowError) as error:
        raise StoreError(f"{path}: a cell holds what its column does not: {error}; {expected}") from None
    except sqlite3.Error as error:
        hints = {"database is locked": "locked by another program", "file is not a database": "no SQLite database"}
        raise StoreError(f"{path}: {hints.get(str(error), str(error))}; {expected}") from None


def _locked(path: Path) -> int:
    """Return a handle on the file that holds the writer's lock; the system gives it up with the process."""
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        # Of another kind than SQLite's own locks on parts of the file, which it does not disturb.
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        raise StoreError(
            f"{path}: another benchmark is writing to it; expected one at a time, or another --output"
        ) from None
    return handle
