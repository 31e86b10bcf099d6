"""What runs come to: small databases counted by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.helpers.made_results import run, write_results

from trailmark.benchmark.report.curves import cost_quartiles, time_grid
from trailmark.benchmark.report.data import Results, load_results
from trailmark.benchmark.report.digits import count, milliseconds, number, percent, probability, seconds
from trailmark.benchmark.report.findings import findings, warnings_of
from trailmark.benchmark.report.palette import family_of, styles_of
from trailmark.benchmark.report.summary import summarise, summarise_runs
from trailmark.benchmark.status import Status


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """Two problems of limit 1 s: A is quick and cheap, B slow, and fails in every other run."""
    quick = [run(k, 0.01 + 0.001 * k, 10.0 + 0.1 * k) for k in range(8)]
    slow = [run(k, 0.2 + 0.01 * k, 20.0 + 0.1 * k) if k % 2 else run(k, None, time=0.4) for k in range(8)]
    problems = {"one": {"A": quick, "B": slow}, "two": {"A": quick, "B": slow}}
    return load_results(write_results(tmp_path / "r.db", problems))


def test_numbers_of_a_planner(results: Results) -> None:
    s = summarise_runs(results.problems[0], "B")
    assert (s.runs, s.claimed, s.success, s.missing) == (8, 4, 4, 0.5)
    times = [1.0, 0.21, 1.0, 0.23, 1.0, 0.25, 1.0, 0.27]  # a failure at 0.4 s counts as the limit all the same
    by_hand = math.prod(t + 0.01 for t in times) ** (1 / 8) - 0.01
    assert s.first_mean == pytest.approx(by_hand)
    assert s.first.tolist() == pytest.approx([0.21, 0.24, math.inf, math.inf, math.inf])
    assert s.ratio.tolist() == pytest.approx([2.01, 2.04, math.inf, math.inf, math.inf])
    assert s.mean_ratio == pytest.approx((2.01 * 2.03 * 2.05 * 2.07) ** 0.25)
    assert s.endings == {"timeout": 4}
    assert (s.interval.low, s.interval.high) == pytest.approx((0.2152, 0.7848), abs=1e-4)


def test_who_is_ahead(results: Results) -> None:
    summary = summarise(results)
    assert [s.planner for s in summary.planners] == ["A", "B"]
    for pairs in (summary.times, summary.costs):
        pair = pairs[frozenset("AB")]
        assert pair.winner == "A"
        assert pair.p < 0.001
        assert pair.seen_from("A").superiority == 1.0
        assert pair.seen_from("B").factor == pytest.approx(1.0 / pair.seen_from("A").factor)
    pair = summary.times[frozenset("AB")].seen_from("A")
    assert pair.interval is not None
    assert pair.interval.low <= pair.factor <= pair.interval.high
    # Four costs of B on each problem are too few to draw from.
    assert summary.costs[frozenset("AB")].interval is None
    means = [s.first_mean for s in summary.planners]
    assert summary.times[frozenset("AB")].seen_from("A").factor == pytest.approx(means[1] / means[0])


def test_the_same_database_gives_the_same_numbers(results: Results) -> None:
    assert summarise(results).times == summarise(results).times


def test_equal_planners_are_not_distinguished(tmp_path: Path) -> None:
    rows = [run(k, 0.1 + 0.01 * k, 10.0) for k in range(6)]
    summary = summarise(load_results(write_results(tmp_path / "r.db", {"yard": {"A": rows, "B": rows}})))
    assert summary.times[frozenset("AB")].winner is None
    assert summary.costs[frozenset("AB")].p == 1.0


def test_findings_say_who_leads_and_how_surely(results: Results) -> None:
    soonest, cheapest, reliable, referee = findings(results, summarise(results))
    assert soonest.answer == cheapest.answer == reliable.answer == "A"
    assert "Ahead of 1 of 1 other" in soonest.detail
    assert "p < 0.001" in soonest.detail
    assert cheapest.value == "1.035×"
    assert reliable.value == "100 %"
    assert referee.value == "24 of 24"
    assert warnings_of(results, summarise(results)) == []


def test_findings_where_nothing_is_solved(tmp_path: Path) -> None:
    rows = [run(0, None), run(1, None, status=int(Status.ABORT))]
    results = load_results(write_results(tmp_path / "r.db", {"yard": {"A": rows}}))
    solved, referee = findings(results, summarise(results))
    assert (solved.value, referee.answer) == ("0 %", "nothing to judge")


def test_refused_paths_are_reported_by_planner(tmp_path: Path) -> None:
    bad = [run(k, 0.1, 10.0, correct_solution=False) for k in range(2)]
    good = [run(k, 0.1, 10.0) for k in range(5)]
    results = load_results(write_results(tmp_path / "r.db", {"yard": {"PRM": bad + good[2:], "A": good}}))
    referee = findings(results, summarise(results))[-1]
    assert referee.value == "2 of 10"
    assert "PRM 2" in referee.detail


def test_warnings(tmp_path: Path) -> None:
    problems = {"one": {"A": [run(0, 0.1, 10.0), run(1, 0.1, 10.0)], "B": [run(0, 0.2, 10.0, time=1.5)]}}
    results = load_results(write_results(tmp_path / "r.db", problems))
    unfinished, few, hopeless, late = warnings_of(results, summarise(results))
    assert "1 of the runs asked for" in unfinished
    assert "As few as 1 run " in few
    assert hopeless.endswith("It takes 4 runs of each planner on each problem.")
    assert "(B 1)" in late


@pytest.mark.slow
@pytest.mark.parametrize(("problems", "runs", "told"), [(1, 6, "7 runs"), (1, 7, ""), (3, 6, "On 3 of 3 problems")])
def test_where_no_test_can_succeed_it_says_so(tmp_path: Path, problems: int, runs: int, told: str) -> None:
    rows = {f"P{i}": [run(k, 10.0**-i + 1e-4 * k, 10.0 + i + 0.01 * k) for k in range(runs)] for i in range(8)}
    rows = dict(rows) if problems == 1 else {name: found[:5] for name, found in rows.items()}
    made = {f"yard{p}": rows for p in range(problems)}
    results = load_results(write_results(tmp_path / "r.db", made))
    summary = summarise(results)
    notes = " ".join(warnings_of(results, summary))
    assert (told in notes) if told else notes == ""
    # The note is true: all planners are apart, and just then no pair is called so.
    assert any(pair.winner for pair in summary.times.values()) == (told != "7 runs")


def test_curves(results: Results) -> None:
    problem = results.problems[0]
    times = time_grid([problem], 48)
    b = cost_quartiles(problem.runs["B"], times)
    assert b.shape == (3, 48)
    assert times[-1] == pytest.approx(1.0)
    assert b[:, 0].tolist() == [math.inf] * 3
    assert b[:, -1].tolist() == pytest.approx([20.4, math.inf, math.inf])
    a = cost_quartiles(problem.runs["A"], times)[1]
    assert a[-1] == pytest.approx(10.35)
    early = int(np.searchsorted(times, 0.5))
    assert a[early] == pytest.approx(12.42)  # each run's first path costs 1.2 times its last, which comes at 0.9 s


def test_styles_tell_planners_apart() -> None:
    algorithms = [f"Planner{i}" for i in range(20)]
    families = [form.format(name) for name in ("PRM", *algorithms) for form in ("{}", "{}+certified", "native:{}")]
    own = ["landmark", "roadmap", "landmark k=200", *(f"landmark k={k}" for k in range(300, 500, 10))]
    names = [*own, *families, "my_module:plan", "RRTConnect:range=2", "RRTConnect:range=4"]
    styles = styles_of(names)
    assert len({(s.colour, s.dash, s.mark) for s in styles.values()}) == len(names)
    assert styles["PRM"].colour == styles["PRM+certified"].colour == styles["native:PRM"].colour
    assert styles["PRM"].mark == styles["PRM+certified"].mark == styles["native:PRM"].mark
    some = ["landmark:samples=9", "PRM+certified:a=1", "native:PRM:range=2", "my_module:plan:a=1", "RRTConnect:range=2"]
    assert [family_of(name) for name in some] == ["landmark", "certified", "native", "own", "discrete"]


def test_numbers_as_words() -> None:
    assert [number(v) for v in (0.0, 0.04217, 4.2, 42.17, 4217.4, 0.09996, math.inf, math.nan, None)] == [
        *("0", "0.0422", "4.20", "42.2", "4,217", "0.100", "∞", "–", "–")
    ]
    assert [count(v) for v in (0.0, 999.4, 12345.6)] == ["0", "999", "12,346"]
    assert milliseconds(0.0421) == "42.1"
    assert [seconds(v) for v in (2e-5, 0.042, 1.5)] == ["20.0 µs", "42.0 ms", "1.50 s"]
    assert [percent(v) for v in (0.0, 1.0, 0.9999, 0.0001, 0.5)] == ["0 %", "100 %", "> 99.9 %", "< 0.1 %", "50.0 %"]
    assert [probability(p) for p in (1e-9, 0.0312, 0.5)] == ["< 0.001", "= 0.031", "= 0.50"]
