"""How the memory of a run is counted."""

from __future__ import annotations

import numpy as np

from trailmark.benchmark.isolation.memory import MemoryPeak, address_space, heap_in_use


def test_the_heap_in_use_is_counted_at_its_largest() -> None:
    peak = MemoryPeak()
    array = np.ones(2**21)  # 16 MB
    peak.measure()
    del array
    peak.measure()
    assert 15.0 < peak.highest < 40.0
    assert heap_in_use() * 2.0**20 < address_space()
