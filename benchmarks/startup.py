"""How long does ``import trailmark`` take, and ``trailmark plan`` as a whole process? Writes results/startup.{json,md}.

Every figure is the median over fresh processes, once caches are warm (one run before the clock).

    python -m benchmarks.startup [--repeats 10]
"""

from __future__ import annotations

import argparse
import json
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
    "trailmark --help": ([SHELL, "--help"], None),
    "trailmark plan office": ([SHELL, "plan", "office", "--seed", "0"], 2.5),
    "trailmark plan corridor": ([SHELL, "plan", "corridor", "--seed", "0"], 2.5),
    "trailmark plan gate": ([SHELL, "plan", "gate", "--seed", "0"], 2.5),
    "trailmark plan parking": ([SHELL, "plan", "parking", "--seed", "0"], 2.5),
}
"""What is run, and the wall time (seconds) that it should stay under."""


def wall_time(command: list[str]) -> float:
    """Return the seconds that one process takes from start to end."""
    begin = perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return perf_counter() - begin


def main() -> int:
    """Measure and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=10)
    options = parser.parse_args()
    rows = []
    for name, (command, limit) in COMMANDS.items():
        wall_time(command)
        times = [wall_time(command) for _ in range(options.repeats)]
        middle = float(np.median(times))
        verdict = "" if limit is None else ("reached" if middle < limit else "not reached")
        rows.append([name, f"{middle:.3f}", f"{min(times):.3f}", f"{max(times):.3f}", str(limit or ""), verdict])
    header = ["command", "median s", "least s", "most s", "wanted below s", ""]
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
