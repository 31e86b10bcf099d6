"""PlanningSite: the newest map with the planner in it, and the plan that is followed there. It knows no ROS."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from trailmark import Goal, LandmarkPlanner, Path, PathAuditor, PlanProgress, PlanResult, World, se2
from trailmark.errors import ConfigurationError
from trailmark.ros.settings import Settings
from trailmark.shapes import Shape

__all__ = ["Answer", "GridMap", "Leg", "PlanningSite", "Pose", "warm_up"]

Pose = tuple[float, float, float]

REPLANNING = 0.2
"""Seconds at most to lead a path around what changed; after that it is planned anew, which can be cancelled."""

LEAST = 1e-3
"""Seconds for a leg for which no time is left."""

REVISIONS = 4
"""Times at most that a plan is made because the map changed meanwhile."""


@dataclass(frozen=True)
class GridMap:
    """An occupancy grid.

    Attributes:
        occupied: shape (rows, columns), row 0 with the smallest y.
        resolution: side of a cell, metres.
        origin: x, y of the outer corner of cell (0, 0), and the yaw by which the grid is turned about it.
        frame: in which that is.
        stamp: seconds and nanoseconds of its message.
    """

    occupied: NDArray[np.bool_]
    resolution: float
    origin: Pose
    frame: str = "map"
    stamp: tuple[int, int] = (0, 0)

    def contains(self, pose: Sequence[float]) -> bool:
        """Return whether a pose's position lies in the grid."""
        columns, rows = self._cells(np.array([pose[:2]]))[0]
        return bool(0.0 <= columns <= self.occupied.shape[1] and 0.0 <= rows <= self.occupied.shape[0])

    def with_shapes(self, shapes: Iterable[Shape]) -> GridMap:
        """Return the grid with every cell occupied that a shape reaches into."""
        shapes = tuple(shapes)
        occupied = self.occupied.copy() if shapes else self.occupied
        rows, columns = occupied.shape
        for shape in shapes:
            outline = shape.polygon(1e-3)
            body = shapely.Polygon(self._cells(outline.vertices), [self._cells(hole) for hole in outline.holes])
            _, low, _, high = body.bounds
            row = np.arange(max(0, math.floor(low)), min(rows, math.ceil(high)))
            # A connected part of the shape in a row of cells reaches into all from its left to its right end.
            strips = shapely.box(-1.0, row, columns + 1.0, row + 1.0)
            parts, which = shapely.get_parts(shapely.intersection(body, strips), return_index=True)
            parts, which = parts[~shapely.is_empty(parts)], which[~shapely.is_empty(parts)]
            left, _, right, _ = shapely.bounds(parts).T
            for i, a, b in zip(row[which], np.floor(left), np.ceil(right), strict=True):
                occupied[i, max(0, int(a)) : max(0, int(b))] = True
        return replace(self, occupied=occupied)

    def equals(self, other: GridMap | None) -> bool:
        """Return whether another grid says the same, whenever it came."""
        told, others = ((g.resolution, g.origin, g.frame) if g else () for g in (self, other))
        return other is not None and told == others and np.array_equal(self.occupied, other.occupied)

    def _cells(self, points: se2.FloatArray) -> se2.FloatArray:
        """Return points, shape (n, 2), in cells along the grid's columns and rows."""
        x, y, yaw = self.origin
        away = points - np.array([x, y])
        cos, sin = math.cos(yaw), math.sin(yaw)
        return np.asarray(away @ np.array([[cos, -sin], [sin, cos]]) / self.resolution)


class Leg(NamedTuple):
    """A plan's part to one of its goals."""

    goal: Pose
    path: Path


@dataclass(frozen=True)
class Answer:
    """What became of a query.

    Attributes:
        code: ``NONE`` if there is a path, else the name of nav2's error code.
        message: why there is no path, or how it was come by.
        legs: the path's parts, one for each goal.
        seconds: that planning took.
        lower_bound: proven lower bound (metres) on the cost of any path through the goals; None where there is none.
        stamp: of the map that the path is free in.
    """

    code: str
    message: str = ""
    legs: tuple[Leg, ...] = ()
    seconds: float = 0.0
    lower_bound: float | None = None
    stamp: tuple[int, int] = (0, 0)

    @property
    def cost(self) -> float:
        """The path's cost, metres."""
        return sum(leg.path.cost for leg in self.legs)

    def states(self, spacing: float) -> se2.FloatArray:
        """Return the path's configurations at most that many metres apart, shape (n, 3)."""
        parts = [leg.path.resample(max(spacing, leg.path.cost / 1e5)).states for leg in self.legs]
        return np.vstack([parts[0], *(part[1:] for part in parts[1:])]) if parts else np.empty((0, 3))


