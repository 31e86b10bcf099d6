"""The table and the plot of benchmarks/ablation.py, from the runs alone."""

from __future__ import annotations

import io
import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from benchmarks.machine import describe_machine, markdown_table
from trailmark.formats.files import write_atomically
from trailmark.planning.mechanisms import MECHANISMS
from trailmark.planning.methods import METHODS

__all__ = ["CONTROL", "FULL", "SAMPLES", "Comparison", "compare", "publish"]

RESULTS = Path(__file__).resolve().parent / "results"

FULL, CONTROL, SAMPLES = "full planner", "the same once more", "samples for K-means"
"""Variants: what all are compared with, what tells how much of a difference is chance, and plain samples."""

REPLICATES = 4000
"""Of the bootstrap: problems are resampled."""

FEWEST = 5
"""Problems from which on there is an interval."""

GROUPS = {
    "worlds": "shipped",
    "data": "real maps",
    "random": "random clutter",
    "mixed": "discs, holes, boundary",
    "passages": "narrow passages",
    "cars": "cars",
}
"""Groups of problems, and what the table calls them."""

Rows = list[dict[str, Any]]


class Interval(NamedTuple):
    """A mean over problems and its 95 % bootstrap interval; NaN where too little is known."""

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, values: ArrayLike) -> Interval:
        """Return the interval of one value for each problem."""
        each: NDArray[np.float64] = np.asarray(values, dtype=np.float64)
        if len(each) == 0:
            return cls(math.nan, math.nan, math.nan)
        rng = np.random.default_rng(0)
        draws = rng.choice(each, (REPLICATES, len(each))).mean(axis=1)
        low, high = np.quantile(draws, (0.025, 0.975)) if len(each) >= FEWEST else (math.nan, math.nan)
        return cls(float(each.mean()), float(low), float(high))

    @property
    def differs(self) -> bool:
        """Whether the interval excludes 0."""
        return self.low > 0.0 or self.high < 0.0


class Comparison(NamedTuple):
    """A variant against the full planner on the problems that both were given.

    Attributes:
        problems: how many.
        success: share of the runs that decided their problem (a path, or a proof that there is none), difference.
        first: logarithm of the ratio of the times to the first path; without a path the limit counts.
        cost: logarithm of the ratio of the costs at the limit, where both have a path.
    """

    problems: int
    success: Interval
    first: Interval
    cost: Interval


def compare(rows: Rows, variant: str, limit: float) -> Comparison:
    """Return how a variant does against the full planner."""
    runs = {(row["stage"], row["problem"], row["seed"], row["variant"]): row for row in rows}
    success, first, cost = defaultdict(list), defaultdict(list), defaultdict(list)
    for (stage, problem, seed, name), row in runs.items():
        full = runs.get((stage, problem, seed, FULL))
        if name != variant or full is None:
            continue
        if stage == "first":
            success[problem].append(float(row["status"] != "timeout") - float(full["status"] != "timeout"))
            if row["first"] is not None or full["first"] is not None:
                first[problem].append(math.log((row["first"] or limit) / (full["first"] or limit)))
        elif row["cost"] and full["cost"]:
            cost[problem].append(math.log(row["cost"] / full["cost"]))
    means = [[float(np.mean(values)) for values in found.values()] for found in (success, first, cost)]
    return Comparison(len(success), *(Interval.of(values) for values in means))


def decided(rows: Rows, variant: str) -> float:
    """Return the share of a variant's runs that decided their problem."""
    chosen = [row["status"] != "timeout" for row in rows if row["variant"] == variant and row["stage"] == "first"]
    return float(np.mean(chosen)) if chosen else math.nan


def names_in(rows: Rows) -> list[str]:
    """Return the variants but the full planner: without single mechanisms, then planners made of parts."""
    order = [CONTROL, *(f"without {name}" for name in MECHANISMS), SAMPLES, *(f"planner {name}" for name in METHODS)]
    there = {row["variant"] for row in rows}
    return [name for name in order if name in there]


def publish(rows: Rows, limit: float, *, write: bool = True) -> str:
    """Return the table as Markdown; write it and the plot."""
    text = page(rows, limit)
    if write:
        write_atomically(RESULTS / "ablation.md", text + "\n")
        write_atomically(RESULTS / "ablation.png", draw(rows, limit))
    return text


