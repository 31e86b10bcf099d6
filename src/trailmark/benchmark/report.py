"""The report on a results database: figures for the shell, and one static page that works offline, light or dark.

It reads the database alone, so that it can be written on any machine, also while a benchmark is running. A run that
failed has no time and no cost: in means of times it counts as the time limit, in medians as infinity, that is, as worse
than every run that succeeded.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.benchmark.results import FloatArray, Problem, Results, Runs

__all__ = ["Ratio", "failures", "html_report", "paired_ratio", "ranked", "step_values", "summary", "wilson"]

SHIFT = 0.01
"""Seconds, of the shifted geometric mean of times."""
RESAMPLES = 2_000
"""Of the bootstrap."""
MOMENTS = 240
"""Places along the time axis at which the charts look."""
NOTHING = "–"
CONDITIONS = {"version": "version", "cpuinfo": "processor", "hostname": "machine", "date": "first begun"}
OWN = ("text", "start", "goal", "problem", "processor")
"""Parts of a problem's setup that are no condition: they are the problem."""


class Ratio(NamedTuple):
    """A geometric mean of ratios and its 95 % interval; NaN where nothing is known."""

    mean: float
    low: float
    high: float


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return Wilson's 95 % score interval of a share (JASA 22, 1927): low and high; 0 to 1 of no runs."""
    from scipy import stats

    if n == 0:
        return 0.0, 1.0
    found = stats.binomtest(successes, n).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def step_values(times: ArrayLike, values: ArrayLike, at: ArrayLike) -> FloatArray:
    """Return the lowest value reached until each moment, shape of ``at``; infinity before the first.

    Args:
        times: shape (n,), seconds, ascending.
        values: shape (n,), what was reached then.
        at: shape (m,), seconds.
    """
    lowest = np.minimum.accumulate(np.concatenate([[np.inf], np.asarray(values, dtype=np.float64)]))
    return np.asarray(lowest[np.searchsorted(np.asarray(times, dtype=np.float64), at, side="right")])


def paired_ratio(pairs: Sequence[tuple[ArrayLike, ArrayLike]]) -> Ratio:
    """Return the geometric mean of a / b over problems, with a percentile bootstrap interval that resamples problems.

    With a single problem its pairs of runs are resampled.

    Args:
        pairs: for each problem the values of two planners with the same seeds, positive, each of shape (n,).
    """
    logs = [np.log(np.asarray(a, dtype=np.float64)) - np.log(np.asarray(b, dtype=np.float64)) for a, b in pairs]
    logs = [each for each in logs if len(each)]
    if not logs:
        return Ratio(math.nan, math.nan, math.nan)
    units = np.array([each.mean() for each in logs]) if len(logs) > 1 else logs[0]
    means = np.random.default_rng(0).choice(units, (RESAMPLES, len(units))).mean(axis=1)
    low, high = np.exp(np.quantile(means, [0.025, 0.975]))
    return Ratio(math.exp(float(units.mean())), float(low), float(high))


def ranked(results: Results) -> list[str]:
    """Return the planners, the one with the least mean time to its first path first; failures count as the limit."""
    means = {name: _mean_time(_parts(results, name)) for name in results.planners}
    return sorted(results.planners, key=lambda name: means[name])


def summary(results: Results, names: Sequence[str]) -> list[list[str]]:
    """Return a header and a row for each planner, over all its runs.

    ``solved`` counts what the referee accepts, ``refused`` what the planner called a solution and is none. Medians are
    over all runs: of the time to the first path, and of the cost as a multiple of the problem's best known.
    """
    rows = [["planner", "solved", "refused", "first path, median s", "cost / best, median"]]
    for name in names:
        parts = _parts(results, name)
        times = np.concatenate([runs.first_times for _, runs in parts])
        costs = np.concatenate([_over_best(problem, runs.costs) for problem, runs in parts])
        solved, refused = sum(int(runs.success.sum()) for _, runs in parts), sum(runs.refused for _, runs in parts)
        medians = (_number(float(np.median(values))) for values in (times, costs))
        rows.append([name, f"{solved}/{len(times)}", str(refused), *medians])
    return rows


