"""SE2Problem and simple_setup: a world, a robot and a query as OMPL plans with them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from ompl import geometric as og

from trailmark import se2
from trailmark.arguments import brief, number, one_of, truth
from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError, WorldError
from trailmark.motion import motion_of
from trailmark.motion.one_way import straight_valid
from trailmark.ompl_bridge.checker import MotionValidator, StateValidityChecker, updated_checker
from trailmark.ompl_bridge.guard import solve
from trailmark.ompl_bridge.ompl_curves import followed_states
from trailmark.ompl_bridge.planners import planner_named
from trailmark.ompl_bridge.spaces import space_for
from trailmark.ompl_bridge.states import planner_data_graph, state, states_of
from trailmark.trajectories import CurvePath, Path
from trailmark.world import Query, Robot, World

__all__ = ["SE2Problem", "simple_setup"]

Ends = Query | str | tuple[ArrayLike, ArrayLike] | None


class SE2Problem:
    """A planning problem for OMPL: space with bounds, checker, motion validator, start and goal.

    A robot with a turning radius moves in OMPL's Reeds-Shepp space, or in its Dubins space if it does not reverse.

    Args:
        world: obstacles and bounds.
        robot: footprint; the world's own robot if None.
        query: a query or its name, a pair (start, goal) of configurations, or None for the world's first query.
        checker: one that is there already for this world and robot.
        certified: whether motions are certified by trailmark; False leaves them to OMPL's discrete validator.
        resolution: metres between the states that OMPL's discrete validator looks at; OMPL's default of 1 % of the
            space's extent if None.

    Attributes:
        setup: the configured ``SimpleSetup``.
        information: its ``SpaceInformation``.
        space: its state space.
        checker: trailmark's checker.
        start: shape (3,).
        goal: shape (3,).

    Raises:
        WorldError: no robot, or no query of that name.
        ConfigurationError: start or goal is not valid.
    """

    def __init__(
        self,
        world: World,
        robot: Robot | None = None,
        query: Ends = None,
        *,
        checker: StateChecker | None = None,
        certified: bool = True,
        resolution: float | None = None,
    ) -> None:
        self.world = one_of(world, World, "world:", hint=" (World.load reads one)", error=WorldError)
        if checker is not None:
            one_of(checker, StateChecker, "checker:").require_for(world, robot)
        self.checker = StateChecker(world, robot) if checker is None else checker
        start, goal = _ends(world, query)
        self.start = self.checker.require_valid(start, "start")
        self.goal = self.checker.require_valid(goal, "goal")
        self.space = space_for(world, self.checker.robot)
        self.setup = og.SimpleSetup(self.space)
        self.information = self.setup.getSpaceInformation()
        self.validity = StateValidityChecker(self.information, self.checker)
        self.setup.setStateValidityChecker(self.validity)
        self.motions: MotionValidator | None = None
        if truth(certified, "certified:"):
            self.motions = MotionValidator(self.information, self.checker)
            self.information.setMotionValidator(self.motions)
        if resolution is not None:
            resolution = number(resolution, "resolution:", above=0.0, unit="m")
            self.information.setStateValidityCheckingResolution(resolution / self.space.getMaximumExtent())
        self.setup.setStartAndGoalStates(state(self.information, self.start), state(self.information, self.goal))

    def update(self, world: World) -> None:
        """Plan in another world from now on, with the same space; start and goal stay, and may no longer be valid.

        What the planner has built is cleared, since its motions were checked in the world before; a
        :class:`~trailmark.ompl_bridge.OmplLandmarkPlanner` keeps what is still true of its roadmap. Landmarks that were
        plugged in (:func:`~trailmark.ompl_bridge.plug_landmark_sampler`) are to be plugged in again.

        Args:
            world: obstacles, boundary, and bounds that the space lies within.

        Raises:
            BoundsError: the space reaches beyond the world. Nothing is changed then.
        """
        checker = updated_checker(self.checker, world, self.space)
        self.validity.update(checker)
        if self.motions is not None:
            self.motions.update(checker)
        self.world, self.checker = world, checker
        self.setup.clear()

    def set_planner(self, planner: Any) -> Any:
        """Use a planner, given itself or by name, and return it.

        Raises:
            PlannerNameError: a name that the installed OMPL does not have.
        """
        made = planner_named(planner, self.information) if isinstance(planner, str) else planner
        self.setup.setPlanner(made)
        return made

    def solve(self, limit: Any = 1.0) -> Any:
        """Run the planner for ``limit`` seconds (or until a ``PlannerTerminationCondition``); return its status.

        An exception in a callback, or Ctrl-C, ends the planning and is raised here.
        """
        return solve(self.setup, limit)

    @property
    def path(self) -> Path | None:
        """The exact solution's path, or None; a car's is a :class:`trailmark.CurvePath`.

        None too where motions are to be certified and one of its is not: PRM takes edges both ways, and no planner of
        OMPL's asks for the direction in which one-way zones are travelled.
        """
        if not self.setup.haveExactSolutionPath():
            return None
        path = self.path_of(self.setup.getSolutionPath())
        if self.motions is None:
            return path
        vertices = path.knots if isinstance(path, CurvePath) else path.states
        certified = motion_of(self.checker).motions_valid(vertices[:-1], vertices[1:])
        return path if np.all(certified) else None

    def path_of(self, path: Any) -> Path:
        """Return one of OMPL's paths in this problem's space; a car's as OMPL drives it."""
        steering = Steering.of(self.checker.robot)
        if steering is None:
            return Path(states_of(path))
        curves = CurvePath(followed_states(self.information, path, steering), steering)
        return curves.refined(straight_valid(self.checker))

    def graph(self) -> Any:
        """Return the planner's roadmap or tree as a ``networkx.Graph``."""
        return planner_data_graph(self.setup)


def simple_setup(world: World, robot: Robot | None = None, query: Ends = None, **options: Any) -> Any:
    """Return a configured ``SimpleSetup``; run it with :func:`trailmark.ompl_bridge.solve`.

    Args:
        world: obstacles and bounds.
        robot: footprint; the world's own robot if None.
        query: a query or its name, a pair (start, goal), or None for the world's first query.
        options: further ones of :class:`SE2Problem`.
    """
    return SE2Problem(world, robot, query, **options).setup


def _ends(world: World, query: Ends) -> tuple[se2.FloatArray, se2.FloatArray]:
    if query is None or isinstance(query, str):
        query = world.query(query)
    ends: Any = (query.start, query.pose()) if isinstance(query, Query) else query
    if not (isinstance(ends, Sequence | np.ndarray) and len(ends) == 2):
        raise ConfigurationError(f"query: expected a Query, its name, or start and goal, got {brief(query)}")
    start, goal = ends
    return se2.configurations(start, name="start"), se2.configurations(goal, name="goal")
