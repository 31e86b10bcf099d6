"""Measured runs of OMPL's planners: the curve, the counts, PRM's slices, the shared simplifier."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from tests.helpers.runs import small_world

from trailmark import Path, Query, Rectangle, Robot, World
from trailmark.ompl_bridge import SE2Problem
from trailmark.ompl_bridge.measured import graph_size, measure, simplify


def problem(certified: bool) -> SE2Problem:
    return SE2Problem(small_world(), query="around", certified=certified, resolution=0.1)


@pytest.mark.parametrize(
    ("name", "certified"),
    [*((name, True) for name in ("RRTstar", "PRMstar", "BITstar", "RRTConnect")), ("RRTstar", False), ("PRM", False)],
)
def test_a_run_is_measured(name: str, certified: bool) -> None:
    posed = problem(certified)
    run = measure(posed, name, 0.2)
    assert run.exact
    assert run.status == 6
    np.testing.assert_allclose(run.path.states[[0, -1]], [posed.start, posed.goal], atol=1e-9)
    assert all(a[0] < b[0] and a[1] > b[1] for a, b in pairwise(run.curve))
    assert run.curve[-1][1] == pytest.approx(run.path.cost, rel=1e-5)
    assert 0.0 < run.curve[0][0] <= run.curve[-1][0] <= run.time + 1e-9
    assert run.motions_checked > 0
    assert run.states_checked > 0
    nodes, edges = graph_size(posed)
    assert nodes >= len(run.path) - 1
    assert edges >= 1
    if name == "RRTConnect":
        assert len(run.curve) == 1
        assert run.curve[0][0] == run.time
    else:
        assert run.time == pytest.approx(0.2, abs=0.2)


def test_without_a_way_there_is_no_curve() -> None:
    wall = World(
        "wall", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 3.0), 0.2, 7.0),), Robot.disc(0.3),
        queries=(Query("over", (1.0, 1.0, 0.0), (9.0, 1.0, 0.0)),),
    )  # fmt: skip
    run = measure(SE2Problem(wall), "RRTstar", 0.05)
    assert not run.exact
    assert run.curve == []


def test_the_simplifier_shortens_and_stays_right() -> None:
    posed = problem(True)
    detour = np.array([posed.start, [3.0, 1.0, 0.5], [5.0, 1.0, 2.0], [7.0, 1.0, -1.0], posed.goal])
    assert posed.checker.motions_valid(detour[:-1], detour[1:]).all()
    path, seconds = simplify(posed, Path(detour), 0.5)
    states = path.states
    assert posed.checker.motions_valid(states[:-1], states[1:]).all()
    np.testing.assert_allclose(states[[0, -1]], detour[[0, -1]], atol=1e-9)
    assert path.cost < 0.8 * Path(detour).cost
    assert seconds > 0.0