def failures(results: Results, names: Sequence[str]) -> list[list[str]]:
    """Return name, endings and most frequent reasons of each planner that has runs without success."""
    rows = []
    for name in names:
        endings, reasons = Counter[str](), Counter[str]()
        for _, runs in _parts(results, name):
            endings.update(runs.endings())
            reasons.update(" ".join(reason.split())[:200] for reason in runs.failures if reason)
        if endings:
            ended = ", ".join(f"{count} {how}" for how, count in endings.most_common())
            said = "; ".join(f"{reason} ({count})" for reason, count in reasons.most_common(3))
            rows.append([name, ended, said or NOTHING])
    return rows


class _Table(NamedTuple):
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: bool = False
    """Whether cells are words, which may break, not numbers."""


def html_report(results: Results) -> str:
    """Return the report as HTML; the same database gives the same text."""
    import jinja2

    from trailmark.plotting.benchmark import line_chart

    names = ranked(results)
    template = files("trailmark.benchmark").joinpath("report.html.j2").read_text(encoding="utf-8")
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    counts = (len(results.problems), "problem"), (len(names), "planner"), (results.runs, "run")
    return environment.from_string(template).render(
        title=results.file.stem,
        sizes=", ".join(f"{n:,} {noun}{'' if n == 1 else 's'}" for n, noun in counts),
        warnings=_warnings(results),
        ranking=_ranking(results, names),
        reference=names[0],
        success=line_chart(_success_over_time(results, names), "time, s", "runs solved", percent=True),
        cost=line_chart(_cost_over_time(results, names), "time, s", "cost / best known"),
        problems=[(problem.name, _problem_table(problem, names)) for problem in results.problems],
        failures=_Table(
            ["planner", "runs without success", "most frequent reasons"], failures(results, names), words=True
        ),
        conditions=_conditions(results),
        settings=_Table(["planner", "settings"], [[n, results.settings.get(n) or NOTHING] for n in names], words=True),
    )


def _parts(results: Results, name: str) -> list[tuple[Problem, Runs]]:
    return [(problem, problem.runs[name]) for problem in results.problems if name in problem.runs]


def _at_limit(problem: Problem, runs: Runs) -> FloatArray:
    """Return the seconds to the first path, failures as the limit, shape (n,)."""
    return np.minimum(runs.first_times, problem.time_limit)


def _mean_time(parts: Sequence[tuple[Problem, Runs]]) -> float:
    """Return the geometric mean, shifted by SHIFT, over the runs on a problem and then over the problems.

    The shift keeps values much smaller than it from deciding the mean (H. Mittelmann's benchmarks of solvers).
    """
    logs = [float(np.log1p(_at_limit(*part) / SHIFT).mean()) for part in parts]
    return float(np.expm1(np.mean(logs)) * SHIFT)


def _over_best(problem: Problem, costs: FloatArray) -> FloatArray:
    """Return costs over the problem's best known one; infinity for failures."""
    best = problem.best_cost
    return costs / best if 0.0 < best < math.inf else np.where(np.isfinite(costs), 1.0, np.inf)


def _ranking(results: Results, names: Sequence[str]) -> _Table:
    header, *rows = summary(results, names)
    for name, row in zip(names, rows, strict=True):
        low, high = wilson(*map(int, row[1].split("/")))
        ratios = _ratios(results, name, names[0]) if name != names[0] else ("1", "1")
        row += [f"{100 * low:.0f} to {100 * high:.0f} %", _number(_mean_time(_parts(results, name))), *ratios]
    return _Table([*header, "95 % interval", "mean s", "time ratio", "cost ratio"], rows)


def _ratios(results: Results, name: str, other: str) -> tuple[str, str]:
    """Return how a planner's times and costs compare with another's, on the problems and with the seeds of both."""
    times, costs = [], []
    for problem in results.problems:
        if name in problem.runs and other in problem.runs:
            ours, theirs = problem.runs[name], problem.runs[other]
            _, own, others = np.intersect1d(ours.seeds, theirs.seeds, return_indices=True)
            times.append((_at_limit(problem, ours)[own], _at_limit(problem, theirs)[others]))
            a, b = ours.costs[own], theirs.costs[others]
            both = np.isfinite(a) & np.isfinite(b) & (a > 0.0) & (b > 0.0)
            costs.append((a[both], b[both]))
    return _ratio(paired_ratio(times)), _ratio(paired_ratio(costs))


