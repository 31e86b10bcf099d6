"""Is anything that is called certified or proven wrong? Writes results/soundness.{json,md}.

    python -m benchmarks.soundness [--hours H] [--seed N] [--part NAME]... [--share F] [--workers N] [--no-write]
    python -m benchmarks.soundness --case FOLDER        asks again what a saved case asks

A run that is stopped goes on where it was, if it is started again with the same seed on the same code (--folder
keeps it; --fresh begins anew). Every wrong answer is kept as a case in the folder, with its world;
tests/soundness/cases holds those that became tests. The exit status is 1 if there was one.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
import sys
from collections import Counter
from datetime import timedelta
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.machine import markdown_table
from benchmarks.soundness.campaign import SECONDS_A_CHUNK, Campaign, ask_case, run_chunk
from benchmarks.soundness.parts import PARTS
from benchmarks.soundness.workers import Worker, run_all
from trailmark.formats.files import write_atomically

RESULTS = Path(__file__).resolve().parents[1] / "results"


def text(record: dict[str, Any]) -> str:
    """Return the report as Markdown."""
    rows, total, wrong = [], Counter[str](), Counter[str]()
    for name, part in record["parts"].items():
        counts = Counter(part["counts"])
        total.update(counts)
        wrong.update(part["wrong"])
        what = PARTS[name].counts
        rest = ", ".join(f"{n:,} {key}" for key, n in sorted(counts.items()) if key != what)
        bad = ", ".join(f"**{n:,} {key}**" for key, n in sorted(part["wrong"].items())) or "0"
        rows.append([name, what, f"{counts[what]:,}", f"{part['target']:,}", bad, rest])
    sums = ", ".join(f"{n:,} {key}" for key, n in sorted(total.items()))
    return "\n".join(
        [
            "# Soundness: is anything certified or proven wrong?",
            "",
            f"Written by `python -m benchmarks.soundness`: {record['machine']}; code {record['code']}, seed "
            f"{record['seed']}.",
            "",
            f"**{sum(wrong.values()):,} wrong** of {sums}; {record['processor_seconds']:,} s of work.",
            "",
            markdown_table(["part", "counts", "judged", "target", "wrong", "also"], rows),
            "",
            "Judged by shapely, and in rational arithmetic within 1e-8 m of what the checker promises (an overlap of",
            "at most 1e-7 m, and 8 roundings of the largest coordinate); the judge shares no code with the checker.",
            "",
            "- states: at random, and pushed by halving to where they are barely valid; a refusal with more than 1e-6",
            "  m of room counts as wrong too.",
            "- motions, curves: pushed by halving until they are barely certified; halved again by the judge wherever",
            "  the room leaves a collision possible.",
            "- paths: `plan` and `plan_many`, cars forward-only and reversing; judged through `path.at`, `resample`",
            "  and by straight motions taken anew from the states.",
            "- carved: a drive first, obstacles around what it sweeps, with 1e-5 to 1e-1 m to spare; then `plan`,",
            "  the lower bound and the enclosure are asked, which must neither claim that there is no way nor",
            "  that it costs more.",
            "- bounds: beside the cost of paths and of parts of paths; walls whose vertices lie nearly on a line, cars",
            "  in the open, up to 1e6 m from the origin.",
            "- angles: turns by half a turn and some doubles more or less, at rest and moving.",
            "- zones: starts in keep-out zones, judged by Minkowski differences: never deeper, never back in.",
            "- touches: past corners of one-way zones and obstacles; judged by `check_path`.",
            "- scales: worlds of 1 mm and of 100 km, 1e4 and 1e6 m away, UTM coordinates.",
        ]
    )


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
    parser.add_argument("--no-write", action="store_true", help="print the report only")
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
    record = campaign.record()
    report = text(record)
    print(report)
    for name in sorted(campaign.found):
        print(campaign.folder / "found" / name)
    if not options.no_write:
        write_atomically(RESULTS / "soundness.json", json.dumps(record, indent=1) + "\n")
        write_atomically(RESULTS / "soundness.md", report + "\n")
    return 1 if any(sum(c.values()) for c in campaign.wrong.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
