"""Checked arguments, fields and options that switch layers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from decimal import Decimal
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from trailmark.arguments import (
    Count,
    Finite,
    NonNegative,
    Numbers,
    Positive,
    PositiveOrInfinite,
    Probability,
    RandomState,
    Share,
    checked,
    checked_arguments,
    checked_fields,
)
from trailmark.errors import ConfigurationError
from trailmark.shown import ALL, Layers

Colour = Literal["red", "green"]


@pytest.mark.parametrize(
    ("hint", "value", "found"),
    [
        (Positive, Decimal("0.5"), 0.5),
        (PositiveOrInfinite, np.inf, np.inf),
        (NonNegative, np.float32(0.0), 0.0),
        (Finite, np.array(-2), -2.0),
        (Count, 3.0, 3),
        (Share, 1, 1.0),
        (int, np.uint8(7), 7),
        (bool, np.True_, True),
        (float, np.inf, np.inf),
        (str, "a", "a"),
        (Colour, "red", "red"),
        (Colour | None, None, None),
        (Positive | Literal["auto"], "auto", "auto"),
        (tuple[Finite, Finite], [1, 2], (1.0, 2.0)),
        (Sequence[int | str], (1, "a"), (1, "a")),
        (Callable[[], None], print, print),
        (Any, print, print),
    ],
)
def test_what_is_allowed_comes_out_as_it_is_used(hint: Any, value: Any, found: Any) -> None:
    result = checked(value, hint, "x", ConfigurationError)
    assert result == found
    assert type(result) is type(found)


@pytest.mark.parametrize(
    ("hint", "value", "said"),
    [
        (Positive, 0.0, "x: expected a finite number above 0, got 0.0"),
        (Positive, "1", "x: expected a finite number above 0, got '1'"),
        (Probability, 1, "x: expected a number above 0 and below 1, got 1"),
        (Count, 1.5, "x: expected a whole number of 1 or more, got 1.5"),
        (float, np.nan, "x: expected a number, got nan"),
        (bool, 1, "x: expected True or False, got 1"),
        (Colour, "gren", r"x: expected green, red, got 'gren' \(did you mean 'green'\?\)"),
        (Colour, 3, "x: expected 'red' or 'green', got 3"),
        (tuple[Finite, Finite], (1.0,), r"x: expected 2 times a finite number, got \(1.0,\)"),
        (Sequence[int], {1, 2}, "x: expected a sequence of a whole number, got {1, 2}"),
        (Mapping[str, int], {"a": "b"}, "x: expected a dictionary of a whole number, got {'a': 'b'}"),
        (Callable[[], None], 3, "x: expected a function, got 3"),
        (Numbers, [np.nan], r"x: expected an array of finite numbers, got \[nan\]"),
        (RandomState, 0.5, "x: expected a whole number of 0 or more or Generator or None, got 0.5"),
    ],
)
def test_the_rest_is_told_in_one_line(hint: Any, value: Any, said: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{said}$"):
        checked(value, hint, "x", ConfigurationError)


@dataclass(frozen=True)
class Settings:
    kind: ClassVar[str] = "settings"
    speed: Positive = 1.0
    place: tuple[Finite, Finite] = (0.0, 0.0)

    def __post_init__(self) -> None:
        checked_fields(self, ConfigurationError)


def test_fields() -> None:
    settings = Settings(np.float32(2.0), (1, 2))  # type: ignore[arg-type]  # numpy's numbers are numbers
    assert settings == Settings(2.0, (1.0, 2.0))
    assert type(settings.speed) is float
    with pytest.raises(ConfigurationError, match=r"^Settings: speed: expected a finite number above 0, got -1$"):
        Settings(-1)


@checked_arguments(ConfigurationError)
def area(length: Positive, width: Positive = 1.0, *, unit: str | None = None) -> str:
    return f"{length * width:g}{unit or ''}"


def test_arguments() -> None:
    assert area(2, width=3.0, unit="m2") == "6m2"
    with pytest.raises(ConfigurationError, match=r"^area: width: expected a finite number above 0, got 'wide'$"):
        area(1.0, "wide")  # type: ignore[arg-type]  # the point
    with pytest.raises(TypeError):
        area()  # type: ignore[call-arg]  # a mistake in the program, not in its input


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
