"""Two databases: which planners became faster or slower, cheaper or dearer, beyond what chance explains."""

# Tested by tests/benchmark/report/test_against.py.
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from trailmark.benchmark.report.comparison import (
    LEVEL,
    Comparison,
    adjusted,
    at_limit,
    compare,
    cost_sample,
    time_sample,
)
from trailmark.benchmark.report.data import Problem, Results
from trailmark.benchmark.report.digits import NOTHING, factor, milliseconds, number, percent, probability
from trailmark.benchmark.report.tables import Table
from trailmark.benchmark.statistics import least_probability, runs_needed, shifted_geometric_mean

__all__ = ["Against", "compare_results"]

SHOWN = 20  # problems with a difference that are listed
NEW, OLD = "new", "old"
Key = TypeVar("Key")


@dataclass(frozen=True)
class Against:
    """What two databases share, and how it differs.

    Attributes:
        new: the database that the report is on.
        old: the one that it is compared with.
        pairs: problems that are the same in both, new and old: same world, robot, query, objective and time limit.
        times: of each planner on those, new against old, adjusted for all planners.
        costs: the same of the final costs.
        cells: time on a single problem, by planner and number in ``pairs``, adjusted for all of them.
    """

    new: Results
    old: Results
    pairs: list[tuple[Problem, Problem]]
    times: Mapping[str, Comparison]
    costs: Mapping[str, Comparison]
    cells: Mapping[tuple[str, int], Comparison]

    def sentences(self) -> list[str]:
        """Return what differs, in words, with the test that says so and what else differs between the two."""
        if not self.times:
            return ["Nothing to compare: no planner ran on the same problem with the same limits in both databases."]
        words = {True: ("faster", "cheaper"), False: ("slower", "dearer")}
        found = []
        for better in (True, False):
            for pairs, kind in zip((self.times, self.costs), words[better], strict=True):
                names = [name for name, pair in pairs.items() if pair.winner == (NEW if better else OLD)]
                found.append(f"{kind.capitalize()} beyond chance: {', '.join(names) or 'none'}.")
        found.append(
            f"Over {_plural(len(self.pairs), 'problem')} that both have: {self.test}, two-sided, adjusted by Holm for "
            f"{_plural(len(self.times), 'planner')}; a difference counts where p < {LEVEL:g}. Failed runs rank last."
        )
        factors = [pair.factor for pair in self.times.values() if math.isfinite(pair.factor)]
        if factors:
            found.append(
                f"The middle planner is {factor(float(np.median(factors)))} as fast as it was. The tests know the "
                "chance between runs, not that between two days of one machine (its load, its clock rate): a planner "
                "that did not change, measured both times, tells how much of a difference is the machine's."
            )
        return found + self._cautions()

    @property
    def test(self) -> str:
        """The test's name."""
        return "Mann–Whitney's test of ranks" if len(self.pairs) == 1 else "van Elteren's test of ranks"

    def table(self) -> Table:
        """Return a row for each planner that both have."""
        columns = ["planner", "problems", "solved, old", "solved, new", "first path, old: mean [ms]", "new [ms]"]
        columns += ["times as fast", "95 % interval", "p, time", "time", "cost, new / old", "p, cost", "cost"]
        rows = []
        for name, pair in self.times.items():
            both = [(new, old) for new, old in self.pairs if name in new.runs and name in old.runs]
            cost = self.costs[name]
            solved, means = [], []
            for side in (1, 0):
                runs = [(problems[side], problems[side].runs[name]) for problems in both]
                solved.append(sum(r.success.sum() for _, r in runs) / sum(len(r) for _, r in runs))
                logs = [shifted_geometric_mean(at_limit(p, r), 0.01) for p, r in runs]
                means.append(shifted_geometric_mean(logs, 0.01))
            rows.append(
                [
                    *(name, str(pair.problems), *map(percent, solved), *map(milliseconds, means)),
                    *(factor(pair.factor), _interval(pair), _p(pair), _word(pair, "faster", "slower")),
                    NOTHING if math.isnan(cost.factor) else f"{1.0 / cost.factor:.4f}",
                    *(_p(cost), _word(cost, "cheaper", "dearer")),
                ]
            )
        return Table(
            f"{self.new.file.name} against {self.old.file.name}: {self.test}", columns, rows, frozenset({9, 12})
        )

    def problems(self) -> Table | None:
        """Return the single problems on which a planner became faster or slower; None without any."""
        found = sorted((c.p, name, i) for (name, i), c in self.cells.items() if c.winner)
        if not found:
            return None
        rows = []
        for _, name, i in found[:SHOWN]:
            pair = self.cells[name, i]
            rows.append([name, self.pairs[i][0].name, factor(pair.factor), _p(pair), _word(pair, "faster", "slower")])
        more = f"; {SHOWN} of {len(found):,}" if len(found) > SHOWN else ""
        caption = (
            "Single problems on which the time to the first path differs beyond chance: Mann–Whitney's test of ranks, "
            f"adjusted by Holm for all {len(self.cells):,} of planner and problem{more}"
        )
        return Table(caption, ["planner", "problem", "times as fast", "p", "time"], rows, frozenset({1, 4}))

    def _cautions(self) -> list[str]:
        found = []
        tests, problems = len(self.times), len(self.pairs)
        sizes = {
            tuple((len(n.runs[name]), len(o.runs[name])) for n, o in self.pairs if name in n.runs and name in o.runs)
            for name in self.times
        }
        if tests * min(map(least_probability, sizes)) >= LEVEL:
            found.append(
                "With so few runs no difference can be shown, however clear it is: it takes "
                f"{_plural(runs_needed(tests, problems, LEVEL), 'run')} of each planner on each problem in both."
            )
        changed = sorted({what for new, old in self.pairs for what in _differing(new, old)})
        if changed:
            found.append(f"Other things differ too, and may be the reason: {', '.join(changed)}.")
        missing = [
            f"{_plural(len(results.problems) - problems, 'problem')} and "
            f"{_plural(len(set(results.planners) - set(self.times)), 'planner')} only in {results.file.name}"
            for results in (self.new, self.old)
            if len(results.problems) > problems or set(results.planners) - set(self.times)
        ]
        return found + ([f"Left out: {'; '.join(missing)}."] if missing else [])


