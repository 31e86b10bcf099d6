"""Kernels made ready, so that time limits are those of planning, and nothing is told of compiling."""

from __future__ import annotations

import pytest

from trailmark.planning.warmup import warm_up

__all__ = ["ready"]


@pytest.fixture(scope="session", autouse=True)
def ready() -> None:
    warm_up()
    warm_up("translation")
