"""Tables of a report: the same cells as HTML and as Markdown."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.comparison import Comparison
from trailmark.benchmark.report.data import Problem
from trailmark.benchmark.report.digits import NOTHING, count, factor, milliseconds, number, percent, probability
from trailmark.benchmark.report.palette import Style, legend_mark
from trailmark.benchmark.report.summary import PlannerSummary, Summary, summarise_runs
from trailmark.benchmark.statistics import holm, quantiles, rank_test

__all__ = ["Table", "effort_table", "failure_table", "overall_table", "pair_table", "problem_table"]

FloatArray = NDArray[np.float64]

LONG = 45  # letters of a cell from which on its column's words are broken into lines
MAX_REASONS, MAX_REASON_LENGTH = 12, 200  # rows, and letters of each, of a table of failures


@dataclass(frozen=True)
class Table:
    """Cells as text.

    Attributes:
        caption: what the table shows.
        columns: heads, with units.
        rows: cells, the first of each the row's head.
        texts: columns that hold words, not numbers, besides the first.
        planners: whether the rows' heads are planners.
    """

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    texts: frozenset[int] = frozenset()
    planners: bool = True

    def html(self, styles: Mapping[str, Style]) -> str:
        """Return the table, in a box that scrolls sideways where the page is too narrow."""
        head = "".join(f'<th scope="col"{self._class(i)}>{escape(c)}</th>' for i, c in enumerate(self.columns))
        body = []
        for row in self.rows:
            mark = legend_mark(styles[row[0]]) if self.planners and row[0] in styles else ""
            cells = "".join(f"<td{self._class(i)}>{escape(cell)}</td>" for i, cell in enumerate(row) if i)
            body.append(f'<tr><th scope="row">{mark}{_breakable(row[0])}</th>{cells}</tr>')
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"
        # Not a caption element: that would scroll away with a wide table.
        box = f'<div class="scroll" role="region" aria-label="{escape(self.caption)}" tabindex="0">{table}</div>'
        return f'<p class="caption">{escape(self.caption)}</p><div class="table">{box}</div>'

    def markdown(self) -> str:
        """Return the table as Markdown whose columns line up as plain text too."""
        cells = [[cell.replace("|", "\\|").replace("\n", " ") for cell in row] for row in (self.columns, *self.rows)]
        widths = [max(3, *(len(row[i]) for row in cells)) for i in range(len(self.columns))]
        left = [i == 0 or i in self.texts for i in range(len(self.columns))]
        lines = [
            "| "
            + " | ".join(c.ljust(w) if side else c.rjust(w) for c, w, side in zip(row, widths, left, strict=True))
            + " |"
            for row in cells
        ]
        rule = "|".join(
            f"{'-' * (w + 2)}" if side else f"{'-' * (w + 1)}:" for w, side in zip(widths, left, strict=True)
        )
        return "\n".join([lines[0], f"|{rule}|", *lines[1:]])

    def _class(self, column: int) -> str:
        if column == 0 or column in self.texts:
            long = column and max((len(row[column]) for row in self.rows), default=0) > LONG
            return ' class="words long"' if long else ' class="words"'
        return ""


def overall_table(summary: Summary, caption: str) -> Table:
    """Return a row for each planner over all problems, the quickest first."""
    columns = ["planner", "problems", "runs", "solved, says planner", "solved and correct", "95 % interval"]
    columns += ["first path: mean [ms]", "median [ms]", "first cost / best", "final cost / best", "quartiles"]
    columns += ["ahead of, in time", "behind", "ahead of, in cost", "behind", "runs without success"]
    rows = [
        [
            *(s.planner, str(s.problems), str(s.runs), percent(s.claimed / s.runs), percent(s.success / s.runs)),
            _interval(s),
            *(milliseconds(s.first_mean), _median_time(s), _ratio(s.first_ratio[2]), _ratio(s.ratio[2])),
            f"{_ratio(s.ratio[1])} to {_ratio(s.ratio[3])}",
            *_ahead(s.planner, summary.times),
            *_ahead(s.planner, summary.costs),
            _endings(s),
        ]
        for s in summary.planners
    ]
    return Table(caption, columns, rows, frozenset({15}))


def pair_table(summary: Summary, what: str, caption: str) -> Table:
    """Return a row and a column for each planner: how many times the row's is better, where the test can tell.

    Args:
        summary: of all runs.
        what: ``times`` or ``costs``.
        caption: of the table.
    """
    found = summary.times if what == "times" else summary.costs
    order = [s.planner for s in (summary.planners if what == "times" else summary.by_cost())]
    rows = []
    for a in order:
        cells = []
        for b in order:
            pair = found.get(frozenset((a, b)))
            cells.append("" if a == b or pair is None else _pair_cell(pair.seen_from(a)))
        rows.append([a, *cells])
    return Table(caption, ["planner", *order], rows)


def problem_table(problem: Problem, caption: str) -> Table:
    """Return a row for each planner on one problem, the quickest first, tested against the best of them."""
    columns = ["planner", "runs", "solved, says planner", "solved and correct", "95 % interval"]
    columns += ["first path: mean [ms]", "median [ms]", "p, time", "first cost [m]", "final cost [m]", "quartiles [m]"]
    columns += ["final / best", "p, cost", "simplified [m]", "runs without success"]
    found = sorted((summarise_runs(problem, name) for name in problem.runs), key=lambda s: s.first_mean)
    quickest = found[0].planner
    cheapest = min(found, key=lambda s: (s.ratio[2], s.missing, s.mean_ratio)).planner
    time_p = _probabilities(quickest, {name: runs.first_times for name, runs in problem.runs.items()})
    cost_p = _probabilities(cheapest, {name: runs.costs for name, runs in problem.runs.items()})
    rows = []
    for s in found:
        runs = problem.runs[s.planner]
        first = np.where(
            runs.success & np.isfinite(runs["first_solution_length"]), runs["first_solution_length"], np.inf
        )
        quarter, median, three = quantiles(runs.costs, (0.25, 0.5, 0.75)).tolist()
        rows.append(
            [
                *(s.planner, str(s.runs), percent(s.claimed / s.runs), percent(s.success / s.runs), _interval(s)),
                *(milliseconds(s.first_mean), _median_time(s), time_p[s.planner]),
                *(_cost(quantiles(first, (0.5,))[0]), _cost(median), f"{_cost(quarter)} to {_cost(three)}"),
                *(_ratio(s.ratio[2]), cost_p[s.planner], _cost(quantiles(runs.simplified_costs, (0.5,))[0])),
                _endings(s),
            ]
        )
    return Table(caption, columns, rows, frozenset({14}))


def effort_table(problem: Problem, caption: str) -> Table:
    """Return what each planner's runs on a problem took: medians of all runs, failed ones too."""
    columns = ["planner", "planning [ms]", "simplifying [ms]", "states checked", "motions checked", "graph states"]
    columns += ["graph motions", "memory [MB]", "overhead [ms]", "set-up of the world [ms]", "turning [rad/m]"]
    columns += ["sharpest [rad/m]", "least clearance [m]", "seeds"]
    rows = []
    for name, runs in problem.runs.items():
        middle = {column: _median(values) for column, values in runs.columns.items()}
        rows.append(
            [
                *(name, milliseconds(middle["time"]), milliseconds(middle["simplification_time"])),
                *(count(middle[c]) for c in ("states_checked", "motions_checked", "graph_states", "graph_motions")),
                *(number(middle["memory"]), milliseconds(middle["overhead"]), milliseconds(middle["setup_time"])),
                *(number(middle[c]) for c in ("smoothness", "max_curvature", "min_clearance")),
                _seeds(runs["seed"]),
            ]
        )
    return Table(caption, columns, rows, frozenset({13}))


