"""Arguments and fields that are checked by their annotations: ``period: Positive`` takes a finite number above 0.

What is given comes out as it is to be used (a float, a whole number, an array of numbers, a tuple), or one line says
what was expected and what was given. Numbers may be Python's or numpy's; text, truth values, times and masked values
are no numbers, as for :mod:`trailmark.arguments`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial, wraps
from inspect import signature
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin
from typing import get_type_hints as type_hints

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, number_array, real
from trailmark.errors import TrailmarkError, expected_name

__all__ = [
    "Count",
    "Finite",
    "NonNegative",
    "NonNegativeOrInfinite",
    "Numbers",
    "Positive",
    "PositiveOrInfinite",
    "Probability",
    "RandomState",
    "Rule",
    "Seed",
    "Share",
    "checked",
    "checked_arguments",
    "checked_fields",
    "shaped",
]

P = ParamSpec("P")
R = TypeVar("R")


class _Mismatch(Exception):  # noqa: N818 # no error: it says that one of several allowed kinds is not the one given
    pass


class Rule(NamedTuple):
    """What a value must be, as the metadata of an ``Annotated`` type."""

    text: str
    """What is expected, as messages say it."""
    holds: Callable[[Any], bool]
    """Whether a value of the right type is allowed."""


Positive = Annotated[float, Rule("a finite number above 0", lambda v: 0.0 < v < math.inf)]
PositiveOrInfinite = Annotated[float, Rule("a number above 0", lambda v: v > 0.0)]
NonNegative = Annotated[float, Rule("a finite number of 0 or more", lambda v: 0.0 <= v < math.inf)]
NonNegativeOrInfinite = Annotated[float, Rule("a number of 0 or more", lambda v: v >= 0.0)]
Finite = Annotated[float, Rule("a finite number", math.isfinite)]
Probability = Annotated[float, Rule("a number above 0 and below 1", lambda v: 0.0 < v < 1.0)]
Share = Annotated[float, Rule("a number from 0 to 1", lambda v: 0.0 <= v <= 1.0)]
Count = Annotated[int, Rule("a whole number of 1 or more", lambda v: v >= 1)]
Seed = Annotated[int, Rule("a whole number of 0 or more", lambda v: v >= 0)]
Numbers = Annotated[ArrayLike, Rule("an array of finite numbers", lambda v: bool(np.isfinite(v).all()))]


def shaped(*sizes: int | None, minimum: int = 0) -> Rule:
    """Return the rule for arrays of finite numbers of that shape, None standing for any size, ``minimum`` rows or more.

    Use it as ``Annotated[ArrayLike, shaped(None, 2)]``.
    """
    sides = ", ".join("n" if size is None else str(size) for size in sizes)
    text = f"finite numbers of shape ({sides}{',' * (len(sizes) == 1)})" + f", n >= {minimum}" * (minimum > 0)

    def holds(v: Any) -> bool:
        fits = v.ndim == len(sizes) and all(a in (None, b) for a, b in zip(sizes, v.shape, strict=True))
        return fits and len(v) >= minimum and bool(np.isfinite(v).all())

    return Rule(text, holds)


RandomState = Seed | np.random.Generator | None
"""A seed or a generator; the same one gives the same numbers."""


def checked(value: Any, hint: Any, name: str, error: type[TrailmarkError]) -> Any:
    """Return a value as its annotation wants it.

    Args:
        value: what was given.
        hint: the annotation: one of the types above, a class, ``Literal``, ``tuple``, ``Sequence``, ``Callable``, or
            several joined by ``|``. Other annotations allow all.
        name: what the message calls it.
        error: what is raised.
    """
    try:
        return _matcher(hint)(value)
    except _Mismatch:
        words = [word for kind in _alternatives(hint) if get_origin(kind) is Literal for word in get_args(kind)]
        if words and isinstance(value, str):
            raise error(f"{name}: {expected_name(value, words)}") from None
        raise error(f"{name}: expected {_text(hint)}, got {brief(value)}") from None


def checked_fields(instance: Any, error: type[TrailmarkError]) -> None:
    """Check the fields of a dataclass, frozen or not, by their annotations; for its ``__post_init__``."""
    for name, hint in _hints(instance.__class__).items():
        value = checked(getattr(instance, name), hint, f"{type(instance).__name__}: {name}", error)
        object.__setattr__(instance, name, value)


def checked_arguments(error: type[TrailmarkError]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator that checks a function's arguments by their annotations at each call."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        parameters, called = signature(function), function.__qualname__.removesuffix(".__init__")

        @wraps(function)
        def call(*args: P.args, **options: P.kwargs) -> R:
            bound, hints = parameters.bind(*args, **options), _hints(function)
            for name, value in bound.arguments.items():
                if name in hints:
                    bound.arguments[name] = checked(value, hints[name], f"{called}: {name}", error)
            return function(*bound.args, **bound.kwargs)

        return call

    return decorate


@lru_cache(maxsize=256)
def _hints(owner: Any) -> dict[str, Any]:
    hints = type_hints(owner, include_extras=True)
    return {name: hint for name, hint in hints.items() if name != "return" and get_origin(hint) is not ClassVar}


@lru_cache(maxsize=1024)
def _matcher(hint: Any) -> Callable[[Any], Any]:
    """Return what gives a value as the kind that an annotation names, or raises _Mismatch."""
    origin, args = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        return _PLAIN[hint]
    if origin in (Union, UnionType):
        return partial(_first_match, [_matcher(kind) for kind in args])
    if origin is Annotated:
        inner, holds = _as_numbers if args[0] == ArrayLike else _matcher(args[0]), args[1].holds
        return lambda value: _require(found := inner(value), holds(found))
    if origin is Literal:
        return lambda value: _require(value, isinstance(value, str) and value in args)
    if origin in (tuple, Sequence):
        any_length = origin is Sequence or args[-1] is Ellipsis
        return partial(_as_tuple, [_matcher(kind) for kind in args if kind is not Ellipsis], any_length)
    if origin is Mapping:
        of_value = _matcher(args[1])
        return lambda value: {key: of_value(v) for key, v in _require(value, isinstance(value, Mapping)).items()}
    if origin is Callable:
        return lambda value: _require(value, callable(value))
    kind = list if origin is list else hint
    return lambda value: _require(value, not isinstance(kind, type) or isinstance(value, kind))


def _first_match(matchers: list[Callable[[Any], Any]], value: Any) -> Any:
    for matcher in matchers:
        try:
            return matcher(value)
        except _Mismatch:
            pass
    raise _Mismatch


def _as_float(value: Any) -> float:
    found = value if type(value) is float else real(value)
    return float(_require(found, found == found))


def _as_int(value: Any) -> int:
    found = real(value)
    return int(_require(value, math.isfinite(found) and found == int(found)))


def _as_numbers(value: Any) -> Any:
    try:
        return number_array(value, "")
    except TrailmarkError:
        raise _Mismatch from None


def _as_tuple(matchers: list[Callable[[Any], Any]], any_length: bool, value: Any) -> tuple[Any, ...]:
    try:
        items = () if np.ma.is_masked(value) else tuple(value)
    except TypeError:
        raise _Mismatch from None
    if any_length:
        matchers = matchers * len(items)
    _require(value, not isinstance(value, str | bytes | dict | set) and len(items) == len(matchers))
    return tuple(matcher(item) for matcher, item in zip(matchers, items, strict=True))


_PLAIN: dict[Any, Callable[[Any], Any]] = {
    float: _as_float,
    int: _as_int,
    bool: lambda value: bool(_require(value, isinstance(value, bool | np.bool_))),
    Any: lambda value: value,
}


def _alternatives(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def _require(value: Any, holds: bool) -> Any:
    if not holds:
        raise _Mismatch
    return value


def _text(hint: Any) -> str:
    """Return what a message calls a kind."""
    origin, args = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(map(_text, args))
    if origin is Annotated:
        return str(args[1].text)
    if origin is Literal:
        return " or ".join(map(repr, args))
    if origin in (tuple, Sequence):
        kind = _text(args[0])
        return f"a sequence of {kind}" if origin is Sequence or args[-1] is Ellipsis else f"{len(args)} times {kind}"
    if origin is Mapping:
        return f"a dictionary of {_text(args[1])}"
    if origin is Callable:
        return "a function"
    plain = {NoneType: "None", float: "a number", int: "a whole number", bool: "True or False", str: "text"}
    return str(plain.get(hint) or getattr(hint, "__name__", hint))
