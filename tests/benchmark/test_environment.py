"""What a result depends on, and how memory is counted."""

from __future__ import annotations

import re
from importlib.metadata import version

import numpy as np

from trailmark.benchmark.environment import cpu_name, source_digest, system, versions
from trailmark.benchmark.isolation.memory import MemoryPeak, address_space, heap_in_use


def test_versions_and_machine() -> None:
    assert versions()["ompl"] == version("ompl")
    assert set(versions()) >= {"Python", "trailmark", "numpy", "numba", "python-fcl"}
    assert re.fullmatch(r".+, \d+ cores", cpu_name())
    assert system()
    assert re.fullmatch("[0-9a-f]{64}", source_digest())


def test_the_heap_in_use_is_counted_at_its_most() -> None:
    peak = MemoryPeak()
    held = np.ones(2**21)  # 16 MB
    peak.measure()
    del held
    peak.measure()
    assert 15.0 < peak.highest < 40.0
    assert heap_in_use() * 2.0**20 < address_space()
