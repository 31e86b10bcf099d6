"""The conditions of the runs: versions, processor, settings, limits, seeds and hashes."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from trailmark.benchmark.report.data import Problem, Results
from trailmark.benchmark.report.tables import Table

__all__ = ["conditions_table", "hash_table", "settings_table", "setup_of", "world_text_of"]

_WORDS = {"cpuinfo": "processor", "hostname": "machine", "date": "first begun"}
_OWN = frozenset(
    {
        "world",
        "query",
        "start",
        "goal",
        "robot",
        "text",
        "problem",
        "processor",
        "time_limit",
        "memory_limit",
        "resolution_share",
    }
)
MAX_VALUES = 6  # values of one condition that are listed


def conditions_table(results: Results) -> Table:
    """Return what the runs depended on; a value that differs between problems is listed with all of its values."""
    found: dict[str, dict[str, None]] = {}
    for problem in results.problems:
        for name, value in _conditions(problem).items():
            found.setdefault(name, {})[_words(value)] = None
    rows = [[name, _joined(list(values))] for name, values in found.items()]
    rows.insert(0, ["database", results.file.name])
    return Table("Environment and limits", ["what", "value"], rows, frozenset({1}), planners=False)


def settings_table(results: Results) -> Table:
    """Return each planner's settings."""
    rows = [[name, results.settings.get(name, "") or "–"] for name in results.planners]
    return Table("Settings of the planners", ["planner", "settings"], rows, frozenset({1}))


def hash_table(results: Results) -> Table:
    """Return each problem's hash, robot, ends, limits and resolution: what it takes to pose it again."""
    columns = ["problem", "robot", "start x, y, θ", "goal x, y, θ", "limit [s]", "memory [MB]", "resolution [m]"]
    columns += ["seeds", "SHA-256 of the problem"]
    rows = []
    for problem in results.problems:
        setup = setup_of(problem)
        seeds = {int(s) for runs in problem.runs.values() for s in runs["seed"] if s == s}
        rows.append(
            [
                *(problem.name, _words(setup.get("robot", "–"))),
                *(_configuration(setup.get(end)) for end in ("start", "goal")),
                f"{problem.time_limit:g}",
                "–" if problem.memory_limit is None else f"{problem.memory_limit:g}",
                _words(setup.get("resolution", "–")),
                f"{min(seeds)} to {max(seeds)}" if seeds else "–",
                _words(setup.get("problem", "–")),
            ]
        )
    return Table("Problems", columns, rows, frozenset({1, 2, 3, 8}), planners=False)


def world_text_of(problem: Problem) -> str | None:
    """Return the problem's world file as the database keeps it; None where it does not."""
    text = setup_of(problem).get("text")
    return text if isinstance(text, str) else None


def setup_of(problem: Problem) -> dict[str, Any]:
    """Return all that the column ``setup`` holds of a problem, in one mapping."""
    parts = problem.facts["setup"]
    return {name: value for part in parts.values() if isinstance(part, dict) for name, value in part.items()}


def _conditions(problem: Problem) -> dict[str, Any]:
    found: dict[str, Any] = {
        _WORDS.get(k, k): v for k, v in problem.facts.items() if k not in ("setup", "seed", "version")
    }
    found["time limit of a run"] = f"{problem.time_limit:g} s"
    if problem.memory_limit is not None:
        found["memory limit of a run"] = f"{problem.memory_limit:g} MB"
    rest = {name: value for name, value in setup_of(problem).items() if name not in _OWN}
    return found | {name.replace("_", " "): value for name, value in rest.items()}


def _words(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {_words(v)}" for k, v in value.items())
    return value if isinstance(value, str) else json.dumps(value)


def _joined(values: list[str]) -> str:
    more = f"; and {len(values) - MAX_VALUES} more" if len(values) > MAX_VALUES else ""
    return "; ".join(values[:MAX_VALUES]) + more


def _configuration(value: object) -> str:
    if not isinstance(value, list):
        return "–"
    return ", ".join(f"{v:.4g}" if isinstance(v, int | float) else "–" for v in value)
