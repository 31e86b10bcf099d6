"""The errors: one family, one line each, with a hint at what was meant."""

from __future__ import annotations

import pickle
from itertools import pairwise

import pytest

from trailmark import FormatError, errors


def test_the_standard_classes_catch_them_too() -> None:
    for error in (errors.ShapeError, errors.WorldError, errors.ConfigurationError, errors.FormatError):
        assert issubclass(error, ValueError)
    assert issubclass(errors.OutputError, OSError)


def test_a_format_error_says_where() -> None:
    error = errors.FormatError("a.yaml", "bounds: missing", line=3)
    assert str(error) == "a.yaml:3: bounds: missing"
    assert (error.path, error.problem, error.line) == ("a.yaml", "bounds: missing", 3)
    assert str(errors.FormatError("a.yaml", "empty")) == "a.yaml: empty"


def test_a_close_name_is_suggested_and_all_are_listed() -> None:
    assert errors.expected_name("dor", ["door", "desk"]) == "expected desk, door, got 'dor' (did you mean 'door'?)"
    assert errors.expected_name("xyz", ["door", "desk"]) == "expected desk, door, got 'xyz'"
    assert errors.expected_name("xyz", []) == "expected nothing, got 'xyz'"


@pytest.mark.parametrize("line", [None, 7])
def test_a_format_error_comes_back_from_a_worker_process(line: int | None) -> None:
    error = FormatError("a.yaml", "no world", line)
    back = pickle.loads(pickle.dumps(error))  # noqa: S301  # what a process pool does, with our own bytes
    assert type(back) is FormatError
    assert (str(back), back.path, back.problem, back.line) == (str(error), "a.yaml", "no world", line)


def test_what_came_up_in_compiled_code_arrives_as_it_was_raised() -> None:
    def failing(*nested: BaseException) -> None:
        for outer, inner in pairwise(nested):
            outer.__cause__ = inner
        raise nested[0]

    ctrl_c = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt) as caught:
        errors.as_raised(failing)(SystemError("a result with an exception set"), ctrl_c)
    assert caught.value is ctrl_c
    with pytest.raises(TimeoutError):
        errors.as_raised(failing)(SystemError("outer"), SystemError("inner"), TimeoutError())
    # One of its own stays what it is, and so does all else.
    with pytest.raises(SystemError, match="own"):
        errors.as_raised(failing)(SystemError("own"))
    with pytest.raises(LookupError):
        errors.as_raised(failing)(LookupError(), SystemError())
    assert errors.as_raised(divmod)(7, 2) == (3, 1)


def test_a_message_is_one_line_however_long_what_was_given() -> None:
    assert str(errors.TrailmarkError("first\nsecond")) == "first second"
    error = FormatError("map.yaml", f"expected a whole number above 0, got height '{'a' * 70_000}'\n", 3)
    assert "\n" not in str(error)
    assert len(str(error)) < 1100
    assert str(error).startswith("map.yaml:3: expected a whole number above 0, got height 'aaa")
    assert str(error).endswith("aaa'")
