"""The landmark planner beside OMPL's, from Python and in native C++, by the project's own benchmark.

    python -m benchmarks.compare [--suite standard] [--workers 2] [--runs N] [--database FILE]

Every run has a process of its own, and a referee judges its path. The native planners take part where they are built
(benchmarks/native). With ``--database`` the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.report import FOLDER, Claim, keep
from trailmark.benchmark.planners import known_planners
from trailmark.benchmark.results import load_results

SUITES = Path(__file__).resolve().parent / "suites"

OURS = "landmark"
NATIVE = ("native:RRTConnect", "native:BITstar", "native:RRTstar", "native:PRM")


def claims(file: Path) -> list[Claim]:
    """Return a row for each planner: what it solves, and its first paths and costs beside the landmark planner's."""
    results = load_results(file)
    names = sorted(
        {name for problem in results.problems for name in problem.runs}, key=lambda name: (name != OURS, name)
    )
    return [_claim(name, results.problems) for name in names]


def _claim(name: str, problems: Sequence[Any]) -> Claim:
    found = [(problem.runs[name], problem.runs.get(OURS)) for problem in problems if name in problem.runs]
    success = sum(int(runs.success.sum()) for runs, _ in found)
    count, refused = sum(len(runs) for runs, _ in found), sum(runs.refused for runs, _ in found)
    times = np.concatenate([runs.first_times for runs, _ in found])
    finite = times[np.isfinite(times)]
    median = f"first path {1e3 * np.median(finite):.1f} ms" if len(finite) else "no path"
    figure = f"{success} of {count} runs solved, {median}"
    pairs = [(ours, runs) for runs, ours in found if name != OURS and ours is not None]
    beside = (
        ""
        if name == OURS
        else (
            f"{OURS} / {name}: first path x {_ratio([(ours.first_times, runs.first_times) for ours, runs in pairs])}, "
            f"cost x {_ratio([(ours.costs, runs.costs) for ours, runs in pairs])}"
        )
    )
    return Claim(name, figure, beside, f"{refused} paths refused by the referee" if refused else "")


def _ratio(pairs: Sequence[tuple[Any, Any]]) -> str:
    """Return the geometric mean over problems of the ratio of medians, with a 95 % bootstrap interval."""
    both = [[np.asarray(each)[np.isfinite(each)] for each in pair] for pair in pairs]
    medians = [(float(np.median(a)), float(np.median(b))) for a, b in both if len(a) and len(b)]
    logs = np.array([np.log(a / b) for a, b in medians if a > 0.0 and b > 0.0])
    if len(logs) == 0:
        return "none"
    draws = np.random.default_rng(0).choice(logs, (4000, len(logs))).mean(axis=1)
    low, high = np.exp(np.quantile(draws, [0.025, 0.975]))
    return f"{np.exp(logs.mean()):.2f} ({low:.2f} to {high:.2f})"


def main() -> int:
    """Run the suite and keep the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", choices=sorted(file.stem for file in SUITES.glob("*.yaml")), default="standard")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--runs", type=int, help="of each planner on each problem; by default the suite's")
    parser.add_argument("--database", type=Path, default=FOLDER / "compare.db", help="where runs are kept")
    options = parser.parse_args()
    options.database.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "trailmark.cli", "benchmark", "--suite", str(SUITES / f"{options.suite}.yaml")]
    command += ["--output", str(options.database), "--workers", str(options.workers)]
    command += [] if options.runs is None else ["--runs", str(options.runs)]
    planners = yaml.safe_load((SUITES / f"{options.suite}.yaml").read_text(encoding="utf-8"))["planners"]
    for name in [*planners, *(name for name in NATIVE if name in known_planners())]:
        command += ["-p", name]
    subprocess.run(command, check=True)
    keep("compare", claims(options.database))
    return 0


if __name__ == "__main__":
    sys.exit(main())
