"""What the figures of benchmarks/nodes.py say: means over worlds, differences to K-means centres, words, a plot.

Worlds are what is resampled (bootstrap, percentile intervals): what is measured in one world for two robots and many
queries is not independent. Differences are paired, world by world.
"""

from __future__ import annotations

import io
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.machine import describe_machine, markdown_table
from benchmarks.placements import CENTRES, HALTON, INFORMED, LATTICE, OURS, PLACEMENTS, UNIFORM

__all__ = ["Measure", "Record", "Table", "differences", "draw", "markdown", "means", "verdict"]

FloatArray = NDArray[np.float64]

RESAMPLES = 4000
MEAN_LEVEL, DIFFERENCE_LEVEL = 0.95, 0.99
"""Levels of the intervals of means, and of differences, of which there are many."""


Interval = tuple[float, float, float]
"""A mean and the ends of its interval."""


class Record(NamedTuple):
    """What was found for one number of nodes and one placement.

    Attributes:
        n: number of nodes.
        nodes: name of the placement.
        intervals: by the measure's title, those that were measured.
    """

    n: int
    nodes: str
    intervals: dict[str, Interval]


class Measure(NamedTuple):
    """What is compared.

    Attributes:
        key: of the rows.
        robot: the rows of one robot only; None takes the mean over both.
        title: of its column and axis.
        scale: what values are multiplied by to be shown.
        digits: shown after the point.
        sign: 1 if more is better, else -1.
    """

    key: str
    robot: str | None
    title: str
    scale: float
    digits: int
    sign: int


DISPERSION = Measure("dispersion", None, "dispersion / √(A/n)", 1.0, 2, -1)
COVERAGE = Measure("coverage", None, "coverage %", 100.0, 1, 1)
SUCCESS = Measure("success", None, "success %", 100.0, 1, 1)
SHOWN = (
    DISPERSION,
    COVERAGE,
    Measure("success", "disc", "success %, disc", 100.0, 1, 1),
    Measure("success", "rectangle", "success %, rectangle", 100.0, 1, 1),
)

MEASURES = {measure.title: measure for measure in (*SHOWN, SUCCESS)}

# Okabe & Ito's colours, which colour-blind readers tell apart; markers and lines repeat what they say.
STYLES = {
    UNIFORM: ("#000000", "o", ":"),
    HALTON: ("#56b4e9", "^", "--"),
    LATTICE: ("#009e73", "v", "-."),
    CENTRES: ("#d55e00", "s", "-"),
    OURS: ("#0072b2", "D", "-"),
    INFORMED: ("#cc79a7", "P", "--"),
}


class Table:
    """The rows of a run, by world.

    Args:
        rows: what benchmarks.nodes.measure returned, for all worlds and robots.

    Attributes:
        counts: the numbers of nodes.
    """

    def __init__(self, rows: Iterable[dict[str, Any]]) -> None:
        self.rows = list(rows)
        self.counts = sorted({int(row["n"]) for row in self.rows})
        self._worlds = {name: i for i, name in enumerate(dict.fromkeys(row["world"] for row in self.rows))}
        picks = np.random.default_rng(0).integers(len(self._worlds), size=(RESAMPLES, len(self._worlds)))
        self._picks: NDArray[np.int64] = picks

    def values(self, measure: Measure, method: str, n: int) -> FloatArray:
        """Return one value per world, the mean over the robots; NaN where nothing was measured."""
        found: dict[int, list[float]] = defaultdict(list)
        for row in self.rows:
            fits = row["method"] == method and row["n"] == n and measure.robot in (None, row["robot"])
            if fits and row.get(measure.key) is not None:
                found[self._worlds[row["world"]]].append(row[measure.key])
        return np.array([np.mean(found[i]) if i in found else np.nan for i in range(len(self._worlds))])

    def interval(self, values: FloatArray, level: float) -> Interval:
        """Return the mean over the worlds and the ends of its bootstrap interval; NaN if there are no values."""
        known = np.isfinite(values)
        if not known.any():
            return np.nan, np.nan, np.nan
        counted = known[self._picks].sum(axis=1)
        sums = np.where(known, values, 0.0)[self._picks].sum(axis=1)
        low, high = np.quantile(sums[counted > 0] / counted[counted > 0], (0.5 - level / 2, 0.5 + level / 2))
        return float(values[known].mean()), float(low), float(high)


def means(table: Table) -> list[Record]:
    """Return the means over the worlds with their intervals, one record per n and placement."""
    records = []
    for n in table.counts:
        for method in STYLES:
            found = {m.title: table.interval(table.values(m, method, n), MEAN_LEVEL) for m in SHOWN}
            records.append(Record(n, method, _known(found)))
    return records


def differences(table: Table) -> list[Record]:
    """Return what K-means centres have more than the others, with intervals, one record per n and rival."""
    records = []
    for n in table.counts:
        for rival in STYLES:
            if rival != CENTRES:
                found = {m.title: _difference(table, m, rival, n) for m in (DISPERSION, COVERAGE, SUCCESS)}
                records.append(Record(n, rival, _known(found)))
    return records


