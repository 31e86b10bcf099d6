"""Paths with fewer vertices: certified, hardly longer, and OMPL's path simplifier comes back from them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import Oracle, motion_states

from trailmark import Disc, Robot, StateChecker, World, se2
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.sparse_path import SLACK, sparse_path


def around_a_pillar(n: int) -> tuple[StateChecker, np.ndarray]:
    """Return a checker and a path of n states that hangs on a round pillar, as the shortest ones do."""
    world = World("pillar", (0.0, 0.0, 20.0, 12.0), (Disc((10.0, 4.0), 3.0),))
    robot = Robot.disc(0.5)
    # The chords keep off by a hair.
    angle = np.linspace(2.6, 0.5, n)
    reach = (3.5 + 1e-5) / np.cos(0.5 * (angle[0] - angle[1]))
    arc = np.column_stack([10.0 + reach * np.cos(angle), 4.0 + reach * np.sin(angle), 0.1 * angle])
    ends = np.array([[1.0, 4.0, 0.0]]), np.array([[19.0, 4.0, 0.0]])
    return StateChecker(world, robot), np.concatenate([ends[0], arc, ends[1]])


@pytest.mark.parametrize("n", [5, 60, 400])
def test_an_arc_becomes_a_few_corners(n: int) -> None:
    checker, path = around_a_pillar(n)
    assert checker.motions_valid(path[:-1], path[1:]).all()
    found = sparse_path(PointwiseChecker(checker), path)
    assert len(found) <= max(20, len(path) // 2)
    assert np.array_equal(found[[0, -1]], path[[0, -1]])
    assert checker.motions_valid(found[:-1], found[1:]).all()
    oracle = Oracle(checker.world, checker.robot)
    assert not oracle.collides(motion_states(found[:-1], found[1:], 300).reshape(-1, 3)).any()
    before, after = (float(np.sum(se2.distance(p[:-1], p[1:]))) for p in (path, found))
    assert after <= before * (1.0 + SLACK) + 1e-12


def test_what_has_nothing_to_leave_out_stays_and_doubled_states_go() -> None:
    checker, path = around_a_pillar(5)
    for states in (path[:1], path[:2], path[:2][[0, 0]], np.repeat(path, 3, axis=0)):
        found = sparse_path(PointwiseChecker(checker), states)
        assert np.array_equal(found[[0, -1]], states[[0, -1]])
        assert len(found) <= min(len(states), len(path))


def test_ompls_simplifier_comes_back(run_ompl: Any) -> None:
    # The same query again and again, on the roadmap of the ones before: the paths get as short as they can be.
    found = run_ompl(
        """
problem = SE2Problem(shipped("office"), query="door")
planner = OmplLandmarkPlanner(problem.information, seed=0)
problem.set_planner(planner)
vertices, hit, longer = [], 0, 0.0
from tests.helpers.oracles import Oracle, motion_states
oracle = Oracle(problem.world, problem.checker.robot)
for _ in range(3):
    problem.setup.clear()
    problem.setup.setStartAndGoalStates(*(state(problem.information, q) for q in (problem.start, problem.goal)))
    problem.solve(0.3)
    solution = problem.setup.getSolutionPath()
    longer = max(longer, solution.length() / planner.result.path.cost - 1.0) if planner.result else longer
    vertices.append(solution.getStateCount())
    problem.setup.simplifySolution()
    rows = problem.path.states
    hit += int(oracle.collides(motion_states(rows[:-1], rows[1:], 200).reshape(-1, 3)).any())
tell(vertices=vertices, hit=hit, longer=longer)
""",
        seconds=300.0,
    )
    assert len(found["vertices"]) == 3
    assert max(found["vertices"]) <= 40
    assert found["hit"] == 0
    assert found["longer"] < 2e-4
