"""Which layers a picture shows, in Python and in the shell."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from trailmark.errors import ConfigurationError
from trailmark.shown import ALL, Layers


def test_names_change_the_default_and_a_list_shows_nothing_else() -> None:
    assert Layers.of({}) == ALL
    assert asdict(Layers.of({"margin": False, "clearance": True})) == asdict(ALL) | {"margin": False, "clearance": True}
    shown = asdict(Layers.parse("obstacles, path"))
    assert {name for name, value in shown.items() if value} == {"obstacles", "path"}


@pytest.mark.parametrize("text", ["", "pth", "path,,ends", "all"])
def test_unknown_names_and_other_values_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"^layers: expected clearance, edges, .*got "):
        Layers.parse(text)
    with pytest.raises(ConfigurationError, match="layers: path: expected True or False, got 'no'"):
        Layers.of({"path": "no"})  # type: ignore[dict-item]  # what the test is about
