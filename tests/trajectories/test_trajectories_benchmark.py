"""The benchmark of smooth paths and trajectories, on a few paths; TOPP-RA is another program's, and may be missing."""

from __future__ import annotations

import pytest
from benchmarks.trajectories import KINDS, judged, report


@pytest.mark.slow
def test_smooth_paths_pass_and_limits_hold() -> None:
    found = [judged(seed, kind, 1) for seed, kind in enumerate(KINDS)]
    assert [item["faults"] for item in found] == [[]] * len(KINDS)
    assert sum(item["stops"] for item in found) < sum(item["corners"] for item in found)
    for item in found:
        for _, beyond, duration, other, _ in item["timed"]:
            assert beyond <= 1.0 + 1e-6
            assert other is None or abs(duration / other - 1.0) < 0.01
    assert "1 of 1" in report(found)
