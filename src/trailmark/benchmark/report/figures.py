"""The figures of a report: which planners share a chart, and what each chart shows."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from trailmark.benchmark.report.charts import BoxRow, ShareRow, box_chart, share_chart
from trailmark.benchmark.report.conditions import world_text_of
from trailmark.benchmark.report.curves import CostCurve, cost_curves, overall_curves
from trailmark.benchmark.report.data import Problem, Results
from trailmark.benchmark.report.digits import number, percent, seconds
from trailmark.benchmark.report.lines import CostLine, EcdfLine, cost_chart, ecdf_chart
from trailmark.benchmark.report.palette import FAMILIES, Style, algorithm_of, family_of
from trailmark.benchmark.report.summary import PlannerSummary, Summary, summarise_runs
from trailmark.benchmark.report.worlds import scene_of

__all__ = ["Figures", "panels"]

FloatArray = NDArray[np.float64]

TOGETHER = 6
"""Planners that fit into one chart of lines; more are shown in a chart for each family, landmark in all of them."""

REFUSED = 3  # paths drawn that the referee did not accept


def panels(planners: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Return the charts of lines that planners are shown in: a title (empty if it is the only one) and their names."""
    families = [f for f in FAMILIES if f != "landmark" and any(family_of(name) == f for name in planners)]
    if len(planners) <= TOGETHER or len(families) < 2:
        return [("", list(planners))]
    always = [name for name in planners if family_of(name) == "landmark"]
    return [(FAMILIES[f], always + [name for name in planners if family_of(name) == f]) for f in families]


class Figures:
    """Draws the figures of one report.

    Args:
        results: the database.
        summary: of them.
        styles: of each planner.
        numbers: gives each drawing that needs one a number of its own on the page.
    """

    def __init__(self, results: Results, summary: Summary, styles: Mapping[str, Style], numbers: Iterator[int]) -> None:
        self._results = results
        self._summary = summary
        self._styles = styles
        self._numbers = numbers

    def overall_rows(self) -> Iterator[str]:
        """Yield the charts of success, times and costs over all problems."""
        yield from self._rows(self._summary.planners, "all problems")

    def overall_ecdfs(self) -> Iterator[str]:
        """Yield the share of all runs that have a path, over time."""
        problems = self._results.problems
        times = {
            name: np.concatenate([p.runs[name].first_times for p in problems if name in p.runs])
            for name in self._results.planners
        }
        yield from self._ecdfs(times, max(p.time_limit for p in problems), "all problems")

    def overall_costs(self) -> Iterator[str]:
        """Yield the cost over the best known, over time, for all problems."""
        yield from self._costs(overall_curves(self._results), 1.0, "cost / best known", "all problems")

    def problem_charts(self, problem: Problem) -> Iterator[str]:
        """Yield all charts of one problem but its picture."""
        found = sorted((summarise_runs(problem, name) for name in problem.runs), key=lambda s: s.first_mean)
        yield from self._rows(found, problem.name)
        order = [s.planner for s in found]
        yield from self._ecdfs(
            {name: problem.runs[name].first_times for name in order}, problem.time_limit, problem.name
        )
        if np.isfinite(problem.best_cost):
            curves = cost_curves(problem)
            yield from self._costs({name: curves[name] for name in order}, problem.best_cost, "cost [m]", problem.name)

    def scenes(self, problem: Problem) -> Iterator[str]:
        """Yield the problem's pictures: the world with the path of each planner's middle run."""
        text = world_text_of(problem)
        scene = scene_of(text, next(self._numbers)) if text else None
        if scene is None:
            yield '<p class="note">The database holds no world for this problem that can be drawn.</p>'
            return
        middle = {name: run for name, runs in problem.runs.items() if (run := _middle(runs.costs)) is not None}
        wrong = [int(i) for runs in problem.runs.values() for i in runs.ids[runs.claimed & ~runs.success]][:REFUSED]
        best = _best(problem)
        ids = {name: int(problem.runs[name].ids[i]) for name, i in middle.items()}
        paths = self._results.paths([*ids.values(), *wrong, *([] if best is None else [best])])
        yield f'<svg class="defs" aria-hidden="true"><defs>{scene.background()}</defs></svg>'
        caption = "Each planner's middle run by cost; the robot along the best path."
        caption += " Red: refused paths." if wrong else ""
        for family, names in panels(list(problem.runs)):
            # The landmark planner's path last, so that it lies on top.
            shown = {name: paths[ids[name]] for name in reversed(names) if name in ids and ids[name] in paths}
            label = f"{problem.name}: world with start S, goal G and the paths of {', '.join(shown) or 'no planner'}"
            along = None if best is None else paths.get(best)
            refused = [paths[i] for i in wrong if i in paths]
            drawn = scene.picture(shown, self._styles, along, refused, label)
            yield _figure(_titled("Paths", family), caption, drawn, wide=not family)

    def _rows(self, found: Sequence[PlannerSummary], where: str) -> Iterator[str]:
        shares = [
            ShareRow(
                s.planner,
                self._styles[s.planner],
                s.success / s.runs,
                s.interval.low,
                s.interval.high,
                s.claimed / s.runs,
                f"{s.success}/{s.runs}",
            )
            for s in sorted(found, key=lambda s: -s.success / s.runs)
        ]
        drawn = share_chart(shares, f"Success rate of {len(found)} planners, {where}, with 95 % Wilson intervals")
        caption = (
            "Dot: solved and correct, with its 95 % Wilson interval. Ring: the planner's own claim, where it differs."
        )
        yield _figure("Success rate", caption, drawn)
        rows = [BoxRow(s.planner, self._styles[s.planner], s.first, seconds(s.first_mean)) for s in found]
        drawn = box_chart(rows, f"Time to the first path, {where}", "time to the first path [s]", True, "mean")
        caption = (
            "Box: quartiles, median; whiskers: 5 and 95 % of all runs; arrow: the rest failed. Right: shifted "
            "geometric mean, failures at the limit."
        )
        yield _figure("Time to the first path", caption, drawn)
        ordered = sorted(found, key=lambda s: (s.ratio[2], s.missing, s.mean_ratio))
        rows = [BoxRow(s.planner, self._styles[s.planner], s.ratio, percent(s.missing)) for s in ordered]
        drawn = box_chart(rows, f"Final cost over the best known, {where}", "final cost / best known", False, "no path")
        caption = "The same of the cost at the end of planning. Right: share of runs without a correct path."
        yield _figure("Cost ratio to the best known", caption, drawn)

    def _ecdfs(self, times: Mapping[str, FloatArray], limit: float, where: str) -> Iterator[str]:
        finite = np.concatenate([t[np.isfinite(t)] for t in times.values()])
        low = max(1e-4, 0.8 * float(finite.min())) if len(finite) else 0.01 * limit
        for family, names in panels(list(times)):
            lines = [EcdfLine(_short(name, family), self._styles[name], times[name]) for name in names]
            label = f"Share of runs that have a path over time, {where}: {', '.join(names)}"
            drawn = ecdf_chart(lines, min(low, 0.5 * limit), limit, label)
            yield _figure(_titled("Runs with a path", family), "Share whose first path was there by then.", drawn)

    def _costs(self, curves: Mapping[str, CostCurve], best: float, axis: str, where: str) -> Iterator[str]:
        high = _highest(curves, best)
        known = f"Best known: {number(best, 4)}{' m' if '[m]' in axis else ''}."
        for family, names in panels(list(curves)):
            lines = [CostLine(_short(name, family), self._styles[name], curves[name]) for name in names]
            label = f"{axis} over planning time, {where}: {', '.join(names)}"
            drawn = cost_chart(lines, best - 0.03 * (high - best), high, axis, label, next(self._numbers))
            caption = f"Best path so far, median and quartiles. {known}"
            yield _figure(_titled("Cost against time", family), caption, drawn)


