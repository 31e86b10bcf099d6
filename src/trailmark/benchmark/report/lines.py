"""Charts of lines over time: how many runs have a path, and what the best path costs, by when."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.charts import WIDTH
from trailmark.benchmark.report.curves import CostCurve
from trailmark.benchmark.report.palette import Style
from trailmark.sketch.svg import Scale, coordinate, drawing, element, points, text, text_width

__all__ = ["CostLine", "EcdfLine", "cost_chart", "ecdf_chart"]

FloatArray = NDArray[np.float64]

LEFT, TOP, PLOT, FOOT = 46.0, 12.0, 220.0, 42.0
STRIP, BETWEEN = 48.0, 26.0
LABEL = 14.0  # height of a line of labels
MAX_STEPS = 120
MAX_BANDS = 6
LABELS = 0.36 * WIDTH  # no wider than this


@dataclass(frozen=True)
class EcdfLine:
    """Seconds to the first solution of a planner's runs, infinity for failures."""

    name: str
    style: Style
    times: FloatArray


@dataclass(frozen=True)
class CostLine:
    """The cost curve of a planner."""

    name: str
    style: Style
    curve: CostCurve


def ecdf_chart(lines: Sequence[EcdfLine], low: float, high: float, label: str) -> str:
    """Return the share of runs that have a first solution, over the time it took.

    Args:
        lines: a planner each.
        low: seconds at the left, above 0.
        high: seconds at the right.
        label: the text alternative.
    """
    x, right = _time_scale(lines, low, high)
    y = Scale(0.0, 1.0, TOP + PLOT, TOP)
    parts = [*_time_axis(x, right, TOP, TOP + PLOT), *_level_axis(y, [0.0, 0.25, 0.5, 0.75, 1.0], right, _per_cent)]
    parts.append(_upright("runs with a path [%]", TOP + PLOT / 2.0))
    ends = []
    for line in lines:
        found = np.sort(line.times[np.isfinite(line.times)])
        shares = np.arange(1, len(found) + 1) / len(line.times)
        if len(found) > MAX_STEPS:
            chosen = np.unique(np.linspace(0, len(found) - 1, MAX_STEPS).round().astype(int))
            found, shares = found[chosen], shares[chosen]
        ends.append(float(y.at(shares[-1] if len(shares) else 0.0)))
        parts.append(_stroke(_stairs(x.at(found), y.at(shares), x, float(y.at(0.0))), line.style, line.name))
    parts += _labels(lines, ends, right, TOP, TOP + PLOT)
    return drawing(WIDTH, TOP + PLOT + FOOT, label, parts, "chart lines")


def cost_chart(lines: Sequence[CostLine], low: float, high: float, axis: str, label: str, number: int) -> str:
    """Return medians and quartiles of the best cost over time, and below them the share of runs without a path.

    Args:
        lines: a planner each; their curves share the moments.
        low: cost at the bottom.
        high: cost at the top; what lies above is cut off.
        axis: what the cost axis shows, with its unit.
        label: the text alternative.
        number: tells this chart's clip path from all others on the page.
    """
    times = lines[0].curve.times
    x, right = _time_scale(lines, float(times[0]), float(times[-1]))
    y = Scale(low, high, TOP + PLOT, TOP)
    top = TOP + PLOT + BETWEEN
    strip = Scale(0.0, 1.0, top + STRIP, top)
    clip = f"c{number}"
    frame = element("rect", x=LEFT, y=TOP, width=right - LEFT, height=PLOT)
    parts = [element("clipPath", frame, id=clip)]
    parts += _time_axis(x, right, top, top + STRIP)
    parts += [element("path", d=points([float(x.at(t))] * 2, [TOP, TOP + PLOT]), class_="grid") for t in x.ticks(5)]
    parts += _level_axis(y, y.ticks(5), right, lambda v: f"{v:g}")
    parts += _level_axis(strip, [0.0, 1.0], right, _per_cent)
    parts.append(_upright(axis, TOP + PLOT / 2.0))
    bands, medians, ends = [], [], []
    for line in lines:
        lower, median, upper = (_height(values, y) for values in line.curve.quartiles)
        known = np.isfinite(line.curve.quartiles[2])
        if len(lines) <= MAX_BANDS and known.sum() > 1:
            at = x.at(times[known])
            outline = points(np.append(at, at[::-1]), np.append(lower[known], upper[known][::-1]), closed=True)
            bands.append(element("path", d=outline, fill=line.style.colour, fill_opacity="0.13"))
        known = np.isfinite(line.curve.quartiles[1])
        medians.append(_stroke(points(x.at(times[known]), median[known]), line.style, line.name))
        parts.append(_stroke(points(x.at(times), strip.at(line.curve.missing)), line.style, line.name))
        last = line.curve.quartiles[1][-1]
        ends.append(float(y.at(last)) if np.isfinite(last) else -math.inf)
    parts.append(element("g", "".join(bands + medians), clip_path=f"url(#{clip})"))
    parts.append(text(right, top - 5.0, "runs without a path [%]", class_="tick", text_anchor="end"))
    parts += _labels(lines, ends, right, TOP, TOP + PLOT)
    return drawing(WIDTH, top + STRIP + FOOT, label, parts, "chart lines")


