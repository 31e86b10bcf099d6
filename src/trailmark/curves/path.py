"""CurvePath: a path whose configurations are joined by a car's shortest curves, not by straight motions."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import number, one_of
from trailmark.curves.steering import Curves, Steering
from trailmark.errors import ConfigurationError
from trailmark.path import Path, fractions

__all__ = ["CurvePath"]

SAGITTA, MAX_TURN = 1e-3, 0.1
"""Between two states of an arc: maximum distance (metres) of the chord from it, and maximum turn (radians)."""


@dataclass(frozen=True, eq=False, repr=False)
class CurvePath(Path):
    """A car's path: the shortest curve from each knot to the next.

    ``states`` follow the curves: all knots, all ends of the curves' pieces (among them the cusps, where the driving
    direction changes), and between those as many as it takes for the straight lines from state to state to lie within
    1 mm of the arcs. What is certified are the curves, not those straight lines.

    Attributes:
        states: shape (n, 3), n >= the number of knots. Read-only.
        knots: shape (k, 3), k >= 1; metres and radians. Read-only.
        steering: turning radius, and whether the car reverses.

    Raises:
        ConfigurationError: knots of another shape, or values that are not finite.
    """

    states: se2.FloatArray = field(init=False)
    knots: se2.FloatArray
    steering: Steering

    def __post_init__(self) -> None:
        one_of(self.steering, Steering, "path: steering:")
        knots = Path(self.knots).states
        object.__setattr__(self, "knots", knots)
        object.__setattr__(self, "states", self._rows(self._places(SAGITTA)))
        super().__post_init__()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, CurvePath):
            # A path of straight motions through the same states is another path.
            return False if isinstance(other, Path) else NotImplemented
        return self.steering == other.steering and np.array_equal(self.knots, other.knots)

    def __hash__(self) -> int:
        # Adding 0 turns -0.0 to 0.0: the two are equal, so that their hashes must be, too.
        return hash(((self.knots + 0.0).tobytes(), self.steering))

    @cached_property
    def curves(self) -> Curves:
        """The curves from knot to knot."""
        return self.steering.curves(self.knots[:-1], self.knots[1:])

    @property
    def length(self) -> float:
        """Distance that the reference point travels along the curves, in metres."""
        return float(self.curves.lengths.sum())

    @property
    def rotation(self) -> float:
        """Total turning, Σ |Δθ|, in radians."""
        curves = self.curves
        return float(np.abs(curves.signed_lengths[curves.sides != 0]).sum() / self.steering.radius)

    @property
    def cost(self) -> float:
        """The curves' length, in metres: the sum of the distances in OMPL's Dubins or Reeds-Shepp state space."""
        return self.length

    @property
    def cusps(self) -> int:
        """How many times the driving direction changes."""
        lengths = self.curves.signed_lengths
        return int(np.count_nonzero(np.diff(np.sign(lengths[lengths != 0.0]))))

    @property
    def reverse_length(self) -> float:
        """Distance that the car drives backwards, in metres."""
        return float(np.maximum(-self.curves.signed_lengths, 0.0).sum())

    def at(self, fraction: ArrayLike) -> se2.FloatArray:
        """Return the configurations at fractions of the length along the path.

        Args:
            fraction: values in [0, 1], shape (m,) or a scalar; values outside are clipped.

        Returns:
            Shape (m, 3), or (3,) for a scalar.
        """
        where = np.clip(fractions(fraction), 0.0, 1.0) * self.length
        return self._on_curves(where.ravel()).reshape(*where.shape, 3)

    def resample(self, step: float) -> Path:
        """Return states on the curves at most ``step`` metres apart as a plain path, the present states among them.

        Raises:
            ConfigurationError: a step that is no finite number above 0, or that makes more than a million states.
        """
        return Path(self._rows(self._places(SAGITTA, self._checked_step(step))))

    def polyline(self, sagitta: float) -> Path:
        """Return a plain path whose straight motions are at most ``sagitta`` metres off the curves.

        Raises:
            ConfigurationError: a distance that is not a finite number above 0.
        """
        return Path(self._rows(self._places(number(sagitta, "polyline: sagitta", above=0.0))))

    def reversed(self) -> CurvePath:
        """Return the path driven back from its end to its start; it has the same length.

        Raises:
            ConfigurationError: the car does not drive backwards.
        """
        if not self.steering.reverse:
            raise ConfigurationError(
                "reversed: expected the path of a car that reverses, got one of a car that does not"
            )
        return CurvePath(self.knots[::-1], self.steering)

    def record(self) -> dict[str, Any]:
        """Return what a program needs to rebuild the curves, as plain numbers, strings and lists."""
        return {"kind": self.steering.kind, "turning_radius": self.steering.radius, "knots": self.knots.tolist()}

    def _places(self, sagitta: float, step: float = np.inf) -> list[se2.FloatArray]:
        """Return for each curve the arc lengths (metres) of its states, the last one at its end."""
        radius = self.steering.radius
        arc = min(step, radius * min(MAX_TURN, sqrt(8.0 * sagitta / radius)))
        places = []
        for sides, lengths in zip(self.curves.sides, np.abs(self.curves.signed_lengths), strict=True):
            ends = np.cumsum(lengths)
            pieces = [np.zeros(0)]
            for side, end, length in zip(sides, ends, lengths, strict=True):
                if length > 0.0:
                    n = max(1, int(np.ceil(length / (arc if side else step))))
                    pieces.append(end - length + length * np.arange(1, n + 1) / n)
            places.append(np.concatenate(pieces))
        return places

    def _rows(self, places: list[se2.FloatArray]) -> se2.FloatArray:
        """Return the states at the places along each curve, with the knots themselves at the curves' ends."""
        rows = [self.knots[:1]]
        for i, along in enumerate(places):
            if len(along) > 1:
                rows.append(self.steering.states(self.knots[i], self.knots[i + 1], along[:-1]))
            rows.append(self.knots[i + 1 : i + 2])
        return np.concatenate(rows)

    def _on_curves(self, where: se2.FloatArray) -> se2.FloatArray:
        """Return the states, shape (m, 3), ``where`` (m,) metres along the path."""
        if len(self.knots) == 1:
            return np.repeat(self.knots, len(where), axis=0)
        ends = np.cumsum(self.curves.lengths)
        curve = np.clip(np.searchsorted(ends, where, side="right"), 0, len(ends) - 1)
        before = np.concatenate([[0.0], ends[:-1]])[curve]
        found = self.steering.states(self.knots[curve], self.knots[curve + 1], (where - before)[:, None])[:, 0]
        # The end itself, without rounding.
        found[where >= ends[-1]] = self.knots[-1]
        return found
