"""Public benchmark sets, read from the folders in which they are published, and worlds of graded difficulty."""

from __future__ import annotations

from trailmark.benchmark.public.base import Found, PublicSuite, evenly
from trailmark.benchmark.public.graded import CLUTTERED, PASSAGES
from trailmark.benchmark.public.nav2 import NAV2
from trailmark.benchmark.public.published import BARN, BENCH_MR, FAMILIES, MOVINGAI, OMPLAPP

__all__ = ["PUBLIC", "Found", "PublicSuite", "evenly"]

PUBLIC: dict[str, PublicSuite] = {
    suite.name: suite for suite in (MOVINGAI, OMPLAPP, NAV2, BARN, BENCH_MR, FAMILIES, CLUTTERED, PASSAGES)
}
"""Suites by the names that ``--suite`` takes."""
