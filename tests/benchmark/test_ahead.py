"""benchmarks/ahead.py: figures of a database whose runs are made up, random cases, and what is run."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.ahead_problems import Case, random_cases
from benchmarks.ahead_report import page
from benchmarks.ahead_results import Results
from benchmarks.ahead_targets import slower_worlds, targets
from tests.benchmark.conftest import START, experiment, solved

from trailmark.benchmark.problems import Problem
from trailmark.benchmark.record import RunRecord
from trailmark.benchmark.referee import Referee
from trailmark.benchmark.status import Status
from trailmark.benchmark.store import Store
from trailmark.shapes import Rectangle
from trailmark.world import Query, Robot, World

GOAL = (9.0, 1.0, 0.0)
LENGTH = 8.0


def case(name: str, feasible: bool | None = None, **changes: Any) -> Case:
    world = World(name, (0.0, 0.0, 10.0, 6.0), (), Robot.disc(0.3), queries=(Query("q", START, GOAL),))
    return Case("random", name, Problem(replace(world, **changes)), feasible)


CASES = {
    "easy": case("easy"),
    "hard": case("hard"),
    "closed": case("closed", obstacles=(Rectangle((5.0, 3.0), 0.2, 7.0),)),
    "open question": case("open question"),
}


def run(seed: int, first: float | None, cost: float = 10.0, status: Status | None = None) -> RunRecord:
    """A run whose first path came after so many seconds and cost a tenth more than the last; None: it failed."""
    if first is None:
        return RunRecord(status=int(status or Status.TIMEOUT), seed=seed, time=0.01 if status else 1.0)
    found = solved(seed, time=first, time_to_first_solution=first, first_solution_length=1.1 * cost)
    found.curve = [(first, 1.1 * cost), (0.9, cost)]
    found.solution_length = found.simplified_solution_length = cost
    return found


@pytest.fixture
def results(tmp_path: Path) -> Results:
    file = tmp_path / "ahead.db"
    refused = run(0, 0.001)
    refused.correct_solution = False
    rows: list[tuple[str, float, str, list[RunRecord]]] = [
        ("easy", 1.0, "landmark", [run(0, 0.02), run(1, 0.02)]),
        ("easy", 1.0, "RRTConnect", [run(0, 0.2), run(1, 0.2)]),
        ("easy", 1.0, "RRT", [run(0, 0.3)]),
        ("easy", 1.0, "RRT+certified", [run(0, 0.01)]),
        ("hard", 1.0, "landmark", [run(0, 0.08), run(1, None)]),
        ("hard", 1.0, "RRTConnect", [run(0, 0.5), refused]),
        ("hard", 1.0, "RRT", [run(0, 0.04)]),
        ("hard", 1.0, "RRT+certified", [run(0, 0.01)]),
        ("closed", 1.0, "landmark", [run(0, None, status=Status.INFEASIBLE)]),
        ("open question", 1.0, "landmark", [run(0, None)]),
        ("easy", 10.0, "landmark", [run(0, 0.02, 8.4), run(1, 0.02, 8.2)]),
        ("easy", 10.0, "RRTstar", [run(0, 0.5, 8.8), run(1, 0.5, 8.3)]),
        ("easy", 10.0, "BITstar", [run(0, 0.5, 9.0)]),
    ]
    refused.seed = 1
    with Store(file) as store:
        for name, limit, planner, records in rows:
            identity = {"problem": CASES[name].problem.key, "time_limit": limit}
            row = store.experiment(experiment(name=name, identity=identity, time_limit=limit))
            for record in records:
                store.add(row, store.planner(planner, "as it is"), record)
    return Results(file, CASES.values())


def test_what_is_known_of_the_cases(results: Results) -> None:
    assert [c.kind for c in results.feasible] == ["easy", "hard"]
    assert [c.kind for c in results.infeasible] == ["closed"]
    assert [c.kind for c in results.undecided] == ["open question"]
    assert results.contradictions == []
    assert results.best_known(CASES["easy"]) == 8.2


def test_times_and_shares(results: Results) -> None:
    chosen = results.timed(results.planners())
    assert [c.kind for c in chosen] == ["easy", "hard"]
    assert results.success("landmark", 0.1, chosen) == 0.75
    assert results.success("landmark", math.inf, chosen) == 0.75
    assert results.success("RRTConnect", 0.1, chosen) == 0.0
    ratio = results.ratio("RRTConnect", chosen)
    assert ratio is not None
    # Easy: 0.02 / 0.2. Hard: the mean of 0.08 and the limit, over that of 0.5 and, for the refused path, the limit.
    assert ratio.value == pytest.approx(math.sqrt(0.1 * math.sqrt(0.08) / math.sqrt(0.5)))
    assert ratio.low <= ratio.value <= ratio.high
    assert results.quantile("landmark", 0.5, chosen) == 0.02
    assert results.quantile("landmark", 0.95, chosen) == math.inf


def test_worlds_on_which_another_is_sooner(results: Results) -> None:
    found = slower_worlds(results)
    assert found is not None
    (row,), counted = found
    assert counted == 2
    assert row[0].startswith("hard")
    assert row[1:4] == (math.inf, "RRT", 0.04)


def test_costs(results: Results) -> None:
    easy = CASES["easy"]
    assert results.compared == [easy]
    assert results.landmark_cost(easy, 0.5) == pytest.approx(1.1 * 8.3)
    assert results.landmark_cost(easy, 1.0) == pytest.approx(8.3)
    cost, name = results.rivals_cost(easy)
    assert cost == pytest.approx(8.55)
    assert name == "RRTstar"
    assert results.gaps[easy.problem.key] == pytest.approx(8.2 / LENGTH - 1.0)


@pytest.mark.slow
def test_the_page_says_what_is_reached(results: Results) -> None:
    verdicts = {target.what: target.reached for target in targets(results)}
    assert verdicts["success within 1 s, feasible problems"] is False
    assert verdicts["success within 0.1 s"] is False
    assert verdicts["infeasible problems proven"] is True
    assert verdicts["cost at 1 s"] is True
    assert verdicts["cost at 10 s over the best known"] is False
    text = page(results)
    assert "1 undecided" in text
    assert "75.0%; next RRT+certified 100.0% (2 problems)" in text


@pytest.mark.slow
def test_random_cases_are_the_same_again_and_valid() -> None:
    first, again = list(random_cases(1)), itertools.islice(random_cases(1), 8)  # of each world there are some
    assert [c.problem.key for c in first[:8]] == [c.problem.key for c in again]
    assert len({c.problem.key for c in first}) == len(first) >= 9
    for chosen in first[::4]:
        query = chosen.problem.query
        referee = Referee(chosen.problem.world, chosen.problem.robot)
        for end in (query.start, query.goal):
            assert referee.fault([list(end), list(end)], end, end) is None
        for end, corner in ((query.start, 5.0), (query.goal, 95.0)):
            assert np.abs(np.array(end[:2]) - corner).max() <= 12.0
