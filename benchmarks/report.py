"""One page of all figures: each program leaves its claims in out/benchmarks, and this writes docs/performance.md.

    python -m benchmarks.report

A claim is a row: what was measured, the figure, what it is compared with, and what is not reached. The page is made
anew for a release, not with a change.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import NamedTuple

from trailmark.benchmark.environment import cpu_name, versions
from trailmark.formats.files import write_atomically

__all__ = ["Claim", "keep", "markdown_table", "page"]

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "out" / "benchmarks"
PAGE = ROOT / "docs" / "performance.md"


class Claim(NamedTuple):
    """One row of the page.

    Attributes:
        what: was measured.
        figure: with its unit.
        beside: the peer, the truth or the other version that it is compared with.
        missed: what is not reached; empty if nothing is.
    """

    what: str
    figure: str
    beside: str = ""
    missed: str = ""


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table whose columns line up as plain text too."""
    table = [list(header), *[list(row) for row in rows]]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    lines = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in table]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)


def keep(program: str, claims: Sequence[Claim], words: Sequence[str] | None = None) -> None:
    """Print what a program claims, and keep it for the page.

    Args:
        program: name of the module in ``benchmarks``, and of a kind of claims after a ``_``.
        claims: its rows.
        words: of its command line; those of this process by default.
    """
    print(markdown_table(Claim._fields, claims))
    module = program.partition("_")[0]  # a program may keep claims of several kinds
    command = " ".join(["python -m", f"benchmarks.{module}", *(sys.argv[1:] if words is None else words)])
    record = {"command": command, "machine": machine(), "claims": [claim._asdict() for claim in claims]}
    FOLDER.mkdir(parents=True, exist_ok=True)
    write_atomically(FOLDER / f"{program}.json", json.dumps(record, indent=1) + "\n")


def machine() -> str:
    """Return date, commit, processor, and the versions of what does the work."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout
    packages = ", ".join(f"{name} {version}" for name, version in versions().items())
    return f"{date.today()}, commit {commit.strip() or 'unknown'}, {cpu_name()}, {platform.system()}, {packages}"


def page(folder: Path) -> str:
    """Return the page of what the programs left in a folder."""
    records = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(folder.glob("*.json"))]
    lines = [
        "# Performance",
        "",
        "Written by `python -m benchmarks.report` from what the programs in `benchmarks/` measured, for a release.",
        "Times drift by a factor of two from run to run: ratios were measured within one run.",
    ]
    for record in records:
        lines += ["", f"## `{record['command']}`", "", record["machine"] + ".", ""]
        lines += ["| what | figure | compared with | not reached |", "|---|---|---|---|"]
        lines += ["| " + " | ".join(claim.values()) + " |" for claim in record["claims"]]
    return "\n".join([*lines, ""])


def main() -> int:
    """Write the page."""
    write_atomically(PAGE, page(FOLDER))
    return 0


if __name__ == "__main__":
    sys.exit(main())
