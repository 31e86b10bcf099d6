"""WeightedBound: what every path costs at least under an objective (:class:`trailmark.motion.WeightedMotion`)."""

from __future__ import annotations

import numpy as np

from trailmark.goals import Goal
from trailmark.motion import Motion, WeightedMotion
from trailmark.planning.proofs.bound import Bound, LowerBound
from trailmark.planning.proofs.eikonal import Eikonal
from trailmark.se2 import ROTATION_WEIGHT, FloatArray

__all__ = ["WeightedBound", "lower_bound_of"]


class WeightedBound:
    """Lower bounds where a metre's cost differs from place to place; its methods are those of :class:`LowerBound`.

    A path of length L and rotation T costs at least ρ·L + r·T, ρ the least density anywhere and r the cost of a radian:
    at least min(ρ, r/w) times what it costs as length, L + w·T. The other bound is that of the densities on a
    grid (:mod:`.eikonal`). The larger of the two holds.

    Args:
        plain: lower bound on L + w·T.
        motion: weighted.
    """

    def __init__(self, plain: LowerBound, motion: WeightedMotion) -> None:
        self.plain, self.motion = plain, motion
        density = motion.density
        # A car's turning costs nothing by itself, and its plain bound is one on its length.
        car = motion.checker.robot.turning_radius is not None
        self._factor = density.least if car else min(density.least, density.rotation / ROTATION_WEIGHT)
        self._eikonal = Eikonal(motion)

    @property
    def ready(self) -> bool:
        """Whether a bound takes little time."""
        return self.plain.ready

    def of(
        self, start: FloatArray, goal: FloatArray, limit: float = np.inf, seconds: float = np.inf, left: float = np.inf
    ) -> Bound:
        """Return the bound for a query, given the cost of a known path."""
        found = self.plain.of(start, goal, limit / self._factor, seconds, left)
        if not np.isfinite(found.cost):
            return found
        return Bound(max(self._factor * found.cost, self._eikonal.of(start, goal)), found.path)

    def known(self, start: FloatArray, goal: FloatArray) -> float:
        """Return a lower bound on any path's cost that takes little time, from what is computed already."""
        return self._factor * self.plain.known(start, goal)

    def seconds(self, start: FloatArray, goal: FloatArray, limit: float = np.inf) -> float:
        """Return how long :meth:`of` is expected to take."""
        return self.plain.seconds(start, goal, limit / self._factor) + self._eikonal.seconds()

    def seconds_for_region(self) -> float:
        """Return how long :meth:`make_region` is expected to take; 0 if there is nothing to do."""
        return self.plain.seconds_for_region()

    def shuts_out(self, start: FloatArray, goal: Goal) -> bool:
        """Return whether it is proven that no path from a valid start, shape (3,), ends anywhere in a goal."""
        return self.plain.shuts_out(start, goal)

    def seconds_for_parts(self) -> float:
        """Return how long it is expected to take to make a disc's region in the whole world, whatever its radius."""
        return self.plain.seconds_for_parts()

    def make_region(self, left: float = np.inf) -> None:
        """Make the region of the whole world, by which :meth:`seconds` tells how large the parts are that matter."""
        self.plain.make_region(left)


def lower_bound_of(
    motion: Motion, before: LowerBound | WeightedBound | None = None, freed: FloatArray | None = None
) -> LowerBound | WeightedBound:
    """Return what proves lower bounds on the cost of paths.

    Args:
        motion: of the robot.
        before: what did so in a world that differs from the motion's in its obstacles.
        freed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed since, shape (f, 4).
    """
    checker = motion.checker
    if before is None or freed is None:
        plain = LowerBound(checker.world, checker.robot, checker.grid)
    else:
        known = before.plain if isinstance(before, WeightedBound) else before
        plain = known.edited(checker.world, checker.grid, freed)
    return WeightedBound(plain, motion) if isinstance(motion, WeightedMotion) else plain
