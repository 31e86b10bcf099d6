"""One run, in the process forked for it: plan, report the result, then measure what was built.

The answer goes out in parts, each a JSON object with fields of :class:`~trailmark.benchmark.record.RunRecord`, so that
a crash in a later part (counting the graph, simplifying the path) does not take the planning's result with it.
"""

from __future__ import annotations

import importlib
import inspect
import os
import sys
from collections.abc import Callable, Generator, Iterator, Mapping
from time import perf_counter
from typing import TYPE_CHECKING, Any

from trailmark import se2
from trailmark.benchmark.isolation.memory import MemoryPeak
from trailmark.benchmark.isolation.prepared import CountingChecker, Prepared
from trailmark.benchmark.planner_name import PlannerName
from trailmark.benchmark.planners import method_settings
from trailmark.benchmark.status import Status
from trailmark.planning.settings import METHODS
from trailmark.trajectories import CurvePath, Path

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from trailmark.collision import StateChecker
    from trailmark.ompl_bridge.problem import SE2Problem
    from trailmark.planning import LandmarkPlanner, PlanProgress

__all__ = ["PREPARING", "WAIT", "Answer", "answers", "latest"]

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


def answers(prepared: Prepared, job: Mapping[str, Any]) -> Iterator[Answer]:
    """Run a job's planner and yield the parts of its answer.

    Args:
        prepared: the job's problem.
        job: as :class:`trailmark.benchmark.problems.Job` gives it.
    """
    for end, status in zip(prepared.ends, (Status.INVALID_START, Status.INVALID_GOAL), strict=True):
        if not prepared.checker.valid(end):
            yield {"status": int(status), "time": 0.0, "failure": status.description.lower()}
            return
    name = PlannerName.parse(str(job["planner"])).base
    if name.startswith("native:"):
        yield _native(prepared, job)
        return
    if ":" in name:
        answer, graph = (yield from _own(prepared, job)), None
    else:
        # Whoever heeds no limit may take as long again.
        yield {WAIT: float(job["time_limit"])}
        _settle(prepared, job)
        yield {WAIT: 0.0}
        answer, graph = (_landmark if name in METHODS else _ompl)(prepared, job)
    answer = _in_time(answer, latest(float(job["time_limit"])))
    yield answer
    if graph is not None:
        nodes, edges = graph()
        yield {"graph_states": nodes, "graph_motions": edges}
    # OMPL has no space for a differential drive, in which its simplifier could shorten.
    if answer["solved"] and not job.get("first") and prepared.problem.robot.drive != "differential":
        yield _simplified(prepared, answer["path"])


def _settle(prepared: Prepared, job: Mapping[str, Any]) -> None:
    """Plan the problem itself for a moment with another seed, by a planner that is dropped, as native programs do.

    The memory that a forked process uses for the first time is copied for it. That takes milliseconds, which are not
    the planner's, and which users of a running program do not wait for.
    """
    name, limit = PlannerName.parse(str(job["planner"])), min(SETTLING, float(job["time_limit"]))
    seed = int(job["seed"]) + SEED_OFFSET
    if name.base in METHODS:
        planner = _landmark_planner(prepared, prepared.checker, name, seed)
        planner.plan(*prepared.ends, time_limit=limit)
        return
    from trailmark.ompl_bridge import measured

    problem = _ompl_problem(prepared, name, seed, float(job["resolution"]))
    measured.measure(problem, name.algorithm, limit, parameters=name.parameters)


def latest(time_limit: float) -> float:
    """Return the seconds after which a solution comes too late."""
    return time_limit + max(GRACE[0], GRACE[1] * time_limit)


