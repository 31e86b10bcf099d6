"""Plain data as the models of :mod:`trailmark.formats.schema`, or one line that says what is wrong with it."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from trailmark.errors import FormatError
from trailmark.formats import schema

__all__ = ["validate"]

_GOALS = {"a pose", "one goal", "several goals"}
_TAGS = {"disc", "polygon", "rectangle", "cost", "keep-out", "one-way", "speed"} | _GOALS
"""What pydantic puts into a place beside keys and indices: which kind of an entry it is."""
_KEYS = {
    name
    for model in vars(schema).values()
    if isinstance(model, type) and issubclass(model, BaseModel)
    for name in model.model_fields
}

ModelT = TypeVar("ModelT", bound=BaseModel)

_short = reprlib.Repr()
_short.maxstring = 60
_short.maxlist = _short.maxdict = 5
_short.maxlevel = 3


def validate(model: type[ModelT], data: dict[str, Any], path: Path) -> ModelT:
    """Return the data as a model.

    Args:
        model: :class:`.schema.WorldFile`, :class:`.schema.MapFile` or :class:`.schema.RobotFile`.
        data: plain data, as :func:`trailmark.formats.yaml_data.parse_yaml` gives it.
        path: the file it came from, for messages.

    Raises:
        FormatError: the data breaks the model's rules; the message names the first field that does, what pydantic says
            of it and its value, and how many more there are.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        # An unknown key goes first: a key that is missing elsewhere is often the same one, misspelt.
        problems = sorted(error.errors(include_url=False), key=lambda e: e["type"] != "extra_forbidden")
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise FormatError(path, _describe(problems[0]) + more) from None


def _describe(problem: Any) -> str:
    *before, last = problem["loc"]
    # Who made up a key may have given it the name of a tag, but for those of goals, which hold a blank.
    where = _where([*(part for part in before if part not in _TAGS), *([] if last in _GOALS else [last])])
    if problem["type"] == "extra_forbidden":
        close = get_close_matches(str(last), _KEYS, n=1)
        return f"{where}: unknown key" + (f" (did you mean {close[0]!r}?)" if close else "")
    message = problem["msg"][0].lower() + problem["msg"][1:]
    return f"{where}: {message}" + ("" if problem["type"] == "missing" else f", got {_short.repr(problem['input'])}")


def _where(location: Sequence[str | int]) -> str:
    # A key that someone made up may hold anything: what is no plain name is quoted and cut.
    named = (part if isinstance(part, int) or part.isidentifier() else _short.repr(part) for part in location)
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in named).removeprefix(".")
