"""``trailmark report``: files written whole or not at all, and bad input in one line."""

from __future__ import annotations

from collections.abc import Callable
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
    assert again.out == run.out + f"written: {page} (1 problem, 2 planners, 6 runs)\n"
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert results.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["report.html", "results.db"]