def _ompl(prepared: Prepared, job: Mapping[str, Any]) -> tuple[Answer, Graph]:
    from trailmark.ompl_bridge import measured

    name = PlannerName.parse(str(job["planner"]))
    problem = _ompl_problem(prepared, name, int(job["seed"]), float(job["resolution"]))
    peak = MemoryPeak()
    limit, first = float(job["time_limit"]), bool(job.get("first"))
    run = measured.measure(problem, name.algorithm, limit, parameters=name.parameters, first=first)
    peak.measure()
    answer = {
        "status": run.status,
        "solved": run.exact,
        "approximate_solution": run.path is not None and not run.exact,
        "solution_difference": run.difference,
        "time": run.time,
        "curve": run.curve,
        "path": None if run.path is None else _states(run.path),
        "states_checked": run.states_checked,
        "motions_checked": run.motions_checked,
        "memory": peak.highest,
    }
    return answer, lambda: measured.graph_size(problem)


def _ompl_problem(prepared: Prepared, name: PlannerName, seed: int, resolution: float) -> SE2Problem:
    """Return the problem as OMPL takes it, and seed OMPL's random numbers."""
    from trailmark.ompl_bridge import measured
    from trailmark.ompl_bridge.problem import SE2Problem

    measured.silence_ompl()
    measured.seed_ompl(seed)
    return SE2Problem(
        prepared.problem.world,
        prepared.problem.robot,
        prepared.ends,
        checker=prepared.checker,
        certified=name.certified,
        resolution=resolution,
    )


def _landmark_planner(prepared: Prepared, checker: StateChecker, name: PlannerName, seed: int) -> LandmarkPlanner:
    from trailmark.planning import LandmarkPlanner

    world, settings = prepared.problem.world, method_settings(name)
    # By length, as OMPL's planners are measured, cars too.
    return LandmarkPlanner(world, seed=seed, checker=checker, settings=settings, objective="length", warm=False)


def _landmark(prepared: Prepared, job: Mapping[str, Any]) -> tuple[Answer, Graph]:
    limit, peak = float(job["time_limit"]), MemoryPeak()
    best: list[PlanProgress] = []

    def on_progress(progress: PlanProgress) -> None:
        peak.measure()
        if progress.elapsed <= latest(limit):
            best[:] = [progress]

    def stop() -> bool:
        return bool(job.get("first") and best and best[0].path is not None)

    checker = CountingChecker(prepared.checker)
    begin = perf_counter()
    planner = _landmark_planner(prepared, checker, PlannerName.parse(str(job["planner"])), int(job["seed"]))
    before = perf_counter() - begin
    result = planner.plan(*prepared.ends, time_limit=max(limit - before, 1e-3), on_progress=on_progress, stop=stop)
    time = perf_counter() - begin
    path, status = result.path, _LANDMARK[result.status]
    if result.status == "timeout" and result.nearest is not None and len(result.nearest) > 1:
        path, status = result.nearest, Status.APPROXIMATE_SOLUTION
    elif path is not None and time > latest(limit) and best and best[0].path is not None:
        path = best[0].path  # the one it had in time
    curve = [(t + before, cost) for t, cost in result.history]
    answer = _answer(prepared, status, time, curve, path, checker, peak)
    return answer, lambda: (result.landmarks, result.edges)


