"""StateValidityChecker and MotionValidator: trailmark's collision checks as OMPL asks for them."""

from __future__ import annotations

from typing import Any

from ompl import base as ob

from trailmark.collision import StateChecker
from trailmark.collision.pointwise import PointwiseChecker
from trailmark.ompl_bridge.guard import caught
from trailmark.ompl_bridge.spaces import require_within, space_of

__all__ = ["MotionValidator", "StateValidityChecker"]


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

    Args:
        information: the ``SpaceInformation`` of an SE(2)-like space within the world's bounds.
        checker: trailmark's checker for world and robot.

    Attributes:
        checked: motions checked so far.

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

    def checkMotion(self, first: Any, second: Any, last_valid: Any = None) -> bool:  # noqa: N802  # OMPL's name
        """Return whether a motion is certified, its end included; its start is known to be valid.

        Args:
            first: start.
            second: end.
            last_valid: OMPL 1.7 hands over where to put the last valid state: (None or a state, fraction).
        """
        try:
            self.checked += 1
            a = (first.getX(), first.getY(), first.getYaw())
            b = (second.getX(), second.getY(), second.getYaw())
            return self._single.valid(*b) and self._single.motion_valid(a, b)
        except BaseException as error:  # nothing may pass through OMPL's C++
            caught(error)
            return False
