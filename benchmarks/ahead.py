"""Is the landmark planner ahead of OMPL's planners, native C++ included? Writes results/ahead.{md,json,png}.

    python -m benchmarks.ahead [--stage first decide cost report] [--first-minutes 22] [--cost-minutes 14] [--workers 2]

Stages, all with the project's own benchmark (each run in a process of its own, paths refereed, the native peer if it
is built), all in one database, so that the same command goes on where it was stopped or where its time was up:

- first: time limit 1 s, all problems (benchmarks/ahead_problems.py), the planners that are ever soon to a first path.
  They end there; the landmark planner's first run goes on until its path has settled. A problem that the landmark
  planner proves infeasible is given to one other planner once, which must not solve it. The landmark planner, whose
  runs are short, has more seeds than the others.
- decide: time limit 10 s, the random problems that nobody solved and nobody proved infeasible.
- cost: time limit 10 s, one problem of every kind, the planners that reach low costs; every path simplified.
- report: the tables, from the database alone.

Runs of other source files than those in the database are refused: figures of two programs are no figures.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from benchmarks.ahead_problems import Case, cases
from benchmarks.ahead_report import publish
from benchmarks.ahead_results import COST_LIMIT, FIRST_LIMIT, Results
from trailmark.benchmark.environment import source_digest
from trailmark.benchmark.isolation.executors import Pool, local
from trailmark.benchmark.planners import known_planners
from trailmark.benchmark.runner import Benchmark, Tally
from trailmark.benchmark.store import Store

STAGES = ("first", "decide", "cost", "report")

SOON = (
    *("RRTConnect", "RRTConnect+certified", "native:RRTConnect", "native:RRTConnect+certified"),
    *("BITstar", "BITstar+certified", "native:BITstar", "native:BITstar+certified"),
    *("benchmarks.smac_like:plan", "benchmarks.theta_star_like:plan", "benchmarks.any_angle_exact:plan"),
)
SOMETIMES = ("KPIECE1", "RRT", "BFMT")
"""Those that were the soonest to a first path on some problem when all were tried; SOMETIMES ones get fewer runs."""

FEWER = 5
"""Seeds of these on shipped worlds and real data; one in random worlds."""

WITNESS = "RRTConnect+certified"
"""Tries problems that are said to be infeasible."""

CHEAP = (
    ("InformedRRTstar+certified", "native:InformedRRTstar", "AORRTC+certified", "native:BITstar"),
    ("BITstar+certified", "PRMstar+certified", "native:RRTstar"),
)
"""Rivals in cost, the ones that reached the lowest when all were tried first."""

MEMORY = 2048.0
"""MB a run."""

REPORT_PERIOD = 15.0
"""Seconds between two lines of progress."""


class TimeIsUp(Exception):  # noqa: N818  # no error: the stage has had its time
    """The stage has had its time."""


@dataclass
class Runner:
    """Makes runs until a moment.

    Attributes:
        store: the database.
        pool: the workers.
        deadline: on perf_counter's clock.
        stage: for the lines of progress.
    """

    store: Store
    pool: Pool
    deadline: float
    stage: str
    _said: float = 0.0

    def run(
        self,
        chosen: Sequence[Case],
        planners: Sequence[str],
        limit: float,
        seed: int,
        *,
        runs: int = 1,
        first: bool = False,
    ) -> None:
        """Make what is missing of these runs.

        Raises:
            TimeIsUp: the deadline has passed; what came in is in the database.
        """
        if chosen and planners and runs > 0:
            benchmark = Benchmark(
                problems=[case.problem for case in chosen],
                planners=planners,
                runs=runs,
                time_limit=limit,
                memory_limit=MEMORY,
                seed=seed,
                # The landmark planner's first run tells what a path costs after FIRST_LIMIT.
                first=[name for name in planners if first and (name != "landmark" or seed > 0)],
            )
            benchmark.run(self.store, self.pool, self._follow)

    def _follow(self, tally: Tally) -> None:
        now = perf_counter()
        if now > self._said + REPORT_PERIOD:
            self._said = now
            left = "" if tally.left is None else f", {tally.left:.0f} s to go"
            print(f"{self.stage}: {tally.done}/{tally.total} runs{left}", file=sys.stderr, flush=True)
        if now > self.deadline and tally.done < tally.total:
            raise TimeIsUp


def first(runner: Runner, given: Sequence[Case], results: Callable[[], Results], options: argparse.Namespace) -> None:
    """Make the runs of the first stage, breadth before depth."""
    runner.run(given, ["landmark"], FIRST_LIMIT, 0)
    proven = {case.problem.key for case in results().infeasible}
    still = [case for case in given if case.problem.key not in proven]
    closed = [case for case in given if case.problem.key in proven]
    runner.run(still, [*options.soon, *SOMETIMES], FIRST_LIMIT, 0, first=True)
    runner.run(closed, [WITNESS], FIRST_LIMIT, 0, first=True)
    runner.run(given, ["landmark"], FIRST_LIMIT, 1, runs=options.own_seeds - 1, first=True)
    for seed in range(1, options.seeds):
        runner.run(still, options.soon, FIRST_LIMIT, seed, first=True)
        if seed < FEWER:
            runner.run([case for case in still if case.group != "random"], SOMETIMES, FIRST_LIMIT, seed, first=True)


def decide(runner: Runner, given: Sequence[Case], results: Callable[[], Results], options: argparse.Namespace) -> None:
    """Try the problems on which nothing is known for longer."""
    del given, options
    runner.run(results().undecided, ["landmark", WITNESS], COST_LIMIT, 0, first=True)


def cost(runner: Runner, given: Sequence[Case], results: Callable[[], Results], options: argparse.Namespace) -> None:
    """Make the long runs, on the first problem of every kind that is known to be feasible."""
    feasible = {case.problem.key for case in results().feasible}
    chosen: dict[str, Case] = {}
    for case in given:
        if case.problem.key in feasible:
            chosen.setdefault(case.kind, case)
    # Should the time run out, it runs out for some of all groups.
    order = [*list(chosen.values())[::2], *list(chosen.values())[1::2]]
    runner.run(order, ["landmark"], COST_LIMIT, 0, runs=options.cost_seeds)
    for seed in range(options.cost_seeds):
        for rivals in options.cheap:
            runner.run(order, rivals, COST_LIMIT, seed)


def main() -> int:
    """Run the stages that were asked for."""
    options = _options()
    given = _given(options)
    if any(stage != "report" for stage in options.stage):
        _require_same_source(options.output)
        _run_stages(given, options)
    if "report" in options.stage:
        if not options.no_write:
            _require_same_source(options.output)
        publish(Results(options.output, given), write=not options.no_write)
    return 0


def _given(options: argparse.Namespace) -> list[Case]:
    """Return the cases that were asked for, kind by kind in turns."""
    counts: Counter[str] = Counter()
    given = []
    for case in cases(options.worlds, data=True):
        counts[case.kind] += 1
        if options.only in f"{case.group} {case.kind}" and counts[case.kind] <= options.per_kind:
            given.append(case)
    return given


def _run_stages(given: Sequence[Case], options: argparse.Namespace) -> None:
    known = known_planners()
    options.soon = [name for name in SOON if name in known or name.startswith("benchmarks.")]
    options.cheap = [[name for name in names if name in known] for names in CHEAP]
    minutes = {"first": options.first_minutes, "decide": options.decide_minutes, "cost": options.cost_minutes}
    options.output.parent.mkdir(parents=True, exist_ok=True)
    with local(options.workers) as pool, Store(options.output) as store:
        for name, stage in (("first", first), ("decide", decide), ("cost", cost)):
            if name not in options.stage:
                continue
            begin = perf_counter()
            runner = Runner(store, pool, begin + 60.0 * minutes[name], name)
            try:
                stage(runner, given, lambda: Results(options.output, given), options)
                ended = "done"
            except TimeIsUp:
                ended = "time is up"
            print(f"{name}: {ended} after {perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)


def _require_same_source(file: Path) -> None:
    """End if the database holds runs of other source files."""
    if not file.exists() or file.stat().st_size == 0:
        return
    with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as db:
        there = {row[0] for row in db.execute("SELECT DISTINCT json_extract(setup, '$.facts.source') FROM experiments")}
    if there - {source_digest()}:
        raise SystemExit(f"{file}: its runs were made by other source files, allowed: the same, or another --output")


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    parser.add_argument("--output", type=Path, default=cache / "trailmark" / "ahead.db", help="the database")
    parser.add_argument("--stage", nargs="+", choices=STAGES, default=list(STAGES))
    parser.add_argument("--worlds", type=int, default=20, help="random worlds for each level of clutter")
    parser.add_argument("--own-seeds", type=int, default=30, help="of the first stage, for the landmark planner")
    parser.add_argument("--seeds", type=int, default=30, help="of the others, as far as the time goes")
    parser.add_argument("--cost-seeds", type=int, default=3)
    parser.add_argument("--first-minutes", type=float, default=22.0, help="after which the stage ends")
    parser.add_argument("--decide-minutes", type=float, default=2.0)
    parser.add_argument("--cost-minutes", type=float, default=14.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", default="", help="groups and kinds that hold this text, such as 'random 50, disc'")
    parser.add_argument("--per-kind", type=int, default=1_000_000, help="problems of each kind, at most")
    parser.add_argument("--no-write", action="store_true", help="print the report only")
    return parser.parse_args()


if __name__ == "__main__":
    raise SystemExit(main())
