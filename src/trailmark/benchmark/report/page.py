"""The page: one HTML file with everything in it, that asks for nothing else and runs no script."""

# Tested by tests/benchmark/report/test_page.py.
from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from html import escape

from trailmark.benchmark.report.charts import legend_mark, legend_marks
from trailmark.benchmark.report.conditions import conditions_table, hash_table, settings_table
from trailmark.benchmark.report.data import Problem, Results
from trailmark.benchmark.report.figures import Figures
from trailmark.benchmark.report.findings import findings, warnings_of
from trailmark.benchmark.report.limits import limitations, method
from trailmark.benchmark.report.palette import FAMILIES, Style, family_of, styles_of
from trailmark.benchmark.report.style import STYLE
from trailmark.benchmark.report.summary import Summary, summarise
from trailmark.benchmark.report.tables import effort_table, failure_table, overall_table, pair_table, problem_table

__all__ = ["html_report"]

OPEN_PROBLEMS = 2
OPEN_PAIRS = 8
POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def html_report(results: Results) -> str:
    """Return the report as HTML; the same database gives the same text."""
    summary = summarise(results)
    styles = styles_of(results.planners)
    figures = Figures(results, summary, styles, itertools.count())
    several = len(results.problems) > 1
    parts = [
        legend_marks(styles.values()),
        _head(results),
        _section("summary", "Summary", _summary(results, summary, styles)),
        *([_section("all", "All problems together", _together(figures))] if several else []),
        _section("problems", "Problems" if several else "The problem", _problems(results, figures, styles)),
        *([_section("ahead", "Who is ahead of whom", _pairs(summary, styles))] if len(results.planners) > 1 else []),
        _section("environment", "Environment", _environment(results, styles)),
        _section("limitations", "How to read this, and its limits", _limits(results)),
    ]
    title = escape(f"Benchmark {results.file.stem}")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="generator" content="trailmark">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        # Whatever a database holds, the page asks for nothing and runs nothing.
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<link rel="icon" href="data:,">\n'
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n"
    )


