"""What is each stage of the planner good for, and what are K-means landmarks good for?

    python -m benchmarks.ablation [--seeds 3] [--time-limit 1] [--problems TEXT] [--minutes 35] [--nodes]

Each stage (trailmark.planning.pipeline) is left out in turn, K-means gives way to as many plain samples, and the
planners that are made of some stages (trailmark.planning.settings) take the place of all: success within the limit,
time to the first path and cost at the limit, against the full planner. All of them answer a problem one after the other
in a random order in one process, so that whatever else the machine does meets all alike; the full planner does so
twice, which tells what is chance. Runs are kept in a record (JSON Lines), so that the same command goes on where it was
stopped. ``--nodes`` compares K-means centres with uniform samples as nodes of a roadmap instead.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.problems import Case, ablation_cases
from benchmarks.report import FOLDER, Claim, keep
from trailmark.benchmark.environment import source_digest
from trailmark.collision import StateChecker
from trailmark.landmarks import free_samples, k_means_landmarks
from trailmark.motion import kind_of
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.planning.settings import METHODS, STAGES
from trailmark.planning.warmup import warm_up
from trailmark.roadmap import Roadmap

__all__ = ["compare", "main", "variants"]

Row = dict[str, Any]

FULL, CONTROL, SAMPLES = "full planner", "the same once more", "samples for K-means"
"""Variants: what all are compared with, what tells how much of a difference is chance, and plain samples."""

OF_CARS, OF_DISCS = {"hybrid-astar", "redriving"}, {"disc-path"}
KEPT = {"shortening", "improvement", "roadmap"}
"""What is not left out: it makes first paths better, not sooner, or serves later queries."""

REPEATS, ENOUGH = 7, 0.2
"""Times that a first path is sought by each at most, and the seconds after which it is sought no more. The soonest one
counts, since what else takes time is other programs'."""

NODES, QUERIES = (100, 300, 1000), 200
"""Nodes of the roadmaps that are compared, and queries put to each."""


def variants(case: Case) -> dict[str, PlannerSettings]:
    """Return the settings to compare on a problem, by name: what makes no difference to its robot is left out."""
    kind, straight = kind_of(case.problem.robot), case.problem.robot.turning_radius is None
    unused = KEPT | (OF_CARS if straight else {"bridges", "lattice", "node-retraction", "multi-steps", "other-ways"})
    unused |= {"background-proof"} if kind == "translation" else OF_DISCS
    found = {FULL: PlannerSettings(), CONTROL: PlannerSettings()}
    found |= {f"without {name}": PlannerSettings(without=(name,)) for name in STAGES if name not in unused}
    found[SAMPLES] = PlannerSettings(placement="samples")
    named = {name: METHODS[name] for name in METHODS if name != "landmark" and (straight or name != "lattice")}
    return found | {f"planner {name}": settings for name, settings in named.items()}


@cache
def _checker(case: Case) -> StateChecker:
    return StateChecker(case.problem.world, case.problem.robot)


def run(case: Case, settings: PlannerSettings, seed: int, limit: float, *, first: bool) -> Row:
    """Return status, seconds to the first path and cost of one run, which may end at its first path."""
    query, found = case.problem.query, list[float]()
    planner = LandmarkPlanner(
        case.problem.world, case.problem.robot, seed=seed, checker=_checker(case), settings=settings, warm=False
    )
    result = planner.plan(
        query.start,
        query.goal,
        limit,
        on_progress=lambda progress: None if progress.cost is None else found.append(progress.cost),
        stop=lambda: first and bool(found),
    )
    return {"status": result.status, "first": result.time["first_solution"], "cost": result.cost}


def block(case: Case, stage: str, seed: int, limit: float, repeats: int) -> Iterator[Row]:
    """Yield the runs of all variants on one problem: up to the first path, repeatedly, or up to the limit."""
    chosen = variants(case)
    # Loads what this robot's kind of motion needs.
    run(case, chosen[FULL], seed, limit, first=True)
    best: dict[str, Row] = {}
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
    about = {"stage": stage, "problem": case.problem.key, "group": case.group, "seed": seed}
    for name, row in best.items():
        yield {**about, "variant": name, **row}


