"""Small pieces of SVG: elements, scales with round ticks, lines of few characters."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["FONT", "Scale", "coordinate", "drawing", "element", "points", "text", "text_width"]

FONT = 12.0
"""Size of a chart's letters, in units of its view box, which are about pixels on a phone."""


@dataclass(frozen=True)
class Scale:
    """Maps values to coordinates.

    Attributes:
        low: value at ``begin``.
        high: value at ``end``; above ``low``.
        begin: coordinate.
        end: coordinate.
        log: whether by the logarithm; ``low`` is then above 0.
    """

    low: float
    high: float
    begin: float
    end: float
    log: bool = False

    def at(self, values: ArrayLike) -> NDArray[np.float64]:
        """Return coordinates, clipped to the scale's ends; infinity lies at its end."""
        array = np.clip(np.asarray(values, dtype=np.float64), self.low, self.high)
        low, high = self.low, self.high
        if self.log:
            array, low, high = np.log(array), math.log(low), math.log(high)
        return np.asarray(self.begin + (array - low) / (high - low) * (self.end - self.begin))

    def ticks(self, max_count: int = 6) -> list[float]:
        """Return round values within the scale, ascending, at max_count about ``max_count``."""
        return _log_ticks(self.low, self.high, max_count) if self.log else _linear_ticks(self.low, self.high, max_count)


def element(name: str, content: str = "", **attributes: Any) -> str:
    """Return an element; ``_`` in names of attributes stands for ``-``, and None leaves one out.

    Args:
        name: the element's.
        content: markup, escaped already.
        attributes: numbers are rounded to a tenth, texts are escaped.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_value(v)}"' for key, v in attributes.items() if v is not None
    )
    return f"<{name}{given}>{content}</{name}>" if content else f"<{name}{given}/>"


def text(x: float, y: float, words: str, **attributes: Any) -> str:
    """Return a line of text."""
    return element("text", escape(words), x=float(x), y=float(y), **attributes)


def text_width(words: str) -> float:
    """Return about how wide a line of text is, on the safe side."""
    return 0.63 * FONT * len(words)


def drawing(width: float, height: float, label: str, parts: Iterable[str], kind: str) -> str:
    """Return a whole SVG that scales with its place on the page and is read out as ``label``.

    Args:
        width: of the view box.
        height: of the view box.
        label: the text alternative.
        parts: markup.
        kind: class of the figure.
    """
    box = f"0 0 {coordinate(width)} {coordinate(height)}"
    return element("svg", "".join(parts), viewBox=box, role="img", aria_label=label, class_=kind)


def points(x: ArrayLike, y: ArrayLike, closed: bool = False) -> str:
    """Return path data of a polyline, in few characters: steps in tenths, those straight on taken together."""
    tenths = np.round(10.0 * np.column_stack([np.ravel(x), np.ravel(y)])).astype(np.int64)
    if len(tenths) == 0:
        return ""
    steps: list[tuple[int, int]] = []
    for dx, dy in np.diff(tenths, axis=0).tolist():
        if steps and steps[-1][0] * dy == steps[-1][1] * dx and steps[-1][0] * dx + steps[-1][1] * dy >= 0:
            steps[-1] = (steps[-1][0] + dx, steps[-1][1] + dy)
        elif dx or dy:
            steps.append((dx, dy))
    numbers = [_tenths(v) for step in steps for v in step]
    moves = "".join(n if n.startswith("-") or i == 0 else f" {n}" for i, n in enumerate(numbers))
    begun = f"M{_tenths(int(tenths[0, 0]))} {_tenths(int(tenths[0, 1]))}"
    return begun + (f"l{moves}" if moves else "") + ("z" if closed else "")


def coordinate(value: float) -> str:
    """Return a number with at max_count one decimal."""
    shown = f"{value:.1f}"
    return shown.removesuffix(".0") if shown != "-0.0" else "0"


def _value(value: object) -> str:
    return coordinate(value) if isinstance(value, float) else escape(str(value))


def _linear_ticks(low: float, high: float, max_count: int) -> list[float]:
    rough = (high - low) / max_count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1.0, 2.0, 2.5, 5.0, 10.0) if power * m >= rough * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    return [round(i * step, 12) for i in range(first, math.floor(high / step + 1e-9) + 1)]


def _log_ticks(low: float, high: float, max_count: int) -> list[float]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    choices: Sequence[tuple[float, ...]] = ((1.0, 2.0, 5.0), (1.0, 3.0), (1.0,))
    for steps in choices:
        found = [s * 10.0**e for e in range(first, last + 1) for s in steps]
        found = [value for value in found if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        if len(found) <= max_count:
            return found
    every = math.ceil(len(found) / max_count)
    return found[::every]


def _tenths(value: int) -> str:
    whole, rest = divmod(abs(value), 10)
    digits = f"{whole or ''}.{rest}" if rest else str(whole)
    return f"-{digits}" if value < 0 else digits
