"""Checks of arguments and settings: what is given comes out as it is to be used, or one line says what was expected.

Numbers may be Python's or numpy's. Text, truth values, times and masked values are no numbers, although numpy would
take them for some. Functions and dataclasses may also be checked by their annotations: ``period: Positive``.
"""

from __future__ import annotations

import math
import reprlib
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from functools import lru_cache, wraps
from inspect import signature
from numbers import Real
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin
from typing import get_type_hints as type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.errors import ConfigurationError, InputWarning, TrailmarkError, expected_name

__all__ = [
    "Count",
    "Finite",
    "NonNegative",
    "Numbers",
    "Positive",
    "PositiveOrInfinite",
    "Probability",
    "RandomState",
    "Rule",
    "Seed",
    "Share",
    "angle",
    "brief",
    "callback",
    "checked",
    "checked_arguments",
    "checked_fields",
    "each_of",
    "number",
    "number_array",
    "one_of",
    "real",
    "shaped",
    "truth",
    "warn_of_degrees",
    "whole",
]

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")
Error = type[TrailmarkError]


def number(
    value: object,
    name: str,
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = math.inf,
    infinite: bool = False,
    unit: str = "",
    error: Error = ConfigurationError,
) -> float:
    """Return a number above ``above``, from ``minimum`` to ``maximum``, finite unless ``infinite``.

    ``name`` is what the message calls it, such as ``time limit``, and ``unit`` what follows the number given there.
    """
    found = real(value)
    if found > above and minimum <= found <= maximum and (infinite or math.isfinite(found)):
        return found
    if infinite:
        allowed = f"more than {above:g}" if above > -math.inf else f"{minimum:g} or more"
    else:
        bounds = [f"above {above:g}"] if above > -math.inf else []
        bounds += [f"of {minimum:g} or more"] if minimum > -math.inf else []
        bounds += [f"at most {maximum:g}"] if maximum < math.inf else []
        allowed = f"a finite number {' and '.join(bounds)}".strip()
    raise error(f"{_label(name)} expected {allowed}, got {brief(value)} {unit}".rstrip())


def whole(
    value: object, name: str, minimum: int, maximum: int | None = None, *, error: Error = ConfigurationError
) -> int:
    """Return a whole number from ``minimum`` to ``maximum``; 3.0 is one, 3.5 is none."""
    found = real(value)
    if math.isfinite(found) and found == int(found):
        count = int(value)  # type: ignore[call-overload]  # a number, as real found; large ones keep their digits
        if minimum <= count and (maximum is None or count <= maximum):
            return int(count)
    allowed = f"{minimum} or more" if maximum is None else f"{minimum} to {maximum}"
    raise error(f"{_label(name)} expected a whole number, {allowed}, got {brief(value)}")


def truth(value: object, name: str, *, error: Error = ConfigurationError) -> bool:
    """Return True or False; numpy's count as well, other values do not."""
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise error(f"{_label(name)} expected True or False, got {brief(value)}")


def callback(value: T, name: str, *, error: Error = ConfigurationError) -> T:
    """Return something that can be called, or None."""
    if value is None or callable(value):
        return value
    raise error(f"{_label(name)} expected a function or None, got {brief(value)}")


def angle(text: str) -> float:
    """Return the radians that a text says: a number, or a number with ``deg`` behind it; NaN for any other text."""
    number, mark, rest = text.partition("deg")
    try:
        return math.nan if rest.strip() else math.radians(float(number)) if mark else float(number)
    except ValueError:
        return math.nan


def warn_of_degrees(radians: float, name: str) -> None:
    """Warn of an angle beyond one and a half turns, which looks like degrees; ``name`` is what the message calls it."""
    if abs(radians) > 3.0 * math.pi + 1e-9:
        problem = f"{name}: {radians:g} is taken as radians; are they degrees? (a file may say {radians:g}deg)"
        warnings.warn(problem, InputWarning, stacklevel=2)


def one_of(
    value: Any, kinds: type[T] | tuple[type[T], ...], name: str, *, hint: str = "", error: Error = ConfigurationError
) -> T:
    """Return an object of one of the kinds; ``hint`` ends the message."""
    if isinstance(value, kinds):
        return value
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    names = " or ".join("None" if kind is NoneType else kind.__name__ for kind in kinds)
    raise error(f"{_label(name)} expected {names}, got {brief(value)}{_conversion(value) or hint}")


