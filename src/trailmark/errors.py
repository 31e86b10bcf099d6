"""The exceptions that trailmark raises on misuse and on bad input.

Every one derives from :class:`TrailmarkError`, so that a program can catch them all at once; the shell turns
each into one line on stderr and exit status 2. "No path found" is not an error but a value: see
:class:`trailmark.planning.PlanResult`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = [
    "ConfigurationError",
    "FormatError",
    "InputWarning",
    "InternalErrorWarning",
    "OutputError",
    "ShapeError",
    "TrailmarkError",
    "WorldError",
    "as_raised",
    "expected_name",
]

P = ParamSpec("P")
R = TypeVar("R")

LONGEST = 1000
"""Characters of a message at most: what was given may be a whole file on one line."""


class TrailmarkError(Exception):
    """Base class of all errors that trailmark raises on purpose. The message is one line."""

    def __str__(self) -> str:
        text = " ".join(super().__str__().splitlines())
        # What was expected stands at the beginning, what was given at the end.
        return text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"


class ShapeError(TrailmarkError, ValueError):
    """A shape that bounds no region: zero area, self-intersection, a radius that is not positive, NaN."""


class WorldError(TrailmarkError, ValueError):
    """A world that contradicts itself: empty bounds, two queries of one name, a query that is not there."""


class ConfigurationError(TrailmarkError, ValueError):
    """A configuration that cannot be used: wrong array shape, not finite, in collision, out of bounds."""


class FormatError(TrailmarkError, ValueError):
    """A file that cannot be read as what it claims to be.

    Args:
        path: the file, as the user named it.
        problem: what is wrong and what is allowed, in one line.
        line: 1-based line number, where known.
    """

    def __init__(self, path: object, problem: str, line: int | None = None) -> None:
        self.path = str(path)
        self.problem = problem
        self.line = line
        where = self.path if line is None else f"{self.path}:{line}"
        super().__init__(f"{where}: {problem}")

    def __reduce__(self) -> tuple[type[FormatError], tuple[str, str, int | None]]:
        # An exception is made anew from its message alone, which is not how this one is made: it would not come
        # back from a worker process.
        return type(self), (self.path, self.problem, self.line)


class InternalErrorWarning(UserWarning):
    """An error of trailmark's own, found before it did harm; the message says where what reproduces it was written."""


class InputWarning(UserWarning):
    """An input that is allowed and yet looks wrong, such as a heading in degrees; the message says how it is read."""


class OutputError(TrailmarkError, OSError):
    """An output path that cannot be written."""


def expected_name(name: str, known: Iterable[str]) -> str:
    """Return ``expected a, b, got 'c'``, followed by the known name that is closest, if any is close."""
    names = sorted(known)
    close = get_close_matches(name, names, n=1)
    hint = f" (did you mean {close[0]!r}?)" if close else ""
    return f"expected {', '.join(names) if names else 'nothing'}, got {name[:60]!r}{hint}"


def as_raised(function: Callable[P, R]) -> Callable[P, R]:
    """Return the function with exceptions that come up on the way into or out of compiled code as they were raised.

    Ctrl-C there, or whatever else a signal handler raises, arrives as ``SystemError: CPUDispatcher(...) returned a
    result with an exception set``, or as one of several around one another.
    """

    @wraps(function)
    def called(*args: P.args, **options: P.kwargs) -> R:
        try:
            return function(*args, **options)
        except SystemError as error:
            cause: BaseException = error
            while isinstance(cause, SystemError) and cause.__cause__ is not None:
                cause = cause.__cause__
            if cause is error:
                raise
            raise cause from None

    return called
