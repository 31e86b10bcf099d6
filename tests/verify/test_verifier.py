"""The verifier at the planner's exit: it finds the paths that collide, by shapely's word, and lets the others pass."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path as FilePath

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from tests.helpers.random_worlds import ROBOTS, random_world
from tests.support.trials import few, trials

from trailmark import CurvePath, Disc, LandmarkPlanner, Path, Polygon, Robot, Steering, World, se2
from trailmark.errors import InternalErrorWarning
from trailmark.planning import pipeline as solving
from trailmark.planning.proofs import LowerBound
from trailmark.planning.query import Query
from trailmark.planning.result import PlanProgress, Status
from trailmark.shapes import Rectangle
from trailmark.verify import RIM, Verifier

KINDS = ["disc", "rectangle", "L", "thin"]


@cache
def obstacles_of(world: World) -> tuple[shapely.Geometry, shapely.STRtree]:
    """Return all that blocks and its parts, discs as polygons that lie within them by up to 1e-4 of their radius."""
    shapes = [
        shapely.Point(s.center).buffer(s.radius, quad_segs=64) if isinstance(s, Disc) else s.polygon().shapely()
        for s in world.obstacles
    ]
    xmin, ymin, xmax, ymax = world.bounds
    frame = shapely.box(xmin - 99, ymin - 99, xmax + 99, ymax + 99)
    shapes.append(shapely.difference(frame, shapely.box(*world.bounds)))
    if world.boundary is not None:
        shapes.append(shapely.difference(shapely.box(*world.bounds), world.boundary.shapely()))
    blocked = shapely.union_all(shapes)
    shapely.prepare(blocked)
    return blocked, shapely.STRtree(shapely.get_parts(blocked))


def is_deep(world: World, robot: Robot, states: np.ndarray, depth: float) -> bool:
    """Return whether the robot reaches farther into obstacles (metres) than that at any state."""
    blocked, parts = obstacles_of(world)
    if isinstance(robot.footprint, Disc):
        return bool((robot.footprint.radius - shapely.distance(shapely.points(states[:, :2]), blocked)).max() > depth)
    bodies = shapely.polygons(se2.transform(states, robot.outline.vertices))
    # The parts are apart: no disc lies in two of them.
    body, part = parts.query(bodies, predicate="intersects")
    overlaps = shapely.intersection(parts.geometries[part], bodies[body])
    areas = shapely.area(overlaps)
    # At least the radius of the largest disc in the overlap; the largest overlaps first.
    largest = overlaps[np.argsort(-areas)[: np.count_nonzero(areas)]]
    return any(shapely.length(shapely.maximum_inscribed_circle(overlap)) > depth for overlap in largest)


def fault_of(world: World, robot: Robot, states: np.ndarray) -> str | None:
    path = Path(states)
    return Verifier(world, robot, RIM).fault(path, path.states[0], path.states[-1])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_random_motions_agree_with_dense_sampling(kind: str, offset: float) -> None:
    robot = ROBOTS[kind]
    origin = (offset, -offset)
    world = random_world(5, 25, size=30.0, radii=(0.3, 2.0), discs=0.3, holes=0.4, boundary=True, origin=origin)
    rng = np.random.default_rng(2)
    faulty = free = 0
    final = Verifier(world, robot, RIM)
    for _ in trials(40, of=2):
        states = np.empty((2, 3))
        states[0] = *rng.uniform(3, 27, 2), rng.uniform(-np.pi, np.pi)
        states[1] = states[0] + rng.normal(0, (2, 2, 1.5))
        states[:, :2] += origin
        path = Path(states)
        deep = is_deep(world, robot, path.resample(0.02).states, 1e-3)
        fault = final.fault(path, path.states[0], path.states[-1])
        # Discs are polygons here; what overlaps by less is left open.
        if deep:
            assert fault is not None
            faulty += 1
        elif fault is None:
            free += 1
        else:
            # Sampling may have missed a corner, by less than a corner of 45 degrees moves between two samples.
            assert is_deep(world, robot, path.resample(2e-4).states, 0.0)
    assert faulty > few(10, of=2)
    assert free > few(5, of=2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("depth", [3e-6, 1e-5, 1e-3, 0.1])
def test_an_obstacle_pushed_into_a_path_is_found(kind: str, depth: float) -> None:
    """Grazing from all sides: a disc is put beside a swept path and pushed in by a little more than the rim."""
    robot = ROBOTS[kind]
    rng = np.random.default_rng(3)
    for _ in trials(6):
        states = np.array([[10, 10, rng.uniform(-3, 3)], [*rng.uniform(11, 15, 2), rng.uniform(-3, 3)]])
        path = Path(states)
        fine = path.resample(1e-3).states
        if isinstance(robot.footprint, Disc):
            reach, bodies = robot.footprint.radius, shapely.points(fine[:, :2])
        else:
            reach, bodies = 0.0, shapely.polygons(se2.transform(fine, robot.outline.vertices))
        at = path.at(0.5)[:2] + 8.0 * np.array([np.cos(a := rng.uniform(-3, 3)), np.sin(a)])
        gap = float(shapely.distance(shapely.Point(at), bodies).min()) - reach
        for radius, expected in ((gap - depth, False), (gap + depth + 2 * RIM, True)):
            world = World("graze", (-20, -20, 40, 40), (Disc((float(at[0]), float(at[1])), radius),))
            assert (fault_of(world, robot, states) is not None) == expected


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


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [True, False])
def test_curves_agree_with_dense_sampling(reverse: bool) -> None:
    world = random_world(7, 20, size=30.0, radii=(0.3, 1.5), discs=0.3, holes=0.0, boundary=False)
    robot = Robot.rectangle(2.0, 1.0).steered(2.0, reverse)
    final, steering = Verifier(world, robot, RIM), Steering(2.0, reverse)
    rng = np.random.default_rng(4)
    faulty = free = 0
    for _ in trials(50):
        knots = np.column_stack([rng.uniform(3, 27, (3, 2)), rng.uniform(-3, 3, 3)])
        knots[1:, :2] = knots[0, :2] + rng.normal(0, 2, (2, 2))
        path = CurvePath(knots, steering)
        deep = is_deep(world, robot, path.resample(0.02).states, 1e-3)
        fault = final.fault(path, path.states[0], path.states[-1])
        if deep:
            assert fault is not None
            faulty += 1
        elif fault is None:
            free += 1
        else:
            assert is_deep(world, robot, path.resample(2e-4).states, 0.0)
    assert faulty > few(10)
    assert free > few(5)


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