def _head(results: Results) -> str:
    problems, planners = len(results.problems), len(results.planners)
    facts = results.problems[0].facts
    sizes = f"{_plural(problems, 'problem')} × {_plural(planners, 'planner')}, {_plural(results.runs, 'run')}"
    machine = " · ".join(escape(str(facts[name])) for name in ("version", "cpuinfo", "date") if facts.get(name))
    several = '<a href="#all">All problems</a>' if problems > 1 else ""
    ahead = '<a href="#ahead">Who is ahead</a>' if planners > 1 else ""
    return (
        f"<header><h1>Motion planners compared: {escape(results.file.stem)}</h1>"
        f'<p class="sub">{sizes}<br>{machine}</p></header>'
        f'<nav aria-label="Sections"><a href="#summary">Summary</a>{several}<a href="#problems">Problems</a>'
        f'{ahead}<a href="#environment">Environment</a><a href="#limitations">Limits</a></nav>'
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
    yield _legend(results.planners, styles)
    yield overall_table(summary, "All runs, the quickest planner first").html(styles)
    yield (
        '<p class="note">A path counts only if planner and referee agree on it. Times: to the first path, a failure as '
        "the limit. Costs: length (m) plus half a metre a radian of rotation, for cars the length of curves; over "
        "the best known, medians over all runs, a failure as infinite (“none”: half of the runs or more failed). "
        "“Ahead of”: adjusted p &lt; 0.05.</p>"
    )


def _together(figures: Figures) -> Iterator[str]:
    yield f'<div class="figures">{"".join(figures.overall_rows())}</div>'
    for title, drawn in (
        ("Time to the first path", list(figures.overall_ecdfs())),
        ("Cost against time", list(figures.overall_costs())),
    ):
        if len(drawn) > 1:
            yield f"<h3>{title}</h3>"
        yield f'<div class="figures">{"".join(drawn)}</div>'
    yield (
        '<p class="note">Cost against time: the best path so far over the best known of its problem; medians (lines) '
        "and quartiles (shaded) over all runs. A line begins where half of the runs have a path; the strip below shows "
        "the share that have none.</p>"
    )


def _problems(results: Results, figures: Figures, styles: Mapping[str, Style]) -> Iterator[str]:
    for i, problem in enumerate(results.problems):
        opened = " open" if len(results.problems) <= OPEN_PROBLEMS or i == 0 else ""
        solved = sum(int(runs.success.sum()) for runs in problem.runs.values())
        total = sum(len(runs) for runs in problem.runs.values())
        note = f"{solved} of {_plural(total, 'run')} solved, limit {problem.time_limit:g} s"
        body = "\n".join(_problem(problem, figures, styles))
        yield (
            f'<details class="problem"{opened}><summary>{escape(problem.name)} '
            f'<span class="note">{escape(note)}</span></summary>\n{body}</details>'
        )


def _problem(problem: Problem, figures: Figures, styles: Mapping[str, Style]) -> Iterator[str]:
    yield f'<div class="figures">{"".join(figures.scenes(problem))}</div>'
    yield problem_table(
        problem, f"{problem.name}: p tells whether a planner differs from the best, adjusted by Holm"
    ).html(styles)
    yield f'<div class="figures">{"".join(figures.problem_charts(problem))}</div>'
    effort = effort_table(problem, f"{problem.name}: what the runs took, medians over all runs").html(styles)
    yield f"<details><summary>Effort: checks, graphs, memory</summary>{effort}</details>"
    failures = failure_table(problem, f"{problem.name}: what failed or refused runs gave as the reason")
    if failures is not None:
        yield f"<details><summary>Reasons of failures</summary>{failures.html(styles)}</details>"


def _pairs(summary: Summary, styles: Mapping[str, Style]) -> Iterator[str]:
    yield (
        "<p>Each row against each column, over all problems that both ran on. ▲ 4.31×: the row is ahead, and by this "
        "factor in the mean; ▼: it is behind; ≈: these runs cannot tell (adjusted p of 0.05 or more).</p>"
    )
    many = len(summary.planners) > OPEN_PAIRS
    for what, title in (("times", "Time to the first path"), ("costs", "Final cost (factors where both succeed)")):
        table = pair_table(summary, what, f"{title}: row against column").html(styles)
        yield f"<details{'' if many else ' open'}><summary>{title}</summary>{table}</details>"


def _environment(results: Results, styles: Mapping[str, Style]) -> Iterator[str]:
    yield conditions_table(results).html(styles)
    opened = "" if len(results.planners) > OPEN_PAIRS else " open"
    settings = settings_table(results).html(styles)
    yield f"<details{opened}><summary>Settings of the planners</summary>{settings}</details>"
    opened = "" if len(results.problems) > OPEN_PAIRS else " open"
    yield f"<details{opened}><summary>Problems and their hashes</summary>{hash_table(results).html(styles)}</details>"


def _limits(results: Results) -> Iterator[str]:
    yield "<h3>How the numbers are made</h3>"
    yield f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in method())}</ul>"
    yield "<h3>What they do not say</h3>"
    yield f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in limitations(results))}</ul>"


def _legend(planners: Sequence[str], styles: Mapping[str, Style]) -> str:
    parts = []
    for family, title in FAMILIES.items():
        names = [name for name in planners if family_of(name) == family]
        if names:
            entries = "".join(f"<li>{legend_mark(styles[name])}{escape(name)}</li>" for name in names)
            parts.append(
                f'<ul class="legend" aria-label="{escape(title)}"><li class="note">{escape(title)}:</li>{entries}</ul>'
            )
    return "".join(parts)


def _plural(n: int, noun: str) -> str:
    return f"{n:,} {noun}{'' if n == 1 else 's'}"
