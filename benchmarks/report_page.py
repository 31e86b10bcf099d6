"""How large is the report page of 100,000 runs, and how soon can it be used? Writes results/report_page.{json,md}.

Databases are made up: many planners with many seeds, many problems, and as many problems as runs allow. Chromium
without a window opens each page anew, at the widths of a desk and of a phone. The clock runs from the navigation until
charts and controls are there and the next frame is drawn, and from a click (all planners off, on again) to the frame
that shows it.

    python -m benchmarks.report_page [--repeats 5]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.chromium import Browser, browser
from benchmarks.machine import describe_machine, markdown_table
from benchmarks.made_results import random_results
from trailmark.benchmark.planners import known_planners
from trailmark.benchmark.problems import problems_of
from trailmark.benchmark.report import html_report, load_results
from trailmark.library import shipped_worlds
from trailmark.world import World

RESULTS = Path(__file__).resolve().parent / "results"
SHAPES = ((39, 85, 30), (10, 1000, 10), (8, 12_500, 1))
"""Planners, problems, seeds: 100,000 runs each, but for a few."""

STATES = 25  # of each path
WIDTHS = (1400, 390)
MAX_BYTES, MAX_SECONDS = 3_000_000, 2.0

USABLE = """new Promise(done => {
  const {dataset} = document.documentElement;
  const frame = () => requestAnimationFrame(() => setTimeout(() => done(performance.now())));
  const ask = () => dataset.ready ? frame() : setTimeout(ask, 1);
  ask();
})"""
CLICK = """new Promise(done => {
  const begun = performance.now();
  document.getElementById('all-planners').click();
  requestAnimationFrame(() => setTimeout(() => done(performance.now() - begun)));
})"""


def main() -> int:
    """Make the databases, write their pages, open them, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    texts = [p.text for name in shipped_worlds() for p in problems_of(World.load(name))]
    rows = []
    with tempfile.TemporaryDirectory() as folder, browser() as chromium:
        for planners, problems, seeds in SHAPES:
            file = Path(folder) / f"{planners}.db"
            names = (known_planners() + [f"native:Planner{i}" for i in range(planners)])[:planners]
            random_results(file, names, problems, seeds, texts=texts, states=STATES)
            begin = process_time()
            page = file.with_suffix(".html")
            page.write_text(html_report(load_results(file)), encoding="utf-8")
            written, size = process_time() - begin, page.stat().st_size
            for width in WIDTHS:
                usable, clicked = measure(chromium, page, width, options.repeats)
                verdict = "reached" if size < MAX_BYTES and max(usable) < MAX_SECONDS else "not reached"
                shape = f"{planners} x {problems:,} x {seeds}"
                figures = (float(np.median(usable)), max(usable), float(np.median(clicked)))
                rows.append([shape, f"{width}", f"{size:,}", f"{written:.0f}", *(f"{s:.2f}" for s in figures), verdict])
            file.unlink()
    header = ["planners x problems x seeds", "width px", "bytes", "written s", "usable s", "at most s", "click s", ""]
    table = markdown_table(header, rows)
    print(table)
    machine = describe_machine()
    (RESULTS / "report_page.json").write_text(
        json.dumps({"machine": machine, "header": header, "table": rows}, indent=1) + "\n"
    )
    wanted = f"Wanted: less than {MAX_BYTES:,} bytes, usable in less than {MAX_SECONDS:g} s."
    text = [
        "# The report page of 100,000 runs",
        "",
        f"{wanted} Opened {options.repeats} times each. {machine}",
        "",
        table,
    ]
    (RESULTS / "report_page.md").write_text("\n".join(text) + "\n")
    return 0


def measure(chromium: Browser, page: Path, width: int, repeats: int) -> tuple[list[float], list[float]]:
    """Return the seconds until a page is usable, and those from a click to the frame that shows what it did."""
    usable, clicked = [], []
    for _ in range(repeats):
        chromium.open(page, width)
        usable.append(chromium.run(USABLE) / 1e3)
        chromium.run(CLICK)
        clicked.append(chromium.run(CLICK) / 1e3)
    if chromium.complaints:
        raise RuntimeError(chromium.complaints[0])
    return usable, clicked


if __name__ == "__main__":
    sys.exit(main())
