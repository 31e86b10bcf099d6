"""Pace: expectations follow what was measured, whatever was guessed."""

from __future__ import annotations

import pytest

from trailmark.planning.pace import Pace


def test_a_guess_is_for_this_machine_and_in_proportion_to_the_work() -> None:
    pace = Pace(1e-6)
    assert 0.0 < pace.seconds(1.0) < 1e-3
    assert pace.seconds(10.0) == pytest.approx(10.0 * pace.seconds(1.0))


def test_expectations_come_to_what_is_measured() -> None:
    pace = Pace(1.0)
    for _ in range(60):
        pace.note(100.0, 0.5)
    assert pace.seconds(200.0) == pytest.approx(1.0, rel=1e-3)
    pace.note(0.0, 5.0)
    assert pace.seconds(200.0) == pytest.approx(1.0, rel=1e-3)


def test_a_process_that_was_suspended_is_not_slow_ever_after() -> None:
    pace = Pace(1e-6)
    guess = pace.seconds(1.0)
    for _ in range(9):
        pace.note(10_000.0, 3600.0)
    assert guess < pace.seconds(1.0) < 4.0 * guess


def test_work_that_is_over_at_once_says_nothing() -> None:
    pace = Pace(1e-6)
    guess = pace.seconds(1.0)
    for _ in range(9):
        pace.note(10.0, 0.01)
    assert pace.seconds(1.0) == guess


def test_what_was_measured_is_forgotten() -> None:
    pace, other = Pace(1e-6), Pace(2e-6)
    before = pace.seconds(1.0), other.seconds(1.0)
    pace.note(1e5, 10.0)
    other.note(1e5, 20.0)
    assert pace.seconds(1.0) != before[0]
    assert other.seconds(1.0) != before[1]
    Pace.forget_all()
    assert (pace.seconds(1.0), other.seconds(1.0)) == before
