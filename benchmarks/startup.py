"""How long does ``import trailmark`` take, and ``trailmark plan`` as a whole process? Writes results/startup.{json,md}.

Every figure is the median over fresh processes, once caches are warm (one run before the clock): compiled kernels, and
Python's own bytecode, which installing a package writes too. Processor time next to wall time says whether anything
else was at work on the machine.

    python -m benchmarks.startup [--repeats 10]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.machine import describe_machine, markdown_table

RESULTS = Path(__file__).resolve().parent / "results"
SHELL = str(Path(sys.executable).with_name("trailmark"))

COMMANDS = {
    "python -c pass": ([sys.executable, "-c", "pass"], None),
    "import trailmark": ([sys.executable, "-c", "import trailmark"], 0.3),
    "trailmark --help": ([SHELL, "--help"], 0.3),
    "trailmark plan office --time-limit 0.1": ([SHELL, "plan", "office", "--time-limit", "0.1", "--seed", "0"], 1.2),
    "trailmark plan office": ([SHELL, "plan", "office", "--seed", "0"], 2.5),
    "trailmark plan corridor": ([SHELL, "plan", "corridor", "--seed", "0"], 2.5),
    "trailmark plan gate": ([SHELL, "plan", "gate", "--seed", "0"], 2.5),
    "trailmark plan parking": ([SHELL, "plan", "parking", "--seed", "0"], 2.5),
}
"""What is run, and the wall time (seconds) that it should stay under."""


def seconds(command: list[str]) -> tuple[float, float]:
    """Return the seconds that one process takes from start to end, by the clock and of the processor."""
    own = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    subprocess.run(command, check=True, capture_output=True, env=own)
    wall, after = perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main() -> int:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=10)
    options = parser.parse_args()
    rows = []
    for name, (command, limit) in COMMANDS.items():
        seconds(command)
        walls, processor = zip(*(seconds(command) for _ in range(options.repeats)), strict=True)
        middle = float(np.median(walls))
        verdict = "" if limit is None else ("reached" if middle < limit else "not reached")
        figures = (middle, min(walls), max(walls), float(np.median(processor)))
        rows.append([name, *(f"{figure:.3f}" for figure in figures), str(limit or ""), verdict])
    header = ["command", "median s", "least s", "most s", "processor s", "wanted below s", ""]
    table = markdown_table(header, rows)
    print(table)
    RESULTS.mkdir(exist_ok=True)
    machine = describe_machine()
    (RESULTS / "startup.json").write_text(
        json.dumps({"machine": machine, "header": header, "table": rows}, indent=1) + "\n"
    )
    text = ["# Start-up", "", f"{options.repeats} fresh processes each, caches warm. {machine}", "", table]
    (RESULTS / "startup.md").write_text("\n".join(text) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
