"""What a benchmark shows, in a few sentences, each with its certainty."""

# Tested by tests/benchmark/report/test_summary.py.
from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from trailmark.benchmark.report.comparison import LEVEL, MIN_RUNS, Comparison
from trailmark.benchmark.report.data import Problem, Results
from trailmark.benchmark.report.digits import count, factor, percent, probability, seconds
from trailmark.benchmark.report.summary import PlannerSummary, Summary
from trailmark.benchmark.statistics import least_probability, runs_needed

__all__ = ["Finding", "findings", "warnings_of"]

LATE = 1.1  # of the limit: a run that took longer is mentioned


@dataclass(frozen=True)
class Finding:
    """One result: a question, who or what is the answer, the number, and how certain that is."""

    question: str
    answer: str
    value: str
    detail: str


def findings(results: Results, summary: Summary) -> list[Finding]:
    """Return what the benchmark shows: who is soonest, cheapest, most reliable, and the referee's word."""
    if not any(s.success for s in summary.planners):
        unsolved = Finding("Solved", "no run of any planner", "0 %", "No path was returned that the referee accepts.")
        return [unsolved, _referee(summary)]
    return [_soonest(summary), _cheapest(summary), _reliable(summary), _referee(summary)]


def warnings_of(results: Results, summary: Summary) -> list[str]:
    """Return what keeps the numbers from being taken at their face value; empty if nothing does."""
    found = []
    fewer = [
        (problem, name, len(problem.runs.get(name, ())))
        for problem in results.problems
        for name in results.planners
        if len(problem.runs.get(name, ())) < problem.wanted
    ]
    if fewer or results.empty:
        missing = sum(problem.wanted - done for problem, _, done in fewer)
        text = f"The benchmark is not finished: {count(missing)} of the runs asked for are not in the database"
        text += f", and nothing is of {_some(results.empty)}" if results.empty else ""
        found.append(text + ". Means over problems compare planners only as far as these ran on the same ones.")
    fewest = min(len(runs) for problem in results.problems for runs in problem.runs.values())
    if fewest < MIN_RUNS:
        found.append(
            f"As few as {fewest} run{'s' if fewest > 1 else ''} of a planner on a problem: intervals are wide, and few "
            "differences can be distinguished from chance."
        )
    found += _hopeless(results)
    late = {
        name: n
        for name in results.planners
        if (
            n := sum(
                int((p.runs[name]["time"] > LATE * p.time_limit).sum()) for p in results.problems if name in p.runs
            )
        )
    }
    if late:
        found.append(
            f"Some runs went on for more than {100 * (LATE - 1):.0f} % beyond the limit before they stopped "
            f"({_counts(late)}); their times stand as measured."
        )
    return found


def _hopeless(results: Results) -> list[str]:
    """Return which comparisons cannot succeed, whatever the runs are, and how many runs they would take."""
    planners, problems = len(results.planners), results.problems
    pairs = planners * (planners - 1) // 2
    sizes = {tuple(_sizes(problems, a, b)) for a, b in combinations(results.planners, 2)}
    found = []
    if sizes and pairs * min(map(least_probability, sizes)) >= LEVEL:
        found.append(
            f"No planner can be shown to be ahead of another: with so few runs no test of {_plural(pairs, 'pair')} of "
            f"planners falls below {LEVEL:g} after Holm's correction, however clear the difference. It takes "
            f"{_plural(runs_needed(pairs, len(problems), LEVEL), 'run')} of each planner on each problem."
        )
    alone = [p for p in problems if len(p.runs) > 1 and _least_on(p) >= LEVEL]
    if alone and len(problems) > 1:
        most = max(len(p.runs) for p in alone) - 1
        found.append(
            f"On {len(alone):,} of {_plural(len(problems), 'problem')}, taken by itself, no planner can be shown to "
            f"differ from the best: it takes {_plural(runs_needed(most, 1, LEVEL), 'run')} of each planner there."
        )
    return found


def _sizes(problems: Sequence[Problem], a: str, b: str) -> list[tuple[int, int]]:
    return [(len(p.runs[a]), len(p.runs[b])) for p in problems if a in p.runs and b in p.runs]


def _least_on(problem: Problem) -> float:
    """Return the lowest adjusted probability that a planner's test against the best can have on one problem."""
    first, second = sorted(map(len, problem.runs.values()))[-2:]
    return (len(problem.runs) - 1) * least_probability([(first, second)])


