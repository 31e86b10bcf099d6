"""``trailmark report``: a benchmark's results as a table and as an HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from trailmark.cli import console, options
from trailmark.cli.options import argument, option

__all__ = ["report"]


def report(
    results: Annotated[Path, argument("RESULTS.db", "Results database of trailmark benchmark.", options.InputFile())],
    html: Annotated[
        Path | None, option(options.OutputFile(".html", ".htm"), "Write a self-contained HTML page: .html or .htm.")
    ] = None,
) -> None:
    """Summarise benchmark results.

    Prints a table; --html writes a page. The benchmark may still be running.
    """
    options.protect_inputs([results], html)
    from trailmark.benchmark.results import load_results
    from trailmark.cli.benchmark import print_results

    with console.progress("reading the results") as progress:
        found = load_results(results)
        if html is not None:
            from trailmark.benchmark.report import html_report
            from trailmark.formats.files import write_atomically

            progress.stage(f"writing {html.name}")
            write_atomically(html, html_report(found))
    print_results(found, found.planners)
    if html is not None:
        numbers = {"problem": len(found.problems), "planner": len(found.planners), "run": found.runs}
        counts = ", ".join(console.plural(n, noun) for noun, n in numbers.items())
        console.say(f"written: {html} ({counts})")
