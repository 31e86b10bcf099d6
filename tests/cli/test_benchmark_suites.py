"""``trailmark benchmark --suite NAME --data DIR``."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

Shell = Callable[..., Any]
HONEST = "tests.benchmark.rogues:honest"


def names(file: Path) -> list[str]:
    with closing(sqlite3.connect(file)) as db:
        return [row[0] for row in db.execute("SELECT name FROM experiments ORDER BY id")]


def test_the_public_suites_are_listed_with_where_they_are_published(shell: Shell) -> None:
    run = shell("benchmark", "--list-suites")
    assert (run.status, run.err) == (0, "")
    listed = [line for line in run.out.splitlines() if not line.startswith(" ")]
    assert listed == [
        *("movingai", "omplapp", "nav2", "barn", "bench-mr", "families", "explore-bench", "clutter", "passages")
    ]
    assert run.out.count("  published: ") == 7
    assert "github.com/Daffan/the-barn-challenge" in run.out


@pytest.mark.slow
def test_a_part_of_a_public_suite_is_run(
    shell: Shell, shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = Path(__file__).resolve().parents[2]
    monkeypatch.setenv("PYTHONPATH", f"{root}:{root / 'src'}")
    results = tmp_path / "results.db"
    words = ["benchmark", "--suite", "barn", "--data", shared_data / "barn", "-p", HONEST, "--runs", 1]
    run = shell(*words, "--problems", 2, "--time-limit", 0.1, "--output", results)
    assert (run.status, run.err) == (0, "")
    assert names(results) == ["barn-world_0-ahead", "barn-world_299-ahead"]
