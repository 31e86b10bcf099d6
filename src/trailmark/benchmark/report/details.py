"""What the page shows of a single problem: its tables, its world with the planners' paths, its costs over time."""

# Tested by tests/benchmark/report/test_details.py.
from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from trailmark.benchmark.report.conditions import hash_table, world_text_of
from trailmark.benchmark.report.curves import cost_quartiles, time_grid
from trailmark.benchmark.report.data import FloatArray, Problem, Results
from trailmark.benchmark.report.payload import cost_steps, stairs
from trailmark.benchmark.report.tables import Table, effort_table, failure_table, problem_table
from trailmark.benchmark.report.worlds import Worlds

__all__ = ["MAX_BYTES", "details"]

MAX_BYTES = 1_000_000
"""Compressed, that the details of all problems take; those that come after it are left out, and the page says so."""

MOMENTS = 40  # of a curve of cost over time
REFUSED = 3  # paths drawn that the referee did not accept


def details(results: Results) -> dict[str, Any]:
    """Return the details of each problem, None for those that do not fit, and the pictures of their worlds.

    Problems in one world share its picture.
    """
    worlds = Worlds()
    found: list[dict[str, Any] | None] = []
    size = 0
    known = hash_table(results)
    for problem, facts in zip(results.problems, known.rows, strict=True):
        if size > MAX_BYTES:
            found.append(None)
            continue
        before = len(worlds.pictures)
        shown = _detail(results, problem, worlds) | {"facts": list(zip(known.columns[1:], facts[1:], strict=True))}
        size += len(zlib.compress(json.dumps([shown, worlds.pictures[before:]]).encode()))
        found.append(shown)
    return {"problems": found, "worlds": worlds.pictures}


def _detail(results: Results, problem: Problem, worlds: Worlds) -> dict[str, Any]:
    where = problem.name
    failures = failure_table(problem, f"{where}: what failed or refused runs gave as the reason")
    return {
        "table": _plain(problem_table(problem, f"{where}: p tells whether a planner differs from the best (Holm)")),
        "effort": _plain(effort_table(problem, f"{where}: what the runs took, medians over all runs")),
        "failures": None if failures is None else _plain(failures),
        "curves": _curves(problem, results.planners),
        "scene": _scene(results, problem, worlds),
    }


def _plain(table: Table) -> dict[str, Any]:
    return {
        "caption": table.caption,
        "columns": list(table.columns),
        "rows": [list(row) for row in table.rows],
        "texts": sorted(table.texts),
    }


def _curves(problem: Problem, planners: Sequence[str]) -> dict[str, Any] | None:
    """Return the quartiles of each planner's cost over time; None where nothing is solved."""
    if not 0.0 < problem.best_cost < np.inf:
        return None
    times = time_grid([problem], MOMENTS)
    cells = [
        [stairs(cost_steps(problem, row)) for row in cost_quartiles(problem.runs[name], times)]
        if name in problem.runs
        else None
        for name in planners
    ]
    return {"times": [float(f"{t:.4g}") for t in times], "cells": cells}


def _scene(results: Results, problem: Problem, worlds: Worlds) -> dict[str, Any] | None:
    """Return the world with the path of each planner's middle run; None where it cannot be drawn."""
    text = world_text_of(problem)
    drawn = worlds.scene(text) if text else None
    if drawn is None:
        return None
    scene, world = drawn
    middle = {name: int(runs.ids[i]) for name, runs in problem.runs.items() if (i := _middle(runs.costs)) is not None}
    wrong = [int(i) for runs in problem.runs.values() for i in runs.ids[runs.claimed & ~runs.success]][:REFUSED]
    best = _best(problem)
    paths = results.paths([*middle.values(), *wrong, *([] if best is None else [best])])
    lines = {key: scene.line(states) for key, states in paths.items()}
    return {
        "world": world,
        "size": [round(length, 1) for length in scene.size],
        "ends": scene.ends(),
        "paths": [lines.get(middle[name]) if name in middle else None for name in results.planners],
        "bodies": scene.bodies(paths[best]) if best in paths else "",
        "refused": [lines[key] for key in wrong if key in lines],
    }


def _middle(costs: FloatArray) -> int | None:
    """Return which run has the middle cost of those that succeeded; None if none did."""
    order = np.argsort(costs, kind="stable")[: int(np.isfinite(costs).sum())]
    return int(order[(len(order) - 1) // 2]) if len(order) else None


def _best(problem: Problem) -> int | None:
    """Return the id of the run whose returned path is the best; None if none is correct."""
    found = [(float(runs.costs.min()), int(runs.ids[runs.costs.argmin()])) for runs in problem.runs.values()]
    cost, key = min(found)
    return key if np.isfinite(cost) else None
