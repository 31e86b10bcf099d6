"""How a report's numbers are computed, and what cannot be concluded from them."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

from collections.abc import Sequence

from trailmark.benchmark.report.comparison import LEVEL, REPLICATES, SHIFT
from trailmark.benchmark.report.conditions import setup_of
from trailmark.benchmark.report.data import Results
from trailmark.benchmark.report.palette import family_of
from trailmark.benchmark.statistics import EXACT_RUNS

__all__ = ["limitations", "method"]


def method() -> list[str]:
    """Return how the numbers are computed from the runs."""
    return [
        "Success: the planner says “solved”, and the referee, which shares no code with any planner, finds the path "
        "free of collisions, within the bounds, and between the query's ends. Intervals of shares are Wilson's, 95 %.",
        f"Means of times are geometric, shifted by {1e3 * SHIFT:g} ms, first over the runs on a problem and then over "
        "the problems, so that each problem has the same weight.",
        "“Ahead of” is a test of ranks: Mann–Whitney's on one problem; over several van Elteren's, which adds up their "
        f"rank sums. Two-sided; exact up to {EXACT_RUNS} runs of the two planners together, normal above. The "
        "probabilities are adjusted by Holm's method for all pairs of the table, and a planner is called ahead where "
        f"p < {LEVEL:g}.",
        "Performance profiles are Dolan's and Moré's (2002), of each planner's median over its runs on a problem, a "
        "failed run counting as infinite; they tell who is best, and compare two planners only where these two alone "
        "are chosen.",
        f"Factors between planners have 95 % bootstrap intervals: {REPLICATES:,} resamples of the runs within each "
        "problem.",
    ]


def limitations(results: Results) -> list[str]:
    """Return what the numbers include and what they do not; only what concerns the planners that are there."""
    families = {family_of(name) for name in results.planners}
    limits = sorted({problem.time_limit for problem in results.problems})
    found = [
        "Planning time is wall-clock time from the call of the planner to its end. Starting the process, importing "
        "libraries, loading the world and building the checker are not in it; set-up is measured apart. What a "
        "planner builds for the query (landmarks, roadmap, trees) is in its own time.",
        "Every run has a process of its own and a fresh planner: no planner profits from an earlier query on the same "
        "world, which is what roadmaps are for.",
    ]
    if "discrete" in families:
        found.append(
            f"“Discrete” is OMPL's usual motion check, {_states(results)}: less strict than the certified check, so "
            "that it may accept motions that collide. If the referee finds one, the run counts as a failure."
        )
    if families & {"discrete", "certified"}:
        found.append(
            "OMPL's planners are called from Python and call back into a checker in Python: what that costs is in "
            "their times. So is what it costs to watch their best path: PRM and PRM* run in slices of 5 to 50 ms, "
            "between which their cost is read; the others are watched while they run."
        )
    if "native" in families:
        found.append(
            "“Native” planners are OMPL's in C++ with FCL in C++, on the same problems; those that are not "
            "certified check motions discretely."
        )
    return [
        *found,
        f"A failed run counts as its time limit ({_span(limits, 's')}) in means of times, whenever it failed, and as "
        "worse than any that succeeded in ranks, medians and quartiles. Means of costs are of the runs that succeeded: "
        "read them beside the share that did.",
        "The referee judges the path at the end of a run; costs before that, in the curves, have the planner's word.",
        "The best known cost is that of the best path in this database, of any planner, simplified or not: it is not "
        "the optimum. More runs may lower it and raise every ratio.",
        "Intervals and tests speak of chance between runs on these very problems, not of other worlds. Planners "
        "have their default settings, but for those in their names; tuning may turn the order round.",
        "Runs side by side share the machine's memory bandwidth, caches and clock rate.",
    ]


def _states(results: Results) -> str:
    setups = map(setup_of, results.problems)
    given = [s.get("resolution") for s in setups]
    found = sorted({float(r) for r in given if isinstance(r, int | float)})
    words = sorted({r for r in given if isinstance(r, str)})
    every = [*([_span(found, "m")] if found else []), *words]
    return f"a state every {' or '.join(every)}" if every else "at the stated resolution"


def _span(values: Sequence[float], unit: str) -> str:
    if len(values) == 1:
        return f"{values[0]:.3g} {unit}"
    return f"{values[0]:.3g} to {values[-1]:.3g} {unit}, by problem"
