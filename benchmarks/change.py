"""How fast does what is known of a world follow its changes? Writes results/change.{json,md,png}.

    python -m benchmarks.change [--part checker ...] [--quick] [--no-write]

Parts are modules of benchmarks/changing; those that are not measured anew stay as they were.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Protocol

from benchmarks.changing import baselines, checker, differential, drive, planner
from benchmarks.changing.plot import plot
from benchmarks.machine import describe_machine
from trailmark.formats.files import write_atomically

RESULTS = Path(__file__).resolve().parent / "results"


class Part(Protocol):
    """A part of the benchmark."""

    def measure(self, quick: bool) -> dict[str, Any]:
        """Return what was measured, as JSON holds it; ``quick`` for a try of less than a minute."""

    def report(self, found: dict[str, Any]) -> str:
        """Return a section of Markdown, with its heading."""


PARTS: dict[str, Part] = {
    "checker": checker,
    "planner": planner,
    "differential": differential,
    "drive": drive,
    "baselines": baselines,
}


def main() -> int:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=PARTS, help="measure these only (default: all)")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--no-write", action="store_true")
    options = parser.parse_args()
    file = RESULTS / "change.json"
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for name in options.part or PARTS:
        found[name] = {"machine": describe_machine(), **PARTS[name].measure(options.quick)}
        print(PARTS[name].report(found[name]))
    if not options.no_write:
        write_atomically(file, (json.dumps(found, indent=1) + "\n").encode())
        sections = [
            f"{PARTS[name].report(found[name])}\n\n{found[name]['machine']}\n" for name in PARTS if name in found
        ]
        text = "\n".join(["# Worlds that change\n", *sections])
        write_atomically(RESULTS / "change.md", text.encode())
        if {"planner", "drive"} <= set(found):
            plot(found, RESULTS / "change.png")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