def _own(prepared: Prepared, job: Mapping[str, Any]) -> Generator[Answer, None, Answer]:
    """Yield how long to wait while a planner of the user's prepares, run it, and return its answer.

    It is a function ``plan(checker, start, goal, time_limit, seed)`` named module:function; it returns a path's states,
    shape (n, 3), or None. One that takes ``report`` as well may call it with the states of each path that it comes by:
    their costs are its curve, and the best one in time counts if it returns too late. A function with an attribute
    ``prepare`` takes ``prepared`` too, which is what ``prepare(checker)`` has returned: that is set-up, before the
    clock starts, as the checker's is.
    """
    module, _, function = str(job["planner"]).partition(":")
    # Last, so that no file of the user's takes a library's place.
    sys.path.append(os.getcwd())  # noqa: PTH109  # sys.path holds strings
    plan = getattr(importlib.import_module(module), function)
    checker, peak = CountingChecker(prepared.checker), MemoryPeak()
    reported: list[tuple[float, Path]] = []

    def add(now: float, states: ArrayLike) -> None:
        path = prepared.problem.path(states)
        if not reported or path.cost < reported[-1][1].cost:
            reported.append((now, path))

    def report(states: ArrayLike) -> None:
        add(perf_counter() - begin, states)

    options: dict[str, Any] = {"report": report} if "report" in inspect.signature(plan).parameters else {}
    limit, begin = float(job["time_limit"]), perf_counter()
    if hasattr(plan, "prepare"):
        yield {WAIT: PREPARING}
        options["prepared"] = plan.prepare(checker)
        yield {WAIT: 0.0}
    setup_time = prepared.setup_time + perf_counter() - begin
    begin = perf_counter()
    found = plan(checker, *prepared.ends, limit, int(job["seed"]), **options)
    time = perf_counter() - begin
    in_time = [path for t, path in reported if t <= latest(limit)]
    if found is not None and (time <= latest(limit) or not in_time):
        path: Path | None = prepared.problem.path(found)
        add(time, found)
    else:
        path = in_time[-1] if in_time else None
    status = Status.TIMEOUT if path is None else Status.EXACT_SOLUTION
    curve = [(t, each.cost) for t, each in reported]
    answer = _answer(prepared, status, time, curve, path, checker, peak)
    # Else it is the problem's own, as for other planners.
    return (answer | {"setup_time": setup_time}) if "prepared" in options else answer


def _answer(
    prepared: Prepared,
    status: Status,
    time: float,
    curve: list[tuple[float, float]],
    path: Path | None,
    checker: CountingChecker,
    peak: MemoryPeak,
) -> Answer:
    """Return what a planner in Python found, as fields of a RunRecord."""
    peak.measure()
    return {
        "status": int(status),
        "solved": status == Status.EXACT_SOLUTION,
        "approximate_solution": status == Status.APPROXIMATE_SOLUTION,
        "solution_difference": None if path is None else _distance(prepared, path.states[-1], prepared.ends[1]),
        "time": time,
        "curve": curve,
        "path": None if path is None else _states(path),
        "states_checked": checker.states,
        # A car's curves are checked within compiled code.
        "motions_checked": checker.motions if prepared.problem.steering is None else None,
        "memory": peak.highest,
    }


def _states(path: Path) -> list[list[float]]:
    """Return the states that the robot's motions join, as rows."""
    rows: list[list[float]] = (path.knots if isinstance(path, CurvePath) else path.states).tolist()
    return rows


def _distance(prepared: Prepared, a: se2.FloatArray, b: se2.FloatArray) -> float:
    steering = prepared.problem.steering
    return float(se2.distance(a, b) if steering is None else steering.lengths(a, b))


def _native(prepared: Prepared, job: Mapping[str, Any]) -> Answer:
    native = importlib.import_module("trailmark.benchmark.native")
    answer: Answer = native.run_native(prepared.problem, job)
    return _in_time(answer, latest(float(job["time_limit"]))) if "curve" in answer else answer


def _in_time(answer: Answer, limit: float) -> Answer:
    """Return an answer without what came too late, and with the first and the last cost filled in."""
    curve = [(t, cost) for t, cost in answer["curve"] if t <= limit]
    if answer["solved"] and not curve:
        late = answer["curve"][0][0] if answer["curve"] else answer["time"]
        failure = f"too late: the first solution came after {late:.3f} s"
        return answer | {"status": int(Status.TIMEOUT), "solved": False, "curve": [], "path": None, "failure": failure}
    if not answer["solved"]:
        return answer | {"curve": []}
    first, last = curve[0], curve[-1]
    return answer | {
        "curve": curve,
        "time_to_first_solution": first[0],
        "first_solution_length": first[1],
        "solution_length": last[1],
    }


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