def markdown(records: list[Record], name: str, *, signed: bool = False) -> str:
    """Return records as a Markdown table; ``signed`` ones are differences and get a star where the interval proves one.

    Args:
        records: of :func:`means` or :func:`differences`.
        name: heads the column of placements.
        signed: whether to show signs.
    """
    titles = list(dict.fromkeys(title for record in records for title in record.intervals))
    rows = []
    for n, method, intervals in records:
        cells = []
        for title in titles:
            measure, interval = MEASURES[title], intervals.get(title)
            star = "*" if signed and interval and _side(measure, interval) else ""
            cells.append(_text(measure, interval, signed=signed) + star if interval else "")
        rows.append([str(n), method, *cells])
    return markdown_table(["n", name, *titles], rows)


def verdict(table: Table) -> str:
    """Return in words, from the figures alone, whether K-means centres are good roadmap nodes."""
    space = _phrase(table, DISPERSION, "leave smaller empty discs than", "leave larger ones than")
    roads = _phrase(table, SUCCESS, "answer more queries than", "answer fewer than")
    best, own, informed = [], [], []
    for n in table.counts:
        mean = {method: 100.0 * np.nanmean(table.values(SUCCESS, method, n)) for method in STYLES}
        first = max(PLACEMENTS, key=lambda method: mean[method])
        best.append(f"{first} at n = {n} ({mean[first]:.1f} %)")
        own.append(f"{mean[CENTRES]:.1f}")
        informed.append(f"{mean[INFORMED]:.1f}")
    return (
        f"As a filling of free space, {space}. As roadmap nodes, {roads}. "
        f"The highest mean success without knowledge of the query: {_and(best)}; K-means centres reach "
        f"{_and(own)} %, landmarks informed by the query {_and(informed)} %."
    )


def draw(table: Table) -> bytes:
    """Return a PNG of the measures against n."""
    figure = Figure(figsize=(10.0, 7.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2, sharex=True).ravel()
    handles = {}
    for ax, measure in zip(axes, SHOWN, strict=True):
        for i, (method, (colour, marker, line)) in enumerate(STYLES.items()):
            found = np.array([table.interval(table.values(measure, method, n), MEAN_LEVEL) for n in table.counts])
            if not np.isfinite(found).any():
                continue
            mean, low, high = measure.scale * found.T
            # Side by side, so that the intervals do not hide one another.
            x = np.array(table.counts) * 1.04 ** (i - 0.5 * (len(STYLES) - 1))
            handles[method] = ax.errorbar(
                x,
                mean,
                [mean - low, high - mean],
                color=colour,
                marker=marker,
                linestyle=line,
                capsize=2.5,
                markersize=6,
            )
        ax.set_title(measure.title + (" (less is better)" if measure.sign < 0 else ""))
        ax.set_xscale("log")
        ax.set_xticks(table.counts, [str(n) for n in table.counts])
        ax.minorticks_off()
        ax.grid(visible=True, color="#dddddd", linewidth=0.6)
        if measure.scale == 100.0:
            ax.set_ylim(top=101.0)
    for ax in axes[2:]:
        ax.set_xlabel("nodes n")
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3, frameon=False)
    figure.suptitle("Nodes placed in several ways: means over worlds, 95 % intervals")
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=120, metadata={"Description": describe_machine()})
    return buffer.getvalue()


def _known(intervals: dict[str, Interval]) -> dict[str, Interval]:
    return {title: interval for title, interval in intervals.items() if np.isfinite(interval[0])}


def _difference(table: Table, measure: Measure, rival: str, n: int) -> Interval:
    own, other = table.values(measure, CENTRES, n), table.values(measure, rival, n)
    return table.interval(own - other, DIFFERENCE_LEVEL)


def _side(measure: Measure, interval: Interval) -> int:
    """Return 1 if K-means centres are proven better, -1 if worse, 0 if neither."""
    _, low, high = interval
    return measure.sign * (int(low > 0.0) - int(high < 0.0))


def _standing(table: Table, measure: Measure) -> dict[int, dict[str, list[int]]]:
    """Return for each verdict (1, -1, 0) the rivals that know no query, with the n for which it holds."""
    found: dict[int, dict[str, list[int]]] = {1: {}, -1: {}, 0: {}}
    for rival in PLACEMENTS:
        for n in table.counts if rival != CENTRES else ():
            found[_side(measure, _difference(table, measure, rival, n))].setdefault(rival, []).append(n)
    return found


def _phrase(table: Table, measure: Measure, better: str, worse: str) -> str:
    """Return a clause that says which rivals, at which n, K-means centres are proven better or worse than."""

    def listed(rivals: dict[str, list[int]]) -> str:
        at = {rival: ", ".join(map(str, n)) for rival, n in rivals.items()}
        return _and([f"{rival} ({'every n' if rivals[rival] == table.counts else f'n = {at[rival]}'})" for rival in at])

    standing = _standing(table, measure)
    parts = [f"{verb} {listed(standing[side])}" for side, verb in ((1, better), (-1, worse)) if standing[side]]
    open_ones = f"no difference from {listed(standing[0])} is proven" if standing[0] else ""
    if not parts:
        return f"for K-means centres {open_ones}"
    return "K-means centres " + " and ".join(parts) + (f"; {open_ones}" if open_ones else "")


def _text(measure: Measure, interval: Interval, *, signed: bool = False) -> str:
    mean, low, high = (f"{measure.scale * v:{'+' if signed else ''}.{measure.digits}f}" for v in interval)
    return f"{mean} [{low}, {high}]"


def _and(parts: Sequence[str]) -> str:
    return ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]
