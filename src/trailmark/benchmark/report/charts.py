"""Charts with a row for each planner: shares with their intervals, and boxes."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.palette import Style
from trailmark.sketch.svg import Scale, drawing, element, points, text, text_width

__all__ = ["WIDTH", "BoxRow", "ShareRow", "box_chart", "legend_mark", "legend_marks", "share_chart"]

WIDTH = 400.0
ROW, HEAD, FOOT = 21.0, 22.0, 40.0
GAP = 8.0


@dataclass(frozen=True)
class ShareRow:
    """A planner's success: the referee's share with its interval, the planner's own, and both as words."""

    name: str
    style: Style
    share: float
    low: float
    high: float
    claimed: float
    words: str


@dataclass(frozen=True)
class BoxRow:
    """Quantiles 5, 25, 50, 75 and 95 % of a planner, infinity for failures, and its share of failures as words."""

    name: str
    style: Style
    five: NDArray[np.float64]
    words: str


def share_chart(rows: Sequence[ShareRow], label: str) -> str:
    """Return a chart of shares: a dot with its interval for the referee's, a ring for the planner's own."""
    scale, height, parts = _frame(rows, "solved", lambda v: f"{100 * v:.0f}", "runs [%]", 0.0, 1.0, False)
    for i, row in enumerate(rows):
        y = HEAD + (i + 0.5) * ROW
        x, low, high, claimed = scale.at([row.share, row.low, row.high, row.claimed]).tolist()
        bar = points([low, high], [y, y]) + "".join(points([c, c], [y - 3.5, y + 3.5]) for c in (low, high))
        drawn = element("path", d=bar, class_="mark")
        if row.claimed != row.share:
            drawn += element("circle", cx=claimed, cy=y, r=4.2, fill="#fff")
        drawn += element("circle", cx=x, cy=y, r=3.6, fill=row.style.colour)
        parts.append(element("g", drawn, stroke=row.style.colour, class_="share"))
    return drawing(WIDTH, height, label, parts, "chart rows")


def box_chart(rows: Sequence[BoxRow], label: str, axis: str, log: bool, head: str) -> str:
    """Return a chart of boxes (quartiles, median) with whiskers (5 and 95 %); what is infinite runs off to the right.

    Args:
        rows: from top to bottom.
        label: the text alternative.
        axis: what the axis shows, with its unit.
        log: whether the axis is logarithmic; else it begins at 1, the best known.
        head: what the words at the right are.
    """
    values = np.concatenate([row.five for row in rows])
    finite = values[np.isfinite(values) & (values > 0.0)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.01, 1.0)
    if log:
        low, high = 0.8 * low, max(1.25 * high, 4.0 * low)
    else:
        # One planner far behind must not press all the others to the left edge.
        usual = float(np.quantile(finite, 0.85)) if len(finite) else 2.0
        low, high = min(1.0, low), 1.0 + 1.08 * max(0.02, min(high, 2.5 * usual - 1.5) - 1.0)
    scale, height, parts = _frame(rows, head, _tick, axis, low, high, log)
    for i, row in enumerate(rows):
        parts.append(_box(row, scale, HEAD + (i + 0.5) * ROW, high))
    return drawing(WIDTH, height, label, parts, "chart rows")


def legend_mark(style: Style) -> str:
    """Return a small picture of a planner's line, for legends and tables; it says nothing to a screen reader."""
    return f'<svg class="key" viewBox="0 0 28 14" aria-hidden="true"><use href="#k{style.number}"/></svg>'


def legend_marks(styles: Iterable[Style]) -> str:
    """Return the definitions that :func:`legend_mark` refers to; once a page."""
    marks = []
    for s in styles:
        dot = element("circle", cx=14.0, cy=7.0, r=3.2, fill="#fff" if s.hollow else s.colour, stroke_width=1.4)
        line = element("path", d="M1 7H27", stroke_width=s.width, stroke_dasharray=s.dash or None)
        marks.append(element("g", line + dot, stroke=s.colour, id=f"k{s.number}"))
    return f'<svg class="defs" aria-hidden="true"><defs>{"".join(marks)}</defs></svg>'


def _frame(
    rows: Sequence[ShareRow | BoxRow],
    head: str,
    shown: Callable[[float], str],
    axis: str,
    low: float,
    high: float,
    log: bool,
) -> tuple[Scale, float, list[str]]:
    """Return the scale, the height, and the names, words, grid and axis that all charts with rows have."""
    left = min(0.42 * WIDTH, max(text_width(row.name) for row in rows)) + GAP
    right = WIDTH - max(max(text_width(row.words) for row in rows), text_width(head)) - GAP
    bottom = HEAD + len(rows) * ROW
    scale = Scale(low, high, left + 4.0, right - 6.0, log)
    parts = []
    for tick in scale.ticks(5):
        x = float(scale.at(tick))
        parts.append(element("path", d=points([x, x], [HEAD, bottom + 4.0]), class_="grid"))
        parts.append(text(x, bottom + 17.0, shown(tick), class_="tick", text_anchor="middle"))
    parts.append(element("path", d=points([left, right], [bottom, bottom]), class_="axis"))
    parts.append(text((left + right) / 2.0, bottom + 33.0, axis, class_="name", text_anchor="middle"))
    parts.append(text(WIDTH, HEAD - 7.0, head, class_="tick", text_anchor="end"))
    for i, row in enumerate(rows):
        y = HEAD + (i + 0.5) * ROW
        fit = left - GAP if text_width(row.name) > left - GAP else None
        squeeze = {} if fit is None else {"textLength": fit, "lengthAdjust": "spacingAndGlyphs"}
        parts.append(text(left - GAP, y + 4.0, row.name, class_="name", text_anchor="end", **squeeze))
        parts.append(text(WIDTH, y + 4.0, row.words, class_="value", text_anchor="end"))
    return scale, bottom + FOOT, parts


def _box(row: BoxRow, scale: Scale, y: float, high: float) -> str:
    if not math.isfinite(row.five[0]):
        return text(scale.begin + 4.0, y + 4.0, "no path", class_="tick")
    first, lower, median, upper, last = scale.at(row.five).tolist()
    box = {"x": lower, "y": y - 6.0, "width": max(0.8, upper - lower), "height": 12.0}
    drawn = element("path", d=points([first, last], [y, y]), class_="mark")
    drawn += element("rect", **box, fill=row.style.tint, class_="mark")
    if row.five[2] <= high:
        drawn += element("path", d=points([median, median], [y - 6.0, y + 6.0]), class_="median")
    if row.five[4] > high:  # an arrow: more lies beyond
        end = scale.end + 5.0
        drawn += element(
            "path", d=points([end - 5, end, end - 5], [y - 4, y, y + 4], closed=True), fill=row.style.colour
        )
    return element("g", drawn, stroke=row.style.colour, class_="box")


def _tick(value: float) -> str:
    return f"{value:g}" if value < 10_000 else f"{value:,.0f}"
