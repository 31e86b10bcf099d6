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

    A query goes through the stages of :mod:`trailmark.planning.pipeline`: what the roadmap does not answer is sought
    over lattices of configurations (not for cars), then in rounds of landmarks: the relaxed problem (the robot's
    inscribed disc on a grid) says where short paths are likely; valid configurations drawn there are clustered by
    K-means; the centres, repaired to valid configurations, join the roadmap; a lazy search finds the shortest path of
    certified motions. While there is none, each round draws from a wider band, in the end over all that the robot might
    reach: a path that exists with some room is found with probability one as time goes on. Then it is shortened, and
    further rounds look for other ways around, until the path settles or the time is up. A disc's shortest path is
    computed.

    A robot with a turning radius is a car: its roadmap is made of Reeds-Shepp curves, or Dubins curves if it does not
    reverse, a path is a :class:`trailmark.CurvePath`, and in tight places short drives lead on.

    A planner can be pickled and copied: the copy knows what the planner knows, and goes on in the same way.

    Args:
        world: obstacles and bounds.
        robot: footprint; the world's own robot if None.
        seed: the same seed gives the same paths, as long as no time limit cuts in; None draws one.
        landmarks: spread over all free space before the first query; by default none, every query places its own.
        clearance: metres that no configuration along a path comes nearer to anything than; the robot's own if None.
        relax: :meth:`plan` keeps as much of that as there is (:attr:`trailmark.PlanResult.clearance`).
        checker: one that is there already for this world and robot; without ``robot``, its robot counts.
        settings: numbers that a person may change; by default those that the benchmarks were run with.
        objective: what paths cost (:meth:`trailmark.Objective.of`); by default their length and a car's maneuvers.
        warm: load the compiled kernels now (:mod:`trailmark.planning.warmup`), so that no query pays for it.

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
        """The world that queries are answered in."""
        return self._models.world

    @property
    def robot(self) -> Robot:
        """The robot that moves in it."""
        return self._models.robot

    @property
    def checker(self) -> StateChecker:
        """Which configurations and motions are valid in it."""
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
        """Proves lower bounds; what it computes is kept from query to query."""
        return self._model.bound

    @property
    def relaxation(self) -> Relaxation:
        """The relaxed problem's grid, kept from query to query."""
        return self._model.relaxation

    @as_raised
    def build(self, landmarks: int | None = None) -> Roadmap:
        """Spread landmarks over all free space, join them to the roadmap, and return it.

        Args:
            landmarks: how many; by default as many as given to the planner, else 200.

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
            time_limit: seconds, half of which may go into landmarks that were asked for and are not spread yet; that
                and making the planner, which reads the world, are not counted in what a first path takes. Kept to
                about 5 % or 20 ms, whichever is more.
            max_iterations: rounds of landmarks at most; with a generous time limit the answer then depends on
                the seed alone.
            on_progress: called after every step and with every better path.
            stop: asked between steps whether to end early, as if the time were up.
            gap: end as soon as the path is proven to cost no more than (1 + gap) times the optimum; infinite: with the
                first path.
            escape: where the start is not free (a robot that is not quite where it is thought to be), begin with the
                shortest way out, along which it is never deeper in what it stands in.

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
        """Return one path from start through places in their order, or for which leg there is none.

        Headings that are left free are chosen together with the legs. ``cost`` and ``lower_bound`` are those of the
        whole path, ``legs`` has the answer for each leg; ``reason`` names the leg that fails.

        Args:
            start: configuration (x, y, theta), shape (3,).
            goals: the places, the last is the goal: each a configuration, shape (3,), a position x, y, which is passed
                with any heading, a goal (:class:`~trailmark.Goal`), or several goals of which any one is passed.
            time_limit: seconds for all legs together.
            max_iterations: rounds of landmarks at most, for each leg.
            on_progress: called after every step, and with every better whole path.
            stop: asked between steps whether to end early, as if the time were up.
            gap: end as soon as the whole path is proven to cost no more than (1 + gap) times the optimum; infinite:
                with the first.
            escape: as of :meth:`plan`.

        Raises:
            ConfigurationError: there are no places, start or a place is not valid, or an option is out of range.
        """
        return self._plan(start, stops_of(goals), time_limit, max_iterations, on_progress, stop, gap, escape)

    @as_raised
    def plan_on_route(
        self, graph: nx.DiGraph, start: ArrayLike, goal: ArrayLike, time_limit: float = 1.0
    ) -> RouteResult:
        """Return the cheapest path over a route graph drawn by hand, with the edges along which the robot collides.

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
        """Bring all that is known up to date with a world in which obstacles came, went or moved.

        The roadmap is kept, and looked at again where the changes reach. Queries that are under way in other threads
        see the world as it was, later ones the world as it is.

        Args:
            changes: what changed, or the world as it is now (:meth:`trailmark.World.edited`), its robot left aside.

        Raises:
            WorldError: a change of an obstacle that this world does not hold. Nothing is changed then.
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
        """Return the path to follow from here on, in a world that changed while another path was being followed.

        The rest of the path from where the robot is is kept while it is free and no other is known to be better by more
        than ``min_gain``. Where it is blocked it is led around; failing that, the query is planned anew. The result
        has ``kept`` and ``reason``; it is ``infeasible`` where the robot or the goal stands in an obstacle.

        Args:
            start: where the robot is, shape (3,).
            goal: configuration, shape (3,), or goals: the path's own end is kept as long as a path leads there.
            path: being followed, or the whole of it.
            time_limit: seconds to find a path.
            min_gain: share of its cost by which another path must be better to take the place of one that is free.
            improvement: seconds to go on bettering a path once there is one; another one still has to be better by
                ``min_gain`` to replace one that is free.
            escape: where the robot stands in an obstacle, begin with the shortest way out, along which it is never
                deeper in it; otherwise the answer only says so.
            speed: m/s: at cost c of its path the robot is c / ``speed`` s from now, certified clear of moving obstacles
                then, up to their horizons (:mod:`.space_time`). Without it, and for cars, what they sweep is occupied.

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
        """Return the answers to many queries, in their order; the roadmap is kept.

        Without a roadmap, one is built first that spreads over all free space, as dense as the world asks for. Each
        query is then answered on the roadmap as it is, in milliseconds, and changes nothing in it; several threads may
        ask one planner at once. Only queries that the roadmap does not answer are planned by :meth:`plan`, one after
        the other, which lets it grow. As long as no time limit cuts in, the answers depend on the seed and on what was
        asked before, not on ``workers``.

        The call takes n times the limit of a query at most. Half of that may go into building; what is not built by
        then is built by later calls. Queries that there is no time left for are answered with ``timeout``.

        Args:
            starts: configurations (x, y, theta), shape (n, 3).
            goals: as many; each may be a goal, or several of which the cheapest is reached, and is planned to then.
            time_limit: seconds for each query, and, times n, for all of them with what is built for them.
            workers: threads that answer queries; the compiled parts run side by side.
            max_iterations: rounds of landmarks at most, for the queries that the roadmap does not answer.
            bounds: prove a lower bound for each query, about a millisecond, where there is time to make that ready;
                else the straight distance is reported.
            on_progress: called in this thread with the number of queries answered and of all; 0 and all while the
                roadmap is built.
            stop: asked between steps whether to end early, as if the time were up.

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