def _soonest(summary: Summary) -> Finding:
    best = summary.planners[0]
    value = seconds(best.first_mean)
    detail = "Shifted geometric mean of the time to the first path; a failure counts as the limit."
    lead = _lead(best, summary.planners, summary.times, lambda pair: f"{factor(pair.factor)} sooner")
    return Finding("Soonest first path", best.planner, value, f"{detail} {lead}")


def _cheapest(summary: Summary) -> Finding:
    ranked = summary.by_cost()
    best = ranked[0]
    if math.isinf(best.ratio[2]):
        return Finding("Cheapest path", "none", "–", "No planner solved half of its runs: there is no median.")
    value = f"{best.ratio[2]:.3f}×"
    detail = "Median final cost over that of the best known path."
    lead = _lead(
        best, ranked, summary.costs, lambda pair: f"{100 * (pair.factor - 1):.2g} % cheaper where both succeed"
    )
    return Finding("Cheapest path at the limit", best.planner, value, f"{detail} {lead}")


def _reliable(summary: Summary) -> Finding:
    top = max(s.success / s.runs for s in summary.planners)
    best = [s for s in summary.planners if s.success / s.runs == top]
    rest = [s for s in summary.planners if s.success / s.runs < top]
    low = min(s.interval.low for s in best)
    detail = (
        f"{best[0].success:,} of {best[0].runs:,} runs solved and correct" if len(best) == 1 else "Solved and correct"
    )
    detail += f" (95 % interval from {100 * low:.1f} %)."
    if rest:
        worst = min(rest, key=lambda s: s.success / s.runs)
        following = max(rest, key=lambda s: s.success / s.runs)
        detail += f" Next: {following.planner} with {percent(following.success / following.runs)}"
        detail += (
            f"; last: {worst.planner} with {percent(worst.success / worst.runs)}." if worst is not following else "."
        )
    return Finding("Most runs solved", _some([s.planner for s in best]), percent(top), detail)


def _referee(summary: Summary) -> Finding:
    claimed = sum(s.claimed for s in summary.planners)
    refused = {s.planner: s.claimed - s.success for s in summary.planners if s.claimed > s.success}
    if claimed == 0:
        return Finding("Referee", "nothing to judge", "0", "No planner returned a path.")
    if not refused:
        return Finding(
            "Referee",
            "every path is right",
            f"{claimed:,} of {claimed:,}",
            "No returned path collides or misses its ends.",
        )
    wrong = sum(refused.values())
    ordered = dict(sorted(refused.items(), key=lambda item: -item[1]))
    detail = f"Paths called solutions that collide or miss their ends: {_counts(ordered)}. They count as failures."
    return Finding("Referee", "paths refused", f"{wrong:,} of {claimed:,}", detail)


def _lead(
    best: PlannerSummary,
    ranked: Sequence[PlannerSummary],
    pairs: Mapping[frozenset[str], Comparison],
    words: Callable[[Comparison], str],
) -> str:
    """Return how far the best is ahead of the next, and from which planners these runs cannot distinguish it."""
    if len(ranked) == 1:
        return "It is the only planner."
    comparisons = [pairs[frozenset((best.planner, s.planner))].seen_from(best.planner) for s in ranked if s is not best]
    behind = [pair for pair in comparisons if pair.winner == best.planner]
    unsure = [pair for pair in comparisons if pair.winner is None]
    text = f"Ahead of {len(behind)} of {len(comparisons)} other{'s' if len(comparisons) > 1 else ''}"
    if behind and math.isfinite(behind[0].factor) and behind[0].factor > 1.0:
        text += f"; {words(behind[0])} than {behind[0].b}{_interval(behind[0])}"
    text += "."
    if unsure:
        text += (
            f" No difference shown by these runs: {_some([f'{pair.b} (p {probability(pair.p)})' for pair in unsure])}."
        )
    ahead = [pair for pair in comparisons if pair.winner == pair.b]
    if ahead:
        text += f" By ranks, run against run, {_some([pair.b for pair in ahead])} is ahead of it."
    return text


def _interval(pair: Comparison) -> str:
    spread = "" if pair.interval is None else f"factor {pair.interval.low:.4g} to {pair.interval.high:.4g}, 95 %; "
    return f" ({spread}p {probability(pair.p)})"


def _some(names: Sequence[str], max_names: int = 4) -> str:
    if len(names) > max_names:
        return f"{', '.join(names[: max_names - 1])} and {len(names) - max_names + 1} others"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _counts(counts: Mapping[str, int]) -> str:
    return _some([f"{name} {n:,}" for name, n in counts.items()], max_names=6)


def _plural(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
