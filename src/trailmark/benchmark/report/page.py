"""The page: one HTML file with everything in it, that asks for nothing else and runs no script but its own."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

from collections.abc import Iterator, Mapping
from html import escape

from trailmark.benchmark.report.against import compare_results
from trailmark.benchmark.report.clock import clock_table, cold_table
from trailmark.benchmark.report.conditions import conditions_table, settings_table
from trailmark.benchmark.report.data import Results
from trailmark.benchmark.report.details import details
from trailmark.benchmark.report.findings import findings, warnings_of
from trailmark.benchmark.report.limits import limitations, method
from trailmark.benchmark.report.palette import Style, legend_marks, styles_of
from trailmark.benchmark.report.payload import compressed, payload
from trailmark.benchmark.report.script import policy, script
from trailmark.benchmark.report.style import STYLE
from trailmark.benchmark.report.summary import Summary, summarise
from trailmark.benchmark.report.sweep import sweep_table
from trailmark.benchmark.report.tables import overall_table, pair_table

__all__ = ["html_report"]

OPEN_PAIRS = 8


def html_report(results: Results, old: Results | None = None) -> str:
    """Return the report as HTML, compared with an older database if one is given; the same databases, the same text."""
    summary = summarise(results)
    styles = styles_of(results.planners)
    sweep = sweep_table(results)
    parts = [
        legend_marks(styles.values()),
        _head(results, compared=old is not None),
        _section("summary", "Summary", _summary(results, summary, styles)),
        *([] if old is None else [_section("against", f"Against {old.file.name}", _against(results, old, styles))]),
        _section("explore", "Charts: choose problems and planners", _explorer(results)),
        *([_section("ahead", "Who is ahead of whom", _pairs(summary, styles))] if len(results.planners) > 1 else []),
        *([_section("sweep", "Speed against refusals", iter([sweep.html(styles)]))] if sweep else []),
        _section("clock", "What the clock measures", _clock(results, summary, styles)),
        _section("environment", "Environment", _environment(results, styles)),
        _section("limitations", "How to read this, and its limits", _limits(results)),
    ]
    title = escape(f"Benchmark {results.file.stem}")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="generator" content="trailmark">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy()}">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        # Of a type that no browser runs.
        + f'\n<script type="text/plain" id="runs">{compressed(payload(results, styles))}</script>'
        + f'\n<script type="text/plain" id="details">{compressed(details(results))}</script>'
        + f"\n<script>{script()}</script>\n</body>\n</html>\n"
    )


def _head(results: Results, *, compared: bool) -> str:
    problems, planners = len(results.problems), len(results.planners)
    facts = results.problems[0].facts
    sizes = f"{_plural(problems, 'problem')} × {_plural(planners, 'planner')}, {_plural(results.runs, 'run')}"
    machine = " · ".join(escape(str(facts[name])) for name in ("version", "cpuinfo", "date") if facts.get(name))
    against = '<a href="#against">Against</a>' if compared else ""
    ahead = '<a href="#ahead">Who is ahead</a>' if planners > 1 else ""
    return (
        f"<header><h1>Motion planners compared: {escape(results.file.stem)}</h1>"
        f'<p class="sub">{sizes}<br>{machine}</p></header>'
        f'<nav aria-label="Sections"><a href="#summary">Summary</a>{against}<a href="#explore">Charts</a>'
        f'{ahead}<a href="#clock">Clock</a><a href="#environment">Environment</a>'
        '<a href="#limitations">Limits</a></nav>'
    )


def _section(key: str, title: str, parts: Iterator[str]) -> str:
    return f'<section id="{key}"><h2>{escape(title)}</h2>\n' + "\n".join(parts) + "</section>"


def _summary(results: Results, summary: Summary, styles: Mapping[str, Style]) -> Iterator[str]:
    for warning in warnings_of(results, summary):
        yield f'<p class="warning"><b>Note.</b> {escape(warning)}</p>'
    cards = [
        f'<div class="card"><div class="question">{escape(f.question)}</div>'
        f'<div class="answer">{escape(f.answer)}</div><div class="value">{escape(f.value)}</div>'
        f"<p>{escape(f.detail)}</p></div>"
        for f in findings(results, summary)
    ]
    yield f'<div class="cards">{"".join(cards)}</div>'
    yield overall_table(summary, "All runs, the quickest planner first").html(styles)
    yield (
        '<p class="note">A path counts only if planner and referee agree on it. Times: to the first path, a failure as '
        "the limit. Costs: length (m) plus half a metre a radian of rotation, for cars the length of curves; over "
        "the best known, medians over all runs, a failure as infinite (“none”: half of the runs or more failed). "
        "“Ahead of”: adjusted p &lt; 0.05.</p>"
    )


def _against(results: Results, old: Results, styles: Mapping[str, Style]) -> Iterator[str]:
    found = compare_results(results, old)
    yield f"<ul>{''.join(f'<li>{escape(sentence)}</li>' for sentence in found.sentences())}</ul>"
    for table in filter(None, (found.table() if found.times else None, found.problems())):
        yield table.html(styles)


def _explorer(results: Results) -> Iterator[str]:
    """Yield what the page's script fills in: the choice, the charts of the chosen problems, and one problem."""
    several = len(results.problems) > 1
    yield (
        '<noscript><p class="warning">The charts are drawn by the page’s own script: this browser runs none.'
        "</p></noscript>"
        '<p class="warning" id="failed" role="status"></p>'
    )
    clocks = "".join(
        f'<label><input type="radio" name="clock" value="{value}"{checked}> {words}</label>'
        for value, checked, words in (
            ("call", " checked", "planning alone"),
            ("file", "", "loading and building the checker too"),
        )
    )
    yield (
        '<div class="explorer"><div id="choice">'
        "<details><summary>Planners</summary>"
        '<p class="note">A family’s name chooses all of it or none. Point at a planner to see it in all charts.</p>'
        '<button type="button" id="all-planners">All or none</button><div id="planners"></div></details>'
        f"<details{'' if several else ' hidden'}><summary>Problems</summary>"
        '<p class="note">Ticked: together in the charts. A click on a name shows that problem.</p>'
        '<input type="search" id="filter" placeholder="part of a name" aria-label="Problems with this in their name">'
        '<button type="button" id="all-problems">All or none of these</button><div id="problems"></div></details>'
        f'<fieldset id="clocks"><legend>Times include</legend>{clocks}</fieldset></div><div class="charts">'
    )
    if several:
        yield '<h3>Chosen problems together</h3><p class="note" id="chosen"></p><div id="together"></div>'
    hidden = "" if several else " hidden"
    yield (
        '<h3 id="one">One problem: <span id="name"></span></h3>'
        f'<p><button type="button" id="before"{hidden}>Previous</button> '
        f'<button type="button" id="after"{hidden}>Next</button> <span class="note" id="limit"></span></p>'
        '<div id="single"></div></div></div><p id="pointed" aria-hidden="true"></p>'
    )