class PlanningSite:
    """One robot's planner in the newest map, with the plan that is followed.

    :meth:`change_map` and :meth:`invalid_poses` may be called while another thread plans: the plan is then looked at
    again in the new map before it is given out.

    Attributes:
        planning: lock, held by who plans or follows until the plan is published.
        grid: the map that is planned in, with the shapes beside it; None before the first.
        planner: in it.
        followed: the newest plan; empty if there is none.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.grid: GridMap | None = None
        self.planner: LandmarkPlanner | None = None
        self.followed: tuple[Leg, ...] = ()
        self._version = 0
        self.planning, self._changing = threading.RLock(), threading.Lock()
        self._auditor: PathAuditor | None = None
        self._last: tuple[tuple[int, Pose, tuple[Pose, ...]], Answer] | None = None

    def change_map(self, grid: GridMap) -> bool:
        """Plan in another map from now on; return whether it says anything new."""
        with self._changing:
            if grid.equals(self.grid):
                return False
            world = World.from_grid(grid.occupied, grid.resolution, grid.origin)
            world = replace(world, zones=self.settings.zones)
            if self.planner is None:
                self.planner = _planner(world, self.settings)
            else:
                self.planner.update(world)
            self.grid = grid
            self._version += 1
        return True

    def change_settings(self, settings: Settings) -> None:
        """Plan with other settings from now on; where no planner can be made of them all stays as it was."""
        _ = settings.robot
        with self._changing:
            if self.planner is not None:
                self.planner = _planner(replace(self.planner.world, zones=settings.zones), settings)
                self._version += 1
            self.settings = settings

    def plan(
        self, start: Pose, goals: Sequence[Pose], stop: Callable[[], bool] = lambda: False, follow: bool = True
    ) -> Answer:
        """Return a path from start through all goals, which is followed from now on if it is to be.

        Where the goals are those of the plan that is followed, its rest is kept, or led around what came in its way.
        ``stop`` is asked whether to end early, as if the time were up.
        """
        begin = perf_counter()
        self._deadline = begin + self.settings.time_limit
        asked = (self._version, start, tuple(goals))
        if self._last is not None and self._last[0] == asked:
            return replace(self._last[1], seconds=perf_counter() - begin)
        same = tuple(leg.goal for leg in self.followed) == tuple(goals)
        known = self.followed if same else ()
        for left in reversed(range(REVISIONS)):
            with nullcontext() if left else self._changing:  # the last time no map changes meanwhile
                version = self._version
                answer = self._through(start, goals, known, stop)
            known = answer.legs or known
            if version == self._version:
                break
        if follow and answer.code == "NONE":
            self.followed, self._last = answer.legs, ((version, *asked[1:]), answer)
        elif follow and not same:
            self.followed, self._last = (), None  # that of the same goals may become free again
        return replace(answer, seconds=perf_counter() - begin)

    def follow(self, here: Pose | None, stop: Callable[[], bool] = lambda: False) -> Answer | None:
        """Return what becomes of the plan that is followed after the map changed; None if there is nothing to do.

        The robot is ``here``, or where it is not known, at the plan's start.
        """
        if not self.followed or (self._last is not None and self._last[0][0] == self._version):
            return None
        if here is None:
            here = _pose(self.followed[0].path.states[0])
        else:
            away = [np.hypot(*(leg.path.resample(0.1).states[:, :2] - here[:2]).T).min() for leg in self.followed]
            self.followed = self.followed[int(np.argmin(away)) :]  # goals before the nearest leg are reached
        return self.plan(here, [leg.goal for leg in self.followed], stop)

    def invalid_poses(self, states: se2.FloatArray, here: Pose | None) -> list[int]:
        """Return the indices of the states, shape (n, 3), at which a path begins to collide; empty if it is free.

        What lies before the state nearest to where the robot is, if that is known, is left aside.
        """
        if self.planner is None:
            raise ConfigurationError("expected a map first, got none yet")
        checker = self.planner.checker
        if self._auditor is None or self._auditor.checker.world is not checker.world:
            self._auditor = PathAuditor(checker)
        passed = 0 if here is None else int(np.hypot(*(states[:, :2] - here[:2]).T).argmin())
        audit = self._auditor.audit(states[passed:])
        return [passed + min(math.ceil(c.motions[0]), len(states) - 1 - passed) for c in audit.collisions]

    def _through(self, start: Pose, goals: Sequence[Pose], known: tuple[Leg, ...], stop: Callable[[], bool]) -> Answer:
        """Return a path through goals in the map as it is; ``known`` are legs of an earlier one."""
        planner, grid = self.planner, self.grid
        if planner is None or grid is None:
            return Answer("UNKNOWN", "expected a map first, got none yet")
        names = ["the goal"] if len(goals) == 1 else [f"goal {i}" for i in range(len(goals))]
        for pose, name in ((start, "the start"), *zip(goals, names, strict=True)):
            if not all(map(math.isfinite, pose)) or not grid.contains(pose):
                end, text = "START" if name == "the start" else "GOAL", ", ".join(f"{value:.3g}" for value in pose)
                return Answer(f"{end}_OUTSIDE_MAP", f"{name} ({text}) lies outside the map", stamp=grid.stamp)
        legs: list[Leg] = []
        bound: float | None = 0.0
        message = ""
        # At first through all goals at once; what is followed, and what begins with a way out, leg by leg.
        alone = len(goals) == 1 or bool(known) or (self.settings.escape and not planner.checker.valid(start))
        parts = [(name, [goal]) for name, goal in zip(names, goals, strict=True)] if alone else [("goals", [*goals])]
        for i, (named, part) in enumerate(parts):
            try:
                result = self._planned(planner, start, part, known[i].path if i < len(known) else None, stop)
            except ConfigurationError as error:
                end = "GOAL" if planner.checker.valid(start) else "START"
                return Answer(f"{end}_OCCUPIED", str(error), stamp=grid.stamp)
            if result.path is None:
                code = "NO_VALID_PATH" if result.status == "infeasible" else "TIMEOUT"
                proven = "proven: no path" if code == "NO_VALID_PATH" else "no path within the time limit"
                return Answer(code, f"{named}: {proven}: {result.reason or 'no reason is known'}", stamp=grid.stamp)
            found = [leg.path or result.path for leg in result.legs or (result,)]
            legs += [Leg(goal, path) for goal, path in zip(part, found, strict=True)]
            bound = None if bound is None or result.lower_bound is None else bound + result.lower_bound
            message, start = result.reason, _pose(result.path.states[-1])
        return Answer("NONE", message, tuple(legs), lower_bound=bound, stamp=grid.stamp)

    def _planned(
        self, planner: LandmarkPlanner, start: Pose, goals: list[Pose], known: Path | None, stop: Callable[[], bool]
    ) -> PlanResult:
        """Return a path through goals; with one that is known to a single goal."""
        own = self.settings
        ends = [goal if own.tolerance == 0.0 else Goal(goal, position_tolerance=own.tolerance) for goal in goals]
        if known is not None:
            limit, how = min(REPLANNING, own.time_limit), {"improvement": own.improvement_time}
            result: PlanResult = planner.replan(start, ends[0], known, limit, escape=own.escape, **how)
            if result.path is not None:
                return result
        first: float | None = None

        def look(progress: PlanProgress) -> None:
            nonlocal first
            if first is None and progress.path is not None:
                first = perf_counter()

        def enough() -> bool:
            return stop() or (first is not None and perf_counter() - first >= len(ends) * own.improvement_time)

        time_limit = max(round(self._deadline - perf_counter(), 3), LEAST)
        if len(ends) > 1:
            return planner.plan_through(start, ends, time_limit, on_progress=look, stop=enough)
        return planner.plan(start, ends[0], time_limit, on_progress=look, stop=enough, escape=own.escape)


def _planner(world: World, own: Settings) -> LandmarkPlanner:
    return LandmarkPlanner(world, own.robot, seed=0, clearance=own.clearance, objective=own.planner_objective)


def _pose(state: NDArray[np.float64]) -> Pose:
    x, y, theta = state.tolist()
    return x, y, theta


def warm_up(settings: Settings) -> None:
    """Load, or on a machine's first use compile, what the robot's plans need."""
    size = 2.0 * (settings.robot.circumradius + settings.clearance) + 2.0 * (settings.robot.turning_radius or 0.0)
    blocked = np.pad(np.ones((20, 4), np.bool_), ((20, 20), (28, 28)))
    room = PlanningSite(replace(settings, zones_file="", tolerance=0.0, time_limit=5.0))
    here, there = (1.2 * size, 3.0 * size, 0.0), (4.8 * size, 3.0 * size, 0.0)
    for occupied in (blocked, np.zeros_like(blocked), blocked):
        room.change_map(GridMap(occupied, size / 10.0, (0.0, 0.0, 0.0)))
        room.plan(here, [there])
    room.invalid_poses(np.array([here, there]), None)
