"""Small problems, and a database with runs in it."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.helpers.runs import ahead, around, experiment, solved

from trailmark.benchmark.record import RunRecord, Status
from trailmark.benchmark.store import Store

__all__ = ["ahead", "around", "database"]


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """A database with one experiment: two planners, two seeds, one run that failed."""
    file = tmp_path / "results.db"
    with Store(file) as store:
        row = store.experiment(**experiment())
        landmark, prm = store.planner("landmark", "default"), store.planner("PRM", "discrete")
        for seed in (0, 1):
            store.add(row, landmark, solved(seed))
        store.add(row, prm, solved(0, solution_length=None, curve=[]))
        store.add(row, prm, RunRecord(status=int(Status.CRASH), seed=1, time=0.5, failure="SIGSEGV; really\nso"))
    return file
