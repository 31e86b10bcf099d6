"""``trailmark report``: what a benchmark's results database shows, as one HTML page or as tables in Markdown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trailmark.cli import console
from trailmark.cli.options import UsageError, option, output_file, protect_inputs

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

    It reads the database only, so that it works on any machine, also while the benchmark is still running.
    """
    page, text = output_file(html, (".html", ".htm")), output_file(markdown, (".md",))
    if page is None and text is None:
        raise UsageError("expected --html, --markdown or both, got neither")
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
    for file in filter(None, (page, text)):
        console.say(
            f"written: {file} ({len(found.problems):,} problems, {len(found.planners):,} planners, {found.runs:,} runs)"
        )