def _pairs(summary: Summary, styles: Mapping[str, Style]) -> Iterator[str]:
    yield (
        "<p>Each row against each column, over all problems that both ran on. ▲ 4.31×: the row is ahead, and by this "
        "factor in the mean; ▼: it is behind; ≈: these runs cannot tell (adjusted p of 0.05 or more).</p>"
    )
    many = len(summary.planners) > OPEN_PAIRS
    for what, title in (("times", "Time to the first path"), ("costs", "Final cost (factors where both succeed)")):
        table = pair_table(summary, what, f"{title}: row against column").html(styles)
        yield f"<details{'' if many else ' open'}><summary>{title}</summary>{table}</details>"


def _clock(results: Results, summary: Summary, styles: Mapping[str, Style]) -> Iterator[str]:
    yield clock_table(results).html(styles)
    yield cold_table(results, summary).html(styles)


def _environment(results: Results, styles: Mapping[str, Style]) -> Iterator[str]:
    yield conditions_table(results).html(styles)
    opened = "" if len(results.planners) > OPEN_PAIRS else " open"
    settings = settings_table(results).html(styles)
    yield f"<details{opened}><summary>Settings of the planners</summary>{settings}</details>"


def _limits(results: Results) -> Iterator[str]:
    yield "<h3>How the numbers are made</h3>"
    yield f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in method())}</ul>"
    yield "<h3>What they do not say</h3>"
    yield f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in limitations(results))}</ul>"


def _plural(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
