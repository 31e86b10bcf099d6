"""Make the compiled kernels ready before a clock runs: compiled on the machine's first use, else loaded from cache."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from trailmark.formats.grid import cells_of
from trailmark.jit import compiling, compiling_for
from trailmark.motion import Kind, is_weighted, kind_of
from trailmark.shapes import Disc, Rectangle
from trailmark.trajectories import Path
from trailmark.world import Robot, World, keep_outs
from trailmark.world.moving import Moving
from trailmark.world.objective import Objective
from trailmark.world.zones import KeepOutZone, OneWayZone

if TYPE_CHECKING:
    from trailmark.planning.planner import LandmarkPlanner

__all__ = ["SMALL", "Use", "side_by_side", "warm_up", "warm_up_for"]

SMALL = World("warm-up", (0.0, 0.0, 6.0, 4.0), (Rectangle((3.0, 1.0), 0.5, 2.0),)), np.array([[1.0, 1, 0], [5, 1, 1]])
"""A small world, and a start and a goal that no single motion joins."""

ROBOTS: dict[Kind, Robot] = {
    "translation": Robot.disc(0.25),
    "straight": Robot.rectangle(0.6, 0.4),
    "curve": Robot.rectangle(0.6, 0.4).steered(0.4),
    "differential": Robot.rectangle(0.6, 0.4).differential(),
}


Use = Literal["plan", "many", "changes", "moving", "grid", "leaving", "reachability"]
"""What kernels are for: single queries; :meth:`LandmarkPlanner.plan_many`; changed worlds and paths in them; those with
moving obstacles; grid maps; starts in keep-out zones; and the proof that places cannot be reached, of
:mod:`trailmark.exploration`."""

NAMES: dict[Use, str] = {
    "plan": "planning",
    "many": "many queries",
    "changes": "changed worlds",
    "moving": "moving obstacles",
    "grid": "grid maps",
    "leaving": "keep-out zones",
    "reachability": "exploration",
}
"""What the uses are called."""


HELPER = """
import pickle, sys
sys.path[:] = pickle.load(sys.stdin.buffer)
from trailmark import jit
jit.compiling.alone = False
for job in pickle.load(sys.stdin.buffer):
    job()
"""
"""What a second process runs; it finds modules where this one does, whatever lies in the working directory."""


@contextmanager
def side_by_side(jobs: Sequence[Callable[[], object]]) -> Iterator[None]:
    """Let a second process do jobs, which are pickled, in the reverse order while the block compiles.

    The block does the same jobs in their order: what one process compiles the other finds in the cache. Where there is
    one processor only, or no second process can be started, the block does everything.
    """
    if not compiling.alone or (os.cpu_count() or 1) < 2:
        yield
        return
    helpers: list[subprocess.Popen[bytes]] = []
    command, null = [sys.executable, "-c", HELPER], subprocess.DEVNULL

    def begin() -> None:
        with suppress(OSError):
            helpers.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=null, stderr=null))  # noqa: S603  # our own
            with helpers[0].stdin as pipe:  # type: ignore[union-attr]  # it is a pipe
                pipe.write(pickle.dumps(sys.path) + pickle.dumps(list(reversed(jobs))))

    compiling.alone, compiling.begin = False, begin
    try:
        yield
    finally:
        compiling.alone, compiling.begin = True, None
        for helper in helpers:
            helper.terminate()
            helper.wait()


@cache
def warm_up(kind: Kind = "straight", use: Use = "plan", *, weighted: bool = False) -> None:
    """Run every kernel that a use of the planner needs once: half a minute on a machine's first use, else a second.

    Args:
        kind: of motion.
        use: what for; each finds what the others compiled.
        weighted: what only zones and other objectives than length need, in place of what all need.
    """
    objective = "clearance" if weighted else "length"
    jobs = [partial(job, kind, objective) for job in _jobs(use, kind, weighted)]
    with compiling_for(NAMES[use]), side_by_side(jobs):
        for job in jobs:
            job()


def warm_up_for(robot: Robot, world: World, objective: Objective, use: Use = "plan") -> None:
    """Run every kernel once that a use of the planner needs for a robot in a world, under an objective."""
    kind = kind_of(robot)
    warm_up(kind, use)
    if cells_of(world.obstacles) is not None:
        warm_up(kind, "grid")
    if keep_outs(world):
        warm_up(kind, "leaving")
    if is_weighted(world, objective):
        warm_up(kind, use, weighted=True)


def _jobs(use: Use, kind: Kind, weighted: bool) -> Sequence[Callable[[Kind, str], None]]:
    alike: dict[Use, Sequence[Callable[[Kind, str], None]]] = {
        "many": [_plan_many],
        "changes": [_follow_changes],
        "moving": [_follow_changes, *([_pass_moving] if kind in ("straight", "translation") else [])],
        "grid": [_plan_in_grid],
        "leaving": [_leave],
        "reachability": [_shut_off],
    }
    if weighted:
        return {**alike, "plan": [_plan, _shorten]}[use]
    drive = [_drive] if kind == "curve" else []
    planning = [_plan, *drive, _certify, _enclose, _shorten, _bound]
    return {**alike, "plan": planning, "many": [_plan_many, _certify]}[use]


def _hasty(kind: Kind, objective: str) -> LandmarkPlanner:
    """Return a planner that does a little of everything: a car's edges and sweeps take long under an objective."""
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.planning.settings import PlannerSettings

    settings = PlannerSettings(
        first_landmarks=20,
        drives=500,
        sweeps=1,
        first_sweeps=1,
        polishing_sweeps=1,
        patience=1,
        least_gain=1.0,
    )
    zone = OneWayZone(Rectangle((0.25, 3.75), 0.5, 0.5).polygon(), 0.0, 1.0)
    world = SMALL[0] if objective == "length" else replace(SMALL[0], zones=(zone,))
    return LandmarkPlanner(world, ROBOTS[kind], seed=0, objective=objective, settings=settings, warm=False)


