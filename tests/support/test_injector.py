"""The injector itself: before every line once, and nothing but what it was asked for."""

from __future__ import annotations

import sys

import pytest
from tests.support.interrupts import interrupted, lines_run

from trailmark.errors import expected_name

FILES = ["errors.py"]


def hint() -> str:
    return expected_name("solv", ["solve", "other"])


def test_every_line_in_turn() -> None:
    lines = lines_run(FILES, hint)
    assert lines == 4
    assert [interrupted(FILES, hint, k) for k in range(lines + 2)] == [True] * lines + [False] * 2
    assert lines_run(["se2.py"], hint) == 0


def test_other_exceptions_come_through_and_the_tracer_goes() -> None:
    before = sys.gettrace()

    def fails() -> None:
        hint()
        raise LookupError

    with pytest.raises(LookupError):
        interrupted(FILES, fails, 99)
    assert interrupted(FILES, fails, 0, TimeoutError)
    with pytest.raises(FileNotFoundError):
        lines_run(["no_such_file.py"], hint)
    assert sys.gettrace() is before
