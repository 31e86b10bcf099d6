"""What once had a wrong answer, asked again; in a process of its own, which may die of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from benchmarks.soundness.campaign import ask_case
from benchmarks.soundness.workers import Worker

CASES = sorted(path.parent for path in (Path(__file__).parent / "cases").glob("*/question.json"))


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    worker = Worker(ask_case, tmp_path_factory.mktemp("cases") / "asking.pickle", seconds=300.0)
    yield worker
    worker.close()


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Path, worker: Worker) -> None:
    outcome = worker.do(str(case))
    assert (outcome.problem or outcome.value) is None