def _plan(kind: Kind, objective: str) -> None:
    """Plan between a start and a goal."""
    _, (start, goal) = SMALL
    planner = _hasty(kind, objective)
    planner.plan(start, goal, time_limit=600.0, max_iterations=1)
    planner.checker.clearance(start)
    # FCL is asked where something touches.
    planner.checker.scene.collides(start)


def _follow_changes(kind: Kind, objective: str) -> None:
    """Let the world change: beside a path, then on it, and back each time, in the end around the robot."""
    _, (start, goal) = SMALL
    planner = _hasty(kind, objective)
    world = planner.world
    path = planner.plan(start, goal, time_limit=600.0, max_iterations=1).path
    if path is None:
        return
    middle = np.asarray(path.at(0.5))
    for obstacle in (Disc((0.3, 3.7), 0.1), Disc((float(middle[0]), float(middle[1])), 0.3)):
        for changed in (world.edited(add=[obstacle]), world):
            planner.update(changed)
            path = planner.replan(start, goal, path, time_limit=600.0).path or path
    planner.update(world.edited(add=[Disc((float(start[0]), float(start[1]) - 0.3), 0.2)]))
    planner.replan(start, goal, path, escape=True, time_limit=600.0)


def _leave(kind: Kind, objective: str) -> None:
    """Plan out of a keep-out zone."""
    from trailmark.planning.planner import LandmarkPlanner

    world, (start, goal) = SMALL
    zone = KeepOutZone(Rectangle((0.6, 2.0), 1.2, 4.0).polygon())
    planner = LandmarkPlanner(replace(world, zones=(zone,)), ROBOTS[kind], seed=0, warm=False)
    planner.plan(start, goal, time_limit=600.0, max_iterations=1)


def _pass_moving(kind: Kind, objective: str) -> None:
    """Give way to a moving obstacle, and go on as it goes."""
    from trailmark.planning.planner import LandmarkPlanner

    world, (start, goal) = SMALL
    planner = LandmarkPlanner(world, ROBOTS[kind], seed=0, warm=False)
    path = Path(np.array([start, goal]))
    for velocity in ((0.0, 0.0), (0.0, 1.0)):
        planner.update(world.edited(add=[Moving(Disc((2.0, 1.5), 0.2), velocity, 5.0)]))
        path = planner.replan(start, goal, path, time_limit=600.0, speed=1.0).path or path


