"""All planners on a suite of problems, by the shell commands of the library. Writes results/SUITE.md.

    python -m benchmarks.suite_report quick [options of trailmark benchmark, such as --workers 2 or -p native:PRM]

The suites are files of ``benchmarks/suites``; ``--name`` writes another file than the suite's. With ``--database`` the
runs are kept, and the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.age import ROOT
from benchmarks.machine import describe_machine

RESULTS = ROOT / "benchmarks" / "results"
SUITES = ROOT / "benchmarks" / "suites"


def main() -> int:
    """Run the suite and write the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite", choices=sorted(file.stem for file in SUITES.glob("*.yaml")))
    parser.add_argument("--name", help="of the report, without suffix")
    parser.add_argument("--database", type=Path, help="where runs are kept")
    options, others = parser.parse_known_args()
    command = [sys.executable, "-m", "trailmark.cli"]
    name = options.name or options.suite
    with tempfile.TemporaryDirectory() as folder:
        # The report's title is the database's name.
        database, report = options.database or Path(folder) / f"{name}.db", Path(folder) / "report.md"
        suite = ["--suite", str(SUITES / f"{options.suite}.yaml"), "--output", str(database)]
        subprocess.run([*command, "benchmark", *suite, *others], check=True)
        subprocess.run([*command, "report", database, "--markdown", report], check=True)
        text = report.read_text(encoding="utf-8")
    (RESULTS / f"{name}.md").write_text(f"{text}\n{describe_machine()}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
