"""What the landmark planner is to reach against OMPL's planners, and what benchmarks/ahead.py measured."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.ahead_problems import Case
from benchmarks.ahead_results import COST_LIMIT, LANDMARK, Results, cost_ratio, median
from trailmark.benchmark.status import Status

__all__ = ["CERTIFIED", "NATIVE", "PYTHON", "SOON", "Target", "ms", "percent", "slower_worlds", "targets"]

PYTHON, CERTIFIED, NATIVE = "RRTConnect", "RRTConnect+certified", "native:RRTConnect"
SOON, EASY = 0.1, 0.02
"""Seconds: of the target of early success; for RRT-Connect, below which a world is left out of the comparison."""

EASY_KINDS = ("environment1", "depot", "RandomPolygons")
"""Worlds where Python's fixed costs tell; random ones of 50 obstacles too."""

SAME = 1e-6
"""Relative difference of costs that are the same but for rounding."""


class Target(NamedTuple):
    """One figure that is asked for.

    Attributes:
        what: it is.
        wanted: value, in words.
        measured: value, in words.
        reached: whether it is what is wanted; None if it is only reported, or was not measured.
    """

    what: str
    wanted: str
    measured: str
    reached: bool | None

    @property
    def verdict(self) -> str:
        """In words."""
        return {True: "reached", False: "**not reached**", None: "–"}[self.reached]


def targets(results: Results) -> list[Target]:
    """Return every target with what was measured."""
    return [
        *_success(results),
        *_times(results),
        *_first_cost(results),
        *_long_runs(results),
        *_bounds(results),
    ]


def _success(results: Results) -> Iterator[Target]:
    chosen = results.timed([LANDMARK])
    if not chosen:
        return
    runs = [run for case in chosen for run in results.runs(case, LANDMARK)]
    missed = sorted({case.kind for case in chosen if not all(run.correct for run in results.runs(case, LANDMARK))})
    text = f"{sum(run.correct for run in runs)} of {len(runs)} runs on {len(chosen)} problems"
    if missed:
        text += f"; below 100 %: {', '.join(missed)}"
    yield Target("success within 1 s, feasible problems", "100 % on every world", text, not missed)

    planners = results.planners()
    common = results.timed(planners)
    if common and len(planners) > 1:
        shares = {name: results.success(name, SOON, common) for name in planners}
        rival = max((name for name in planners if name != LANDMARK), key=shares.__getitem__)
        text = f"{shares[LANDMARK]:.1%}; next {rival} {shares[rival]:.1%} ({len(common)} problems)"
        wanted = "more than any OMPL planner, native C++ included"
        yield Target("success within 0.1 s", wanted, text, shares[LANDMARK] > shares[rival])


def _times(results: Results) -> Iterator[Target]:
    for rival, words, most in (
        (PYTHON, "OMPL's RRT-Connect from Python", 0.2),
        (NATIVE, "native C++ RRT-Connect", 0.25),
        (f"{NATIVE}+certified", "native C++ RRT-Connect with certified motions", 0.25),
        (CERTIFIED, "OMPL's RRT-Connect from Python with trailmark's motion validator", None),
    ):
        found = results.ratio(rival, results.timed([LANDMARK, rival]))
        what = f"time to the first path, geometric mean of the ratio to {words}"
        if found is None:
            yield Target(what, "" if most is None else f"at most {most:g}", "not measured", None)
        else:
            text = f"{found.value:.2f} (95 %: {found.low:.2f} to {found.high:.2f})"
            yield Target(
                what,
                "stated" if most is None else f"at most {most:g}",
                text,
                None if most is None else found.value <= most,
            )
    yield from _easy(results)
    chosen = results.timed([LANDMARK])
    if chosen:
        quantiles = [results.quantile(LANDMARK, share, chosen) for share in (0.5, 0.95)]
        text = f"median {ms(quantiles[0])} ms, 95th percentile {ms(quantiles[1])} ms"
        yield Target("time to the first path, feasible problems", "reported", text, None)
    behind = slower_worlds(results)
    if behind is not None:
        slow, counted = behind
        text = f"slower in {len(slow)} of {counted} worlds on which RRT-Connect takes 20 ms or more"
        wanted = "at most that of the fastest OMPL planner from Python"
        yield Target("median time to the first path, every world", wanted, text, not slow)


def _easy(results: Results) -> Iterator[Target]:
    easy = [case for case in results.timed([LANDMARK, NATIVE]) if case.kind in EASY_KINDS or "random 50," in case.kind]
    found = results.ratio(NATIVE, easy)
    if found is not None:
        what = "the same to native C++ RRT-Connect, easy worlds (50 obstacles, environment1, depot, RandomPolygons)"
        text = f"{found.value:.2f} (95 %: {found.low:.2f} to {found.high:.2f}; {len(easy)} problems)"
        yield Target(what, "at most 1", text, found.value <= 1.0)


