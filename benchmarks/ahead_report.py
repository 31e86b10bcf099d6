"""The page that benchmarks/ahead.py writes: targets reached and not, and tables."""

from __future__ import annotations

import json
import math
from pathlib import Path

from benchmarks.ahead_plot import draw
from benchmarks.ahead_problems import FIRST_WORLD
from benchmarks.ahead_results import COST_LIMIT, FIRST_LIMIT, LANDMARK, Results, cost_ratio, median
from benchmarks.ahead_targets import CERTIFIED, NATIVE, PYTHON, SOON, Target, ms, percent, slower_worlds, targets
from benchmarks.machine import describe_machine, markdown_table
from trailmark.formats.files import write_atomically

__all__ = ["page", "publish"]

RESULTS = Path(__file__).resolve().parent / "results"


def kind_table(results: Results) -> str:
    """Return the table of the first stage, a row for each kind."""
    planners = [name for name in results.planners() if name != LANDMARK]
    rivals = [name for name in (PYTHON, CERTIFIED, NATIVE) if name in planners]
    rows = []
    for kind in dict.fromkeys(case.kind for case in results.cases.values()):
        every = [case for case in results.cases.values() if case.kind == kind]
        closed, unknown = (sum(c.kind == kind for c in part) for part in (results.infeasible, results.undecided))
        chosen = [case for case in results.timed([LANDMARK, *planners]) if case.kind == kind]
        counts = [str(len(every)), str(len(chosen)), str(closed), str(unknown)]
        if not chosen:
            rows.append([kind, *counts, *[""] * (7 + 2 * len(rivals))])
            continue
        early = {name: results.success(name, SOON, chosen) for name in planners}
        best = max(early, key=early.__getitem__, default="")
        times = {name: results.median_first(name, chosen) for name in planners}
        plain = [name for name in planners if ":" not in name and "+" not in name]
        soonest = min(plain, key=times.__getitem__, default="")
        ratios = [results.ratio(name, chosen) for name in rivals]
        rows.append(
            [
                kind,
                *counts,
                f"{results.success(LANDMARK, math.inf, chosen):.0%}",
                f"{results.success(LANDMARK, SOON, chosen):.0%}",
                f"{early[best]:.0%} {best}" if best else "",
                ms(results.median_first(LANDMARK, chosen)),
                ms(results.quantile(LANDMARK, 0.95, chosen)),
                *(ms(times[name]) for name in rivals),
                *("" if ratio is None else f"{ratio.value:.2f}" for ratio in ratios),
                f"{ms(times[soonest])} {soonest}" if math.isfinite(times.get(soonest, math.inf)) else "–",
                percent(median([results.first_over_best(case) for case in chosen])),
            ]
        )
    header = ["kind", "problems", "compared", "infeasible", "undecided", "1 s", "0.1 s", "best other, 0.1 s"]
    header += ["landmark ms", "95 %", *(f"{name} ms" for name in rivals), *(f"/ {name}" for name in rivals)]
    header += ["soonest plain OMPL ms", "first cost"]
    return markdown_table(header, rows)


def planner_table(results: Results) -> str:
    """Return the table of all planners of the first stage."""
    planners = results.planners()
    chosen = results.timed(planners)
    rows = []
    refused = {name: count for name, _, _, count in results.conditions["planners"]}
    for name in sorted(planners, key=lambda name: -results.success(name, SOON, chosen)) if chosen else ():
        ratio = results.ratio(name, chosen)
        rows.append(
            [
                name,
                *(f"{results.success(name, within, chosen):.1%}" for within in (0.01, SOON, math.inf)),
                *(ms(results.quantile(name, share, chosen)) for share in (0.5, 0.95)),
                "" if ratio is None or name == LANDMARK else f"{ratio.value:.2f} ({ratio.low:.2f} to {ratio.high:.2f})",
                str(refused.get(name) or 0),
            ]
        )
    header = ["planner", "10 ms", "0.1 s", "1 s", "median ms", "95 % ms", "landmark's time over its", "paths refused"]
    return markdown_table(header, rows)


def cost_table(results: Results) -> str:
    """Return the table of the long runs."""
    rows = []
    for case in results.compared:
        best, (rival, name) = results.best_known(case), results.rivals_cost(case)
        at_1, at_10 = results.landmark_cost(case, 1.0), results.landmark_cost(case, COST_LIMIT)
        runs = (len(results.runs(case, planner, COST_LIMIT)) for planner in results.planners(COST_LIMIT))
        gap = results.gaps.get(case.problem.key)
        rows.append(
            [
                case.kind,
                case.problem.query.name,
                f"{best:.3f}",
                *(percent(cost_ratio(value, best)) for value in (at_1, at_10, rival)),
                name,
                "" if gap is None else f"{100.0 * gap:.1f} %",
                str(sum(runs)),
            ]
        )
    header = [
        "kind",
        "query",
        "best known",
        "landmark 1 s",
        "landmark 10 s",
        "best other 10 s",
        "",
        "bound's gap",
        "runs",
    ]
    return markdown_table(header, rows)


