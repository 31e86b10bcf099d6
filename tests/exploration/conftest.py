"""Fixtures shared by the tests of explorations."""

from __future__ import annotations

from typing import Any

import pytest

from trailmark.exploration.background import Background


class Waited(Background):
    """Each piece of work is waited for: where the robot goes does not hang on how fast the machine is."""

    def outcome(self, until: float) -> Any:
        return super().outcome(until + 60.0)


@pytest.fixture
def waited(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no reading be taken while a way is looked for, or cells are divided."""
    monkeypatch.setattr("trailmark.exploration.course.Background", Waited)
