"""One run, in the process forked for it: plan, report the result, then measure what was built.

The answer goes out in parts, each with fields of :class:`~trailmark.benchmark.record.RunRecord`, so that a crash in a
later part (counting the graph, simplifying the path) does not take the planning's result with it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import suppress
from pathlib import Path as FilePath
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from trailmark import se2
from trailmark.benchmark.planners import PlannerName, load_function, method_settings, native_peer
from trailmark.benchmark.problems import Job, read_problem
from trailmark.benchmark.record import Status
from trailmark.benchmark.referee import Referee
from trailmark.collision import StateChecker
from trailmark.motion import kind_of
from trailmark.motion.pointwise import CurveMarks, PointwiseChecker
from trailmark.planning.settings import METHODS
from trailmark.planning.warmup import warm_up
from trailmark.trajectories import CurvePath, Path
from trailmark.world import Robot, World

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from trailmark.ompl_bridge.problem import SE2Problem
    from trailmark.planning import LandmarkPlanner

__all__ = ["PREPARING", "WAIT", "Prepared", "answers", "load_all"]

GRACE = (0.02, 0.05)
"""Seconds, and share of the time limit (the larger counts), after which a solution comes too late for any planner."""

SETTLING = 0.02
"""Seconds of planning that no clock measures, before that which is measured; native programs get the same."""

SEED_OFFSET = 1_000_000_007
"""Between the seed of a run and that of settling in."""

SIMPLIFY_LIMIT = 0.5
"""Seconds that the simplifier gets at most."""

PREPARING = 60.0
"""Seconds that a planner of the user's gets to prepare at most: on first use it may have to be compiled."""

WAIT = "wait"
"""In a part of the answer that tells nothing else: seconds that come before those of the run, from then on."""

Answer = dict[str, Any]
Graph = Callable[[], tuple[int, int]]

_LANDMARK = {"solved": Status.EXACT_SOLUTION, "timeout": Status.TIMEOUT, "infeasible": Status.INFEASIBLE}


class Prepared:
    """A problem with all that does not count as a planner's own time: it is read, its checker built, kernels loaded.

    Args:
        text: as in :class:`trailmark.benchmark.problems.Job`.

    Attributes:
        problem: world, robot and query.
        ends: start and goal, each of shape (3,).
        checker: the one that every planner gets.
        setup_time: seconds for reading and for building the checker.
    """

    def __init__(self, text: str) -> None:
        begin = perf_counter()
        self.problem = read_problem(text)
        read = perf_counter() - begin
        # Compiled or loaded from the cache for this kind of motion: no planner's time.
        warm_up(kind_of(self.problem.robot))
        begin = perf_counter()
        self.checker = StateChecker(self.problem.world, self.problem.robot)
        self.setup_time = read + perf_counter() - begin
        if self.problem.steering is not None:
            # They compile what OMPL's simplifier asks of a car's curves: a process whose time is up would never finish.
            CurveMarks(PointwiseChecker(self.checker, self.problem.steering))
        query = self.problem.query
        start, goal = se2.configurations([query.start, query.pose()])
        self.ends = start, goal
        self._referee = Referee(self.problem.world, self.problem.robot)

    def judged(self, answer: Mapping[str, Any]) -> Answer:
        """Return the referee's fields of a solved run; what a planner calls a solution and is none is a failure."""
        if (fault := self._referee.fault(answer["path"], *self.ends)) is not None:
            return {"failure": f"refused: {fault}"}
        found: Answer = {"correct_solution": True}
        if answer.get("simplified_path"):
            fault = self._referee.fault(answer["simplified_path"], *self.ends)
            if fault is not None:
                found |= {"simplified_solution_length": None, "failure": f"simplified path refused: {fault}"}
        return found


def load_all() -> None:
    """Load what runs need, and compile what they call; OMPL's own random numbers stay untouched."""
    from trailmark.ompl_bridge import measured  # noqa: F401  # loaded for the children

    warm_up()
    checker = StateChecker(World("warm-up", (0.0, 0.0, 4.0, 4.0)), Robot.rectangle(0.6, 0.4))
    single = PointwiseChecker(checker)
    single.valid(1.0, 1.0, 0.0)
    single.clearance(1.0, 1.0, 0.0)
    single.step_valid(1.0, 1.0, 0.0, 2.0, 2.0, 0.5)
    single.motion_valid((1.0, 1.0, 0.0), (2.0, 2.0, 0.5))
    checker.motions_by_field(np.ones((1, 3)), np.full((1, 3), 2.0))


