"""Small pieces of SVG: elements, and lines of few characters."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["coordinate", "element", "points", "text"]


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


def _tenths(value: int) -> str:
    whole, rest = divmod(abs(value), 10)
    digits = f"{whole or ''}.{rest}" if rest else str(whole)
    return f"-{digits}" if value < 0 else digits
