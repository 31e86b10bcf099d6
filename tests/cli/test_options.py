"""How the words of the command line are read."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trailmark import plotting
from trailmark.cli import options

finite = st.floats(allow_nan=False, allow_infinity=False)


@given(finite, finite, finite)
def test_any_finite_configuration_is_read_as_written(x: float, y: float, theta: float) -> None:
    assert options.read_configuration(f"{x!r},{y!r},{theta!r}", "--start") == (x, y, theta)


@given(finite, st.floats(-720.0, 720.0))
def test_headings_may_be_in_degrees(x: float, degrees: float) -> None:
    expected = (x, 1.0, math.radians(degrees))
    for text in (f"{degrees!r}deg", f" {degrees!r} deg "):
        assert options.read_configuration(f"{x!r},1,{text}", "--start") == expected


@pytest.mark.parametrize("text", ["1,2,deg", "1,2,90degrees", "1,90deg,2", "1,2,90deg5", "1,2,nandeg", "1,2,90°"])
def test_no_degrees(text: str) -> None:
    with pytest.raises(options.UsageError, match=r"expected X,Y,T, finite numbers .*, or degrees such as 90deg"):
        options.read_configuration(text, "--start")


@pytest.mark.slow
@given(st.text(max_size=30))
def test_other_text_is_a_usage_error_that_quotes_it(text: str) -> None:
    try:
        values = [float(word) for word in text.split(",")]
    except ValueError:
        values = []
    if len(values) == 3 and all(map(math.isfinite, values)):
        assert options.read_configuration(text, "--goal") == tuple(values)
        return
    with pytest.raises(options.UsageError) as caught:
        options.read_configuration(text, "--goal")
    assert caught.value.format_message().startswith("expected X,Y,T, finite numbers")


@pytest.mark.parametrize(("text", "count"), [("0", 0), ("7", 7), (" 7 ", 7), ("4294967295", 2**32 - 1)])
def test_counts(text: str, count: int) -> None:
    assert options.read_count(text, "--seed", 0) == count


@pytest.mark.parametrize("text", ["-1", "1.0", "", "4294967296", "1e3", "9" * 5000])
def test_no_counts(text: str) -> None:
    with pytest.raises(options.UsageError, match="expected an integer from 0 to 4294967295"):
        options.read_count(text, "--seed", 0)


@pytest.mark.parametrize(("text", "seconds"), [("1", 1.0), ("0.25", 0.25), ("1e-3", 0.001)])
def test_durations(text: str, seconds: float) -> None:
    assert options.read_duration(text, "--time-limit") == seconds


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "-inf", "1e999", "", "1s"])
def test_no_durations(text: str) -> None:
    with pytest.raises(options.UsageError, match="expected a finite number of seconds above 0"):
        options.read_duration(text, "--time-limit")


def test_pictures_are_those_that_plotting_writes() -> None:
    assert options.PICTURE_SUFFIXES == plotting.PICTURE_SUFFIXES