def answers(prepared: Prepared, job: Job) -> Iterator[Answer]:
    """Run a job's planner and yield the parts of its answer."""
    for end, status in zip(prepared.ends, (Status.INVALID_START, Status.INVALID_GOAL), strict=True):
        if not prepared.checker.valid(end):
            yield {"status": int(status), "time": 0.0, "failure": status.description.lower()}
            return
    name, limit, graph = PlannerName.parse(job["planner"]), job["time_limit"], None
    if name.native:
        answer = native_peer().run_native(prepared.problem, job)
        yield _in_time(answer, limit) if "curve" in answer else answer
        return
    if name.own:
        answer = yield from _own(prepared, job)
    else:
        # Whoever heeds no limit may take as long again.
        yield {WAIT: limit}
        _settle(prepared, job, name)
        yield {WAIT: 0.0}
        answer, graph = (_landmark if name.base in METHODS else _ompl)(prepared, job, name)
    answer = _in_time(answer, limit)
    yield answer
    if graph is not None:
        yield dict(zip(("graph_states", "graph_motions"), graph(), strict=True))
    # OMPL has no space for a differential drive, in which its simplifier could shorten.
    if answer["solved"] and prepared.problem.robot.drive != "differential":
        yield _simplified(prepared, answer["path"])


def _settle(prepared: Prepared, job: Job, name: PlannerName) -> None:
    """Plan the problem itself for a moment with another seed, by a planner that is dropped, as native programs do.

    The memory that a forked process uses for the first time is copied for it. That takes milliseconds, which are not
    the planner's, and which users of a running program do not wait for.
    """
    limit, seed = min(SETTLING, job["time_limit"]), job["seed"] + SEED_OFFSET
    if name.base in METHODS:
        _landmark_planner(prepared, name, seed).plan(*prepared.ends, time_limit=limit)
        return
    from trailmark.ompl_bridge import measured

    problem = _ompl_problem(prepared, name, seed, job["resolution"])
    measured.measure(problem, name.algorithm, limit, parameters=name.parameters)


def _latest(time_limit: float) -> float:
    """Return the seconds after which a solution comes too late."""
    return time_limit + max(GRACE[0], GRACE[1] * time_limit)


def _ompl(prepared: Prepared, job: Job, name: PlannerName) -> tuple[Answer, Graph]:
    from trailmark.ompl_bridge import measured

    problem, memory = _ompl_problem(prepared, name, job["seed"], job["resolution"]), _resident_memory()
    run = measured.measure(problem, name.algorithm, job["time_limit"], parameters=name.parameters)
    answer = _answer(prepared, Status(run.status), run.time, run.curve, run.path, memory)
    answer |= {"states_checked": run.states_checked, "motions_checked": run.motions_checked}
    return answer, lambda: measured.graph_size(problem)


def _ompl_problem(prepared: Prepared, name: PlannerName, seed: int, resolution: float) -> SE2Problem:
    """Return the problem as OMPL takes it, and seed OMPL's random numbers."""
    from trailmark.ompl_bridge import measured
    from trailmark.ompl_bridge.problem import SE2Problem

    measured.silence_ompl()
    measured.seed_ompl(seed)
    world, robot, options = prepared.problem.world, prepared.problem.robot, {"certified": name.certified}
    return SE2Problem(world, robot, prepared.ends, checker=prepared.checker, resolution=resolution, **options)


def _landmark_planner(prepared: Prepared, name: PlannerName, seed: int) -> LandmarkPlanner:
    from trailmark.planning import LandmarkPlanner

    world, checker, settings = prepared.problem.world, prepared.checker, method_settings(name)
    # By length, as OMPL's planners are measured, cars too.
    return LandmarkPlanner(world, seed=seed, checker=checker, settings=settings, objective="length", warm=False)


def _landmark(prepared: Prepared, job: Job, name: PlannerName) -> tuple[Answer, Graph]:
    limit, memory, begin = job["time_limit"], _resident_memory(), perf_counter()
    planner = _landmark_planner(prepared, name, job["seed"])
    before = perf_counter() - begin
    result = planner.plan(*prepared.ends, time_limit=max(limit - before, 1e-3))
    time, path, status = perf_counter() - begin, result.path, _LANDMARK[result.status]
    if result.status == "timeout" and result.nearest is not None and len(result.nearest) > 1:
        path, status = result.nearest, Status.APPROXIMATE_SOLUTION
    curve = [(t + before, cost) for t, cost in result.history]
    return _answer(prepared, status, time, curve, path, memory), lambda: (result.landmarks, result.edges)