def page(results: Results) -> str:
    """Return the Markdown page."""
    found = results.conditions
    rows = [[t.what, t.wanted, t.measured, t.verdict] for t in targets(results)]
    behind = slower_worlds(results)
    slow = [] if behind is None else behind[0]
    lines = ["# Ahead of OMPL's planners?", "", "Written by `python -m benchmarks.ahead`.", ""]
    lines += [markdown_table(["figure", "wanted", "measured", ""], rows), ""]
    if results.contradictions:
        names = ", ".join(case.problem.name for case in results.contradictions)
        lines += [f"**Proofs of infeasibility that are wrong: {names}.**", ""]
    lines += ["![Time to the first path, and cost](ahead.png)", "", "## Planners, to the first path", ""]
    lines += [planner_table(results), "", "## Worlds, to the first path", "", kind_table(results), ""]
    if slow:
        lines += [
            "Worlds on which RRT-Connect takes 20 ms or more and a plain OMPL planner is sooner (medians, ms):",
            "",
        ]
        rows = [[world, ms(mine), f"{ms(time)} {name}", ms(other)] for world, mine, name, time, other in slow]
        lines += [markdown_table(["world", LANDMARK, "soonest", PYTHON], rows), ""]
    if results.compared:
        lines += ["## Cost", "", cost_table(results), ""]
    lines += [*_notes(results), ""]
    lines += [f"{found['runs']:,} runs; {found['version']}; {describe_machine()}", ""]
    return "\n".join(lines)


def _notes(results: Results) -> list[str]:
    own = {len(runs) for case in results.feasible if (runs := results.runs(case, LANDMARK))}
    others = {len(runs) for case in results.feasible if (runs := results.runs(case, PYTHON))}
    unknown = len(results.undecided)
    problems = f"{len(results.cases)} problems, {len(results.feasible)} feasible, {len(results.infeasible)} infeasible"
    return [
        f"- Each run in a process of its own. Time is planning alone, limit {FIRST_LIMIT:g} s; world and checker are",
        "  set up before, for every planner. A path that the referee refuses is a failure. Failures count as the limit",
        "  in ratios, as infinite in medians. All problems have the same weight. Intervals: bootstrap over the worlds.",
        f"- {problems}, {unknown} undecided and left out;",
        f"  {_span(own)} seeds a problem for landmark, {_span(others)} for OMPL's RRT-Connect (30 are asked",
        f"  for). Random worlds have the numbers from {FIRST_WORLD} on, which the planner was not developed on.",
        "- Plain names: OMPL from Python as it is (motions checked at steps of half the robot's inscribed radius);",
        "  `+certified`: with trailmark's motion validator; `native:`: OMPL and FCL in C++, same steps. In the first",
        "  stage OMPL's planners end at their first path. A world's soonest planner is chosen after the fact from few",
        "  runs, which flatters it.",
        f"- Cost: one problem of every kind, limit {COST_LIMIT:g} s, the median over the seeds. The others' after",
        "  OMPL's simplifier (or before it, if that path is refused), the landmark planner's as it is, from its curve.",
        "  Percentages are above the best known: the cheapest path of any run, which in the problems without long runs",
        "  is most often the landmark planner's own after 1 s.",
        "- The bound's gap is that of the best known cost over `LowerBound`'s value, not what a run reported: it tells",
        "  of the bound alone.",
    ]


def publish(results: Results, *, write: bool) -> None:
    """Print the page, and write it, its figures and the picture."""
    text = page(results)
    print(text)
    if write:
        rows = [[*t._asdict().values()] for t in targets(results)]
        planners = results.planners()
        record = {
            "machine": describe_machine(),
            "conditions": results.conditions,
            "columns of targets": list(Target._fields),
            "targets": rows,
            "columns of problems": ["problem", "kind", "best known", "lower bound's gap", *planners],
            "problems": [
                [
                    case.problem.name,
                    case.kind,
                    _number(results.best_known(case)),
                    _number(results.gaps.get(case.problem.key, math.inf)),
                    *(_number(results.median_first(name, [case])) for name in planners),
                ]
                for case in results.feasible
            ],
            "undecided": [case.problem.name for case in results.undecided],
            "infeasible": [case.problem.name for case in results.infeasible],
        }
        RESULTS.mkdir(exist_ok=True)
        write_atomically(RESULTS / "ahead.json", json.dumps(record, allow_nan=False) + "\n")
        write_atomically(RESULTS / "ahead.md", text)
        write_atomically(RESULTS / "ahead.png", draw(results))


def _number(value: float) -> float | None:
    """Return a value for JSON: None where there is none, or a median that is a failure."""
    return round(value, 6) if math.isfinite(value) else None


def _span(counts: set[int]) -> str:
    return "no" if not counts else f"{min(counts)}" if len(counts) == 1 else f"{min(counts)} to {max(counts)}"
