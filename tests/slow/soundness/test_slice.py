"""A slice of the campaign: every part, a few chunks of each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from benchmarks.soundness.campaign import run_chunk
from benchmarks.soundness.parts import PARTS
from tests.helpers.trials import thorough

CHUNKS: dict[str, tuple[int, ...]] = {
    "states": (3,),
    "motions": (0,),
    "curves": (0,),
    "paths": (5,),
    "carved": (0, 1),
    "bounds": (0, 1, 3),
    "angles": (0,),
    "scales": (7,),
    "clearances": (0, 1, 2),
    "zones": (0,),
    "touches": (0,),
}
"""Chunks of each part, so that each kind of case comes once: paths of cars among scales, scenes among bounds.

Of those that have it, the ones that take the least time.
"""

MORE: dict[str, tuple[int, ...]] = {"paths": (0, 1, 31), "bounds": (2,), "scales": (0, 2)}
"""Where all trials are asked for."""


def run(part: str, chunk: int, seed: int, folder: Path) -> dict[str, Any]:
    """Run a chunk in this process: one of the campaign's own would load all kernels once more."""
    task = {"part": part, "chunk": chunk, "seed": seed, "folder": str(folder), "version": "test"}
    return run_chunk(task, folder / "asking.pickle")


@pytest.mark.parametrize("part", list(PARTS))
def test_nothing_certified_is_wrong(part: str, tmp_path: Path) -> None:
    counts = 0
    for chunk in CHUNKS[part] + (MORE.get(part, ()) if thorough() else ()):
        outcome = run(part, chunk, 2026, tmp_path)
        assert outcome["wrong"] == {}, outcome
        counts += outcome["counts"].get(PARTS[part].counts, 0)
    assert counts > 0