def each_of(
    values: Iterable[Any], kinds: type[T] | tuple[type[T], ...], name: str, *, error: Error = ConfigurationError
) -> tuple[T, ...]:
    """Return objects of some kinds as a tuple."""
    if not isinstance(values, Iterable) or (isinstance(values, str) and values):
        raise error(f"{name}: expected a sequence, got {brief(values)}{_conversion(values)}")
    try:
        found = tuple(values)
    except TypeError:  # an array of no dimension
        raise error(f"{name}: expected a sequence, got {brief(values)}") from None
    for i, value in enumerate(found):
        if not isinstance(value, kinds):
            one_of(value, kinds, f"{name}[{i}]:", error=error)
    return found


def number_array(
    value: object, name: str, what: str = "{} is not an array of numbers", *, error: Error = ConfigurationError
) -> NDArray[np.float64]:
    """Return numbers as a new float array in C order: to compiled kernels, another order is another type.

    Whether they are finite is left to the caller; ``what`` is the message, with the value in the place of ``{}``.
    """
    if type(value) is np.ndarray and value.dtype == np.float64:
        return np.array(value, order="C")
    if np.ma.is_masked(value):
        raise error(f"{name}: expected numbers, got an array with masked values")
    try:
        raw = np.asarray(value)
        if raw.dtype.kind in "iufO" and not any(
            isinstance(item, str | bytes | bool | np.bool_) for item in (raw.flat if raw.dtype.kind == "O" else ())
        ):
            return np.array(raw, dtype=np.float64, order="C")
    except (TypeError, ValueError, OverflowError):
        pass
    raise error(f"{name}: {what.format(brief(value))}")


def brief(value: object) -> str:
    """Return a value for a message: on one line, and cut where it is long."""
    try:
        return " ".join(reprlib.repr(value.item() if isinstance(value, np.generic) else value).split())
    except Exception:  # a repr of somebody's own
        return f"an object of {type(value).__name__}"


def real(value: object) -> float:
    """Return what is a number as a float, anything else as NaN."""
    if type(value) is float:  # mostly
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0 and not np.ma.is_masked(value):
        value = value[()]
    if isinstance(value, Real | Decimal) and not isinstance(value, bool | np.timedelta64):
        try:
            return float(value)
        except (ValueError, OverflowError):
            pass
    return math.nan


def _label(name: str) -> str:
    return name if name.endswith(":") else f"{name}:"


def _conversion(value: object) -> str:
    """Return what takes a shapely geometry, for a message."""
    return "; World.from_geometries takes geometries" if type(value).__module__.startswith("shapely") else ""


# --- Checks by annotations


class Rule(NamedTuple):
    """What a value must be, as metadata of ``Annotated``: as messages say it, and whether one is allowed."""

    text: str
    holds: Callable[[Any], bool]


Positive = Annotated[float, Rule("a finite number above 0", lambda v: 0.0 < v < math.inf)]
PositiveOrInfinite = Annotated[float, Rule("a number above 0", lambda v: v > 0.0)]
NonNegative = Annotated[float, Rule("a finite number of 0 or more", lambda v: 0.0 <= v < math.inf)]
Finite = Annotated[float, Rule("a finite number", math.isfinite)]
Probability = Annotated[float, Rule("a number above 0 and below 1", lambda v: 0.0 < v < 1.0)]
Share = Annotated[float, Rule("a number from 0 to 1", lambda v: 0.0 <= v <= 1.0)]
Count = Annotated[int, Rule("a whole number of 1 or more", lambda v: v >= 1)]
Seed = Annotated[int, Rule("a whole number of 0 or more", lambda v: v >= 0)]
Numbers = Annotated[ArrayLike, Rule("an array of finite numbers", lambda v: bool(np.isfinite(v).all()))]
RandomState = Seed | np.random.Generator | None
"""A seed or a generator; the same one gives the same numbers."""


def shaped(*sizes: int | None, minimum: int = 0) -> Rule:
    """Return the rule for finite numbers of a shape, None standing for any size; ``minimum`` is that of the first."""
    sides = ", ".join("n" if size is None else str(size) for size in sizes)
    text = f"finite numbers of shape ({sides}{',' * (len(sizes) == 1)})" + f", n >= {minimum}" * (minimum > 0)

    def holds(v: Any) -> bool:
        fits = v.ndim == len(sizes) and all(a in (None, b) for a, b in zip(sizes, v.shape, strict=True))
        return fits and len(v) >= minimum and bool(np.isfinite(v).all())

    return Rule(text, holds)