def _titled(title: str, family: str) -> str:
    return f"{title}: {family}" if family else title


def _short(name: str, family: str) -> str:
    """Return what a planner is called in a chart: where the title names the family, its name need not."""
    return algorithm_of(name) if family else name


def _figure(title: str, caption: str, drawn: str, wide: bool = False) -> str:
    kind = ' class="wide"' if wide else ""
    return f"<figure{kind}><figcaption><b>{escape(title)}</b>{escape(caption)}</figcaption>{drawn}</figure>"


def _middle(costs: FloatArray) -> int | None:
    """Return which run has the middle cost of those that succeeded; None if none did."""
    order = np.argsort(costs, kind="stable")[: int(np.isfinite(costs).sum())]
    return int(order[(len(order) - 1) // 2]) if len(order) else None


def _best(problem: Problem) -> int | None:
    """Return the id of the run whose returned path is the best; None if none is correct."""
    found = [(float(runs.costs.min()), int(runs.ids[runs.costs.argmin()])) for runs in problem.runs.values()]
    cost, key = min(found)
    return key if np.isfinite(cost) else None


def _highest(curves: Mapping[str, CostCurve], best: float) -> float:
    """Return the cost at a chart's top: it shows where all planners end, and where most of them begin."""
    ends = [c.quartiles[1:, -1] for c in curves.values()]
    finite = np.concatenate(ends)[np.isfinite(np.concatenate(ends))]
    begun = [c.quartiles[1][np.isfinite(c.quartiles[1])][:1] for c in curves.values()]
    firsts = np.concatenate(begun)
    if not len(finite):
        return 1.5 * best if best > 0.0 else 1.0
    end = float(np.quantile(finite, 0.9))
    first = float(np.quantile(firsts, 0.75))
    high = max(end, min(first, best + 4.0 * (end - best) + 0.1 * best))
    return max(high + 0.05 * (high - best), 1.01 * best, best + 1e-6)
