"""What is planned for less long: each plan, solve and default of a program, and nothing else of it."""

from __future__ import annotations

from tests.support.brief import briefly


def test_times_that_are_named_are_cut() -> None:
    assert briefly("p.plan(a, b, time_limit=20.0)", 0.1) == "p.plan(a, b, time_limit=0.1)"
    assert briefly("problem.solve(0.5)", 0.3) == "problem.solve(0.3)"
    assert briefly("p.plan(a, b, time_limit=0.05)", 0.1) == "p.plan(a, b, time_limit=0.05)"
    assert briefly("p.clearance(2.0)", 0.1) == "p.clearance(2.0)"


def test_the_default_is_cut_where_it_is_used() -> None:
    text = briefly("p.plan(a, b)", 0.25)
    assert text.endswith("\np.plan(a, b)")
    assert "time_limit=0.25" in text
    # One that is named in such a program is its own.
    assert "time_limit=0.1)" in briefly("p.plan(a, b)\np.plan(a, c, time_limit=0.1)", 0.25)
