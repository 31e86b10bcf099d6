"""How the words of the command line are read."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark import plotting
from trailmark.cli import options

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(finite, finite, st.floats(-6.28, 6.28))
def test_any_finite_configuration_is_read_as_written(x: float, y: float, theta: float) -> None:
    assert options.read_configuration(f"{x!r},{y!r},{theta!r}", "--start") == (x, y, theta)


@given(finite, st.floats(-360.0, 360.0))
def test_headings_may_be_in_degrees(x: float, degrees: float) -> None:
    expected = (x, 1.0, math.radians(degrees))
    for text in (f"{degrees!r}deg", f" {degrees!r} deg "):
        assert options.read_configuration(f"{x!r},1,{text}", "--start") == expected


def test_pictures_are_those_that_plotting_writes() -> None:
    assert options.PICTURE_SUFFIXES == plotting.PICTURE_SUFFIXES


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "1e999", "", "1s"])
def test_anything_but_positive_finite_seconds_is_refused(text: str) -> None:
    assert options.read_duration("1e-3", "--time-limit") == 0.001
    with pytest.raises(options.UsageError, match="seconds above 0"):
        options.read_duration(text, "--time-limit")
