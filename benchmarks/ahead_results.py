"""The runs of benchmarks/ahead.py as its database holds them, and the figures that they give.

A run counts as solved if the referee passed its path. Failures count as the time limit in means of times, as infinite
in medians. Each problem counts as much as any other, however many runs it has.
"""

from __future__ import annotations

import math
import sqlite3
from collections import defaultdict
from collections.abc import Iterable, Sequence
from contextlib import closing
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.ahead_problems import Case
from trailmark.benchmark.statistics import quantiles, step_values
from trailmark.benchmark.status import Status
from trailmark.planning.proofs import LowerBound

__all__ = ["COST_LIMIT", "FIRST_LIMIT", "LANDMARK", "Estimate", "Results", "Run", "cost_ratio", "median"]

FIRST_LIMIT, COST_LIMIT = 1.0, 10.0
"""Time limits (seconds) of the stages."""

LANDMARK = "landmark"
RESAMPLES = 4000

FloatArray = NDArray[np.float64]


class Run(NamedTuple):
    """One run.

    Attributes:
        id: of its row.
        planner: its name.
        limit: seconds.
        status: OMPL's number.
        claimed: the planner's word.
        correct: the referee's.
        time: seconds of planning.
        setup: seconds for world and checker.
        first: seconds until the first path; infinite if the run is not correct.
        first_cost: metres; infinite as above.
        cost: metres at the end; infinite as above.
        simplified: metres after the simplifier if that path is correct, else ``cost``.
    """

    id: int
    planner: str
    limit: float
    status: int
    claimed: bool
    correct: bool
    time: float
    setup: float
    first: float
    first_cost: float
    cost: float
    simplified: float


class Estimate(NamedTuple):
    """A value with the ends of its 95 % bootstrap interval."""

    value: float
    low: float
    high: float


