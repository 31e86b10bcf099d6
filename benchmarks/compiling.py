"""How long does first use take, while no kernel is compiled? Writes results/compiling.{json,md}.

Every run is a fresh process with an empty cache of its own. The version of another checkout takes turns with this one,
so that both meet the same machine: what counts are the ratios of the medians. Processor time is that of all processes
together; divided by wall time it says how much of the machine was to be had.

    python -m benchmarks.compiling --base OTHER_CHECKOUT [--repeats 3] [--command "plan office"]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.age import ROOT
from benchmarks.machine import describe_machine, markdown_table

RESULTS = Path(__file__).resolve().parent / "results"

COMMANDS = ("plan office", "warmup")

Row = dict[str, Any]
"""A command, and its runs before and now: seconds by the clock, and of all processors."""


def seconds(checkout: Path, command: str) -> tuple[float, float]:
    """Return the seconds that a command takes with an empty cache, by the clock and of all processors."""
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"PYTHONPATH": str(checkout / "src"), "NUMBA_CACHE_DIR": cache}
        words = [sys.executable, "-m", "trailmark", *command.split()]
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
        subprocess.run(words, check=True, capture_output=True, env=environment, cwd=cache)
        wall, after = perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main() -> int:
    """Measure both checkouts by turns and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--base", type=Path, required=True, help="the checkout to compare with")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--command", action="append", help=f"of the shell; by default {', '.join(COMMANDS)}")
    options = parser.parse_args()
    rows: list[Row] = []
    for command in options.command or COMMANDS:
        rows.append({"command": command, "before": [], "now": []})
        for _ in range(options.repeats):
            for name, checkout in (("before", options.base.resolve()), ("now", ROOT)):
                rows[-1][name].append(seconds(checkout, command))
                print(command, name, *(f"{t:.1f} s" for t in rows[-1][name][-1]), flush=True)
            publish(rows)  # after each turn: a run that is cut short keeps what it has
    return 0


def publish(rows: Sequence[Row]) -> None:
    """Write what is measured so far, and print it."""
    table = []
    for row in rows:
        walls, processor = zip(*(np.median(row[name], axis=0).tolist() for name in ("before", "now")), strict=True)
        figures = [f for a, b in (walls, processor) for f in (f"{a:.1f}", f"{b:.1f}", f"{b / a:.2f}")]
        table.append([row["command"], str(len(row["now"])), *figures])
    header = ["command", "runs", "wall s, before", "now", "ratio", "processor s, before", "now", "ratio"]
    machine = describe_machine()
    what = "Medians of fresh processes, by turns, every one with an empty cache of its own."
    text = f"# First use\n\n{what} {machine}\n\n{markdown_table(header, table)}\n"
    (RESULTS / "compiling.md").write_text(text)
    (RESULTS / "compiling.json").write_text(json.dumps({"machine": machine, "rows": list(rows)}, indent=1) + "\n")
    print("\n" + text, flush=True)


if __name__ == "__main__":
    sys.exit(main())
