"""Objective: names, weights, and what is refused."""

from __future__ import annotations

import pytest

from trailmark import ConfigurationError, Objective


def test_the_default_is_the_length() -> None:
    assert Objective.of(None) == Objective.of("length") == Objective()
    assert Objective().rotation == 0.5


def test_time_charges_a_turn_by_its_rate() -> None:
    objective = Objective.of("time", max_speed=0.5, max_turn_rate=2.0)
    assert (objective.length, objective.time, objective.max_speed) == (0.0, 1.0, 0.5)
    assert objective.rotation == 0.5


def test_a_weighted_sum_is_read() -> None:
    assert Objective.of("length=1, clearance=2.5") == Objective(length=1.0, clearance=2.5)
    assert Objective.of("time=2") == Objective(length=0.0, time=2.0)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("lenght", "expected clearance, length, time, got 'lenght'"),
        ("height=1", "got 'height'"),
        ("length=far", "length: expected a number, got 'far'"),
        ("clearance=2", "a weight of length or of time above 0"),
        ("length=-1", "expected a finite number of 0 or more"),
        ("length=1, length=2", "expected each weight once, got 'length=1, length=2'"),
        ("length=1,reverse=0.5", "reverse: expected a finite number of 1 or more"),
        (3, "expected an Objective or a name, got 3"),
    ],
)
def test_what_is_no_objective_is_refused_in_one_line(given: object, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message) as caught:
        Objective.of(given)  # type: ignore[arg-type]  # on purpose
    assert "\n" not in str(caught.value)