def slower_worlds(results: Results) -> tuple[list[tuple[str, float, str, float, float]], int] | None:
    """Return the worlds where another planner from Python is sooner, and how many worlds count; None without runs.

    Rows: world, the landmark planner's median, the soonest planner and its median, RRT-Connect's median; seconds.
    Planners with trailmark's own motion validator do not count: they are not what OMPL has from Python.
    """
    rivals = [name for name in results.planners() if name != LANDMARK and ":" not in name and "+" not in name]
    if PYTHON not in rivals:
        return None
    worlds: dict[str, list[Case]] = {}
    for case in results.timed([LANDMARK, *rivals]):
        worlds.setdefault(case.world, []).append(case)
    slow, counted = [], 0
    for world, chosen in worlds.items():
        times = {name: results.median_first(name, chosen) for name in (LANDMARK, *rivals)}
        if times[PYTHON] < EASY:
            continue
        counted += 1
        best = min(rivals, key=times.__getitem__)
        if times[best] < times[LANDMARK]:
            slow.append((world, times[LANDMARK], best, times[best], times[PYTHON]))
    return slow, counted


def _first_cost(results: Results) -> Iterator[Target]:
    ratios = [results.first_over_best(case) for case in results.timed([LANDMARK])]
    if ratios:
        middle, high = median(ratios), float(np.quantile(ratios, 0.95, method="higher"))
        text = f"median {percent(middle)}, 95th percentile {percent(high)}"
        yield Target("cost of the first path over the best known", "median within 10 %", text, middle <= 1.1)


def _long_runs(results: Results) -> Iterator[Target]:
    chosen = results.compared
    if not chosen:
        return
    ratios = {case.kind: cost_ratio(results.landmark_cost(case, 1.0), results.rivals_cost(case)[0]) for case in chosen}
    over = {kind: ratio for kind, ratio in ratios.items() if not ratio <= 1.0 + SAME}
    text = f"higher in {len(over)} of {len(ratios)} kinds of worlds"
    if over:
        text += ": " + ", ".join(f"{kind} {percent(ratio)}" for kind, ratio in over.items())
    yield Target("cost at 1 s", "at most the best median of any planner after 10 s, simplified", text, not over)
    found = {
        case.kind: cost_ratio(results.landmark_cost(case, COST_LIMIT), results.best_known(case)) for case in chosen
    }
    worst = max(found, key=found.__getitem__)
    text = f"median {percent(median(list(found.values())))}, most {percent(found[worst])} ({worst})"
    yield Target("cost at 10 s over the best known", "within 0.5 %", text, found[worst] <= 1.005)


def _bounds(results: Results) -> Iterator[Target]:
    for words, shape, most in (("discs", "disc", 0.05), ("the 2 x 1 m rectangle", "rectangle 2 x 1 m", 0.15)):
        found = [
            results.gaps[case.problem.key]
            for case in results.feasible
            if case.problem.robot.describe().startswith(shape) and case.problem.key in results.gaps
        ]
        if found:
            text = f"median {100.0 * median(found):.1f} % ({len(found)} problems)"
            yield Target(
                f"lower bound: best known cost above it, {words}",
                f"median under {most:.0%}",
                text,
                median(found) < most,
            )
    closed = [case for case in results.infeasible if results.runs(case, LANDMARK)]
    if closed:
        runs = [run for case in closed for run in results.runs(case, LANDMARK)]
        proven = [run for run in runs if run.status == Status.INFEASIBLE]
        missed = sorted({c.problem.name for c in closed for r in results.runs(c, LANDMARK) if r not in proven})
        slowest = max((run.time for run in proven), default=math.inf)
        text = f"{len(proven)} of {len(runs)} runs on {len(closed)} problems"
        if proven:
            text += f", median {ms(median([run.time for run in proven]))} ms, longest {ms(slowest)} ms"
        if missed:
            text += f"; not proven: {', '.join(missed)}"
        yield Target("infeasible problems proven", "all, in under 1 s", text, not missed and slowest < 1.0)


def ms(seconds: float) -> str:
    """Return seconds as milliseconds."""
    return "–" if not math.isfinite(seconds) else f"{1e3 * seconds:.3g}"


def percent(ratio: float) -> str:
    """Return a ratio as what it is above 1."""
    return "–" if not math.isfinite(ratio) else f"{100.0 * (ratio - 1.0):+.2f} %"
