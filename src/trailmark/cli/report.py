"""``trailmark report``: what a benchmark's results database shows, as one HTML page or as tables in Markdown."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from trailmark.cli import console
from trailmark.cli.options import option, output_file, protect_inputs

if TYPE_CHECKING:
    from trailmark.benchmark.report import Results

__all__ = ["report"]


def report(
    results: Annotated[
        str, typer.Argument(metavar="RESULTS.db", help="A results database of trailmark benchmark.", show_default=False)
    ],
    html: Annotated[str | None, option("--html", "FILE", "Write one page that works offline: .html or .htm.")] = None,
    against: Annotated[
        str | None, option("--against", "OLD.db", "Say what is faster or slower than there, beyond chance.")
    ] = None,
    markdown: Annotated[str | None, option("--markdown", "FILE", "Write the tables as text: .md.")] = None,
) -> None:
    """Report on a benchmark: who is ahead of whom, by how much, and with what certainty.

    It reads the database only, so that it works on any machine, also while the benchmark is still running. Without a
    file to write it prints the summary.
    """
    page, text = output_file(html, (".html", ".htm")), output_file(markdown, (".md",))
    protect_inputs([Path(file) for file in (results, against) if file], page, text)
    from trailmark.benchmark.report import html_report, load_results, markdown_report
    from trailmark.formats.files import write_atomically

    with console.progress("reading the results") as progress:
        found = load_results(Path(results))
        old = None if against is None else load_results(Path(against))
        for file, write in ((page, html_report), (text, markdown_report)):
            if file is not None:
                progress.stage(f"writing {file.name}")
                write_atomically(file, write(found, old))
    if page is None and text is None:
        _print_summary(found, old)
    for file in filter(None, (page, text)):
        console.say(f"written: {file} ({_size(found)})")


def _size(found: Results) -> str:
    return f"{len(found.problems):,} problems, {len(found.planners):,} planners, {found.runs:,} runs"


def _print_summary(found: Results, old: Results | None) -> None:
    from trailmark.benchmark.report.against import compare_results
    from trailmark.benchmark.summary import failure_lines, summary_rows

    console.say(
        f"{found.file}: {len(found.problems):,} problems, {len(found.planners):,} planners, {found.runs:,} runs"
    )
    console.print_table(summary_rows(found, found.planners), indent="  ")
    compared = [] if old is None else compare_results(found, old).sentences()
    for line in (*failure_lines(found, found.planners), *compared):
        console.say(line)