def _plan_in_grid(kind: Kind, objective: str) -> None:
    """Plan in a grid map, with a guide and without."""
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.search.grid_tangents import GridTangents

    world = World.from_grid(np.eye(5, dtype=np.bool_)[::-1] & (np.arange(5) % 4 > 0), 1.0)
    start, goal = (0.5, 0.5, 0.0), (4.5, 4.5, 0.0)
    LandmarkPlanner(world, ROBOTS[kind], seed=0, warm=False).plan(start, goal, time_limit=600.0, max_iterations=1)
    ends = np.array([start, goal])[:, :2]
    if (tangents := GridTangents.of(world, 0.25)) is not None:
        search = tangents.search(*ends, guide=tangents.guide(*ends))
        search.run(100)
        tangents.certified(tangents.bends(search, 0.0))


def _plan_many(kind: Kind, objective: str) -> None:
    """Plan between many starts and goals."""
    _, (start, goal) = SMALL
    planner = _hasty(kind, objective)
    planner.build(50)
    planner.plan_many([start, goal], [goal, start], time_limit=600.0)


def _certify(kind: Kind, objective: str) -> None:
    """Certify the edges of a roadmap, and find paths with and without."""
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.roadmap.snapshot import RoadmapSnapshot

    world, (start, goal) = SMALL
    planner = LandmarkPlanner(world, ROBOTS[kind], seed=0, warm=False)
    planner.build(50)
    planner.roadmap.certify_all()
    for checking in (True, False):
        planner.roadmap.find_path(start, goal, checking=checking)
    RoadmapSnapshot(planner.roadmap).between(0, 1)


def _drive(kind: Kind, objective: str) -> None:
    """Search for a car's path by hybrid A*: which queries need it nobody knows beforehand."""
    from trailmark.planning.planner import LandmarkPlanner
    from trailmark.search.cost_to_go import CostToGo
    from trailmark.search.hybrid_astar import hybrid_astar

    world, (start, goal) = SMALL
    planner = LandmarkPlanner(world, ROBOTS[kind], seed=0, warm=False)
    CostToGo.of(planner.checker, start, 1000)  # several goals are ranked by it
    hybrid_astar(
        planner.motion,
        planner.relaxation,
        planner.relaxation.costs_from(goal),
        start[None],
        reverse=False,
        step=0.1,
        most=50,
        landmarks=5,
        rng=np.random.default_rng(0),
    )


def _shorten(kind: Kind, objective: str) -> None:
    """Shorten a path."""
    from trailmark.collision import StateChecker
    from trailmark.motion import motion_of
    from trailmark.planning.shortening import EFFORT, shorten, without_needless

    world, (start, goal) = SMALL
    motion = motion_of(StateChecker(world, ROBOTS[kind]), objective=Objective.of(objective))
    path = np.array([start, [3.0, 3.2, 0.0], goal])
    for splitting in (False, True):
        shorten(motion, path, np.random.default_rng(0), sweeps=1, splitting=splitting)
    without_needless(motion.kind, path, EFFORT)


def _bound(kind: Kind, objective: str) -> None:
    """Prove a lower bound."""
    from trailmark.proofs.bound import LowerBound

    world, (start, goal) = SMALL
    LowerBound(world, ROBOTS[kind]).of(start, goal)


SHUT = World("shut", (0.0, 0.0, 3.0, 2.0), (Rectangle((1.5, 1.0), 0.6, 2.0),)), np.array([[0.6, 1, 0], [2.4, 1, 0]])
"""A world that a wall divides, and a configuration on either side."""


def _enclose(kind: Kind, objective: str) -> None:
    """Prove that there is no path: only what is hardly feasible, or not at all, asks for that."""
    from trailmark.collision import StateChecker
    from trailmark.landmarks import Relaxation
    from trailmark.proofs import enclosed
    from trailmark.proofs.claims import grid_separates

    world, ends = SHUT
    checker = StateChecker(world, ROBOTS["straight"])
    enclosed(checker, *ends)
    relaxation = Relaxation(checker)
    grid_separates(relaxation, relaxation.costs_from(ends[1], target=ends[0]), *ends)


def _shut_off(kind: Kind, objective: str) -> None:
    """Prove that a place cannot be reached."""
    from trailmark.collision import StateChecker
    from trailmark.proofs.enclosure import shut_off

    world, (here, there) = SHUT
    shut_off(StateChecker(world, ROBOTS["straight"]), here, there[:2], np.array([here[:2], there[:2]]))
