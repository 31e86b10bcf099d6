"""OmplCurves: certifies the curves that OMPL's Dubins and Reeds-Shepp spaces follow, whichever those are."""

from __future__ import annotations

from itertools import pairwise
from math import hypot, pi
from typing import Any

import numpy as np

from trailmark import se2
from trailmark.curves import Steering
from trailmark.motion.pointwise import TIE, CurveMarks, PointwiseChecker
from trailmark.ompl_bridge.states import configuration, state, states_of
from trailmark.se2 import FloatArray
from trailmark.touching import TOUCHING_TOLERANCE
from trailmark.trajectories import CurvePath

__all__ = ["OmplCurves", "followed_states"]

PARTS = (1, 2, 3, 4, 5, 7, 9, 12, 16, 23, 32)
"""Numbers of parts that a curve is divided into, one after the other, until OMPL follows it."""

LONGER = 1e-6
"""Metres that OMPL's curves may be longer than the path's by rounding."""

COMPARED = np.array([0.25, 0.5, 0.75])
"""Parts of a curve at which OMPL's and trailmark's are compared."""

ARC = 0.2
"""Radians on an arc between two states of a curve that trailmark would not take."""


class OmplCurves:
    """Certifies the curves that ``space.interpolate`` follows, whichever of the words they are.

    On nearly degenerate pairs (straight ahead, a single arc), OMPL's formulas lose the shortest word to rounding and
    take a longer one; of several that are as short it takes any. The bindings do not tell which one, but lengths do,
    and places on the curve.

    Args:
        information: the ``SpaceInformation`` of the space; only the space is stored.
        single: trailmark's checker for world and robot, with the steering of the cars that the space is for.
    """

    def __init__(self, information: Any, single: PointwiseChecker) -> None:
        self._space = information.getStateSpace()
        self._place = state(information, (0.0, 0.0, 0.0))
        self._single, self._marks = single, CurveMarks(single)
        sweep_radius, radius = single.checker.footprint.sweep_radius, self._marks.steering.radius
        self._reach = max(sweep_radius, radius)
        # The same place computed in another order differs by rounding.
        self._alike = TOUCHING_TOLERANCE + 2.0**-48 * max(abs(value) for value in single.checker.world.bounds)

    def certified(self, first: Any, second: Any) -> bool:
        """Return whether the curve that OMPL follows between two states known to be valid is certified.

        Trailmark's own curve between them, which may be another one, must be certified too.
        """
        a = (first.getX(), first.getY(), first.getYaw())
        b = (second.getX(), second.getY(), second.getYaw())
        own = self._marks.shortest(a, b)
        if own is None:
            return False
        length = self._space.distance(first, second)
        if abs(length - own[0]) <= TIE and self._passes(first, second, own[1]):
            return True
        return any(self._passes(first, second, marks) for marks in self._marks.others(a, b, length))

    def certified_states(self, information: Any, path: CurvePath) -> FloatArray | None:
        """Return states on a path whose curves are certified, such that OMPL's curves from state to state are too.

        These are the path's knots. Where OMPL follows another curve than the path's, which is longer or not certified,
        they are as many states on the path's curve, evenly spread, as make OMPL follow it.

        Args:
            information: the ``SpaceInformation`` of the space, which makes states.
            path: of the steering given.

        Returns:
            Shape (n, 3), or None if no number of states makes OMPL's curves certified.
        """
        rows = [path.knots[:1]]
        for a, b, length in zip(path.knots[:-1], path.knots[1:], path.curves.lengths, strict=True):
            chosen: FloatArray | None = None
            for parts in PARTS:
                part = path.steering.states(a, b, np.linspace(0.0, length, parts + 1))
                part[0], part[-1] = a, b
                made = [state(information, q) for q in part]
                pairs = list(pairwise(made))
                if all(self.certified(*pair) for pair in pairs):
                    as_short = sum(self._space.distance(*pair) for pair in pairs) <= length + LONGER
                    if as_short or chosen is None:
                        chosen = part
                    if as_short:
                        break
            if chosen is None:
                return None
            rows.append(chosen[1:])
        return np.concatenate(rows)

    def _passes(self, first: Any, second: Any, marks: list[list[float]]) -> bool:
        """Return whether OMPL's curve passes all marks, up to the depth that counts as touching."""
        place = self._place
        for fraction, x, y, theta in marks:
            self._space.interpolate(first, second, fraction, place)
            turned = abs(place.getYaw() - theta)
            beside = hypot(place.getX() - x, place.getY() - y) + self._reach * min(turned, abs(turned - 2.0 * pi))
            # Written this way, NaN does not pass.
            if not beside <= self._alike:
                return False
        return True


def followed_states(information: Any, path: Any, steering: Steering) -> FloatArray:
    """Return states, shape (n, 3), whose shortest curves are the curves that OMPL follows along a path.

    These are the path's states, and more of them on curves where OMPL takes another one than trailmark.

    Args:
        information: the ``SpaceInformation`` of a ``DubinsStateSpace`` or ``ReedsSheppStateSpace``.
        path: a ``PathGeometric`` in that space.
        steering: of the cars that the space is for.
    """
    space, place = information.getStateSpace(), state(information, (0.0, 0.0, 0.0))

    def followed(i: int, fractions: FloatArray) -> FloatArray:
        rows = []
        for fraction in fractions.tolist():
            space.interpolate(path.getState(i), path.getState(i + 1), fraction, place)
            rows.append(configuration(place))
        return np.array(rows).reshape(-1, 3)

    states = states_of(path)
    rows = [states[:1]]
    for i, (a, b) in enumerate(pairwise(states)):
        length = float(space.distance(path.getState(i), path.getState(i + 1)))
        own = steering.states(a, b, COMPARED * steering.lengths(a, b))
        if np.max(se2.distance(followed(i, COMPARED), own)) > LONGER * max(1.0, length):
            parts = int(np.ceil(length / (ARC * steering.radius)))
            rows.append(followed(i, np.arange(1, parts) / parts))
        rows.append(b[None])
    return np.concatenate(rows)
