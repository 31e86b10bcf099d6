"""Kernels made ready, so that time limits are those of planning."""

from __future__ import annotations

import pytest

from trailmark.planning.warmup import warm_up


@pytest.fixture(scope="session", autouse=True)
def _ready() -> None:
    warm_up()
    warm_up("translation")
