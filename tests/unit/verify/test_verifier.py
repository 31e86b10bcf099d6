"""The verifier at the planner's exit: it finds the paths that collide, by shapely's word, and lets the others pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import pytest
from numpy.typing import NDArray

from trailmark import Disc, InternalErrorWarning, LandmarkPlanner, Path, Polygon, Rectangle, Robot, World
from trailmark.planning import pipeline as solving
from trailmark.planning.query import Query
from trailmark.planning.result import PlanProgress, Status
from trailmark.proofs import LowerBound
from trailmark.verify import RIM, Verifier


def fault_of(world: World, robot: Robot, states: np.ndarray) -> str | None:
    path = Path(states)
    return Verifier(world, robot, RIM).fault(path, path.states[0], path.states[-1])


def test_what_lies_inside_is_found_without_an_edge_being_met() -> None:
    robot = Robot.rectangle(4.0, 4.0)
    inside = World("in", (0, 0, 20, 20), (Rectangle((10.0, 10.0), 0.1, 0.1),))
    assert fault_of(inside, robot, np.array([[10, 10, 0], [10.1, 10, 0]])) is not None
    within = World("out", (0, 0, 20, 20), (Rectangle((10.0, 10.0), 12.0, 12.0),))
    assert fault_of(within, robot, np.array([[10, 10, 0], [10.1, 10, 0]])) is not None
    assert fault_of(within, Robot.disc(1.0), np.array([[10, 10, 0], [10.1, 10, 0]])) is not None
    around = World("disc", (0, 0, 20, 20), (Disc((10.0, 10.0), 0.1),))
    assert fault_of(around, robot, np.array([[10, 10, 0], [10.1, 10, 0]])) is not None
    lake = World("lake", (0, 0, 20, 20), boundary=Polygon(np.array([[1, 1], [9, 1], [9, 9], [1, 9]])))
    assert fault_of(lake, robot, np.array([[15, 15, 0], [15.1, 15, 0]])) is not None
    assert fault_of(lake, robot, np.array([[5, 5, 0], [5.1, 5, 0]])) is None


def test_a_path_of_other_ends_is_refused() -> None:
    world, robot = World("w", (0, 0, 10, 10)), Robot.disc(0.5)
    path = Path(np.array([[1.0, 1, 0], [2, 2, 0]]))
    final = Verifier(world, robot, RIM)
    assert final.fault(path, np.array([1, 1, 0]), np.array([2, 2, 0])) is None
    assert "goal" in str(final.fault(path, np.array([1, 1, 0]), np.array([2, 2, 1e-9])))
    assert "start" in str(final.fault(path, np.array([1, 1.1, 0]), np.array([2, 2, 0])))


WALL = World("wall", (0, 0, 10, 4), (Rectangle((5.0, 1.0), 0.5, 2.0),))
START, GOAL = (1.0, 1.0, 0.0), (9.0, 1.0, 0.0)


def test_a_wrong_path_is_reported_and_planning_goes_on(
    monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath, capsys: pytest.CaptureFixture[str]
) -> None:
    """The search is made to return a path through the wall at first: nobody gets to see it."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    right = solving.solve
    wrong: list[bool] = []

    def solve(query: Query, bound: LowerBound | None, known: NDArray[np.float64] | None = None) -> Status:
        if not wrong:
            wrong.append(True)
            query.offer(np.array([START, GOAL]))
            return "solved"
        return right(query, bound, known)

    planner = LandmarkPlanner(WALL, Robot.disc(0.4), seed=0)
    monkeypatch.setattr("trailmark.planning.pipeline.solve", solve)
    seen: list[PlanProgress] = []
    with pytest.warns(InternalErrorWarning, match="not free"):
        result = planner.plan(START, GOAL, time_limit=20.0, max_iterations=1, on_progress=seen.append)
    assert result.status == "solved"
    assert result.path is not None
    assert Verifier(WALL, Robot.disc(0.4), RIM).fault(result.path, *np.array([START, GOAL])) is None
    assert all(p.path is None or p.path.length > 8.1 for p in seen)
    (file,) = tmp_path.glob("trailmark-internal-error-*.yaml")
    again = World.load(file)
    assert again.obstacles == WALL.obstacles
    assert again.query("failed").goal == GOAL


@pytest.mark.slow
def test_a_path_that_is_wrong_whatever_is_tried_is_no_path(monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath) -> None:
    from trailmark.planning.batch import BatchSolver

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    straight = np.array([START, GOAL])

    def solve(query: Query, bound: LowerBound | None, known: NDArray[np.float64] | None = None) -> Status:
        query.offer(straight)
        return "solved"

    planner = LandmarkPlanner(WALL, Robot.disc(0.4), seed=0)
    monkeypatch.setattr("trailmark.planning.pipeline.solve", solve)
    answer = BatchSolver.answer

    def wrong(self: BatchSolver, *arguments: object) -> object:
        found = answer(self, *arguments)  # type: ignore[arg-type]  # handed on as they came
        found.states = straight
        return found

    monkeypatch.setattr(BatchSolver, "answer", wrong)
    with pytest.warns(InternalErrorWarning):
        result = planner.plan(START, GOAL, time_limit=0.3)
    assert (result.status, result.path) == ("timeout", None)
    with pytest.warns(InternalErrorWarning):
        (result,) = planner.plan_many([START], [GOAL], time_limit=0.3)
    assert (result.status, result.path) == ("timeout", None)


@pytest.mark.slow
@pytest.mark.parametrize("robot", [Robot.disc(0.4), Robot.rectangle(0.9, 0.5)])
def test_verdicts_in_a_grid_map_are_those_of_the_polygons_of_its_cells(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    world = World.from_grid(rng.random((20, 20)) < 0.05, 1.0)
    mine, theirs = Verifier(world, robot, RIM), Verifier(replace(world, obstacles=tuple(world.obstacles)), robot, RIM)
    free = 0
    for _ in range(300):
        a, b = np.column_stack([rng.uniform(1.0, 19.0, (2, 2)), rng.uniform(-3.0, 3.0, 2)])
        path = Path(np.array([a, a + 0.3 * (b - a)]))
        verdicts = [check.fault(path, path.states[0], path.states[1]) for check in (mine, theirs)]
        assert (verdicts[0] is None) == (verdicts[1] is None)
        free += verdicts[0] is None
    assert 30 < free < 270