def _time_scale(lines: Sequence[EcdfLine] | Sequence[CostLine], low: float, high: float) -> tuple[Scale, float]:
    right = WIDTH - min(LABELS, max(text_width(line.name) for line in lines)) - 22.0
    return Scale(low, max(high, 1.5 * low), LEFT, right, log=True), right


def _time_axis(x: Scale, right: float, top: float, bottom: float) -> list[str]:
    parts = [element("path", d=points([LEFT, right], [bottom, bottom]), class_="axis")]
    for tick in x.ticks(5):
        at = float(x.at(tick))
        parts.append(element("path", d=points([at, at], [top, bottom + 4.0]), class_="grid"))
        parts.append(text(at, bottom + 17.0, f"{tick:g}", class_="tick", text_anchor="middle"))
    parts.append(text((LEFT + right) / 2.0, bottom + 34.0, "planning time [s]", class_="name", text_anchor="middle"))
    return parts


def _level_axis(y: Scale, ticks: Sequence[float], right: float, shown: Callable[[float], str]) -> list[str]:
    parts = []
    for tick in ticks:
        at = float(y.at(tick))
        parts.append(element("path", d=points([LEFT, right], [at, at]), class_="grid"))
        parts.append(text(LEFT - 5.0, at + 4.0, shown(tick), class_="tick", text_anchor="end"))
    return parts


def _upright(words: str, middle: float) -> str:
    turned = f"rotate(-90 11 {coordinate(middle)})"
    return text(11.0, middle, words, class_="name", text_anchor="middle", transform=turned)


def _per_cent(share: float) -> str:
    return f"{100.0 * share:.0f}"


def _height(values: FloatArray, y: Scale) -> FloatArray:
    """Return coordinates; those above the top are left to the clip path, since a level line would mislead."""
    finite = np.minimum(values, y.high + 5.0 * (y.high - y.low))
    return np.asarray(y.begin + (finite - y.low) / (y.high - y.low) * (y.end - y.begin))


def _stroke(data: str, style: Style, name: str) -> str:
    if not data:
        return ""
    title = element("title", name.replace("&", "&amp;").replace("<", "&lt;"))
    return element(
        "path",
        title,
        d=data,
        stroke=style.colour,
        stroke_width=style.width,
        stroke_dasharray=style.dash or None,
        class_="line mark",
    )


def _stairs(x: FloatArray, y: FloatArray, scale: Scale, floor: float) -> str:
    if len(x) == 0:
        return points([scale.begin, scale.end], [floor, floor])
    return points(np.append(np.repeat(x, 2), scale.end), np.append(floor, np.repeat(y, 2)))


def _labels(
    lines: Sequence[EcdfLine] | Sequence[CostLine], ends: Sequence[float], right: float, top: float, bottom: float
) -> list[str]:
    """Return a label at the end of each line, moved apart where they would lie upon each other.

    Lines that have no end, being at infinity, are named at the top.
    """
    order = sorted(range(len(lines)), key=lambda i: ends[i])
    places = _apart(
        [max(top, ends[i]) for i in order], min(LABEL, (bottom - top) / max(1, len(lines) - 1)), top, bottom
    )
    parts = []
    for i, place in zip(order, places, strict=True):
        style, name = lines[i].style, lines[i].name
        if math.isinf(ends[i]):
            name += " (none)"
        else:
            leader = points([right, right + 8.0], [ends[i], place])
            parts.append(element("path", d=leader, stroke=style.colour, stroke_width=1.0))
        fill = "#fff" if style.hollow else style.colour
        parts.append(
            element("circle", cx=right + 11.0, cy=place, r=3.2, fill=fill, stroke=style.colour, stroke_width=1.4)
        )
        room = WIDTH - right - 19.0
        squeeze = {"textLength": room, "lengthAdjust": "spacingAndGlyphs"} if text_width(name) > room + 1.0 else {}
        parts.append(text(right + 18.0, place + 4.0, name, class_="name", **squeeze))
    return parts


def _apart(wanted: Sequence[float], gap: float, top: float, bottom: float) -> list[float]:
    """Return places near the wanted ones, ascending, at least ``gap`` apart and, if they fit, within the ends."""
    places: list[float] = []
    for place in wanted:
        places.append(max(place, top, places[-1] + gap if places else top))
    limit = bottom
    for i in reversed(range(len(places))):
        places[i] = min(places[i], limit)
        limit = places[i] - gap
    return places
