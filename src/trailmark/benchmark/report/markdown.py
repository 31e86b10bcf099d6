"""The report's tables as Markdown, to be committed beside the code that made them."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

from trailmark.benchmark.report.against import compare_results
from trailmark.benchmark.report.clock import clock_table, cold_table
from trailmark.benchmark.report.conditions import conditions_table, hash_table, settings_table
from trailmark.benchmark.report.data import Results
from trailmark.benchmark.report.findings import findings, warnings_of
from trailmark.benchmark.report.limits import limitations, method
from trailmark.benchmark.report.summary import summarise
from trailmark.benchmark.report.sweep import sweep_table
from trailmark.benchmark.report.tables import overall_table, pair_table, problem_table

__all__ = ["markdown_report"]

MAX_PAIRS = 12
"""Most planners for which the tables of pairs are written: wider tables are not readable as text."""


def markdown_report(results: Results, old: Results | None = None) -> str:
    """Return the tables with what it takes to read them, compared with an older database if one is given."""
    summary = summarise(results)
    parts = [f"# Benchmark: {results.file.stem}", "Written by `trailmark report`; not to be changed by hand."]
    parts += [f"**Note.** {warning}" for warning in warnings_of(results, summary)]
    parts.append(
        "\n".join(
            f"- **{f.question}: {_escaped(f.answer)}, {f.value}.** {_escaped(f.detail)}"
            for f in findings(results, summary)
        )
    )
    if old is not None:
        found = compare_results(results, old)
        parts += [f"## Against {_escaped(old.file.name)}", _list([_escaped(s) for s in found.sentences()])]
        tables = filter(None, (found.table() if found.times else None, found.problems()))
        parts += [part for table in tables for part in (f"{table.caption}:", table.markdown())]
    parts += ["## All problems", overall_table(summary, "").markdown()]
    if 1 < len(summary.planners) <= MAX_PAIRS:
        parts.append("Time to the first path, row against column (▲ ahead, ▼ behind, ≈ no difference shown):")
        parts.append(pair_table(summary, "times", "").markdown())
        parts.append("Final cost, row against column (factors where both succeed):")
        parts.append(pair_table(summary, "costs", "").markdown())
    for problem in results.problems:
        parts += [
            f"## {_escaped(problem.name)}",
            f"Limit {problem.time_limit:g} s.",
            problem_table(problem, "").markdown(),
        ]
    if (sweep := sweep_table(results)) is not None:
        parts += ["## Speed against refusals", sweep.caption, sweep.markdown()]
    parts += ["## What the clock measures", clock_table(results).markdown()]
    parts += ["From the world's file on:", cold_table(results, summary).markdown()]
    parts += ["## Environment", conditions_table(results).markdown(), settings_table(results).markdown()]
    parts += [hash_table(results).markdown(), "## How the numbers are made", _list(method())]
    parts += ["## Limitations", _list(limitations(results))]
    return "\n\n".join(parts) + "\n"


def _list(lines: list[str]) -> str:
    return "\n".join(f"- {line}" for line in lines)


def _escaped(words: str) -> str:
    return words.replace("*", "\\*").replace("<", "&lt;").replace("`", "\\`")