def checked(value: Any, hint: Any, name: str, error: Error) -> Any:
    """Return a value as its annotation wants it.

    That is one of the types above, a class, ``Literal``, ``tuple``, ``Sequence``, ``Mapping``, ``Callable``, or several
    joined by ``|``. Other annotations allow all.
    """
    text, convert = _kind(hint)
    try:
        return convert(value)
    except _Mismatch:
        kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        words = [word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)]
        allowed = expected_name(value, words) if words and isinstance(value, str) else None
        raise error(f"{name}: {allowed or f'expected {text}, got {brief(value)}'}") from None


def checked_fields(instance: Any, error: Error) -> None:
    """Check the fields of a dataclass, frozen or not, by their annotations; for its ``__post_init__``."""
    for name, hint in _hints(instance.__class__).items():
        value = checked(getattr(instance, name), hint, f"{type(instance).__name__}: {name}", error)
        object.__setattr__(instance, name, value)


def checked_arguments(error: Error) -> Callable[[Callable[P, R]], Callable[P, R]]:
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


class _Mismatch(Exception):  # noqa: N818 # no error: it says that one of several allowed kinds is not the one given
    pass


def _when(value: Any, holds: bool) -> Any:
    """Return a value for which something holds."""
    if not holds:
        raise _Mismatch
    return value


@lru_cache(maxsize=1024)
def _kind(hint: Any) -> tuple[str, Callable[[Any], Any]]:
    """Return what messages call an annotation, and what gives a value as that or raises a mismatch."""
    origin, args = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        return _PLAIN[hint]
    if origin is Annotated:
        rule, convert = args[1], _as_numbers if args[0] == ArrayLike else _kind(args[0])[1]
        return rule.text, lambda v: _when(found := convert(v), rule.holds(found))
    if origin is Literal:
        return " or ".join(map(repr, args)), lambda v: _when(v, isinstance(v, str) and v in args)
    if origin is Callable:
        return "a function", lambda v: _when(v, callable(v))
    if origin in (Union, UnionType):
        texts, choices = zip(*map(_kind, args), strict=True)
        return " or ".join(texts), lambda v: _first(choices, v)
    if origin is Mapping:
        text, convert = _kind(args[1])
        return f"a dictionary of {text}", lambda v: {
            key: convert(item) for key, item in _when(v, isinstance(v, Mapping)).items()
        }
    if origin in (tuple, Sequence):
        texts, converters = zip(*(_kind(kind) for kind in args if kind is not Ellipsis), strict=True)
        if origin is Sequence or args[-1] is Ellipsis:
            return f"a sequence of {texts[0]}", lambda v: tuple(converters[0](item) for item in _items(v))
        return f"{len(args)} times {texts[0]}", lambda v: tuple(
            convert(item) for convert, item in zip(converters, _items(v, len(converters)), strict=True)
        )
    kind = list if origin is list else hint
    return getattr(kind, "__name__", str(kind)), lambda v: _when(v, not isinstance(kind, type) or isinstance(v, kind))


def _first(converters: Iterable[Callable[[Any], Any]], value: Any) -> Any:
    """Return what the first converter that takes a value makes of it."""
    for convert in converters:
        try:
            return convert(value)
        except _Mismatch:
            pass
    raise _Mismatch


def _items(value: Any, count: int | None = None) -> tuple[Any, ...]:
    """Return what a sequence of ``count`` values holds."""
    try:
        items = tuple(_when(value, not (isinstance(value, str | bytes | dict | set) or np.ma.is_masked(value))))
    except TypeError:
        raise _Mismatch from None
    return items if count in (None, len(items)) else _when(items, False)


def _as_int(value: Any) -> int:
    found = real(value)
    return int(_when(value, math.isfinite(found) and found == int(found)))


def _as_numbers(value: Any) -> Any:
    try:
        return number_array(value, "")
    except TrailmarkError:
        raise _Mismatch from None


_PLAIN: dict[Any, tuple[str, Callable[[Any], Any]]] = {
    float: ("a number", lambda v: _when(found := real(v), found == found)),
    int: ("a whole number", _as_int),
    bool: ("True or False", lambda v: bool(_when(v, isinstance(v, bool | np.bool_)))),
    str: ("text", lambda v: _when(v, isinstance(v, str))),
    NoneType: ("None", lambda v: _when(v, v is None)),
    Any: ("anything", lambda v: v),
}
