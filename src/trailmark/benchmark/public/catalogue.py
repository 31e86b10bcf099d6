"""The public suites by name."""

from __future__ import annotations

from pathlib import Path

from trailmark.benchmark.errors import SuiteError
from trailmark.benchmark.public.base import PublicSuite
from trailmark.benchmark.public.bench_mr import BenchMR
from trailmark.benchmark.public.graded import Clutter, Passages
from trailmark.benchmark.public.nav2 import ExploreBench, Nav2
from trailmark.benchmark.public.published import Barn, Families, MovingAI, OmplApp

__all__ = ["PUBLIC", "folder_of"]

PUBLIC: dict[str, PublicSuite] = {
    suite.name: suite
    for suite in (
        MovingAI(),
        OmplApp(),
        Nav2(),
        Barn(),
        BenchMR(),
        Families(),
        ExploreBench(),
        Clutter(),
        Passages(),
    )
}
"""Suites by the names that ``--suite`` takes."""


def folder_of(suite: PublicSuite, given: str | None) -> Path:
    """Return the folder in which a suite's data lies.

    Raises:
        SuiteError: none is given for a suite that needs one, one is given for a suite that is made, or it is none.
    """
    if not suite.published:
        if given is not None:
            raise SuiteError(f"suite {suite.name}: expected no --data, for its worlds are made, got {given!r}")
        return Path()
    if given is None:
        raise SuiteError(f"suite {suite.name}: --data is missing; expected a folder with {suite.expected}")
    folder = Path(given)
    try:
        there = folder.is_dir()
    except OSError:  # no folder can have that name
        there = False
    if not there:
        raise SuiteError(f"--data: expected a folder with {suite.expected}, got {given!r}")
    return folder
