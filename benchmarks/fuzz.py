"""Do readers refuse damaged files in one line, whatever the damage? Prints a table.

    python -m benchmarks.fuzz [--minutes M] [--seed N] [--target NAME]... [--workers N] [--folder FOLDER]

Worlds, maps, meshes, paths, roadmaps, logs, bags, suites and results, real ones and such as the library writes, are
damaged in one to four places and read, in a process with 700 MB of memory to spare. Only trailmark's errors may come of
it, in one line. Whatever else comes is kept in the folder, with the files. The exit status is 1 if there was anything.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.fuzzing import attack as fuzzing
from benchmarks.fuzzing.attack import Finding, attack, available
from benchmarks.fuzzing.targets import TARGETS
from benchmarks.report import Claim, keep, markdown_table
from benchmarks.soundness.workers import run_all

BATCH, SECONDS_A_BATCH = 25, 200.0
"""Files that are read at a time, and seconds after which they hang."""


def tasks(names: list[str], seed: int, deadline: float) -> Iterator[dict[str, Any]]:
    """Yield tasks, a batch of each reader by turns."""
    for k in count():
        for name in names:
            if perf_counter() > deadline:
                return
            yield {"target": name, "seed": seed + k, "count": BATCH}


def main() -> int:
    """Fuzz."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0, metavar="M")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--target", action="append", metavar="NAME", help="only this reader; may be given again")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument("--folder", type=Path, default=Path("out/fuzz"), help="where findings are kept")
    options = parser.parse_args()
    names = options.target or list(TARGETS)
    if unknown := set(names) - set(TARGETS):
        parser.error(f"--target {min(unknown)!r} given, allowed: {', '.join(TARGETS)}")
    left_out = [name for name in names if not available(name)]
    names = [name for name in names if name not in left_out]
    options.folder.mkdir(parents=True, exist_ok=True)
    read, refused, wrong = Counter[str](), Counter[str](), Counter[str]()
    known: set[tuple[str, str]] = set()
    todo = tasks(names, options.seed, perf_counter() + 60.0 * options.minutes)
    for outcome, _ in run_all(attack, todo, options.workers, options.folder, SECONDS_A_BATCH):
        name = outcome.task["target"]
        if outcome.value is None:
            asking = outcome.asking or Finding(name, {}, "")
            findings = [asking._replace(problem=str(outcome.problem))]
        else:
            read[name] += outcome.value[0]
            refused[name] += outcome.value[1]
            findings = outcome.value[2]
        for finding in findings:
            wrong[name] += 1
            # The same place in the code is one finding.
            lines = finding.problem.splitlines()
            kind = "\n".join(line for line in lines[-9:] if line.startswith("  File")) or lines[0][:20]
            if (name, kind) not in known:
                known.add((name, kind))
                print(f"{fuzzing.keep(options.folder, finding)}\n{finding.problem[:1500]}", file=sys.stderr, flush=True)
    rows = [[name, f"{read[name]:,}", f"{refused[name]:,}", f"{wrong[name]:,}"] for name in names]
    print(markdown_table(["reader", "read", "refused", "wrong"], rows))
    if left_out:
        print(f"left out, their files are not there: {', '.join(left_out)}")
    count = sum(read.values()) + sum(refused.values()) + sum(wrong.values())
    keep("fuzz", [Claim("damaged files that are not refused in one line", f"{sum(wrong.values())} of {count:,}")])
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
