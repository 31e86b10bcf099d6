"""The page of benchmarks/kmeans.py: what K-means contributes, in tables and a picture."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.ahead_problems import Case
from benchmarks.ahead_results import FIRST_LIMIT, Results, median
from benchmarks.machine import describe_machine, markdown_table
from trailmark.benchmark.statistics import wilson

__all__ = ["OURS", "PARTS", "RIVALS", "publish"]

OURS = ("roadmap", "roadmap-uniform", "lattice", "paper", "landmark")
RIVALS = ("PRM+certified", "PRMstar+certified", "RRTstar+certified", "RRTConnect+certified", "BITstar+certified")
PARTS = ("limit", "narrow", "counts", "many")

RESULTS = Path(__file__).resolve().parent / "results"
CHANCE = 0.05

Rows = list[dict[str, Any]]


def publish(database: Path, given: Sequence[Case], *, write: bool) -> None:
    """Print the page, and write it into the results with its figures."""
    found = {name: _read(database.with_suffix(f".{name}.json")) for name in PARTS[1:]}
    results = Results(database, given) if database.exists() else None
    texts = ["# What K-means contributes\n", "Written by `python -m benchmarks.kmeans`.\n"]
    if results is not None:
        texts += _limit(results)
    for name, section in (("narrow", _narrow), ("counts", _counts), ("many", _many)):
        if rows := found[name]:
            texts += section(rows)
    text = "\n".join([*texts, describe_machine(), ""])
    print(text)
    if write:
        if found["counts"] and found["many"]:
            _plot(found["counts"], found["many"])
        (RESULTS / "kmeans.md").write_text(text, encoding="utf-8")
        record = {"machine": describe_machine(), **found}
        (RESULTS / "kmeans.json").write_text(json.dumps(record, indent=0) + "\n", encoding="utf-8")


def _read(file: Path) -> Rows:
    rows: Rows = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    return rows


def _limit(results: Results) -> list[str]:
    """Return one second a query: targets, then every planner in every kind of world."""
    planners = [name for name in (*OURS, *RIVALS) if name in results.planners()]
    chosen = results.timed(planners)
    runs = sum(len(results.runs(case, planners[0])) for case in chosen)
    kinds = {kind: [case for case in chosen if case.group == kind] for kind in dict.fromkeys(c.group for c in chosen)}
    head = ["kind of world", *planners]
    success = [
        [f"{kind} ({len(cases)})", *(f"{results.success(name, FIRST_LIMIT, cases):.0%}" for name in planners)]
        for kind, cases in kinds.items()
    ]
    first = [
        [f"{kind} ({len(cases)})", *(_ms(results.median_first(name, cases)) for name in planners)]
        for kind, cases in kinds.items()
    ]
    cost = [
        [f"{kind} ({len(cases)})", *(_ratio(_over_best(results, name, cases)) for name in planners)]
        for kind, cases in kinds.items()
    ]
    return [
        "## One query, one second\n",
        f"{len(chosen)} problems that somebody solved, {runs} runs of each planner; OMPL's from Python with "
        "trailmark's certified motions. They take "
        "turns, so that what else runs on the machine meets all alike. Numbers of problems in brackets.\n",
        markdown_table(["what is asked of `roadmap`", "measured", ""], list(_targets(results, kinds))),
        "\nCorrect within 1 s:\n",
        markdown_table(head, success),
        "\nMedian time to the first path [ms], failures as infinite:\n",
        markdown_table(head, first),
        "\nCost at 1 s over the best known, geometric mean over the problems of the median over runs, solved problems "
        "only, each after the same simplifier:\n",
        markdown_table(head, cost),
        "",
    ]


def _targets(results: Results, kinds: dict[str, list[Case]]) -> Iterable[list[str]]:
    chosen = [case for cases in kinds.values() for case in cases]
    ratio = results.ratio("PRM+certified", chosen, "roadmap")
    if ratio is None:
        return
    yield [
        "first path at most 0.5 times PRM's, geometric mean",
        f"{ratio.value:.2f} (95 %: {ratio.low:.2f} to {ratio.high:.2f})",
        _verdict(ratio.value <= 0.5),
    ]
    for rival in ("PRM+certified", "RRTstar+certified"):
        shares = {
            kind: [results.success(name, FIRST_LIMIT, cases) for name in ("roadmap", rival)]
            for kind, cases in kinds.items()
        }
        lower = [f"{kind} ({own:.0%} against {other:.0%})" for kind, (own, other) in shares.items() if own < other]
        yield [
            f"success in 1 s not lower than {rival}'s in any kind of world",
            f"lower in {len(lower)} of {len(kinds)}{': ' if lower else ''}{', '.join(lower)}",
            _verdict(not lower),
        ]
        ratios = {kind: _cost_ratio(results, rival, cases) for kind, cases in kinds.items()}
        above = {kind: value for kind, value in ratios.items() if not (value < 1.0 or math.isnan(value))}
        text = ", ".join(f"{kind} {_ratio(value)}" for kind, value in ratios.items())
        yield [f"cost at 1 s lower than {rival}'s in all", text, _verdict(not above)]


def _cost_ratio(results: Results, rival: str, cases: Sequence[Case]) -> float:
    """Return the geometric mean of ``roadmap``'s cost over a rival's, where both solve in half of their runs."""
    pairs = [(_cost(results, "roadmap", case), _cost(results, rival, case)) for case in cases]
    return _mean([a / b for a, b in pairs if math.isfinite(a) and math.isfinite(b)])


def _cost(results: Results, planner: str, case: Case) -> float:
    return median([run.simplified for run in results.runs(case, planner)])


def _over_best(results: Results, planner: str, cases: Sequence[Case]) -> float:
    ratios = [_cost(results, planner, case) / results.best_known(case) for case in cases]
    return _mean([ratio for ratio in ratios if math.isfinite(ratio)])


def _narrow(rows: Rows) -> list[str]:
    names = ("roadmap", "roadmap-uniform")
    solved = {name: sum(row[name] for row in rows) for name in names}
    only = [sum(row[a] and not row[b] for row in rows) for a, b in (names, names[::-1])]
    p = float(binomtest(only[0], sum(only)).pvalue) if sum(only) else 1.0
    if p >= CHANCE:
        verdict = "In narrow worlds K-means centres do not solve more than plain samples beyond chance."
    else:
        better = names[0] if only[0] > only[1] else names[1]
        verdict = f"In narrow worlds `{better}` solves more, beyond chance."
    intervals = {name: wilson(solved[name], len(rows)) for name in names}
    shares = "; ".join(
        f"`{name}` {solved[name]} ({found.low:.0%} to {found.high:.0%})" for name, found in intervals.items()
    )
    return [
        "## Narrow worlds\n",
        f"{verdict} Of {len(rows)} runs of 1 s on {len({row['problem'] for row in rows})} worlds of narrow passages: "
        f"{shares}; with the same seed and world, `roadmap` alone {only[0]}, `roadmap-uniform` alone {only[1]} "
        f"(sign test, p = {p:.2g}).\n",
    ]


def _counts(rows: Rows) -> list[str]:
    best: dict[str, float] = {}
    for row in rows:
        best[row["problem"]] = min(best.get(row["problem"], math.inf), row["cost"] or math.inf)
    planners, ks = _in_order(rows, "planner"), _in_order(rows, "k")
    known = [row for row in rows if math.isfinite(best[row["problem"]])]

    def of(k: int, name: str) -> Rows:
        return [row for row in known if row["k"] == k and row["planner"] == name]

    def over_best(k: int, name: str) -> float:
        return _mean([row["cost"] / best[row["problem"]] for row in of(k, name) if row["cost"]])

    def tables(cell: Any) -> str:
        return markdown_table(["k", *planners], [[str(k), *(cell(k, name) for name in planners)] for k in ks])

    return [
        "## One query against the number of landmarks\n",
        "One round of k landmarks for the query (`lattice` has none: its column says what it does without), and "
        f"OMPL's PRM and PRM* with k milestones, grown with certified motions; "
        f"{len({row['problem'] for row in known})} problems.\n",
        "Solved:\n",
        tables(lambda k, name: _share([row["cost"] is not None for row in of(k, name)])),
        "\nCost over the best known, geometric mean of what is solved (trailmark's are shortened, PRM's are not):\n",
        tables(lambda k, name: _ratio(over_best(k, name))),
        "\nMedian time [ms] to the path, or to the end of the round; of PRM, to grow the roadmap:\n",
        tables(lambda k, name: _ms(median([row["seconds"] for row in of(k, name)]))),
    ]


def _many(rows: Rows) -> list[str]:
    names, ks = _in_order(rows, "nodes"), _in_order(rows, "k")

    def of(k: int, name: str, what: str) -> list[float]:
        return [row[what] for row in rows if row["k"] == k and row["nodes"] == name and row[what] is not None]

    def table(cell: Any) -> str:
        return markdown_table(["k", *names], [[str(k), *(cell(k, name) for name in names)] for k in ks])

    queries = sum(row["queries"] for row in rows if row["k"] == ks[0] and row["nodes"] == names[0])
    return [
        "## A thousand queries on one roadmap\n",
        f"{len({row['problem'] for row in rows})} worlds, one of each kind, a thousand random queries each; counted "
        f"are the {queries} that some roadmap answers and no straight motion does. Nodes over free space, certified "
        f"motions, ends joined to their ten nearest nodes; no path is shortened.\n",
        "Answered:\n",
        table(lambda k, name: f"{np.mean(of(k, name, 'success')):.1%}"),
        "\nCost over the cheapest of all these roadmaps, geometric mean over the worlds of the median query:\n",
        table(lambda k, name: _ratio(_mean(of(k, name, "over_best")))),
        "\nMedian time to build the roadmap [ms]:\n",
        table(lambda k, name: _ms(median(of(k, name, "seconds")))),
        "\n![success against the number of nodes](kmeans.png)\n",
    ]


def _plot(counts: Rows, many: Rows) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 4.2), layout="constrained", sharey=True)
    for axis, rows, column, title in (
        (axes[0], counts, "planner", "one query, landmarks for it"),
        (axes[1], many, "nodes", "a thousand queries, one roadmap"),
    ):
        for number, name in enumerate(_in_order(rows, column)):
            ks = _in_order(rows, "k")
            of = [[row for row in rows if row["k"] == k and row[column] == name] for k in ks]
            shares = [np.mean([row.get("success", row.get("cost") is not None) for row in some]) for some in of]
            # Each is thinner than the one before, so that of equal curves both are seen.
            axis.plot(ks, shares, marker="o", markersize=3, linewidth=3.6 - 0.4 * number, label=name)
        axis.set(title=title, xlabel="nodes", xscale="log")
        axis.set_xticks(_in_order(rows, "k"), [str(k) for k in _in_order(rows, "k")], minor=False)
        axis.minorticks_off()
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), ncols=4, fontsize=8, frameon=False)
    axes[0].set_ylabel("share solved")
    figure.savefig(RESULTS / "kmeans.png", dpi=110, metadata={"Description": describe_machine()})


def _in_order(rows: Rows, column: str) -> list[Any]:
    return list(dict.fromkeys(row[column] for row in rows))


def _mean(ratios: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(ratios)))) if ratios else math.nan


def _share(found: Sequence[bool]) -> str:
    return f"{np.mean(found):.0%}" if found else "–"


def _ratio(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "–"


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g}" if math.isfinite(seconds) else "–"


def _verdict(reached: bool) -> str:
    return "reached" if reached else "**not reached**"
