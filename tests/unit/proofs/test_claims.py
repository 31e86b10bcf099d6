"""Claims that are wrong never leave the planner: they are reported, and planning goes on without."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.helpers.oracles import free_somewhere
from tests.helpers.trials import few
from tests.helpers.worlds import random_world

from trailmark import Disc, InternalErrorWarning, Rectangle, Robot, StateChecker, World
from trailmark.landmarks import Relaxation
from trailmark.landmarks.relaxation import CostMap
from trailmark.planning import LandmarkPlanner, PlannerSettings
from trailmark.proofs import LowerBound, enclosed
from trailmark.proofs.bound import Bound
from trailmark.proofs.claims import CERTAIN, Separation, grid_separates
from trailmark.proofs.enclosure import core, enclosure

WALL = World("wall", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 2.0), 0.5, 4.0), Disc((2.0, 5.0), 0.3)))
"""A way round the wall's upper end, 2 m wide."""

SHUT = World("shut", (0.0, 0.0, 10.0, 6.0), (Rectangle((5.0, 3.0), 0.5, 6.2, 0.1),))
ENDS = np.array([[1.0, 1.0, 0.0], [9.0, 1.0, 1.0]])
ROBOTS = (Robot.disc(0.3), Robot.rectangle(0.7, 0.5))


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("fineness", [0, 1])
def test_the_grid_is_proven_where_it_separates(robot: Robot, fineness: int) -> None:
    for world, shut in ((SHUT, True), (WALL, False)):
        relaxation = Relaxation(StateChecker(world, robot), fineness)
        to_goal = relaxation.costs_from(ENDS[1], target=ENDS[0])
        assert grid_separates(relaxation, to_goal, *ENDS) == shut


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


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("bound", [1000.0, np.inf])
def test_a_bound_above_a_known_cost_is_reported_and_dropped(
    robot: Robot, bound: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LowerBound, "of", lambda *_, **__: Bound(bound, np.empty((0, 2))))
    monkeypatch.setattr(LowerBound, "ready", True)
    planner = LandmarkPlanner(WALL, robot, seed=0)
    with pytest.warns(InternalErrorWarning, match="lower bound"):
        alone = planner.plan(ENDS[0], ENDS[1], 20.0, max_iterations=3)
    with pytest.warns(InternalErrorWarning, match="lower bound"):
        (many,) = LandmarkPlanner(WALL, robot, seed=0).plan_many(ENDS[:1], ENDS[1:], 0.5)
    for result in (alone, many):
        assert result.lower_bound <= result.path.cost


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

    monkeypatch.setattr("trailmark.proofs.enclosure.core", swollen)
    proof = enclosure(checker, ENDS[0], ENDS[1], seconds=20.0)
    assert free_somewhere(tight, ROBOTS[1], proof.rim_centers, proof.rim_extents, proof.pivot)


def clearance(world: World, points: np.ndarray) -> np.ndarray:
    """Distance of points (n, 2) to outlines, bounds and discs; 0 inside of discs."""
    xmin, ymin, xmax, ymax = world.bounds
    lines = [shapely.box(xmin, ymin, xmax, ymax).exterior]
    lines += [] if world.boundary is None else [world.boundary.shapely().exterior]
    for shape in world.obstacles:
        if not isinstance(shape, Disc):
            lines += list(shapely.get_rings(shape.polygon().shapely()))
    outlines = shapely.union_all(lines)
    shapely.prepare(outlines)
    found = shapely.distance(outlines, shapely.points(points))
    for shape in world.obstacles:
        if isinstance(shape, Disc):
            off = np.hypot(*(points - shape.center).T) - shape.radius
            found = np.minimum(found, np.maximum(0.0, off))
    return np.asarray(found)


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.05, 0.4, 1.5]), st.sampled_from([0.0, 1e6]))
@settings(max_examples=few(15), deadline=None)
def test_nowhere_on_what_blocks_is_the_disc_free(seed: int, radius: float, offset: float) -> None:
    world = random_world(
        seed, 15, size=12.0, radii=(0.3, 2.0), discs=0.4, holes=0.3, boundary=seed % 2 == 0, origin=(offset, offset)
    )
    rng = np.random.default_rng(seed)
    starts = rng.uniform(0.0, 12.0, (150, 2)) + offset
    edges = np.stack([starts, starts + rng.normal(0.0, rng.choice([0.1, 1.0]), (150, 2))], axis=1)
    squares = starts[:, None] + rng.uniform(0.01, 0.5) * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    separation = Separation(world, radius)
    # On edges of up to 4 m: clearance differs by 1 cm at most from one to the next.
    share = np.linspace(0.0, 1.0, 200)[:, None]
    lines = edges[:, :1] + share * (edges[:, 1:] - edges[:, :1])
    nearest = clearance(world, lines.reshape(-1, 2)).reshape(len(edges), -1).max(axis=1)
    found = separation.edges_block(edges)
    assert (nearest[found] < radius - 0.5 * CERTAIN).all()
    # And most that block are known: sampled densely, so that hardly any place is missed.
    assert found[nearest < 0.98 * radius - 0.02].all()
    u, v = np.meshgrid(share[::13, 0], share[::13, 0])
    inside = squares[:, 0][:, None] + np.stack([u, v], axis=-1).reshape(-1, 2) * (squares[0, 2] - squares[0, 0])
    worst = clearance(world, inside[:40].reshape(-1, 2)).reshape(40, -1).max(axis=1)
    assert (worst[separation.cells_block(squares)[:40]] < radius - 0.5 * CERTAIN).all()
