"""What is each mechanism of the planner good for? Writes results/ablation.{md,png}.

Each mechanism is switched off in turn, K-means gives way to as many plain samples, and the planners that are made of
parts (trailmark.planning.methods) take the place of all: success within the limit, time to the first path and cost at
the limit, against the full planner. All of them answer a problem one after the other in a random order in one process,
so that whatever else the machine does meets all alike; the full planner does so twice, which tells what is chance.

    python -m benchmarks.ablation [--seeds 3] [--time-limit 1] [--problems TEXT] [--minutes 35] [--record FILE]

Runs are kept in a record (JSON Lines), seed by seed through all problems, so that the same command goes on where it was
stopped; the table is of the runs that are there. Runs of other code than the record's are refused.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.ablation_problems import ablation_cases
from benchmarks.ablation_report import CONTROL, FULL, SAMPLES, publish
from benchmarks.age import code_digest
from benchmarks.ahead_problems import Case
from trailmark.collision import StateChecker
from trailmark.motion import kind_of
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.planning.methods import METHODS
from trailmark.planning.warmup import warm_up

__all__ = ["main", "variants"]

ON_LATTICES = (
    *("lattice", "straight-level", "coarse-level", "small-levels", "large-levels", "largest-levels"),
    *("node-retraction", "multi-steps", "other-ways"),
)
REPEATS, ENOUGH = 7, 0.2
"""Times that a first path is sought by each at most, and the seconds after which it is sought no more. The soonest one
counts, since what else takes time is other programs'."""


def variants(case: Case) -> dict[str, PlannerSettings]:
    """Return the settings to compare on a problem, by name: what makes no difference to its robot is left out."""
    kind, straight = kind_of(case.problem.robot), case.problem.robot.turning_radius is None
    off = [*((*ON_LATTICES, "bridges") if straight else ("hybrid-astar",)), "bands"]
    off += ["disc-path"] if kind == "translation" else ["background-proof"]
    found = {FULL: PlannerSettings(), CONTROL: PlannerSettings()}
    found |= {f"without {name}": PlannerSettings(without=(name,)) for name in off}
    found[SAMPLES] = PlannerSettings(placement="samples")
    named = {name: METHODS[name] for name in METHODS if name != "landmark" and (straight or name != "lattice")}
    return found | {f"planner {name}": settings for name, settings in named.items()}


@cache
def _checker(case: Case) -> StateChecker:
    return StateChecker(case.problem.world, case.problem.robot)


def run(case: Case, settings: PlannerSettings, seed: int, limit: float, *, first: bool) -> dict[str, Any]:
    """Return status, seconds to the first path and cost of one run, which may end at its first path."""
    planner = LandmarkPlanner(
        case.problem.world, case.problem.robot, seed=seed, checker=_checker(case), settings=settings, warm=False
    )
    found: list[float] = []
    result = planner.plan(
        case.problem.query.start,
        case.problem.query.goal,
        limit,
        on_progress=lambda progress: None if progress.cost is None else found.append(progress.cost),
        stop=lambda: first and bool(found),
    )
    return {"status": result.status, "first": result.time["first_solution"], "cost": result.cost}


def block(case: Case, stage: str, seed: int, limit: float, repeats: int) -> Iterator[dict[str, Any]]:
    """Yield the runs of all variants on one problem: up to the first path, repeatedly, or up to the limit."""
    chosen = variants(case)
    # Loads what this robot's kind of motion needs.
    run(case, chosen[FULL], seed, limit, first=True)
    best: dict[str, dict[str, Any]] = {}
    spent = dict.fromkeys(chosen, 0.0)
    rng = np.random.default_rng([seed, len(stage)])
    for _ in range(repeats if stage == "first" else 1):
        for name in rng.permutation(list(chosen)).tolist():
            if spent[name] > ENOUGH:
                continue
            begin = perf_counter()
            row = run(case, chosen[name], seed, limit, first=stage == "first")
            spent[name] += perf_counter() - begin
            if name not in best or (row["first"] or np.inf) < (best[name]["first"] or np.inf):
                best[name] = row
    for name, row in best.items():
        yield {
            "stage": stage,
            "problem": case.problem.key,
            "group": case.group,
            "kind": case.kind,
            "seed": seed,
            "variant": name,
            **row,
        }


def measure(given: list[Case], record: Path, options: argparse.Namespace) -> None:
    """Add the runs that are missing to the record, as far as the minutes go."""
    head = {"code": code_digest("benchmarks.ablation"), "time_limit": options.time_limit}
    rows = _read(record)
    if rows and rows[0] != head:
        raise SystemExit(f"{record}: expected runs of this code and limit, got others; give another --record")
    done = {(row["stage"], row["problem"], row["seed"]) for row in rows[1:]}
    work = [(stage, case, seed) for seed in range(options.seeds) for stage in ("first", "cost") for case in given]
    missing = [(stage, case, seed) for stage, case, seed in work if (stage, case.problem.key, seed) not in done]
    begin = perf_counter()
    record.parent.mkdir(parents=True, exist_ok=True)
    with record.open("a") as file:
        if not rows:
            file.write(json.dumps(head) + "\n")
        for number, (stage, case, seed) in enumerate(missing):
            if perf_counter() - begin > 60.0 * options.minutes:
                break
            lines = [json.dumps(row) + "\n" for row in block(case, stage, seed, options.time_limit, options.repeats)]
            # In one piece: a block that was cut short is made anew.
            file.write("".join(lines))
            file.flush()
            done_now, spent = number + 1, perf_counter() - begin
            left = spent / done_now * (len(missing) - done_now)
            text = f"\r{done_now} of {len(missing)} blocks, {left:.0f} s to go; {stage}, {case.kind}, seed {seed}"
            print(f"{text:<100}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)


def _read(record: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in record.read_text().splitlines()] if record.exists() else []


def main(words: Sequence[str] | None = None, given: Sequence[Case] | None = None) -> int:
    """Measure what is missing, and write the table and the plot.

    Args:
        words: of the command line; the program's own if it is None.
        given: the problems; those of :func:`ablation_cases` if it is None.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    parser.add_argument("--record", type=Path, default=folder / "trailmark" / "ablation.jsonl", help="of the runs")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--time-limit", type=float, default=1.0, help="seconds of a run")
    parser.add_argument(
        "--problems", default="", help="groups and kinds that hold this text, such as 'random 50, disc'"
    )
    parser.add_argument(
        "--repeats", type=int, default=REPEATS, help="times that a first path is sought by each at most"
    )
    parser.add_argument("--count", type=int, default=1_000_000, help="problems at most")
    parser.add_argument("--minutes", type=float, default=35.0, help="after which no further block begins")
    parser.add_argument("--no-write", action="store_true", help="print the table only")
    options = parser.parse_args(words)
    warm_up()
    given = ablation_cases() if given is None else given
    chosen = [case for case in given if options.problems in f"{case.group} {case.kind}"][: options.count]
    measure(chosen, options.record, options)
    print(publish(_read(options.record)[1:], options.time_limit, write=not options.no_write))
    return 0


if __name__ == "__main__":
    sys.exit(main())
