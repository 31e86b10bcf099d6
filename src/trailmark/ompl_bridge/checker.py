"""StateValidityChecker and MotionValidator: trailmark's collision checks as OMPL asks for them."""

from __future__ import annotations

from math import hypot, pi
from typing import Any

from ompl import base as ob

from trailmark.collision import StateChecker
from trailmark.collision.pointwise import PointwiseChecker
from trailmark.collision.pointwise_curves import PointwiseCurveChecker
from trailmark.heading import turn, wrapped
from trailmark.ompl_bridge.guard import caught
from trailmark.ompl_bridge.spaces import require_within, space_of, steering_of
from trailmark.ompl_bridge.states import write_state

__all__ = ["MotionValidator", "StateValidityChecker"]

Configuration = tuple[float, float, float]

LAST_PLACE = 1e-3
"""Metres that a point of the robot may move between the last certified place of a motion and one that is not."""


class StateValidityChecker(ob.StateValidityChecker):  # type: ignore[misc]  # OMPL's bindings carry no types
    """Validity and clearance of configurations, by FCL with trailmark's kernels in front of it.

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
        require_within(space_of(information), checker.world)
        super().__init__(information)
        self.checker = checker
        self.checked = 0
        self._single = PointwiseChecker(checker)

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
    ``ReedsSheppStateSpace``. Where several curves are as short, all of them must be free, whichever OMPL follows.

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
        require_within(space_of(information), checker.world)
        super().__init__(information)
        self.checker = checker
        self.checked = 0
        self.steering = steering_of(information)
        self._single = (
            PointwiseChecker(checker) if self.steering is None else PointwiseCurveChecker(checker, self.steering)
        )

    def checkMotion(self, first: Any, second: Any, last_valid: Any = None) -> bool:  # noqa: N802  # OMPL's name
        """Return whether a motion is certified, its end included; its start is known to be valid.

        Args:
            first: start.
            second: end.
            last_valid: where to put how far a refused motion is certified: a pair of a state, or None, and a fraction.
                OMPL 1.7 hands it over; OMPL 2.0 asks for it without coming here.
        """
        try:
            self.checked += 1
            ax, ay, at = first.getX(), first.getY(), first.getYaw()
            bx, by, bt = second.getX(), second.getY(), second.getYaw()
            if bt - at == -pi and self.steering is None:
                # Exactly half a turn back: OMPL turns clockwise, as trailmark does from b to a.
                return self._single.valid(bx, by, bt) and self._single.motion_valid((bx, by, bt), (ax, ay, at))
            if self._single.step_valid(ax, ay, at, bx, by, bt):
                return True
            if last_valid is not None:
                a, b = (ax, ay, at), (bx, by, bt)
                # The pair's state may be ``second`` itself, which was read above.
                q, last_valid.second = self._last_certified(a, b)
                if last_valid.first is not None:
                    write_state(last_valid.first, q)
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
        return False

    def _last_certified(self, a: Configuration, b: Configuration) -> tuple[Configuration, float]:
        """Return the farthest place up to which a refused motion is certified, within LAST_PLACE, and its fraction."""
        dx, dy, shorter = b[0] - a[0], b[1] - a[1], turn(a[2], b[2])
        radius, steering = self.checker.footprint.sweep_radius, self.steering
        bound = hypot(dx, dy) + radius * abs(shorter)
        if steering is not None:
            bound = steering.lengths(a, b) * (1.0 + radius / steering.radius)
        last, low, high = a, 0.0, 1.0
        while (high - low) * bound > LAST_PLACE:
            middle = 0.5 * (low + high)
            if steering is None:
                q = (a[0] + middle * dx, a[1] + middle * dy, wrapped(a[2] + middle * shorter))
            else:
                q = tuple(steering.states(a, b, [middle * steering.lengths(a, b)])[0].tolist())
            # What lies before ``last`` is certified already.
            if self._single.valid(*q) and self._single.motion_valid(last, q):
                last, low = q, middle
            else:
                high = middle
        return last, low
