"""How long does the documentation take to build, its gallery's examples included? Writes results/docs_build.{json,md}.

From a copy of the sources, so that nothing of an earlier build is there; the kernels' cache is warm. Links and public
names are counted by tests/test_docs_build.py, which refuses any that lead nowhere or are missing.

    python -m benchmarks.docs_build
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.machine import describe_machine, markdown_table

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).resolve().parent / "results"

LIMIT = 180.0
"""Seconds that it may take."""


def built(folder: Path) -> dict[str, float]:
    """Return the seconds of a build in an empty folder, by the clock and of the processor, and how many pages it has.

    Raises:
        subprocess.CalledProcessError: there was a warning or an error.
    """
    generated = shutil.ignore_patterns("api", "gallery", "__pycache__")
    shutil.copytree(ROOT / "docs", folder / "docs", symlinks=True, ignore=generated)
    for beside in ("benchmarks", "examples", "src", "worlds"):
        (folder / beside).symlink_to(ROOT / beside)
    words = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "docs", "pages"]
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    subprocess.run(words, check=True, cwd=folder, env=os.environ | {"MPLBACKEND": "Agg"}, capture_output=True)
    wall, after = perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    pages = sum(1 for _ in (folder / "pages").rglob("*.html"))
    return {"seconds": round(wall, 1), "processor": round(processor, 1), "pages": pages}


def main() -> int:
    """Measure and write the table."""
    with tempfile.TemporaryDirectory() as folder:
        found = built(Path(folder))
    machine = describe_machine()
    RESULTS.joinpath("docs_build.json").write_text(json.dumps({"machine": machine, **found}, indent=1) + "\n")
    verdict = "reached" if found["seconds"] < LIMIT else "not reached"
    row = [f"{found['pages']:.0f}", f"{found['seconds']:.0f}", f"{found['processor']:.0f}", f"{LIMIT:.0f}", verdict]
    table = markdown_table(["pages", "s", "s of the processor", "wanted s", ""], [row])
    RESULTS.joinpath("docs_build.md").write_text(
        f"# The documentation's build, with its gallery\n\n{machine}\n\n{table}\n"
    )
    sys.stdout.write(table + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