def _own(prepared: Prepared, job: Job) -> Generator[Answer, None, Answer]:
    """Yield how long to wait while a planner of the user's prepares, run it, and return its answer.

    It is a function ``plan(checker, start, goal, time_limit, seed)`` named module:function; it returns a path's states,
    shape (n, 3), or None. One that takes ``report`` as well may call it with the states of each path that it comes by:
    their costs are its curve, and the best one in time counts if it returns too late. A function with an attribute
    ``prepare`` takes ``prepared`` too, which is what ``prepare(checker)`` has returned: that is set-up, before the
    clock starts, as the checker's is.
    """
    plan = load_function(job["planner"])
    memory, reported = _resident_memory(), list[tuple[float, Path]]()

    def add(now: float, states: ArrayLike) -> None:
        path = prepared.problem.path(states)
        if not reported or path.cost < reported[-1][1].cost:
            reported.append((now, path))

    def report(states: ArrayLike) -> None:
        add(perf_counter() - begin, states)

    options: dict[str, Any] = {"report": report} if "report" in inspect.signature(plan).parameters else {}
    limit, begin = job["time_limit"], perf_counter()
    if hasattr(plan, "prepare"):
        yield {WAIT: PREPARING}
        options["prepared"] = plan.prepare(prepared.checker)
        yield {WAIT: 0.0}
    setup_time = prepared.setup_time + perf_counter() - begin
    begin = perf_counter()
    found = plan(prepared.checker, *prepared.ends, limit, job["seed"], **options)
    time = perf_counter() - begin
    in_time = [path for t, path in reported if t <= _latest(limit)]
    if found is not None and (time <= _latest(limit) or not in_time):
        path: Path | None = prepared.problem.path(found)
        add(time, found)
    else:
        path = in_time[-1] if in_time else None
    status = Status.TIMEOUT if path is None else Status.EXACT_SOLUTION
    answer = _answer(prepared, status, time, [(t, each.cost) for t, each in reported], path, memory)
    # Else it is the problem's own, as for other planners.
    return (answer | {"setup_time": setup_time}) if "prepared" in options else answer


def _answer(
    prepared: Prepared,
    status: Status,
    time: float,
    curve: list[tuple[float, float]],
    path: Path | None,
    memory: float,
) -> Answer:
    """Return what was found, as fields of a RunRecord; ``memory`` is what the process held when planning began."""
    steering, solved, difference = prepared.problem.steering, status == Status.EXACT_SOLUTION, None
    if path is not None:
        between = se2.distance if steering is None else steering.lengths
        difference = float(between(path.states[-1], prepared.ends[1]))
    return {
        "status": int(status),
        "solved": solved,
        "approximate_solution": path is not None and not solved,
        "solution_difference": difference,
        "time": time,
        "curve": curve,
        "path": None if path is None else _states(path),
        "memory": max(0.0, _resident_memory(peak=True) - memory),
    }


def _states(path: Path) -> list[list[float]]:
    """Return the states that the robot's motions join, as rows."""
    rows: list[list[float]] = (path.knots if isinstance(path, CurvePath) else path.states).tolist()
    return rows


def _in_time(answer: Answer, limit: float) -> Answer:
    """Return an answer without what came too late, and with the first and the last cost filled in."""
    curve = [(t, cost) for t, cost in answer["curve"] if t <= _latest(limit)]
    if not answer["solved"]:
        return answer | {"curve": []}
    if not curve:
        late = answer["curve"][0][0] if answer["curve"] else answer["time"]
        failure = f"too late: the first solution came after {late:.3f} s"
        return answer | {"status": int(Status.TIMEOUT), "solved": False, "curve": [], "path": None, "failure": failure}
    costs = {"first_solution_length": curve[0][1], "solution_length": curve[-1][1]}
    return answer | {"curve": curve, "time_to_first_solution": curve[0][0], **costs}


def _simplified(prepared: Prepared, path: list[list[float]]) -> Answer:
    """Return the path after OMPL's simplifier with certified motions, the same for all planners."""
    from trailmark.ompl_bridge import measured
    from trailmark.ompl_bridge.problem import SE2Problem

    measured.silence_ompl()
    problem = SE2Problem(prepared.problem.world, prepared.problem.robot, prepared.ends, checker=prepared.checker)
    shortened, seconds = measured.simplify(problem, prepared.problem.path(path), SIMPLIFY_LIMIT)
    return {
        "simplified_path": _states(shortened),
        "simplified_solution_length": shortened.cost,
        "simplification_time": seconds,
    }


def _resident_memory(*, peak: bool = False) -> float:
    """Return the MB of main memory that this process holds, or has held at most since it was asked without ``peak``."""
    if not peak:
        with suppress(OSError):  # a kernel without it: the peak is then that of the process's whole life
            FilePath("/proc/self/clear_refs").write_text("5", encoding="ascii")
    words = FilePath("/proc/self/status").read_text(encoding="ascii").split()
    return float(words[words.index("VmHWM:" if peak else "VmRSS:") + 1]) / 1024.0