def failure_table(problem: Problem, caption: str) -> Table | None:
    """Return what the failed runs on a problem gave as the reason, equal reasons together; None without any."""
    found: dict[tuple[str, str], list[int]] = {}
    for name, runs in problem.runs.items():
        for reason, seed in zip(runs.failures, runs["seed"].tolist(), strict=True):
            if reason:
                found.setdefault((name, " ".join(reason.split())), []).append(int(seed))
    if not found:
        return None
    ordered = sorted(found.items(), key=lambda item: -len(item[1]))
    rows = [
        [
            name,
            str(len(seeds)),
            str(seeds[0]),
            reason if len(reason) <= MAX_REASON_LENGTH else f"{reason[:MAX_REASON_LENGTH]}…",
        ]
        for (name, reason), seeds in ordered[:MAX_REASONS]
    ]
    more = f"; the {MAX_REASONS} most frequent of {len(found)}" if len(found) > MAX_REASONS else ""
    return Table(caption + more, ["planner", "runs", "first seed", "reason"], rows, frozenset({3}))


def _breakable(name: str) -> str:
    """Return a planner's name as HTML that a narrow page may break before or after what tells its family."""
    return escape(name).replace("+", "<wbr>+").replace(":", ":<wbr>")


def _pair_cell(pair: Comparison) -> str:
    if pair.winner is None:
        return "≈"
    sign = "▲" if pair.winner == pair.a else "▼"
    return sign if math.isnan(pair.factor) else f"{sign} {factor(pair.factor)}"


def _ahead(planner: str, pairs: Mapping[frozenset[str], Comparison]) -> tuple[str, str]:
    mine = [pair for names, pair in pairs.items() if planner in names]
    won = sum(pair.winner == planner for pair in mine)
    lost = sum(pair.winner not in (None, planner) for pair in mine)
    return f"{won} of {len(mine)}", str(lost)


def _probabilities(best: str, values: Mapping[str, FloatArray]) -> dict[str, str]:
    """Return Holm's probabilities of each planner being as good as the best, as words."""
    others = [name for name in values if name != best]
    adjusted = holm([rank_test([(values[best], values[name])]).p for name in others])
    return {best: "best"} | {
        name: probability(float(p)).removeprefix("= ") for name, p in zip(others, adjusted, strict=True)
    }


def _median(values: FloatArray) -> float:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else math.nan


def _interval(s: PlannerSummary) -> str:
    return f"{100 * s.interval.low:.0f} to {100 * s.interval.high:.0f} %"


def _median_time(s: PlannerSummary) -> str:
    return "none" if math.isinf(s.first[2]) else milliseconds(s.first[2])


def _cost(value: float) -> str:
    return "none" if math.isinf(value) else number(value, 4)


def _ratio(value: float) -> str:
    return "none" if math.isinf(value) else f"{value:.3f}" if value < 9.9995 else number(value)


def _endings(s: PlannerSummary) -> str:
    return ", ".join(f"{n} {how}" for how, n in s.endings.items()) or NOTHING


def _seeds(seeds: FloatArray) -> str:
    known = np.unique(seeds[~np.isnan(seeds)]).astype(int)
    if len(known) == 0:
        return NOTHING
    whole = len(known) == known[-1] - known[0] + 1
    return (
        f"{known[0]} to {known[-1]}"
        if whole and len(known) > 1
        else ", ".join(map(str, known[:8])) + (" …" if len(known) > 8 else "")
    )
