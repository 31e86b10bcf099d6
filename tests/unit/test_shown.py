"""Which layers a picture shows."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import pytest

from trailmark.errors import ConfigurationError
from trailmark.shown import ALL, Layers


def test_names_change_the_default() -> None:
    assert Layers.of({}) == ALL
    assert asdict(Layers.of({"margin": False, "clearance": True})) == asdict(ALL) | {"margin": False, "clearance": True}


@pytest.mark.parametrize(
    ("chosen", "problem"),
    [
        *(({name: True}, "layers: expected clearance, edges, .*got ") for name in ("", "pth", "all")),
        ({"path": "no"}, "layers: path: expected True or False, got 'no'"),
    ],
)
def test_unknown_names_and_other_values_are_refused(chosen: Any, problem: str) -> None:
    with pytest.raises(ConfigurationError, match=problem):
        Layers.of(chosen)
