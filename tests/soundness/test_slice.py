"""A slice of the campaign: every part, until some count is reached."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from benchmarks.soundness.campaign import run_chunk
from benchmarks.soundness.parts import PARTS
from benchmarks.soundness.workers import Worker

CHUNKS = {"states": 1, "motions": 1, "curves": 1, "paths": 2, "carved": 2, "bounds": 3, "angles": 1, "scales": 1}
"""Chunks of each part, so that each kind of case comes once: cars among paths, scenes among bounds."""


@pytest.fixture(scope="module")
def worker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Worker]:
    worker = Worker(run_chunk, tmp_path_factory.mktemp("slice") / "asking.pickle", seconds=300.0)
    yield worker
    worker.close()


@pytest.mark.slow
@pytest.mark.parametrize("part", list(PARTS))
def test_nothing_certified_is_wrong(part: str, worker: Worker, tmp_path: Path) -> None:
    counts = 0
    for chunk in range(CHUNKS[part]):
        task = {"part": part, "chunk": chunk, "seed": 2026, "folder": str(tmp_path), "version": "test"}
        outcome = worker.do(task)
        assert outcome.problem is None, outcome.asking
        assert outcome.value["wrong"] == {}, outcome.value
        counts += outcome.value["counts"].get(PARTS[part].counts, 0)
    assert counts > 0


@pytest.mark.slow
def test_the_same_chunk_asks_the_same(worker: Worker, tmp_path: Path) -> None:
    task = {"part": "motions", "chunk": 5, "seed": 1, "folder": str(tmp_path), "version": "test"}
    assert worker.do(task).value == worker.do(task).value
