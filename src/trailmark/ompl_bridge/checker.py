"""StateValidityChecker and MotionValidator: trailmark's collision checks as OMPL calls them."""

# Tested by tests/ompl_bridge/test_checker.py and test_curves.py.

from __future__ import annotations

from math import hypot, pi
from typing import Any

from ompl import base as ob

from trailmark.arguments import one_of
from trailmark.collision import StateChecker
from trailmark.heading import turn, wrapped
from trailmark.motion.pointwise import Configuration, PointwiseChecker
from trailmark.ompl_bridge.errors import BridgeError
from trailmark.ompl_bridge.guard import caught
from trailmark.ompl_bridge.ompl_curves import OmplCurves
from trailmark.ompl_bridge.spaces import require_within, space_of, steering_of
from trailmark.ompl_bridge.states import write_state
from trailmark.world import World

__all__ = ["MotionValidator", "StateValidityChecker", "checker_in", "updated_checker"]

LAST_PLACE = 1e-3
"""Metres that a point of the robot may move from the last place up to which a motion is certified to one beyond."""


class StateValidityChecker(ob.StateValidityChecker):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Validity and clearance of configurations, by trailmark's kernels, and by FCL where they leave it open.

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space within the world's bounds.
        checker: trailmark's checker for world and robot.

    Attributes:
        checked: states checked so far.

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

    def checkMotion(self, first: Any, second: Any, last_valid: Any = None) -> bool:  # noqa: N802  # OMPL's name
        """Return whether a motion is certified, its end included; its start is known to be valid.

        Args:
            first: start.
            second: end.
            last_valid: where to put how far a refused motion is certified: a pair of a state, or None, and a fraction.
                OMPL 1.7 passes it; OMPL 2.0 computes it without calling this method.
        """
        try:
            self.checked += 1
            ax, ay, at = first.getX(), first.getY(), first.getYaw()
            bx, by, bt = second.getX(), second.getY(), second.getYaw()
            if self._curves is not None:
                free = self._single.valid(bx, by, bt) and self._curves.certified(first, second)
            else:
                free = self._single.step_valid(ax, ay, at, bx, by, bt)
                if free and bt - at == -pi:
                    # Exactly half a turn back: OMPL turns clockwise, as trailmark does from b to a only.
                    free = self._single.motion_valid((bx, by, bt), (ax, ay, at))
            if free:
                return True
            if last_valid is not None:
                # The pair's state may be ``second`` itself, so it is written to last.
                q, last_valid.second = self._last_certified(first, second)
                if last_valid.first is not None:
                    write_state(last_valid.first, q)
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
        return False

    def _last_certified(self, first: Any, second: Any) -> tuple[Configuration, float]:
        """Return the farthest place found up to which a refused motion is certified, and its fraction."""
        a, b = ((q.getX(), q.getY(), q.getYaw()) for q in (first, second))
        dx, dy, turned = b[0] - a[0], b[1] - a[1], -pi if b[2] - a[2] == -pi else turn(a[2], b[2])
        bound = hypot(dx, dy) + self.checker.footprint.sweep_radius * abs(turned)
        if self._curves is not None:
            bound = self._curves.bound(first, second)
        last, low, high = a, 0.0, 1.0
        # A length that is no number ends it at once.
        while (high - low) * bound > LAST_PLACE:
            middle = 0.5 * (low + high)
            if self._curves is not None:
                # The curve to a place on a curve need not be a part of it, as OMPL computes it.
                q, free = self._curves.part(first, second, middle)
            else:
                q = (a[0] + middle * dx, a[1] + middle * dy, wrapped(a[2] + middle * turned))
                # What lies before ``last`` is certified already.
                free = self._single.valid(*q) and self._single.motion_valid(last, q)
            if free:
                last, low = q, middle
            else:
                high = middle
        return last, low


def updated_checker(checker: StateChecker, world: World | StateChecker, space: Any) -> StateChecker:
    """Return the checker of the same robot in another world.

    What a planner has built so far was checked in the world before: ``clear`` it.

    Args:
        checker: which is brought up to date (:meth:`trailmark.StateChecker.edited`).
        world: the other world, or a checker for it that is there already, for instance one that has been edited for
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
    try:
        found = owner.getStateValidityChecker()
    except TypeError:
        found = None  # OMPL 1.7 does not hand out every checker.
    if not isinstance(found, StateValidityChecker):
        raise BridgeError("expected a checker, or a trailmark StateValidityChecker that is set; got neither")
    return found.checker
