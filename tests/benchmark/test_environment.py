"""What a result depends on."""

from __future__ import annotations

import re
from importlib.metadata import version

from trailmark.benchmark.environment import cpu_name, source_digest, system, versions


def test_versions_and_machine() -> None:
    assert versions()["ompl"] == version("ompl")
    assert set(versions()) >= {"Python", "trailmark", "numpy", "numba", "python-fcl"}
    assert re.fullmatch(r".+, \d+ cores", cpu_name())
    assert system()
    assert re.fullmatch("[0-9a-f]{64}", source_digest())
