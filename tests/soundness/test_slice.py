"""A slice of the campaign: every part, until some count is reached."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from benchmarks.soundness.campaign import run_chunk
from benchmarks.soundness.parts import PARTS

CHUNKS = {"states": 1, "motions": 1, "curves": 1, "paths": 2, "carved": 2, "bounds": 3, "angles": 1, "scales": 1}
"""Chunks of each part, so that each kind of case comes once: cars among paths, scenes among bounds."""


def run(part: str, chunk: int, seed: int, folder: Path) -> dict[str, Any]:
    """Run a chunk in this process: one of the campaign's own would load all kernels once more."""
    task = {"part": part, "chunk": chunk, "seed": seed, "folder": str(folder), "version": "test"}
    return run_chunk(task, folder / "asking.pickle")


@pytest.mark.slow
@pytest.mark.parametrize("part", list(PARTS))
def test_nothing_certified_is_wrong(part: str, tmp_path: Path) -> None:
    counts = 0
    for chunk in range(CHUNKS[part]):
        outcome = run(part, chunk, 2026, tmp_path)
        assert outcome["wrong"] == {}, outcome
        counts += outcome["counts"].get(PARTS[part].counts, 0)
    assert counts > 0


@pytest.mark.slow
def test_the_same_chunk_asks_the_same(tmp_path: Path) -> None:
    first = run("motions", 5, 1, tmp_path)
    assert first["counts"]["grazing motions"] > 10
    assert run("motions", 5, 1, tmp_path) == first
