"""What the benchmarks write beside their figures: the machine, the versions, the code, and tables."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from datetime import date
from importlib.metadata import version

from benchmarks.age import describe_code
from trailmark.benchmark.environment import cpu_name

__all__ = ["describe_machine", "markdown_table"]

PACKAGES = ("trailmark", "numpy", "scipy", "scikit-learn", "numba", "python-fcl", "shapely", "filterpy", "ompl")


def describe_machine() -> str:
    """Return one line: date, processor, cores, Python, the versions of what does the work, and of which code."""
    packages = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    return f"{date.today()}, {cpu_name()}, Python {platform.python_version()}, {packages}; {describe_code()}"


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table whose columns line up as plain text too."""
    table = [list(header), *[list(row) for row in rows]]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    lines = ["| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in table]
    lines.insert(1, "|" + "|".join("-" * (w + 2) for w in widths) + "|")
    return "\n".join(lines)
