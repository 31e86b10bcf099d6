"""PathObjective: trailmark's objectives and zones, for OMPL's planners and for the landmark planner in OMPL."""

from __future__ import annotations

from typing import Any

import numpy as np
from ompl import base as ob

from trailmark.arguments import one_of
from trailmark.collision import StateChecker
from trailmark.motion import motion_of
from trailmark.ompl_bridge.checker import checker_in
from trailmark.ompl_bridge.guard import returns_on_error
from trailmark.ompl_bridge.spaces import steering_of
from trailmark.ompl_bridge.states import configuration
from trailmark.world.objective import Objective

__all__ = ["PathObjective"]


class PathObjective(ob.OptimizationObjective):  # type: ignore[misc]  # OMPL's bindings carry no types
    """What motions cost under an objective, zones included; straight ones, or curves in a car's space.

    OMPL's planners add the costs of motions up: a car's changes of direction where two of them meet are not charged.
    PRM and PRM* of OMPL 2.0 wait for Python for ever with an objective written in it; RRT*, BIT* and others take it.

    Args:
        information: the ``SpaceInformation`` of one of trailmark's spaces.
        objective: as :meth:`trailmark.Objective.of` takes it.
        checker: gives world and robot; by default that of the ``StateValidityChecker`` in ``information``.
    """

    def __init__(self, information: Any, objective: Objective | str, checker: StateChecker | None = None) -> None:
        super().__init__(information)
        own = checker_in(information) if checker is None else one_of(checker, StateChecker, "checker:")
        self.objective = Objective.of(objective)
        self.motion = motion_of(own, steering_of(information), self.objective)

    @returns_on_error(ob.Cost(np.inf))
    def stateCost(self, state: Any) -> Any:  # noqa: N802  # OMPL's name
        """Return 0: it is motions that cost."""
        return ob.Cost(0.0)

    @returns_on_error(ob.Cost(np.inf))
    def motionCost(self, a: Any, b: Any) -> Any:  # noqa: N802  # OMPL's name
        """Return the cost of the motion between two states."""
        start, goal = configuration(a), configuration(b)
        cost = float(self.motion.costs(*self.motion.ends(start, goal)[:, None])[0])
        return ob.Cost(self.motion.whole_cost(cost, start, goal))

    @returns_on_error(ob.Cost(np.inf))
    def motionCostHeuristic(self, a: Any, b: Any) -> Any:  # noqa: N802  # OMPL's name
        """Return a lower bound on the cost of a path between two states."""
        return ob.Cost(self.motion.least_cost(configuration(a), configuration(b)))
