"""Checks of arguments: each returns the argument as it is to be used, or raises one line that says what was given.

Numbers may be Python's or numpy's. Text, truth values, times and masked values are no numbers, although numpy would
take them for some.
"""

from __future__ import annotations

import math
import reprlib
import warnings
from collections.abc import Iterable
from decimal import Decimal
from numbers import Real
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from trailmark.errors import ConfigurationError, InputWarning, TrailmarkError

__all__ = [
    "angle",
    "brief",
    "callback",
    "each_of",
    "number",
    "number_array",
    "one_of",
    "real",
    "truth",
    "warn_of_degrees",
    "whole",
]

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
    """Return a number above ``above``, from ``minimum`` to ``maximum``.

    Args:
        value: what was given.
        name: what the message calls it, such as ``time limit:``; the value comes next.
        above: the number must be larger.
        minimum: the number must not be smaller.
        maximum: the number must not be larger.
        infinite: whether infinity is allowed too.
        unit: of the number given, for the message.
        error: what is raised.
    """
    found = real(value)
    if found > above and minimum <= found <= maximum and (infinite or math.isfinite(found)):
        return found
    bounds = [f"above {above:g}"] if above > -math.inf else []
    bounds += [f"of {minimum:g} or more"] if minimum > -math.inf else []
    bounds += [f"at most {maximum:g}"] if maximum < math.inf else []
    allowed = f"a finite number {' and '.join(bounds)}".strip()
    if infinite:
        allowed = f"more than {above:g}" if above > -math.inf else f"{minimum:g} or more"
    raise error(f"{_label(name)} expected {allowed}, got {brief(value)}{unit and ' '}{unit}")


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
    names = ["None" if kind is type(None) else kind.__name__ for kind in kinds]
    raise error(f"{_label(name)} expected {' or '.join(names)}, got {brief(value)}{_conversion(value) or hint}")


def each_of(
    values: Iterable[Any], kinds: type[T] | tuple[type[T], ...], name: str, *, error: Error = ConfigurationError
) -> tuple[T, ...]:
    """Return objects of some kinds as a tuple."""
    try:
        found = () if isinstance(values, str) else tuple(values)
    except TypeError:
        found = None
    if found is None or (isinstance(values, str) and values):
        raise error(f"{name}: expected a sequence, got {brief(values)}{_conversion(values)}")
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
        if raw.dtype.kind in "iufO" and not (raw.dtype.kind == "O" and any(map(_is_text, raw.flat))):
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
    """Return the name of an argument as the beginning of a message."""
    return name if name.endswith(":") else f"{name}:"


def _is_text(value: object) -> bool:
    return isinstance(value, str | bytes | bool | np.bool_)


def _conversion(value: object) -> str:
    """Return what takes a shapely geometry, for a message."""
    return "; World.from_shapely takes geometries" if type(value).__module__.startswith("shapely") else ""
