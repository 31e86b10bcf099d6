"""Is anything that is called certified or proven wrong? Prints a table.

    python -m benchmarks.soundness [--hours H] [--seed N] [--part NAME]... [--share F] [--workers N]
    python -m benchmarks.soundness --case FOLDER        asks again what a saved case asks

A run that is stopped goes on where it was, if it is started again with the same seed on the same code (--folder
keeps it; --fresh begins anew). Every wrong answer is kept as a case in the folder, with its world;
tests/slow/soundness/cases holds those that became tests. The exit status is 1 if there was one.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
from collections import Counter
from datetime import timedelta
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.report import Claim, keep
from benchmarks.soundness.campaign import SECONDS_A_CHUNK, Campaign, ask_case, run_chunk
from benchmarks.soundness.parts import PARTS
from benchmarks.soundness.workers import Worker, run_all

JUDGE = "shapely, and rational arithmetic near the tolerance of 1e-7 m"


def claims(record: dict[str, Any]) -> list[Claim]:
    """Return a row for each part, and one for all of them."""
    found, total, wrong = [], Counter[str](), Counter[str]()
    for name, part in record["parts"].items():
        counts = Counter(part["counts"])
        total.update(counts)
        wrong.update(part["wrong"])
        what = PARTS[name].counts
        bad = ", ".join(f"{n:,} {key}" for key, n in sorted(part["wrong"].items()))
        share = counts[what] / part["target"]
        missed = bad or ("" if share >= 1.0 else f"{share:.0%} of the intended number")
        found.append(
            Claim(f"wrong among {what} of {name}", f"{sum(part['wrong'].values())} of {counts[what]:,}", JUDGE, missed)
        )
    sums = ", ".join(f"{n:,} {key}" for key, n in sorted(total.items()) if not key.startswith("refused"))
    return [Claim("wrong certificates and proofs", f"{sum(wrong.values()):,} of {sums}", JUDGE), *found]


def run_case(folder: Path) -> int:
    """Ask a saved case again; print what is wrong with the answer."""
    worker = Worker(ask_case, folder / "asking.pickle", SECONDS_A_CHUNK)
    outcome = worker.do(str(folder))
    worker.close()
    complaint = outcome.problem or outcome.value
    print("right" if complaint is None else complaint)
    return 0 if complaint is None else 1


def main() -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=math.inf, metavar="H", help="stop after so long")
    parser.add_argument("--seed", type=int, default=0, metavar="N")
    parser.add_argument("--part", action="append", metavar="NAME", help="only this one; may be given again")
    parser.add_argument("--share", type=float, default=1.0, metavar="F", help="of the targets (1)")
    parser.add_argument("--workers", type=int, default=2, metavar="N")
    parser.add_argument("--folder", type=Path, default=Path("out/soundness"), help="where the run is kept")
    parser.add_argument("--fresh", action="store_true", help="begin anew")
    parser.add_argument("--case", type=Path, metavar="FOLDER", help="ask a saved case again")
    options = parser.parse_args()
    if options.case is not None:
        return run_case(options.case)
    names = options.part or list(PARTS)
    if unknown := set(names) - set(PARTS):
        parser.error(f"--part {min(unknown)} given, allowed: {', '.join(PARTS)}")
    campaign = Campaign(options.folder, options.seed, names, options.share)
    if options.fresh and campaign.seconds:
        shutil.rmtree(campaign.folder)
        campaign = Campaign(options.folder, options.seed, names, options.share)
    begin = shown = perf_counter()
    tasks = campaign.tasks(begin + 3600.0 * options.hours)
    for outcome, seconds in run_all(run_chunk, tasks, options.workers, campaign.folder, SECONDS_A_CHUNK):
        campaign.add(outcome, seconds)
        if perf_counter() - shown > 20.0:
            shown = perf_counter()
            state = ", ".join(f"{name} {100.0 * min(1.0, campaign.progress(name)):.0f} %" for name in names)
            wrong = sum(sum(c.values()) for c in campaign.wrong.values())
            print(f"{timedelta(seconds=round(shown - begin))} {state}; {wrong} wrong", file=sys.stderr, flush=True)
    keep("soundness", claims(campaign.record()))
    for name in sorted(campaign.found):
        print(campaign.folder / "found" / name)
    return 1 if any(sum(c.values()) for c in campaign.wrong.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
