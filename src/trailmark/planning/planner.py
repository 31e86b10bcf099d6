"""LandmarkPlanner: landmarks by K-means, a roadmap over them, its shortest path, shortened."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Sized
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, callback, number, one_of, truth, whole
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError, WorldError, as_raised
from trailmark.landmarks import Relaxation
from trailmark.lock import Lock
from trailmark.motion import Motion
from trailmark.planning.batch import plan_batch
from trailmark.planning.dispatch import plan_explained, replan
from trailmark.planning.incumbent import GAP, Budget, OnProgress
from trailmark.planning.model import WorldModel, WorldModels
from trailmark.planning.replanning import ReplanOptions
from trailmark.planning.result import PlanResult, ReplanResult, Update
from trailmark.planning.route import RouteResult, plan_on_route
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.through import Stops, stops_of
from trailmark.planning.warmup import Use, warm_up_for
from trailmark.proofs import LowerBound
from trailmark.roadmap import Roadmap
from trailmark.trajectories import Path
from trailmark.world import Robot, World
from trailmark.world.changes import Changes
from trailmark.world.goals import Ends
from trailmark.world.objective import Objective

if TYPE_CHECKING:
    import networkx as nx

__all__ = ["LandmarkPlanner"]

MAX_LANDMARKS = 200_000
"""Most landmarks that may be asked for: more take longer than anybody waits."""

MAX_WORKERS = 1024
"""Most threads that answer queries, however many are asked for."""


class LandmarkPlanner:
    """Plans paths for one robot in one world, over a roadmap that grows with its queries.

    A query goes through the stages of :mod:`trailmark.planning.pipeline`. If the roadmap has no path, lattices of
    configurations are searched (not for cars), then landmarks are placed in rounds: the relaxed problem (the robot's
    inscribed disc on a grid) says where short paths are likely; valid configurations drawn there are clustered by
    K-means; the centres, repaired to valid configurations, join the roadmap; a lazy search finds the shortest path of
    certified motions. While there is none, each round draws from a wider band, in the end from all places that the
    robot might reach: a path with some clearance is found with probability one as time goes on. The path is then
    shortened, and further rounds look for other homotopy classes, until the cost settles or the time is up. A disc's
    shortest path is computed.

    A robot with a turning radius is a car: its roadmap is made of Reeds-Shepp curves, or Dubins curves if it does not
    reverse, a path is a :class:`trailmark.CurvePath`, and in tight places hybrid A* connects its parts.

    A planner can be pickled and copied, with its roadmap and its random state.

    Args:
        world: obstacles and bounds.
        robot: footprint; the world's own robot if None.
        seed: the same seed gives the same paths, as long as no time limit cuts in; None draws one.
        landmarks: number of landmarks spread over all free space before the first query; default: none, each query
            places its own.
        clearance: minimum distance to obstacles and bounds along a path, metres; the robot's own if None.
        relax: if no path keeps the clearance, keep the largest feasible one (:attr:`trailmark.PlanResult.clearance`).
        checker: an existing checker for this world and robot; without ``robot``, its robot is used.
        settings: default: those of the benchmarks.
        objective: the cost of paths (:meth:`trailmark.Objective.of`); default: length, and a car's maneuvers.
        warm: load the compiled kernels now (:mod:`trailmark.planning.warmup`), so that no query waits for it.

    Raises:
        WorldError: neither ``robot`` nor ``world.robot`` is given.
        ConfigurationError: an argument out of range or of another kind, a checker for another world or robot.
    """

    def __init__(
        self,
        world: World,
        robot: Robot | None = None,
        *,
        seed: int | None = None,
        landmarks: int | None = None,
        clearance: float | None = None,
        relax: bool = False,
        checker: StateChecker | None = None,
        settings: PlannerSettings | None = None,
        objective: Objective | str | None = None,
        warm: bool = True,
    ) -> None:
        landmarks = None if landmarks is None else whole(landmarks, "landmarks:", 1, MAX_LANDMARKS)
        one_of(world, World, "world:", hint=" (World.load reads one)", error=WorldError)
        if checker is not None:
            one_of(checker, StateChecker, "checker:").require_for(world, robot)
            if clearance not in (None, checker.robot.clearance):
                raise ConfigurationError(f"clearance: expected the checker's or none, got {brief(clearance)}")
        self.seed = int(np.random.default_rng().integers(2**31)) if seed is None else whole(seed, "seed:", 0)
        self.settings = one_of(PlannerSettings() if settings is None else settings, PlannerSettings, "settings:")
        self._relax, self._warm = truth(relax, "relax:"), truth(warm, "warm:")
        moving = robot if robot is not None else checker.robot if checker is not None else world.robot
        charges = Objective.of(objective, moving)
        if self._warm and moving is not None:
            warm_up_for(one_of(moving, Robot, "robot:", error=WorldError), world, charges)
        begin = perf_counter()
        checker = StateChecker(world, robot, clearance=clearance) if checker is None else checker
        self._landmarks, rng = landmarks, np.random.default_rng(self.seed)
        model = WorldModel(checker, rng, self.seed, self.settings, landmarks or 0, charges)
        self._models = WorldModels(world, model)
        self._updating = Lock()
        self._model.shared.build_seconds = perf_counter() - begin

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._warm_up("plan")

    def _warm_up(self, use: Use) -> None:
        """Compile what a use needs on a machine's first, before the limit of a query begins."""
        if self._warm:
            warm_up_for(self.robot, self.world, self._models.objective, use)

    @property
    def _model(self) -> WorldModel:
        return self._models.full

    @property
    def world(self) -> World:
        """The world that is planned in."""
        return self._models.world

    @property
    def robot(self) -> Robot:
        """The robot that is planned for."""
        return self._models.robot

    @property
    def checker(self) -> StateChecker:
        """The checker of configurations and motions."""
        return self._model.checker

    @property
    def motion(self) -> Motion:
        """How the robot moves."""
        return self._model.motion

    @property
    def roadmap(self) -> Roadmap:
        """The roadmap of the queries so far; ``roadmap.graph`` is a networkx graph."""
        return self._model.shared.roadmap

    @property
    def bound(self) -> LowerBound:
        """Proves lower bounds; its results are kept from query to query."""
        return self._model.bound

    @property
    def relaxation(self) -> Relaxation:
        """The relaxed problem's grid, kept from query to query."""
        return self._model.relaxation

    @as_raised
    def build(self, landmarks: int | None = None) -> Roadmap:
        """Spread landmarks over all free space, join them to the roadmap, and return it.

        Args:
            landmarks: number; default: as given to the planner, else 200.

        Raises:
            ConfigurationError: ``landmarks`` below 1, or no free space to place them in.
        """
        k = self._landmarks or 200 if landmarks is None else whole(landmarks, "landmarks:", 1, MAX_LANDMARKS)
        shared = self._model.shared
        with shared.lock:
            shared.place(k)
        return shared.roadmap

    @as_raised
    def plan(
        self,
        start: ArrayLike,
        goal: Ends,
        time_limit: float = 1.0,
        *,
        max_iterations: int | None = None,
        on_progress: OnProgress | None = None,
        stop: Callable[[], bool] | None = None,
        gap: float = GAP,
        escape: bool = False,
    ) -> PlanResult:
        """Return a path from start to goal, or why there is none.

        Args:
            start: configuration (x, y, theta), shape (3,).
            goal: configuration, shape (3,), or goals (:class:`~trailmark.Goal`) of which the cheapest is reached.
            time_limit: seconds; at most half go into spreading the planner's ``landmarks``, if that is not done yet.
                Kept to about 5 % or 20 ms, whichever is more.
            max_iterations: rounds of landmarks at most; with a generous time limit the answer then depends on
                the seed alone.
            on_progress: called after every step and with every better path.
            stop: called between steps; planning ends early once it returns True, as if the time were up.
            gap: end as soon as the path is proven to cost no more than (1 + gap) times the optimum; infinite: with the
                first path.
            escape: if the start is in collision (by an error of localisation, say), begin with the shortest way out,
                along which the robot never gets deeper.

        Raises:
            ConfigurationError: start or goal is not valid, the time limit is not above 0, or the gap is negative.
        """
        return self._plan(start, goal, time_limit, max_iterations, on_progress, stop, gap, escape)

    @as_raised
    def plan_through(
        self,
        start: ArrayLike,
        goals: Sequence[Ends],
        time_limit: float = 1.0,
        *,
        max_iterations: int | None = None,
        on_progress: OnProgress | None = None,
        stop: Callable[[], bool] | None = None,
        gap: float = GAP,
        escape: bool = False,
    ) -> PlanResult:
        """Return one path from start through via points in their order, or the leg that has none.

        Free headings are chosen together with the legs. ``cost`` and ``lower_bound`` are those of the whole path,
        ``legs`` has the result of each leg; ``reason`` names the leg that fails.

        Args:
            start: configuration (x, y, theta), shape (3,).
            goals: the via points, and last the goal: each a configuration, shape (3,), a position x, y with any
                heading, a goal (:class:`~trailmark.Goal`), or several goals, one of which is passed.
            time_limit: seconds for all legs together.
            max_iterations: rounds of landmarks at most, for each leg.
            on_progress: called after every step, and with every better whole path.
            stop: called between steps; planning ends early once it returns True, as if the time were up.
            gap: end as soon as the whole path is proven to cost no more than (1 + gap) times the optimum; infinite:
                with the first.
            escape: as of :meth:`plan`.

        Raises:
            ConfigurationError: no goals, a start or goal that is not valid, or an option out of range.
        """
        return self._plan(start, stops_of(goals), time_limit, max_iterations, on_progress, stop, gap, escape)

    @as_raised
    def plan_on_route(
        self, graph: nx.DiGraph, start: ArrayLike, goal: ArrayLike, time_limit: float = 1.0
    ) -> RouteResult:
        """Return the cheapest path over a route graph, and the edges along which the robot collides.

        The robot drives each edge in its direction and turns in place at nodes. Start and goal are joined to it.

        Args:
            graph: as :func:`trailmark.read_route_graph` reads it from GeoJSON.
            start: configuration (x, y, theta), shape (3,).
            goal: configuration, shape (3,).
            time_limit: seconds for joining start and goal.

        Raises:
            ConfigurationError: start or goal is not valid, the graph has no edge, or the robot is a car.
        """
        model, budget = self._model, Budget(_limits(time_limit, None)[0])
        with model.shared.lock:
            return plan_on_route(model, graph, start, goal, budget)

    def _plan(
        self,
        start: ArrayLike,
        goal: Ends | Stops,
        time_limit: float,
        max_iterations: int | None,
        on_progress: OnProgress | None,
        stop: Callable[[], bool] | None,
        gap: float,
        escape: bool,
    ) -> PlanResult:
        gap = number(gap, "gap:", minimum=0.0, infinite=True)
        seconds, rounds = _limits(time_limit, max_iterations)
        callback(on_progress, "on_progress:")
        callback(stop, "stop:")
        budget = Budget(seconds, stop=stop, rounds=rounds, gap=gap)
        how: dict[str, Any] = {"relax": self._relax, "escape": truth(escape, "escape:"), "on_progress": on_progress}
        return plan_explained(self._model, start, goal, budget, **how)

    @as_raised
    def update(self, changes: Changes | World) -> Update:
        """Update the planner for a world in which obstacles were added, removed or moved.

        The roadmap is kept and checked again near the changes. Queries that run in other threads see the old world,
        later queries the new one.

        Args:
            changes: the changes, or the new world (:meth:`trailmark.World.edited`), whose robot is ignored.

        Raises:
            WorldError: a change of an obstacle that is not in this world. The planner stays as it was.
        """
        one_of(changes, (Changes, World), "changes:", error=WorldError)
        self._warm_up("changes")
        with self._updating:
            self._models, update = self._models.updated(changes)
        # What only the new world needs: it may hold zones, or be a grid map.
        self._warm_up("changes")
        return update

    @as_raised
    def replan(
        self,
        start: ArrayLike,
        goal: Ends,
        path: Path,
        time_limit: float = 1.0,
        *,
        min_gain: float = 0.05,
        improvement: float = 0.0,
        escape: bool = False,
        speed: float | None = None,
    ) -> ReplanResult:
        """Return the path to follow from here, after a change of the world.

        The rest of the current path is kept while it is free and no known path is better by more than ``min_gain``. A
        blocked path is repaired; failing that, the query is planned anew. The result has ``kept`` and ``reason``; it is
        ``infeasible`` if the robot or the goal is in an obstacle.

        Args:
            start: the robot's configuration, shape (3,).
            goal: configuration, shape (3,), or goals, of which the path's own is kept while it can be reached.
            path: the path being followed, from its beginning or from here.
            time_limit: seconds to find a path.
            min_gain: share of its cost by which another path must be better to replace a free one.
            improvement: seconds for improving the path; to replace a free path, the improved one must be better by
                ``min_gain`` too.
            escape: if the robot is in an obstacle, begin with the shortest way out, along which it never gets deeper;
                without it there is no path then.
            speed: m/s; the robot reaches cost c of its path c / ``speed`` seconds from now, and is certified clear of
                moving obstacles at that time, up to their horizons (:mod:`.space_time`). Without it, and for cars, the
                regions that they sweep are occupied.

        Raises:
            ConfigurationError: start or goal is no configuration, or an option is out of range.
        """
        one_of(path, Path, "path:")
        self._warm_up("changes" if speed is None else "moving")
        options = ReplanOptions(
            deadline=perf_counter() + _limits(time_limit, None)[0],
            min_gain=number(min_gain, "min gain:", minimum=0.0),
            improvement=number(improvement, "improvement:", minimum=0.0, unit="s"),
            escape=truth(escape, "escape:"),
            speed=None if speed is None else number(speed, "speed:", above=0.0, unit="m/s"),
        )
        return replan(self._models, start, goal, path, options)

    @as_raised
    def plan_many(
        self,
        starts: ArrayLike,
        goals: ArrayLike | Sequence[Ends],
        time_limit: float = 1.0,
        *,
        workers: int = 1,
        max_iterations: int | None = None,
        bounds: bool = True,
        on_progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> list[PlanResult]:
        """Return the results of many queries, in their order; the roadmap is kept.

        Without a roadmap, one is first built over all free space, as dense as the world needs. Each query then takes
        milliseconds and leaves the roadmap unchanged; several threads may call one planner at once. Queries for which
        the roadmap has no path are planned by :meth:`plan`, one after the other, and let it grow. If no time limit is
        reached, the results depend on the seed and on earlier queries, not on ``workers``.

        The call takes at most n times the limit of a query. Half of that may go into building, which later calls
        continue. Queries without time left end with ``timeout``.

        Args:
            starts: configurations (x, y, theta), shape (n, 3).
            goals: one for each start: a configuration, a goal, or several goals, of which the cheapest is reached.
            time_limit: seconds for each query; n times that for all of them and the building.
            workers: threads; the compiled code runs in parallel.
            max_iterations: rounds of landmarks at most, for queries planned by :meth:`plan`.
            bounds: prove a lower bound for each query (about a millisecond each), if there is time to prepare for it;
                else the straight distance is reported.
            on_progress: called in this thread with the number of queries answered and of all; 0 and all while the
                roadmap is built.
            stop: called between steps; planning ends early once it returns True, as if the time were up.

        Raises:
            ConfigurationError: a start or goal is not valid, their numbers differ, or an option is out of range.
        """
        time_limit, max_iterations = _limits(time_limit, max_iterations)
        workers = min(whole(workers, "workers:", 1), MAX_WORKERS)
        callback(on_progress, "on_progress:")
        callback(stop, "stop:")
        if all(isinstance(q, Sized) and len(q) == 0 for q in (starts, goals)):
            return []
        self._warm_up("many")
        return plan_batch(
            self._model,
            starts,
            goals,
            time_limit,
            rounds=max_iterations,
            workers=workers,
            bounds=bounds,
            on_progress=on_progress,
            stop=stop,
        )


def _limits(time_limit: float, max_iterations: int | None) -> tuple[float, int | None]:
    """Return the limits of a query, checked."""
    seconds = number(time_limit, "time limit:", above=0.0, infinite=True, unit="s")
    return seconds, None if max_iterations is None else whole(max_iterations, "max iterations:", 1)
