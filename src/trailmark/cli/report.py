"""``trailmark report``: a benchmark's results as a table and as an HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from trailmark.cli import console
from trailmark.cli.options import option, output_file, protect_inputs

__all__ = ["report"]


def report(
    results: Annotated[
        str, typer.Argument(metavar="RESULTS.db", help="Results database of trailmark benchmark.", show_default=False)
    ],
    html: Annotated[str | None, option("--html", "FILE", "Write a self-contained HTML page: .html or .htm.")] = None,
) -> None:
    """Summarise benchmark results.

    Prints a table; --html writes a page. The benchmark may still be running.
    """
    page = output_file(html, (".html", ".htm"))
    protect_inputs([Path(results)], page)
    from trailmark.benchmark.results import failure_lines, load_results, summary_rows

    with console.progress("reading the results") as progress:
        found = load_results(Path(results))
        if page is not None:
            from trailmark.benchmark.report import html_report
            from trailmark.formats.files import write_atomically

            progress.stage(f"writing {page.name}")
            write_atomically(page, html_report(found))
    console.print_table(summary_rows(found, found.planners), indent="  ")
    for line in failure_lines(found, found.planners):
        console.say(line)
    if page is not None:
        counts = f"{len(found.problems):,} problems, {len(found.planners):,} planners, {found.runs:,} runs"
        console.say(f"written: {page} ({counts})")
