"""Claims that are wrong never leave the planner: they are reported, and planning goes on without."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.helpers.cell_oracle import free_somewhere

from trailmark.collision import StateChecker
from trailmark.errors import InternalErrorWarning
from trailmark.landmarks import Relaxation
from trailmark.landmarks.relaxation import CostMap
from trailmark.library import find_world
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.planning.proofs import LowerBound, enclosed
from trailmark.planning.proofs.bound import Bound
from trailmark.planning.proofs.cell_core import core
from trailmark.planning.proofs.claims import contradicted, grid_separates
from trailmark.planning.proofs.enclosure import enclosure
from trailmark.shapes import Disc, Rectangle
from trailmark.world import Robot, World

WALL = World("wall", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 2.0), 0.5, 4.0), Disc((2.0, 5.0), 0.3)))
"""A way round the wall's upper end, 2 m wide."""

SHUT = World("shut", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 3.0), 0.5, 6.2, 0.1),))
ENDS = np.array([[1.0, 1.0, 0.0], [9.0, 1.0, 1.0]])
ROBOTS = (Robot.disc(0.3), Robot.rectangle(0.7, 0.5))


def test_what_contradicts_a_path() -> None:
    assert not contradicted(10.0, 10.0)
    assert not contradicted(10.0 + 1e-9, 10.0)
    assert contradicted(10.0 + 1e-6, 10.0)
    assert contradicted(np.inf, 1e6)
    assert not contradicted(np.inf, np.inf)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("fineness", [0, 1])
def test_the_grid_is_proven_where_it_separates(robot: Robot, fineness: int) -> None:
    for world, shut in ((SHUT, True), (WALL, False)):
        relaxation = Relaxation(StateChecker(world, robot), fineness)
        to_goal = relaxation.costs_from(ENDS[1], target=ENDS[0])
        assert grid_separates(relaxation, to_goal, *ENDS) == shut


def test_shipped_and_large_cells_are_proven() -> None:
    world = World.load(find_world("enclosed"))
    query = world.queries[0]
    relaxation = Relaxation(StateChecker(world, world.robot))
    ends = np.array([query.start, query.goal])
    assert grid_separates(relaxation, relaxation.costs_from(ends[1], target=ends[0]), *ends)
    # Cells larger than the robot: those inside the wall are covered by it.
    wide = World("wide", (0.0, 0.0, 60.0, 60.0), (Rectangle((30.0, 30.0), 2.0, 60.0),))
    ends = np.array([[5.0, 5.0, 0.0], [55.0, 5.0, 0.0]])
    relaxation = Relaxation(StateChecker(wide, Robot.disc(0.15)))
    assert relaxation.size > 0.2
    to_goal = relaxation.costs_from(ends[1], target=ends[0])
    assert np.isinf(to_goal.cost[:, : relaxation.columns // 2 - 1]).all()
    assert grid_separates(relaxation, to_goal, *ends)


def test_a_grid_that_has_lost_a_cell_proves_nothing() -> None:
    relaxation = Relaxation(StateChecker(WALL, ROBOTS[0]))
    to_goal = relaxation.costs_from(ENDS[1])
    columns = np.arange(relaxation.columns) * relaxation.size
    cost = to_goal.cost.copy()
    # As if the way above the wall were closed.
    cost[:, columns < 5.0] = np.inf
    assert not grid_separates(relaxation, CostMap(cost, to_goal.parent, np.inf), *ENDS)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_grid_that_closes_too_much_is_not_believed(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Relaxation, "_min_clearance", lambda self: 5.0 * self.radius)
    with pytest.warns(InternalErrorWarning, match="lower bound of inf"):
        result = LandmarkPlanner(WALL, robot, seed=0).plan(ENDS[0], ENDS[1], 0.5)
    assert result.status == "solved"
    # Where no path was found before, the grid is not believed either.
    planner = LandmarkPlanner(WALL, robot, seed=0, settings=PlannerSettings(without=("lattice",)))
    assert planner.plan(ENDS[0], ENDS[1], 0.5).status == "timeout"


@pytest.fixture(scope="module", params=ROBOTS)
def honest(request: pytest.FixtureRequest) -> tuple[Robot, float]:
    """A robot, and what a path costs it that no claim disturbed."""
    result = LandmarkPlanner(WALL, request.param, seed=0).plan(ENDS[0], ENDS[1], 20.0, max_iterations=3)
    assert result.path is not None
    return request.param, result.path.cost


@pytest.mark.slow
@pytest.mark.parametrize("bound", [1000.0, np.inf])
def test_a_bound_above_a_known_cost_is_reported_and_dropped(
    honest: tuple[Robot, float], bound: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, cost = honest
    monkeypatch.setattr(LowerBound, "of", lambda *_, **__: Bound(bound, np.empty((0, 2))))
    with pytest.warns(InternalErrorWarning, match="lower bound"):
        result = LandmarkPlanner(WALL, robot, seed=0).plan(ENDS[0], ENDS[1], 20.0, max_iterations=3)
    assert result.status == "solved"
    assert result.path is not None
    assert result.path.cost < 1.05 * cost
    assert result.lower_bound is not None
    assert result.lower_bound <= result.path.cost
    with pytest.warns(InternalErrorWarning, match="lower bound"):
        many = LandmarkPlanner(WALL, robot, seed=0).plan_many(ENDS[:1], ENDS[1:], 0.5)
    assert many[0].path is not None
    assert many[0].lower_bound is not None
    assert many[0].lower_bound <= many[0].path.cost


@pytest.mark.slow
def test_cells_that_are_wrongly_blocked_are_found_by_the_oracle(monkeypatch: pytest.MonkeyPatch) -> None:
    # Its way above the wall has 1 mm to spare.
    tight = World("tight", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 2.7495), 0.5, 5.499),))
    checker = StateChecker(tight, ROBOTS[1])
    assert not enclosed(checker, ENDS[0], ENDS[1], seconds=5.0)
    shut = StateChecker(SHUT, ROBOTS[1])
    assert enclosed(shut, ENDS[0], ENDS[1])

    def swollen(*arguments: Any) -> Any:
        return [1.3 * ring for ring in core(*arguments)]

    monkeypatch.setattr("trailmark.planning.proofs.enclosure.core", swollen)
    proof = enclosure(checker, ENDS[0], ENDS[1], seconds=20.0)
    assert proof is not None
    assert free_somewhere(tight, ROBOTS[1], proof.rim_centers, proof.rim_extents, proof.pivot)
