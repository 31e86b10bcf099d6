"""The results database's tables: Planner Arena's, with more columns for each run.

Planner Arena and OMPL's ``ompl_benchmark_statistics`` ask for the tables ``experiments``, ``plannerConfigs``,
``enums``, ``runs`` and ``progress``, and take any further columns of the last two as what was measured.
"""

from __future__ import annotations

from trailmark.benchmark.status import Status

__all__ = ["APPLICATION", "DDL", "ENUMS", "MEASURED", "VERSION"]

VERSION = 1
"""Of the schema, in the database's ``user_version``."""

APPLICATION = 0x74726D6B
"""``trmk``: tells trailmark's results from other SQLite files, in the database's ``application_id``."""

MEASURED = {
    "status": "ENUM",
    "solved": "BOOLEAN",
    "correct_solution": "BOOLEAN",
    "approximate_solution": "BOOLEAN",
    "solution_difference": "REAL",
    "time": "REAL",
    "time_to_first_solution": "REAL",
    "first_solution_length": "REAL",
    "solution_length": "REAL",
    "simplified_solution_length": "REAL",
    "simplification_time": "REAL",
    "states_checked": "INTEGER",
    "motions_checked": "INTEGER",
    "graph_states": "INTEGER",
    "graph_motions": "INTEGER",
    "memory": "REAL",
    "seed": "INTEGER",
    "setup_time": "REAL",
    "overhead": "REAL",
    "smoothness": "REAL",
    "max_curvature": "REAL",
    "min_clearance": "REAL",
    "parameters": "TEXT",
    "failure": "TEXT",
    "path": "TEXT",
    "simplified_path": "TEXT",
}
"""The columns of ``runs`` after its three keys: fields of :class:`~trailmark.benchmark.record.RunRecord`.

Paths are JSON, a list of states [x, y, theta]. The record's curve is in ``progress``, a row for each better path.
"""

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