class Results:
    """What a database says of the cases.

    Args:
        file: of benchmarks/ahead.py.
        cases: runs of other problems are left out.
    """

    def __init__(self, file: Path, cases: Iterable[Case]) -> None:
        self.file = file
        self.cases = {case.problem.key: case for case in cases}
        self._runs: dict[tuple[str, float], dict[str, list[Run]]] = defaultdict(lambda: defaultdict(list))
        query = (
            "SELECT e.id, e.timelimit, p.name, r.id, r.status, r.solved, "
            "r.correct_solution, r.time, r.setup_time, r.time_to_first_solution, r.first_solution_length, "
            "r.solution_length, r.simplified_solution_length "
            "FROM runs r JOIN experiments e ON e.id = r.experimentid JOIN plannerConfigs p ON p.id = r.plannerid "
            "ORDER BY r.seed"
        )
        with closing(self._open()) as db:
            keys = dict(db.execute("SELECT id, json_extract(setup, '$.identity.problem') FROM experiments"))
            for experiment, limit, planner, *row in db.execute(query):
                if keys[experiment] in self.cases:
                    self._runs[keys[experiment], limit][planner].append(_run(planner, limit, row))

    def _open(self) -> sqlite3.Connection:
        return sqlite3.connect(f"{self.file.resolve().as_uri()}?mode=ro", uri=True)

    def runs(self, case: Case, planner: str, limit: float = FIRST_LIMIT) -> list[Run]:
        """Return a planner's runs on a case, in the order of their seeds."""
        return self._runs.get((case.problem.key, limit), {}).get(planner, [])

    def all_runs(self, case: Case) -> list[Run]:
        """Return all runs on a case."""
        limits = (FIRST_LIMIT, COST_LIMIT)
        return [r for limit in limits for runs in self._runs.get((case.problem.key, limit), {}).values() for r in runs]

    def planners(self, limit: float = FIRST_LIMIT) -> list[str]:
        """Return the names of the planners that have runs with this limit, the landmark planner first."""
        found = {name for (_, given), runs in self._runs.items() if given == limit for name in runs}
        return sorted(found, key=lambda name: (name != LANDMARK, name))

    @cached_property
    def feasible(self) -> list[Case]:
        """The cases to which a path is known, or that are made so that there is one."""
        return [case for case in self.cases.values() if case.feasible or self._solved(case)]

    @cached_property
    def infeasible(self) -> list[Case]:
        """The cases that are proven infeasible, or made so, and that nobody solved."""
        closed = [case for case in self.cases.values() if case.feasible is False or self._proven(case)]
        solved = {case.problem.key for case in self.feasible}
        return [case for case in closed if case.problem.key not in solved]

    @cached_property
    def undecided(self) -> list[Case]:
        """The cases of which nothing is known."""
        known = {case.problem.key for case in (*self.feasible, *self.infeasible)}
        return [case for key, case in self.cases.items() if key not in known]

    @cached_property
    def contradictions(self) -> list[Case]:
        """The feasible cases that some run claims to have proven infeasible, and those made infeasible but solved."""
        return [case for case in self.feasible if self._proven(case) or case.feasible is False]

    def _solved(self, case: Case) -> bool:
        return any(run.correct for run in self.all_runs(case))

    def _proven(self, case: Case) -> bool:
        return any(run.planner == LANDMARK and run.status == Status.INFEASIBLE for run in self.all_runs(case))

    def best_known(self, case: Case) -> float:
        """Return the lowest cost of any correct path, metres."""
        return min((min(run.cost, run.simplified) for run in self.all_runs(case)), default=math.inf)

    def timed(self, planners: Sequence[str]) -> list[Case]:
        """Return the feasible cases on which all of these planners have runs of the first stage."""
        return [case for case in self.feasible if all(self.runs(case, planner) for planner in planners)]

    def success(self, planner: str, within: float, chosen: Sequence[Case]) -> float:
        """Return the share of runs with a correct path after so many seconds, each case with the same weight."""
        shares = [np.mean([r.correct and r.first <= within for r in self.runs(case, planner)]) for case in chosen]
        return float(np.mean(shares))

    def ratio(self, rival: str, chosen: Sequence[Case], planner: str = LANDMARK) -> Estimate | None:
        """Return the geometric mean of the landmark planner's (or another's) times to a first path over a rival's.

        Failures of either count as the limit. The bootstrap draws worlds, since the cases of one are not independent.
        """
        worlds: dict[str, list[float]] = defaultdict(list)
        for case in chosen:
            mine, other = self.runs(case, planner), self.runs(case, rival)
            if mine and other:
                worlds[case.problem.world.name].append(_mean_log_first(mine) - _mean_log_first(other))
        if not worlds:
            return None
        sums, counts = np.array([[sum(found), len(found)] for found in worlds.values()]).T
        picks = np.random.default_rng(0).integers(len(sums), size=(RESAMPLES, len(sums)))
        low, high = np.quantile(sums[picks].sum(axis=1) / counts[picks].sum(axis=1), (0.025, 0.975))
        return Estimate(math.exp(sums.sum() / counts.sum()), math.exp(low), math.exp(high))

    def first_times(self, planner: str, chosen: Iterable[Case]) -> tuple[FloatArray, FloatArray]:
        """Return times to the first path, ascending, infinite for failures; and the share of cases until then."""
        pairs = [(r.first, 1.0 / len(runs)) for case in chosen if (runs := self.runs(case, planner)) for r in runs]
        times, weights = np.array(sorted(pairs)).reshape(-1, 2).T
        return times, np.cumsum(weights) / max(weights.sum(), 1e-300)

    def quantile(self, planner: str, share: float, chosen: Iterable[Case]) -> float:
        """Return a quantile of the times to the first path, each case with the same weight."""
        times, shares = self.first_times(planner, chosen)
        return float(times[np.searchsorted(shares, share - 1e-12)]) if len(times) else math.nan

    def median_first(self, planner: str, chosen: Iterable[Case]) -> float:
        """Return the median time to the first path over all runs on some cases."""
        return median([run.first for case in chosen for run in self.runs(case, planner)])

    def first_over_best(self, case: Case) -> float:
        """Return the landmark planner's median cost of the first path over the best known."""
        return cost_ratio(median([run.first_cost for run in self.runs(case, LANDMARK)]), self.best_known(case))

    def landmark_cost(self, case: Case, at: float) -> float:
        """Return the landmark planner's median cost after so many seconds of its long runs."""
        found = []
        with closing(self._open()) as db:
            for run in self.runs(case, LANDMARK, COST_LIMIT):
                query = "SELECT time, best_cost FROM progress WHERE runid = ? ORDER BY time"
                curve = np.array(db.execute(query, (run.id,)).fetchall()).reshape(-1, 2)
                found.append(float(step_values(curve[:, 0], curve[:, 1], [at])[0]) if run.correct else math.inf)
        return median(found)

    def rivals_cost(self, case: Case) -> tuple[float, str]:
        """Return the lowest of the other planners' median costs after 10 s and the simplifier, and whose it is."""
        rivals = [name for name in self.planners(COST_LIMIT) if name != LANDMARK]
        costs = {name: [r.simplified for r in self.runs(case, name, COST_LIMIT)] for name in rivals}
        return min(((median(found), name) for name, found in costs.items() if found), default=(math.inf, "none"))

    @cached_property
    def compared(self) -> list[Case]:
        """The cases on which the landmark planner and some other planner have long runs."""
        rivals = [name for name in self.planners(COST_LIMIT) if name != LANDMARK]
        return [
            case
            for case in self.feasible
            if self.runs(case, LANDMARK, COST_LIMIT)
            # Runs of the stage "decide" end at their first path.
            and any(self.runs(case, name, COST_LIMIT) for name in rivals if not name.startswith("RRTConnect"))
        ]

    @cached_property
    def gaps(self) -> dict[str, float]:
        """By problem, how far the best known cost is above the lower bound, as a share of the bound."""
        bounds: dict[str, LowerBound] = {}
        found = {}
        for case in self.feasible:
            best, problem = self.best_known(case), case.problem
            if math.isfinite(best):
                bound = bounds.setdefault(case.world, LowerBound(problem.world, problem.robot))
                ends = np.array([problem.query.start, problem.query.goal])
                found[problem.key] = best / bound.of(*ends).cost - 1.0
        return found

    @cached_property
    def conditions(self) -> dict[str, Any]:
        """What the database says of itself: machine, versions, dates, number of runs."""
        with closing(self._open()) as db:
            cpu, version, begin, end = db.execute(
                "SELECT cpuinfo, version, min(date), max(date) FROM experiments"
            ).fetchone()
            count, refused = db.execute("SELECT count(*), sum(solved AND NOT correct_solution) FROM runs").fetchone()
            per_planner = db.execute(
                "SELECT p.name, count(*), sum(r.solved), sum(r.solved AND NOT r.correct_solution) "
                "FROM runs r JOIN plannerConfigs p ON p.id = r.plannerid GROUP BY p.name ORDER BY p.name"
            ).fetchall()
        names = ("processor", "version", "begin", "end", "runs", "refused", "planners")
        return dict(zip(names, (cpu, version, begin, end, count, refused, per_planner), strict=True))


def median(values: Sequence[float]) -> float:
    """Return the median of values that may be infinite; NaN of none."""
    return float(quantiles(values, [0.5])[0]) if len(values) else math.nan


def cost_ratio(cost: float, other: float) -> float:
    """Return the ratio of two costs, infinite if there is no path to have the first."""
    return cost / other if math.isfinite(cost) else math.inf


def _mean_log_first(runs: Sequence[Run]) -> float:
    return float(np.mean([math.log(min(run.first, run.limit)) for run in runs]))


def _run(planner: str, limit: float, row: Sequence[Any]) -> Run:
    number, status, claimed, correct, time, setup, first, first_cost, cost, simplified = row
    right = bool(correct)

    def known(value: float | None) -> float:
        return math.inf if value is None or not right else float(value)

    return Run(
        id=number,
        planner=planner,
        limit=limit,
        status=status,
        claimed=bool(claimed),
        correct=right,
        time=limit if time is None else time,
        setup=setup or 0.0,
        first=known(first),
        first_cost=known(first_cost),
        cost=known(cost),
        simplified=min(known(cost), known(simplified)),
    )