def _moments(results: Results) -> FloatArray:
    """Return moments, seconds, from before the first path to the longest limit, evenly on a logarithmic axis."""
    times = [runs.first_times[runs.success] for problem in results.problems for runs in problem.runs.values()]
    first = min((float(some.min()) for some in times if len(some)), default=1e-3)
    return np.geomspace(max(0.8 * first, 1e-5), max(problem.time_limit for problem in results.problems), MOMENTS)


def _success_over_time(results: Results, names: Sequence[str]) -> dict[str, tuple[FloatArray, FloatArray]]:
    moments, found = _moments(results), {}
    for name in names:
        times = np.sort(np.concatenate([runs.first_times for _, runs in _parts(results, name)]))
        found[name] = moments, np.searchsorted(times, moments, side="right") / len(times)
    return found


def _cost_over_time(results: Results, names: Sequence[str]) -> dict[str, tuple[FloatArray, FloatArray]]:
    moments, found = _moments(results), {}
    for name in names:
        rows = []
        for problem, runs in _parts(results, name):
            for i, (times, costs) in enumerate(runs.curves):
                # A run that the referee refuses has no cost at any time, one that is not watched has its last.
                times, costs = (times, costs) if len(times) else (runs.first_times[i : i + 1], runs.costs[i : i + 1])
                steps = step_values(times, costs, moments) if runs.success[i] else np.full(MOMENTS, np.inf)
                rows.append(_over_best(problem, steps))
        middle = np.median(rows, axis=0)
        found[name] = moments, np.where(np.isfinite(middle), middle, np.nan)
    return found


def _problem_table(problem: Problem, names: Sequence[str]) -> _Table:
    header = ["planner", "solved", "refused", "first path, median s"]
    header += ["cost, median", "simplified, median", "least cost"]
    rows = []
    for name in names:
        if name in problem.runs:
            runs = problem.runs[name]
            medians = (float(np.median(values)) for values in (runs.first_times, runs.costs, runs.simplified_costs))
            told = (_number(value) for value in (*medians, float(runs.best_costs.min())))
            rows.append([name, f"{int(runs.success.sum())}/{len(runs)}", str(runs.refused), *told])
    return _Table(header, rows)


def _conditions(results: Results) -> _Table:
    """Return what the runs depended on; a condition that differs between problems is listed with its values."""
    found: dict[str, dict[str, None]] = {}
    for problem in results.problems:
        facts: dict[str, Any] = {words: problem.facts.get(name) for name, words in CONDITIONS.items()}
        facts["time limit of a run"] = f"{problem.time_limit:g} s"
        facts["memory limit of a run"] = None if problem.memory_limit is None else f"{problem.memory_limit:g} MB"
        for part in problem.facts["setup"].values():
            named = part.items() if isinstance(part, Mapping) else ()
            facts |= {name.replace("_", " "): value for name, value in named if name not in OWN and "limit" not in name}
        for name, value in facts.items():
            if value is not None:
                found.setdefault(name, {})[value if isinstance(value, str) else json.dumps(value)] = None
    rows = [[name, "; ".join(list(values)[:6]) + (" …" if len(values) > 6 else "")] for name, values in found.items()]
    return _Table(["condition", "value"], rows, words=True)


def _warnings(results: Results) -> list[str]:
    found = [f"{name}: no run is finished." for name in results.empty]
    short = [p.name for p in results.problems if any(len(runs) < p.wanted for runs in p.runs.values())]
    if short:
        found.append(
            f"Runs are missing, the benchmark is not done: {', '.join(short[:5])}{' …' if len(short) > 5 else ''}."
        )
    if max(len(runs) for problem in results.problems for runs in problem.runs.values()) < 5:
        found.append("Fewer than five runs of each planner on a problem: medians and intervals say little.")
    return found


def _ratio(ratio: Ratio) -> str:
    if math.isnan(ratio.mean):
        return NOTHING
    return f"{ratio.mean:.3g} ({ratio.low:.3g} to {ratio.high:.3g})"


def _number(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else NOTHING
