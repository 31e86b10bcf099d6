"""Damaged files: readers refuse them by trailmark's errors, in one line, with little memory and time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from benchmarks.fuzzing.targets import TARGETS
from benchmarks.soundness.workers import Worker
from tests.helpers.fuzzed import attack_if_available
from tests.helpers.trials import few

COUNT = few(12)
"""Damaged files for each reader: seconds in all; ``python -m benchmarks.fuzz`` takes as long as it is given."""


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    worker = Worker(attack_if_available, tmp_path_factory.mktemp("fuzz") / "asking.pickle", seconds=120.0)
    yield worker
    worker.close()


@pytest.mark.parametrize("name", list(TARGETS))
def test_damaged_files_are_refused_in_one_line(name: str, worker: Worker) -> None:
    count = 1 if name == "bag as MCAP" else COUNT  # whose metadata rosbags reads for a second
    outcome = worker.do({"target": name, "seed": 0, "count": count})
    assert outcome.problem is None, outcome.asking
    if outcome.value is None:
        pytest.skip("real data not found, or an extra is not installed")
    read, refused, found = outcome.value
    assert [finding.problem for finding in found] == []
    assert read + refused == count
