"""``trailmark report``: files written whole or not at all, and bad input in one line."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from tests.helpers.made_results import random_results

Shell = Callable[..., Any]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return random_results(tmp_path / "results.db", ["landmark", "PRM"], problems=1, runs=3)


def test_the_summary_is_printed_and_the_page_written(shell: Shell, results: Path, tmp_path: Path) -> None:
    page = tmp_path / "report.html"
    before = results.read_bytes()
    run = shell("report", results)
    assert (run.status, run.err) == (0, "")
    assert [line.split()[0] for line in run.out.splitlines()[:3]] == ["planner", "landmark", "PRM"]
    again = shell("report", results, "--html", page)
    assert again.out == run.out + f"written: {page} (1 problems, 2 planners, 6 runs)\n"
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert results.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "results.db"]


def test_bad_usage_is_one_line(shell: Shell, results: Path, tmp_path: Path) -> None:
    cases: list[tuple[list[object], str]] = [
        ([results, "--html", tmp_path / "report.pdf"], "suffix: expected .htm, .html, got '.pdf'"),
        ([results, "--html", tmp_path / "nowhere" / "r.html"], "does not exist"),
        ([results, "--html", tmp_path], "suffix: expected .htm, .html, got ''"),
        ([tmp_path / "none.db", "--html", tmp_path / "r.html"], "does not exist"),
        (["--html", tmp_path / "r.html"], "Missing argument 'RESULTS.db'"),
    ]
    for words, problem in cases:
        run = shell("report", *words)
        assert run.status == 2
        assert problem in run.problem
    assert [file.name for file in tmp_path.iterdir()] == ["results.db"]


def test_an_unwritable_folder_is_one_line(shell: Shell, results: Path) -> None:
    run = shell("report", results, "--html", "/proc/report.html")
    assert run.status == 2
    assert run.problem.startswith("/proc/report.html: cannot be written")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"", "empty database"),
        (b"name,time\nPRM,0.1\n", "not an SQLite database"),
        (b"SQLite format 3\0junk", "cannot be read"),
    ],
)
def test_files_that_are_no_database(shell: Shell, tmp_path: Path, content: bytes, problem: str) -> None:
    file = tmp_path / "results.db"
    file.write_bytes(content)
    run = shell("report", file, "--html", tmp_path / "r.html")
    assert run.status == 2
    assert problem in run.problem
    assert [f.name for f in tmp_path.iterdir()] == ["results.db"]


@pytest.mark.parametrize("change", ["PRAGMA user_version = 2", "PRAGMA application_id = 0", "DELETE FROM runs"])
def test_databases_that_hold_no_results(shell: Shell, results: Path, tmp_path: Path, change: str) -> None:
    with closing(sqlite3.connect(results)) as db, db:
        db.execute(change)
    run = shell("report", results, "--html", tmp_path / "r.html")
    assert run.status == 2
    assert "expected " in run.problem
    assert not (tmp_path / "r.html").exists()
