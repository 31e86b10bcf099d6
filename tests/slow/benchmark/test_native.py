"""The native program: the problems that it reads, and its answers against trailmark's and shapely's."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from benchmarks.native import peer
from benchmarks.native.peer import (
    NativeError,
    native_planners,
    native_program,
    native_versions,
    problem_text,
    run_native,
)
from numpy.typing import NDArray
from tests.helpers.oracles import Oracle
from tests.helpers.trials import few

from trailmark import Disc, Polygon, Query, Rectangle, Robot, StateChecker, World
from trailmark.benchmark.problems import Problem
from trailmark.benchmark.record import RunRecord, Status
from trailmark.benchmark.referee import Referee
from trailmark.trajectories.path import Path as StatePath

built = pytest.mark.skipif(
    native_program() is None, reason="native program not built (see benchmarks/native/README.md)"
)

STATES = few(20_000)

RESOLUTION = 0.02

ROOM = World(
    "room",
    (0.0, 0.0, 10.0, 6.0),
    (Rectangle((3.0, 2.0), 1.0, 4.0), Disc((6.5, 4.5), 1.0), Polygon(np.array([[6.0, 0.0], [7.0, 0.0], [6.5, 2.0]]))),
    Robot.rectangle(0.6, 0.4),
    queries=(Query("across", (1.0, 1.0, 0.0), (9.0, 1.0, np.pi)),),
)

JOB: Any = {"text": "", "seed": 3, "time_limit": 0.3, "memory_limit": 500.0, "resolution": RESOLUTION}


def native_valid(
    world: World, robot: Robot, states: NDArray[np.float64], folder: Path, *more: str
) -> NDArray[np.bool_]:
    """Return the program's verdicts on configurations, shape (n, 3)."""
    rows = folder / "states.txt"
    np.savetxt(rows, states, fmt="%.17g")
    query = Query("none", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    program = str(native_program())
    text = problem_text(world, robot, query)
    done = subprocess.run([program, "check", str(rows), *more], input=text, capture_output=True, text=True, check=True)
    verdicts: NDArray[np.bool_] = np.array(list(json.loads(done.stdout)["valid"])) == "1"
    assert verdicts.shape == (len(states),)
    return verdicts


def random_states(world: World, seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    low, high = np.array([*world.bounds[:2], -np.pi]), np.array([*world.bounds[2:], np.pi])
    # A little over the bounds too.
    return rng.uniform(low - 0.1, high + 0.1, (STATES, 3))


def native_motions(world: World, robot: Robot, states: NDArray[np.float64], folder: Path) -> dict[str, Any]:
    """Return what the program says of configurations' clearances, and of the motions whose ends they are by turns."""
    rows = folder / "ends.txt"
    np.savetxt(rows, states, fmt="%.17g")
    query = Query("none", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    command, text = [str(native_program()), "certify", str(rows)], problem_text(world, robot, query)
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=True)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


def hook_of(r: float) -> Robot:
    """Return a hook away from its reference point, of about the size ``r`` (metres)."""
    return Robot.polygon(np.array([[0.3, -0.2], [1.5, -0.2], [1.5, 1.0], [1.1, 1.0], [1.1, 0.2], [0.3, 0.2]]) * r)


def ends_of_motions(world: World, robot: Robot) -> NDArray[np.float64]:
    """Return the ends of motions between free configurations by turns, shape (2 n, 3); all lengths, many turns."""
    rng = np.random.default_rng(3)
    q = random_states(world, seed=11)
    q = q[StateChecker(world, robot).valid(q)][: few(250)]
    other = q + rng.normal(size=q.shape) * 10.0 ** rng.uniform(-1.5, 1.0, (len(q), 1))
    other[:, 2] = np.remainder(other[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return np.stack([q, other], axis=1).reshape(-1, 3)


def assert_same_answers(world: World, robot: Robot, folder: Path) -> None:
    q = random_states(world, seed=len(world.obstacles))
    theirs, ours = native_valid(world, robot, q, folder), StateChecker(world, robot).valid(q)
    assert 0.05 < ours.mean() < 0.95
    differ = theirs != ours
    # Where the two differ, shapely must find the robot within 1e-6 m of touching: there both are right.
    assert differ.mean() < 1e-3
    assert not Oracle(world, robot).disagrees(q[differ], theirs[differ]).any()


@built
@pytest.mark.parametrize("name", ["office", "clutter", "maze", "narrow", "discs", "environment1", "lake"])
def test_checker_answers_as_trailmarks_does(name: str, worlds: Path, tmp_path: Path) -> None:
    world = World.load(worlds / f"{name}.yaml")
    assert world.robot is not None
    assert_same_answers(world, world.robot, tmp_path)
    if name in ("office", "discs", "environment1"):  # a polygon off its reference point
        assert_same_answers(world, hook_of(world.robot.circumradius), tmp_path)


@built
@pytest.mark.parametrize("name", ["Maze", "RandomPolygons"])
def test_checker_answers_on_ompl_apps_problems(name: str, shared_data: Path, tmp_path: Path) -> None:
    world = World.load(shared_data / "omplapp" / f"{name}_planar.cfg")
    assert world.robot is not None
    assert_same_answers(world, world.robot, tmp_path)


@built
def test_touching_is_allowed_and_the_inside_of_obstacles_is_not_free(tmp_path: Path) -> None:
    world = World("wall", (0.0, 0.0, 4.0, 4.0), (Rectangle((3.0, 2.0), 1.0, 4.0),))
    robot = Robot.rectangle(0.6, 0.4)
    q = np.array(
        [
            [0.3, 0.2, 0.0],  # in the corner of the bounds, on both
            [0.2, 0.3, np.pi / 2],
            [2.2, 2.0, 0.0],  # against the wall
            [2.2 + 1e-5, 2.0, 0.0],
            [0.3 - 1e-5, 2.0, 0.0],
            [3.0, 2.0, 0.7],  # wholly inside the wall
            [9.0, 2.0, 0.0],  # far outside
            [-1e9, 1e9, 0.0],
        ]
    )
    assert native_valid(world, robot, q, tmp_path).tolist() == [True] * 3 + [False] * 5


@built
@pytest.mark.parametrize("name", native_planners() or ["none"])
def test_paths_and_figures_of_every_planner(name: str) -> None:
    record = RunRecord.from_json(run_native(Problem(ROOM), JOB | {"planner": name, "time_limit": 0.2}))
    assert record.status in (Status.EXACT_SOLUTION, Status.APPROXIMATE_SOLUTION, Status.TIMEOUT)
    assert record.seed == 3
    assert record.time > 0.0
    assert record.states_checked
    assert record.motions_checked
    assert record.graph_states
    assert record.memory >= 0.0
    assert record.solved, "an open room takes every planner a few milliseconds"
    # A discrete validator looks at states that are so near to one another that no point of the robot between them is
    # farther than the resolution from where it was seen free: of a robot less that much, all of the path is right.
    small = Robot.rectangle(0.6 - 2.0 * RESOLUTION, 0.4 - 2.0 * RESOLUTION)
    referee, (query,) = Referee(ROOM, small), ROOM.queries
    assert record.path is not None
    assert record.simplified_path is not None
    assert referee.fault(record.path, query.start, query.goal) is None
    assert referee.fault(record.simplified_path, query.start, query.goal) is None
    assert record.solution_length == pytest.approx(StatePath(np.array(record.path)).cost)
    assert record.simplified_solution_length == pytest.approx(StatePath(np.array(record.simplified_path)).cost)
    times, costs = np.array(record.curve).T
    assert (np.diff(times) >= 0.0).all()
    assert (np.diff(costs) < 0.0).all()
    assert (times[0], costs[0]) == (record.time_to_first_solution, record.first_solution_length)
    assert costs[-1] == pytest.approx(record.solution_length, rel=1e-5)


@built
@pytest.mark.parametrize(
    ("name", "reverse"), [("RRTConnect", True), ("RRTstar", False), ("RRTConnect+certified", True)]
)
def test_cars_drive_the_curves_that_were_checked(name: str, reverse: bool) -> None:
    # The referee takes long over paths of many states; certified motions know no resolution.
    resolution = 0.0 if name.endswith("certified") else 2.0 * RESOLUTION
    problem = Problem(ROOM.with_robot(Robot.rectangle(0.6, 0.4).steered(0.5, reverse)))
    job = JOB | {"planner": f"native:{name}", "time_limit": 0.5, "resolution": resolution or 5.0}
    record = RunRecord.from_json(run_native(problem, job))
    assert record.solved, "an open room takes every planner a few milliseconds"
    small = Robot.rectangle(0.6 - 2.5 * resolution, 0.4 - 2.5 * resolution).steered(0.5, reverse)
    referee, (query,) = Referee(ROOM, small), ROOM.queries
    for states, cost in (
        (record.path, record.solution_length),
        (record.simplified_path, record.simplified_solution_length),
    ):
        assert states is not None
        assert referee.fault(states, query.start, query.goal) is None
        assert cost == pytest.approx(problem.path(states).cost, rel=1e-3)


@built
@pytest.mark.parametrize("name", ["office", "clutter", "discs", "environment1", "lake"])
def test_clearances_are_never_more_than_they_are(name: str, worlds: Path, tmp_path: Path) -> None:
    world = World.load(worlds / f"{name}.yaml")
    for robot in (world.robot, Robot.disc(world.robot.inscribed_disc.radius), hook_of(world.robot.circumradius)):
        q = random_states(world, seed=7)[: few(600)]
        clearances = np.array(native_motions(world, robot, q, tmp_path)["clearances"])
        true = Oracle(world, robot).clearance(q)
        assert (clearances <= true + 1e-6).all()
        # What is free is seen to be free.
        assert (clearances[true > 1e-6] > 0.0).all()


@built
@pytest.mark.parametrize(
    ("name", "shape"),
    [
        *(("office", "own"), ("office", "thin"), ("discs", "own"), ("discs", "thin")),
        *(("lake", "hook"), ("lake", "disc"), ("environment1", "own"), ("environment1", "hook")),
    ],
)
def test_certified_motions_collide_nowhere(name: str, shape: str, worlds: Path, tmp_path: Path) -> None:
    world = World.load(worlds / f"{name}.yaml")
    r = world.robot.circumradius
    robots = {"own": world.robot, "thin": Robot.rectangle(2.0 * r, 0.02), "hook": hook_of(r), "disc": Robot.disc(r / 2)}
    ends = ends_of_motions(world, robots[shape])
    free = np.array(list(native_motions(world, robots[shape], ends, tmp_path)["free"])) == "1"
    referee = Referee(world, robots[shape])
    # Each end is itself a state of the path: goals are compared with it.
    truly = [referee.fault(pair.tolist(), pair[0], pair[1]) is None for pair in ends.reshape(-1, 2, 3)]
    assert not (free & ~np.array(truly)).any()
    assert (free != truly).sum() <= 0.02 * len(free), "only what comes near to touching is refused"
    assert 0.05 < free.mean() < 0.97


@built
def test_certified_motions_see_what_lies_between_any_two_states(tmp_path: Path) -> None:
    # A wire as thin as can be said, anywhere across the way: no resolution finds it, a bisection of clearances does.
    rng = np.random.default_rng(1)
    for _ in range(8):
        x, width = rng.uniform(1.0, 9.0), 10.0 ** rng.uniform(-9.0, -3.0)
        world = World("wire", (0.0, 0.0, 10.0, 6.0), (Rectangle((x, 3.0), width, 6.0),))
        ends = np.array([[x - 0.6, 3.0, 0.3], [x + 0.6, 3.1, 0.3], [x - 0.6, 1.0, 0.3], [x - 0.5, 5.0, 0.3]])
        ends[:, 0] = np.clip(ends[:, 0], 0.5, 9.5)
        free = native_motions(world, Robot.rectangle(0.2, 0.1), ends, tmp_path)["free"]
        assert free == "01"


@built
def test_the_same_seed_gives_the_same_path_and_an_invalid_start_is_a_result() -> None:
    runs = [run_native(Problem(ROOM), JOB | {"planner": "native:RRTConnect", "seed": seed}) for seed in (0, 0, 1)]
    assert runs[0]["path"] == runs[1]["path"] != runs[2]["path"]
    assert all(version[0].isdigit() for version in native_versions().values())
    with pytest.raises(NativeError, match="did you mean 'native:PRMstar'"):
        run_native(Problem(ROOM), JOB | {"planner": "native:PRMstars"})
    world = replace(ROOM, queries=(Query("inside", (3.0, 2.0, 0.0), (9.0, 1.0, 0.0)),))
    record = RunRecord.from_json(run_native(Problem(world), JOB | {"planner": "native:RRTConnect"}))
    assert (record.status, record.solved, record.path) == (Status.INVALID_START, False, None)


@built
def test_the_memory_limit_ends_a_run_and_is_a_result() -> None:
    # LazyPRM* joins many pairs of states; it may take what the program sets aside for a second thread, and no more.
    job = JOB | {"planner": "native:LazyPRMstar", "time_limit": 20.0, "memory_limit": 1e-3}
    open_field = World("field", (0.0, 0.0, 10.0, 10.0), (), Robot.disc(0.1), queries=ROOM.queries)
    answer = run_native(Problem(open_field), job)
    assert answer["status"] == Status.ABORT
    assert "out of memory" in answer["failure"]


@built
@pytest.mark.parametrize(
    ("arguments", "text", "message"),
    [
        (["plan", "PRM"], "{}", "problem: "),
        (["plan", "PRM"], "\n[", "problem: "),
        (["plan", "PRM"], '{"trailmark_native": 9}', "version 9 given, allowed: 2"),
        (["plan", "XYZ"], None, "planner 'XYZ' given, allowed: AITstar"),
        (["plan", "PRM", "--seed", "0"], None, "--seed 0 given"),
        (["plan", "PRM", "--time-limit"], None, "--time-limit given without a value"),
        (["plan", "PRM", "--parameter", "a"], None, "--parameter a given, allowed: NAME=VALUE"),
        (["plan", "RRTConnect", "--parameter", "range=x"], None, "parameter range=x given, allowed: a name and a"),
        (["plan", "PRM", "--speed", "1"], None, "--speed 1 given, allowed: --resolution"),
        (["check", "/no/such/file"], None, "cannot be read"),
        ([], None, "arguments: allowed are planners"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], text: str | None, message: str) -> None:
    assert ROOM.robot is not None
    given = problem_text(ROOM, ROOM.robot, ROOM.queries[0]) if text is None else text
    done = subprocess.run([str(native_program()), *arguments], input=given, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    """Make a shell script the native program: it knows one planner and does ``body`` when it is to plan."""
    script = folder / "program"
    names = '{"planners": ["PRM"], "parameters": {}, "ompl": "1", "fcl": "2"}'
    script.write_text(
        f"#!/bin/sh\nif [ \"$1\" = planners ]; then echo '{names}'; exit 0; fi\ncat > /dev/null\n{body}\n"
    )
    script.chmod(0o755)
    monkeypatch.setenv(peer.VARIABLE, str(script))


@pytest.mark.parametrize(
    ("body", "status", "failure"),
    [
        ("echo oh >&2; kill -SEGV $$", Status.CRASH, "SIGSEGV oh"),
        ("echo what: std::bad_alloc >&2; kill -ABRT $$", Status.ABORT, "out of memory: SIGABRT"),
        ("exec sleep 60", Status.TIMEOUT, "did not end by itself: killed after"),
    ],
)
def test_a_program_that_dies_or_hangs_is_a_result(
    body: str, status: Status, failure: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(peer, "GRACE", (0.2, 0.0))
    stand_in(tmp_path, monkeypatch, body)
    record = RunRecord.from_json(run_native(Problem(ROOM), JOB | {"planner": "native:PRM"}))
    assert record.status == status
    assert record.failure is not None
    assert failure in record.failure
    assert not record.solved
    stand_in(tmp_path, monkeypatch, "echo what is this >&2; exit 2")
    with pytest.raises(NativeError, match=r"program: what is this"):
        run_native(Problem(ROOM), JOB | {"planner": "native:PRM"})


def test_where_it_is_not_built_it_has_no_planners_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(peer.VARIABLE, str(tmp_path / "nowhere"))
    assert native_planners() == []
    assert native_versions() == {}
    with pytest.raises(NativeError, match=r"TRAILMARK_NATIVE names .*README.md says how it is built"):
        run_native(Problem(ROOM), JOB | {"planner": "native:PRM"})


QUERY = Query("q", (1.0, 2.0, 0.5), (3.0, 4.0, np.pi))

FRAME = Polygon(
    np.array([[1.0, 1.0], [5.0, 1.0], [5.0, 5.0], [1.0, 5.0]]),
    (np.array([[2.0, 2.0], [4.0, 2.0], [4.0, 4.0], [2.0, 4.0]]),),
)


def exported(world: World, robot: Robot) -> dict[str, Any]:
    problem: dict[str, Any] = json.loads(problem_text(world, robot, QUERY))
    return problem


def region(rows: list[list[float]]) -> shapely.Geometry:
    return shapely.union_all(shapely.polygons(np.array(rows).reshape(-1, 3, 2)))


def test_triangles_fill_the_polygons_and_discs_stay_discs() -> None:
    obstacles = (FRAME, Rectangle((8.0, 3.0), 2.0, 1.0, 0.4), Disc((7.0, 8.0), 0.5))
    problem = exported(World("w", (0.0, 0.0, 10.0, 10.0), obstacles), Robot.disc(0.3))
    whole = shapely.union_all([FRAME.shapely(), obstacles[1].polygon().shapely()])
    assert region(problem["triangles"]).symmetric_difference(whole).area < 1e-12
    assert problem["discs"] == [[7.0, 8.0, 0.5]]
    assert problem["bounds"] == [0.0, 0.0, 10.0, 10.0]
    assert (problem["start"], problem["goal"]) == (list(QUERY.start), list(QUERY.goal))


def test_outside_the_boundary_is_an_obstacle_to_beyond_the_bounds() -> None:
    boundary = Polygon(np.array([[0.0, 0.0], [9.0, 1.0], [6.0, 8.0]]))
    problem = exported(World("w", (0.0, 0.0, 9.0, 9.0), (), None, boundary), Robot.disc(0.3))
    outside = shapely.box(-1.0, -1.0, 10.0, 10.0).difference(boundary.shapely())
    assert region(problem["triangles"]).symmetric_difference(outside).area < 1e-12
    problem = exported(World("w", (0.0, 0.0, 9.0, 9.0)), Robot.disc(0.3))
    assert problem["triangles"] == problem["discs"] == []


@pytest.mark.parametrize(
    "robot",
    [
        Robot.rectangle(0.6, 0.4),
        Robot.polygon([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.5, 2.0], [1.5, 0.5], [0.0, 0.5]]),
    ],
)
def test_the_robot_is_smaller_by_less_than_touching(robot: Robot) -> None:
    entry = exported(World("w", (0.0, 0.0, 9.0, 9.0)), robot)["robot"]
    filled, outline = region(entry["triangles"]), robot.outline.shapely()
    assert outline.contains(filled)
    assert shapely.hausdorff_distance(outline, filled) < 1.01e-7
    assert shapely.Polygon(entry["hull"]).equals(outline.convex_hull)
    x, y, radius = entry["inscribed"]
    assert filled.buffer(1e-9).contains(shapely.Point(x, y).buffer(radius))
    assert entry["circumradius"] == pytest.approx(np.hypot(*robot.outline.vertices.T).max())


def test_a_round_robot_is_a_radius_of_which_something_is_left() -> None:
    world = World("w", (0.0, 0.0, 9.0, 9.0))
    assert exported(world, Robot.disc(0.3))["robot"]["radius"] == pytest.approx(0.3 - 1e-7, abs=1e-12)
    assert exported(world, Robot.disc(1e-7))["robot"]["radius"] == pytest.approx(5e-8)
    assert exported(world, Robot.disc(0.3))["robot"]["circumradius"] == 0.3
