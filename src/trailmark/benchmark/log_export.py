"""Export of a results database as OMPL's benchmark log, which ``ompl_benchmark_statistics`` reads.

A log holds one experiment. A database with several becomes several files, numbered, beside one another.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from trailmark.benchmark.errors import StoreError
from trailmark.benchmark.schema import ENUMS, MEASURED
from trailmark.formats.files import write_atomically
from trailmark.formats.outputs import require_not_an_input, require_replaceable

__all__ = ["export_log"]

COLUMNS = {name: kind for name, kind in MEASURED.items() if kind != "TEXT"}
"""The log's rows are split at semicolons and its names at blanks: texts and paths stay in the database."""


def export_log(database: Path, log: Path, inputs: Sequence[Path] = ()) -> list[Path]:
    """Write every experiment of a results database as a log; return the files written.

    Args:
        database: written by ``trailmark benchmark``.
        log: the file, where the database holds one experiment; of more, the second goes to ``NAME-2.log``, and so on.
        inputs: files that none of these may be.

    Raises:
        StoreError: the database cannot be read.
        OutputError: a log cannot be written, is the database or an input, or is none that trailmark wrote.
    """
    written = []
    try:
        with closing(sqlite3.connect(f"{database.resolve().as_uri()}?mode=ro", uri=True)) as db:
            db.row_factory = sqlite3.Row
            for i, experiment in enumerate(db.execute("SELECT * FROM experiments ORDER BY id").fetchall()):
                file = log if i == 0 else log.with_name(f"{log.stem}-{i + 1}{log.suffix}")
                require_not_an_input(file, (database, *inputs))
                require_replaceable(file)
                write_atomically(file, _log(db, experiment))
                written.append(file)
    except sqlite3.Error as error:
        raise StoreError(f"{database}: {error}; expected a database of trailmark benchmark") from None
    return written


def _log(db: sqlite3.Connection, experiment: sqlite3.Row) -> str:
    planners = db.execute(
        "SELECT DISTINCT p.id, p.name, p.settings FROM plannerConfigs p JOIN runs r ON r.plannerid = p.id "
        "WHERE r.experimentid = ? ORDER BY p.id",
        (experiment["id"],),
    ).fetchall()
    words = [description for _, _, description in sorted(ENUMS, key=lambda row: row[1])]
    lines = [
        # The last word of the line is the version, the first the library.
        f"trailmark version {experiment['version'].split()[1].rstrip(',')}",
        f"Experiment {experiment['name']}",
        "0 experiment properties",
        f"Running on {experiment['hostname'] or 'unknown'}",
        f"Starting at {experiment['date']}",
        "<<<|",
        experiment["setup"],
        "|>>>",
        "<<<|",
        experiment["cpuinfo"],
        "|>>>",
        f"{experiment['seed']} is the random seed",
        f"{experiment['timelimit']:g} seconds per run",
        f"{experiment['memorylimit']:g} MB per run",
        f"{experiment['runcount']} runs per planner",
        f"{experiment['totaltime']:g} seconds spent to collect the data",
        "1 enum type",
        "|".join(["status", *words]),
        f"{len(planners)} planners",
    ]
    for planner in planners:
        lines += _planner(db, experiment["id"], planner)
    return "\n".join(lines) + "\n"


def _planner(db: sqlite3.Connection, experiment: int, planner: sqlite3.Row) -> list[str]:
    names = ", ".join(COLUMNS)
    rows = db.execute(
        f"SELECT id, {names} FROM runs WHERE experimentid = ? AND plannerid = ? ORDER BY seed",  # noqa: S608  # our own columns' names
        (experiment, planner["id"]),
    ).fetchall()
    lines = [
        planner["name"],
        "1 common properties",
        f"settings = {planner['settings']}",
        f"{len(COLUMNS)} properties for each run",
    ]
    # OMPL writes names with blanks and makes them underscores on reading.
    lines += [f"{name.replace('_', ' ')} {kind}" for name, kind in COLUMNS.items()]
    lines.append(f"{len(rows)} runs")
    lines += ["".join(f"{_cell(row[name])}; " for name in COLUMNS) for row in rows]
    lines += ["2 progress properties for each run", "time REAL", "best cost REAL", f"{len(rows)} runs"]
    for row in rows:
        curve = db.execute("SELECT time, best_cost FROM progress WHERE runid = ? ORDER BY time", (row["id"],))
        lines.append("".join(f"{t!r},{cost!r},;" for t, cost in curve))
    lines.append(".")
    return lines


def _cell(value: Any) -> str:
    return "" if value is None else repr(value)