def page(rows: Rows, limit: float) -> str:
    """Return the report as Markdown."""
    problems = {row["problem"] for row in rows}
    counts = {
        stage: len({(r["problem"], r["seed"]) for r in rows if r["stage"] == stage}) for stage in ("first", "cost")
    }
    lines = ["# What each mechanism is good for", "", "Written by `python -m benchmarks.ablation`.", ""]
    lines += ["![success, time to the first path and cost without each mechanism](ablation.png)", ""]
    header = ["variant", "problems", "decided", "difference, points", "first path, ratio", "cost, difference %"]
    found = {name: compare(rows, name, limit) for name in names_in(rows)}
    table = [[FULL, str(len(problems)), f"{100.0 * decided(rows, FULL):.1f} %", "", "", ""]]
    for name, each in found.items():
        share = f"{100.0 * decided(rows, name):.1f} %"
        table.append([name, str(each.problems), share, _points(each.success), _ratio(each.first), _percent(each.cost)])
    lines += [
        markdown_table(header, table),
        "",
        "Time to the first path by group of problems, ratio to the full planner:",
        "",
    ]
    groups = {group: title for group, title in GROUPS.items() if any(row["group"] == group for row in rows)}
    by_group = []
    for name in found:
        cells = []
        for group in groups:
            within = compare([row for row in rows if row["group"] == group], name, limit)
            cells.append(_ratio(within.first, brief=True) if within.problems else "")
        by_group.append([name, *cells])
    lines += [markdown_table(["variant", *groups.values()], by_group), ""]
    lines += [
        f"- {len(problems)} problems: one of every kind of `benchmarks.ahead`, further worlds of 500 obstacles,",
        "  worlds of narrow passages, worlds of discs and polygons with holes in a curved boundary, cars. A variant",
        "  runs where it makes a difference to the robot.",
        f"- {counts['first']} pairs of problem and seed up to the first path, the soonest of several runs each;",
        f"  {counts['cost']} up to the limit of {limit:g} s. All variants answer a pair one after the other in a",
        "  random order in one process.",
        "- Decided: a path, or a proof that there is none. First path: geometric mean; without a path the limit",
        "  counts. Cost at the limit: where both have a path. In brackets 95 % bootstrap intervals, problems",
        "  resampled; a star where that excludes no difference.",
        f"- “{CONTROL[0].upper()}{CONTROL[1:]}” tells what is chance.",
        f"- {describe_machine()}",
    ]
    return "\n".join(lines)


def _as_points(value: Any) -> Any:
    return 100.0 * value


def _as_percent(value: Any) -> Any:
    return 100.0 * np.expm1(value)


def draw(rows: Rows, limit: float) -> bytes:
    """Return the plot as PNG: a mark and an interval for each variant and figure."""
    found = {name: compare(rows, name, limit) for name in reversed(names_in(rows))}
    figure = Figure(figsize=(12.0, 1.6 + 0.27 * len(found)), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    panels: tuple[tuple[str, list[Interval], Callable[[Any], Any], str], ...] = (
        ("decided within the limit, points", [c.success for c in found.values()], _as_points, "linear"),
        ("time to the first path, ratio", [c.first for c in found.values()], np.exp, "log"),
        ("cost at the limit, %", [c.cost for c in found.values()], _as_percent, "symlog"),
    )
    all_axes = figure.subplots(1, 3, sharey=True)
    for axes, (title, intervals, shown, scale) in zip(all_axes, panels, strict=True):
        mean, low, high = (shown(np.array(column)) for column in zip(*intervals, strict=True))
        colours = ["#d55e00" if interval.differs else "#777777" for interval in intervals]
        y = np.arange(len(found))
        axes.hlines(y, low, high, colors=colours, linewidth=2.0)
        axes.scatter(mean, y, c=colours, s=22, zorder=3)
        axes.axvline(float(shown(np.array(0.0))), color="#000000", linewidth=0.8)
        if scale == "log":
            axes.set_xscale("log")
            axes.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
            axes.minorticks_off()
        elif scale == "symlog":
            axes.set_xscale("symlog", linthresh=1.0)
            axes.set_xticks([-1, -0.5, 0, 0.5, 1, 10, 50], ["-1", "-0.5", "0", "0.5", "1", "10", "50"])
        axes.set_title(title, loc="left", fontsize=10)
        axes.grid(axis="x", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.set_yticks(y, list(found), fontsize=9)
        axes.set_ylim(-0.7, len(found) - 0.3)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120, metadata={"Description": describe_machine()})
    return buffer.getvalue()


def _points(interval: Interval) -> str:
    return _text(interval, lambda v: f"{_as_points(v):+.1f}")


def _percent(interval: Interval) -> str:
    return _text(interval, lambda v: f"{_as_percent(v):+.2f}")


def _ratio(interval: Interval, *, brief: bool = False) -> str:
    return _text(interval, lambda v: f"{math.exp(v):.2f}", brief=brief)


def _text(interval: Interval, shown: Callable[[float], str], *, brief: bool = False) -> str:
    if math.isnan(interval.mean):
        return "–"
    star = "*" if interval.differs else ""
    if brief or math.isnan(interval.low):
        return f"{shown(interval.mean)}{star}"
    return f"{shown(interval.mean)} [{shown(interval.low)}, {shown(interval.high)}]{star}"