def compare_results(new: Results, old: Results) -> Against:
    """Return how the runs of one database compare with those of an older one, planner by planner."""
    pairs = _pairs(new, old)
    generator = np.random.default_rng(6)
    times, costs, cells = {}, {}, {}
    for name in new.planners:
        shared = {i: both for i, both in enumerate(pairs) if all(name in problem.runs for problem in both)}
        if not shared:
            continue
        ours, theirs = (
            {i: time_sample(both[side], both[side].runs[name], generator) for i, both in shared.items()}
            for side in (0, 1)
        )
        times[name] = compare(NEW, OLD, ours, theirs)
        for i in shared:
            cells[name, i] = compare(NEW, OLD, {i: ours[i]}, {i: theirs[i]})
        best = {i: min(problem.best_cost for problem in both) for i, both in shared.items()}
        ours, theirs = (
            {i: cost_sample(both[side], both[side].runs[name], generator, best[i]) for i, both in shared.items()}
            for side in (0, 1)
        )
        costs[name] = compare(NEW, OLD, ours, theirs)
    return Against(new, old, pairs, _adjusted(times), _adjusted(costs), _adjusted(cells))


def _adjusted(found: Mapping[Key, Comparison]) -> dict[Key, Comparison]:
    return dict(zip(found, adjusted(list(found.values())), strict=True))


def _pairs(new: Results, old: Results) -> list[tuple[Problem, Problem]]:
    """Return the problems that both have, with the same limits if there are such; each of the old ones once."""
    left = list(old.problems)
    found = []
    for problem in new.problems:
        same = [other for other in left if _key(other) == _key(problem) is not None]
        if same:
            # Of several, in a sweep say, the one with the same settings.
            best = max(same, key=lambda other: _identity(other) == _identity(problem))
            left.remove(best)
            found.append((problem, best))
    return found


def _identity(problem: Problem) -> dict[str, Any]:
    identity = problem.facts["setup"].get("identity")
    return identity if isinstance(identity, dict) else {}


def _key(problem: Problem) -> tuple[str, str, float] | None:
    """Return what must be equal for runs to be comparable: problem, objective and time limit; None if not known."""
    identity = _identity(problem)
    if "problem" not in identity:
        return None
    return str(identity["problem"]), str(identity.get("objective")), problem.time_limit


def _differing(new: Problem, old: Problem) -> set[str]:
    """Return which conditions of the runs are not the same."""

    def conditions(problem: Problem) -> dict[str, Any]:
        found = problem.facts["setup"].get("conditions")
        stated = found if isinstance(found, dict) else {}
        return stated | _identity(problem) | {"processor": problem.facts["cpuinfo"]}

    ours, theirs = conditions(new), conditions(old)
    return {f"{what} ({theirs.get(what)}, now {value})" for what, value in ours.items() if value != theirs.get(what)}


def _word(pair: Comparison, better: str, worse: str) -> str:
    return {NEW: better, OLD: worse, None: "no difference shown"}[pair.winner]


def _p(pair: Comparison) -> str:
    return probability(pair.p).removeprefix("= ")


def _interval(pair: Comparison) -> str:
    return NOTHING if pair.interval is None else f"{number(pair.interval.low)} to {number(pair.interval.high)}"


def _plural(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
