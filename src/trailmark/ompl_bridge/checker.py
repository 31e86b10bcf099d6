"""StateValidityChecker and MotionValidator: trailmark's collision checks as OMPL calls them."""

from __future__ import annotations

from collections.abc import Callable
from math import pi
from typing import Any

from ompl import base as ob

from trailmark.arguments import one_of
from trailmark.collision import StateChecker
from trailmark.motion.pointwise import PointwiseChecker
from trailmark.ompl_bridge.errors import BridgeError
from trailmark.ompl_bridge.guard import caught
from trailmark.ompl_bridge.ompl_curves import OmplCurves
from trailmark.ompl_bridge.spaces import require_within, space_of, steering_of
from trailmark.world import World

__all__ = ["MotionValidator", "StateValidityChecker", "checker_in", "updated_checker"]

WATCHED = 16
"""Checks from one call of ``watch`` to the next, for reading a clock takes a tenth of a check."""


class StateValidityChecker(ob.StateValidityChecker):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Validity and clearance of configurations, by trailmark's kernels, and by FCL where they leave it open.

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space within the world's bounds.
        checker: trailmark's checker for world and robot.

    Attributes:
        checked: states checked so far.
        watch: called now and then while states are checked.

    Raises:
        SpaceError: a space not made of x, y and heading.
        BoundsError: a space that reaches beyond the world.
    """

    def __init__(self, information: Any, checker: StateChecker) -> None:
        one_of(checker, StateChecker, "checker:")
        self._space = space_of(information)
        require_within(self._space, checker.world)
        super().__init__(information)
        self.checked = 0
        self.watch: Callable[[], None] | None = None
        self._single = PointwiseChecker(checker)

    @property
    def checker(self) -> StateChecker:
        """Trailmark's checker."""
        return self._single.checker

    def update(self, world: World | StateChecker) -> None:
        """Check in another world from now on: see :func:`updated_checker`."""
        self._single.update(updated_checker(self.checker, world, self._space))

    def isValid(self, state: Any) -> bool:  # noqa: N802  # OMPL's name
        """Return whether a state is valid."""
        try:
            self.checked += 1
            if self.watch is not None and not self.checked % WATCHED:
                self.watch()
            return self._single.valid(state.getX(), state.getY(), state.getYaw())
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return False

    def clearance(self, state: Any, *others: Any) -> float:
        """Return the distance (metres) to the nearest obstacle or bound."""
        try:
            return self._single.clearance(state.getX(), state.getY(), state.getYaw())
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return 0.0


class MotionValidator(ob.MotionValidator):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Motions certified free of collision: no resolution, nothing missed.

    The space decides what a motion is: straight in an ``SE2StateSpace``, a shortest curve in a ``DubinsStateSpace`` or
    ``ReedsSheppStateSpace``. Where several curves are as short, or rounding makes OMPL take a longer one, the curve
    that OMPL follows is identified and certified as well as trailmark's; if that fails, the motion is refused.

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space within the world's bounds.
        checker: trailmark's checker for world and robot.

    Attributes:
        checked: motions checked so far.
        watch: called now and then while motions are checked.
        steering: of the cars that the space is for; None if motions are straight.

    Raises:
        SpaceError: a space not made of x, y and heading, or a symmetric Dubins space.
        BoundsError: a space that reaches beyond the world.
    """

    def __init__(self, information: Any, checker: StateChecker) -> None:
        one_of(checker, StateChecker, "checker:")
        self._space = space_of(information)
        require_within(self._space, checker.world)
        super().__init__(information)
        self.checked = 0
        self.watch: Callable[[], None] | None = None
        self.steering = steering_of(information)
        self._single = PointwiseChecker(checker, self.steering)
        self._curves = None if self.steering is None else OmplCurves(information, self._single)

    @property
    def checker(self) -> StateChecker:
        """Trailmark's checker."""
        return self._single.checker

    def update(self, world: World | StateChecker) -> None:
        """Check in another world from now on: see :func:`updated_checker`."""
        self._single.update(updated_checker(self.checker, world, self._space))

    def checkMotion(self, first: Any, second: Any) -> bool:  # noqa: N802  # OMPL's name
        """Return whether a motion is certified, its end included; its start is known to be valid."""
        try:
            self.checked += 1
            if self.watch is not None and not self.checked % WATCHED:
                self.watch()
            ax, ay, at = first.getX(), first.getY(), first.getYaw()
            bx, by, bt = second.getX(), second.getY(), second.getYaw()
            if self._curves is not None:
                free = self._single.valid(bx, by, bt) and self._curves.certified(first, second)
            else:
                free = self._single.step_valid(ax, ay, at, bx, by, bt)
                if free and bt - at == -pi:
                    # Exactly half a turn back: OMPL turns clockwise, as trailmark does from b to a only.
                    free = self._single.motion_valid((bx, by, bt), (ax, ay, at))
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return False
        return free


def updated_checker(checker: StateChecker, world: World | StateChecker, space: Any) -> StateChecker:
    """Return the checker of the same robot in another world.

    What a planner has built so far was checked in the world before: ``clear`` it.

    Args:
        checker: whose robot it is (:meth:`trailmark.StateChecker.edited`).
        world: the other world, or a checker for it that is there already, for instance one that has been made for
            another of OMPL's parts.
        space: the state space that the parts were made for.

    Raises:
        BoundsError: a world that the space reaches beyond.
        ConfigurationError: a checker for another robot.
    """
    one_of(world, (World, StateChecker), "world:")
    if isinstance(world, World):
        require_within(space, world)
        return checker.edited(world)
    require_within(space, world.world)
    world.require_for(world.world, checker.robot)
    return world


def checker_in(owner: Any) -> StateChecker:
    """Return trailmark's checker of the ``StateValidityChecker`` in a ``SimpleSetup`` or ``SpaceInformation``.

    Raises:
        BridgeError: there is none of trailmark's.
    """
    found = owner.getStateValidityChecker()
    if not isinstance(found, StateValidityChecker):
        raise BridgeError("expected a checker, or a trailmark StateValidityChecker that is set; got neither")
    return found.checker