def measure(given: Sequence[Case], record: Path, options: argparse.Namespace) -> list[Row]:
    """Add the runs that are missing to the record, as far as the minutes go, and return all of it."""
    head = {"code": source_digest(), "time_limit": options.time_limit}
    rows = [json.loads(line) for line in record.read_text().splitlines()] if record.exists() else []
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
            found = list(block(case, stage, seed, options.time_limit, options.repeats))
            # In one piece: a block that was cut short is made anew.
            file.write("".join(json.dumps(row) + "\n" for row in found))
            file.flush()
            rows += found
            print(f"\r{number + 1} of {len(missing)}: {stage}, {case.kind:<40}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return [row for row in rows if "variant" in row]


def compare(rows: Sequence[Row], variant: str, limit: float) -> tuple[list[float], list[float], list[float]]:
    """Return, for each problem, a variant's differences to the full planner.

    Returns:
        Decided runs (share; a path, or a proof that there is none), logarithm of the ratio of times to the first path
        (without a path the limit counts), and of costs at the limit.
    """
    runs = {(row["stage"], row["problem"], row["seed"], row["variant"]): row for row in rows}
    success, first, cost = defaultdict(list), defaultdict(list), defaultdict(list)
    for (stage, problem, seed, name), row in runs.items():
        full = runs.get((stage, problem, seed, FULL))
        if name != variant or full is None:
            continue
        if stage == "first":
            success[problem].append(float(row["status"] != "timeout") - float(full["status"] != "timeout"))
            if row["first"] is not None or full["first"] is not None:
                first[problem].append(math.log((row["first"] or limit) / (full["first"] or limit)))
        elif row["cost"] and full["cost"]:
            cost[problem].append(math.log(row["cost"] / full["cost"]))
    means = [[float(np.mean(values)) for values in found.values()] for found in (success, first, cost)]
    return means[0], means[1], means[2]


def claims(rows: Sequence[Row], limit: float) -> list[Claim]:
    """Return a row for each variant; by group of problems, the time to the first path."""
    names = [name for name in dict.fromkeys(row["variant"] for row in rows) if name != FULL]
    groups = sorted({row["group"] for row in rows})
    found = []
    for name in names:
        success, first, cost = compare(rows, name, limit)
        figure = (
            f"decided {_interval(success, lambda v: 100.0 * v, '+.1f')} points, first path x "
            f"{_interval(first, math.exp, '.2f')}, cost {_interval(cost, lambda v: 100.0 * math.expm1(v), '+.2f')} %"
        )
        within = {group: compare([r for r in rows if r["group"] == group], name, limit)[1] for group in groups}
        told = ", ".join(f"{group} {math.exp(float(np.mean(logs))):.2f}" for group, logs in within.items() if logs)
        found.append(Claim(name, figure, f"full planner; first path by group: {told}"))
    return found


def _interval(values: Sequence[float], shown: Any, form: str) -> str:
    """Return a mean over problems and its 95 % bootstrap interval, problems resampled."""
    if not values:
        return "-"
    draws = np.random.default_rng(0).choice(values, (4000, len(values))).mean(axis=1)
    low, high = np.quantile(draws, (0.025, 0.975))
    return f"{shown(float(np.mean(values))):{form}} ({shown(low):{form}} to {shown(high):{form}})"


def nodes(given: Sequence[Case]) -> list[Claim]:
    """Return the share of random queries that roadmaps of K-means centres and of samples answer."""
    share: dict[tuple[int, str], list[float]] = defaultdict(list)
    for case in given:
        checker = _checker(case)
        ends = free_samples(checker, 2 * QUERIES, random_state=1)
        for count in NODES:
            rng, radius = np.random.default_rng(count), checker.footprint.sweep_radius
            samples = free_samples(checker, 10 * count, random_state=rng)
            placed = {
                "K-means centres": k_means_landmarks(samples, count, radius=radius, steps=10, random_state=rng),
                "uniform samples": samples[:count],
            }
            for name, q in placed.items():
                roadmap = Roadmap(checker)
                roadmap.add(q)
                pairs = roadmap.add(ends).reshape(-1, 2)
                answered = [len(roadmap.shortest_path(int(a), int(b)).nodes) > 0 for a, b in pairs]
                share[count, name].append(float(np.mean(answered)))
    return [
        Claim(
            f"random queries answered by a roadmap of {count} K-means centres, {len(given)} worlds",
            f"{100.0 * np.mean(share[count, 'K-means centres']):.1f} %",
            f"uniform samples: {100.0 * np.mean(share[count, 'uniform samples']):.1f} %",
        )
        for count in NODES
    ]


def main(words: Sequence[str] | None = None, given: Sequence[Case] | None = None) -> int:
    """Measure what is missing, and keep the table.

    Args:
        words: of the command line; the program's own if it is None.
        given: the problems; those of :func:`benchmarks.problems.ablation_cases` if it is None.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", type=Path, default=FOLDER / "ablation.jsonl", help="of the runs")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--time-limit", type=float, default=1.0, help="seconds of a run")
    parser.add_argument("--problems", default="", help="groups and kinds that hold this text, such as 'random 50'")
    parser.add_argument("--repeats", type=int, default=REPEATS, help="of the search for a first path, at most")
    parser.add_argument("--minutes", type=float, default=35.0, help="after which no further problem begins")
    parser.add_argument("--nodes", action="store_true", help="compare nodes of roadmaps instead")
    options = parser.parse_args(words)
    warm_up()
    given = ablation_cases() if given is None else given
    chosen = [case for case in given if options.problems in f"{case.group} {case.kind}"]
    if options.nodes:
        straight = [case for case in chosen if case.problem.robot.turning_radius is None]
        keep("ablation_nodes", nodes(straight), ["--nodes"])
    else:
        keep("ablation", claims(measure(chosen, options.record, options), options.time_limit), words)
    return 0


if __name__ == "__main__":
    sys.exit(main())
