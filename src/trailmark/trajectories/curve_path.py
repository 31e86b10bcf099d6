"""CurvePath: a path whose configurations are joined by a car's shortest curves, not by straight motions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import number, number_array, one_of
from trailmark.curves.steering import Curves, Steering
from trailmark.errors import ConfigurationError
from trailmark.motion import CurveMotion, Motion
from trailmark.trajectories.path import Path, fractions

__all__ = ["CurvePath", "path_of"]

SAGITTA, MAX_TURN = 1e-3, 0.1
"""Between two states of an arc: maximum distance (metres) of the chord from it, and maximum turn (radians)."""

CLOSE = 5e-8
"""Metres from an arc within which a chord is as free as the arc: half of the overlap that counts as touching."""

SAME = 1e-6
"""Share of its length, and metres, by which lengths of the same curve may differ, found from its two ends."""


@dataclass(frozen=True, eq=False, repr=False)
class CurvePath(Path):
    """A car's path: the shortest curve from each knot to the next.

    ``states`` follow the curves: all knots, all ends of the curves' pieces (among them the cusps, where the driving
    direction changes), and between those as many as it takes for the straight lines from state to state to lie within
    1 mm of the arcs. The planner's paths have more where these straight lines would come upon an obstacle
    (:meth:`refined`).

    Attributes:
        states: shape (n, 3), n >= the number of knots. Read-only.
        knots: shape (k, 3), k >= 1; metres and radians. Read-only.
        steering: turning radius, and whether the car reverses.
        places: of the states, metres along the path, shape (n,), rising from 0 to the path's length. Read-only. None to
            have them chosen as above.

    Raises:
        ConfigurationError: knots or places of another shape, values that are not finite, or places that do not rise
            from 0 to the length.
    """

    states: se2.FloatArray = field(init=False)
    knots: se2.FloatArray
    steering: Steering
    places: se2.FloatArray = None  # type: ignore[assignment]  # known once it is made

    def __post_init__(self) -> None:
        one_of(self.steering, Steering, "path: steering:")
        knots = Path(self.knots).states
        object.__setattr__(self, "knots", knots)
        places = self._places(SAGITTA) if self.places is None else self._checked(self.places)
        places.setflags(write=False)
        object.__setattr__(self, "places", places)
        object.__setattr__(self, "states", self._rows(places))
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
        gaps = np.diff(self.places)
        count = np.maximum(1, np.ceil(gaps / self._checked_step(step))).astype(np.intp)
        gap = np.repeat(np.arange(len(count)), count)
        before = np.cumsum(count) - count
        within = (np.arange(len(gap)) - before[gap]) / count[gap]
        return Path(self._rows(np.append(self.places[gap] + within * gaps[gap], self.places[-1])))

    def polyline(self, sagitta: float) -> Path:
        """Return a plain path whose straight motions are at most ``sagitta`` metres off the curves.

        Raises:
            ConfigurationError: a distance that is not a finite number above 0.
        """
        return Path(self._rows(self._places(number(sagitta, "polyline: sagitta", above=0.0))))

    def refined(self, free: Callable[[se2.FloatArray, se2.FloatArray], NDArray[np.bool_]]) -> CurvePath:
        """Return the path with more states on arcs, so that whoever joins them by straight lines is free too.

        Motions that are not free are halved until they are, or lie within 0.05 µm of an arc that is.

        Args:
            free: tells which straight motions between states, each of shape (n, 3), are free.
        """
        places = self.places
        while True:
            middle = 0.5 * (places[:-1] + places[1:])
            coarse = np.diff(places) ** 2 > 8.0 * CLOSE * self.steering.radius
            coarse[coarse] = self._turns(middle[coarse])
            states = self._rows(places)
            coarse[coarse] = ~free(states[:-1][coarse], states[1:][coarse])
            if not coarse.any():
                return self if places is self.places else CurvePath(self.knots, self.steering, places)
            places = np.insert(places, np.flatnonzero(coarse) + 1, middle[coarse])

    def reversed(self) -> CurvePath:
        """Return the path driven back from its end to its start; it has the same length.

        Raises:
            ConfigurationError: the car does not drive backwards.
        """
        if not self.steering.reverse:
            raise ConfigurationError(
                "reversed: expected the path of a car that reverses, got one of a car that does not"
            )
        return CurvePath(self.knots[::-1], self.steering, self.places[-1] - self.places[::-1])

    def record(self) -> dict[str, Any]:
        """Return what a program needs to rebuild the curves and states, as plain numbers, strings and lists."""
        return {
            "kind": self.steering.kind,
            "turning_radius": self.steering.radius,
            "knots": self.knots.tolist(),
            "places": self.places.tolist(),
        }

    def _checked(self, places: ArrayLike) -> se2.FloatArray:
        """Return a copy of places that were given; raise a ConfigurationError if they cannot be the path's."""
        given = number_array(places, "path: places").copy()
        if given.ndim != 1 or not len(given) or given[0] != 0.0 or (np.diff(given) < 0.0).any():
            raise ConfigurationError("path: places: expected numbers, shape (n,), that rise from 0")
        if not abs(given[-1] - self.length) <= SAME * (1.0 + self.length):
            raise ConfigurationError(f"path: places: expected {self.length:g} m at the end, got {given[-1]:g}")
        given[-1] = self._ends[-1]
        return np.asarray(np.minimum(given, self._ends[-1]))

    def _places(self, sagitta: float) -> se2.FloatArray:
        """Return places (metres along the path, rising) between which chords are at most ``sagitta`` m off arcs."""
        radius = self.steering.radius
        arc = radius * min(MAX_TURN, sqrt(8.0 * sagitta / radius))
        places = [np.zeros(1)]
        for i, lengths in enumerate(np.abs(self.curves.signed_lengths)):
            begin, end = self._ends[i : i + 2]
            for side, length in zip(self.curves.sides[i], lengths, strict=True):
                if length > 0.0:
                    n = max(1, int(np.ceil(length / arc))) if side else 1
                    # Rounding must not lead beyond the knot: of some pieces there is hardly more than that.
                    places.append(np.minimum(begin + length * np.arange(1, n + 1) / n, end))
                    begin += length
            places[-1][-1] = end
        if len(self.knots) > 1 and self._ends[-1] == 0.0:
            places.append(np.zeros(1))
        return np.concatenate(places)

    @cached_property
    def _ends(self) -> se2.FloatArray:
        """How far along the path (metres) each knot is, shape (k,)."""
        return np.concatenate([[0.0], np.cumsum(self.curves.lengths)])

    def _turns(self, where: se2.FloatArray) -> NDArray[np.bool_]:
        """Return whether the path turns ``where`` (m,) metres along it, shape (m,)."""
        ends = np.cumsum(np.abs(self.curves.signed_lengths))
        piece = np.minimum(np.searchsorted(ends, where), len(ends) - 1)
        return np.asarray(self.curves.sides.ravel()[piece] != 0)

    def _rows(self, places: se2.FloatArray) -> se2.FloatArray:
        """Return the states (n, 3) at places (n,) that rise from the path's start to its end, which are knots."""
        rows = self._on_curves(places)
        # Knots a rounding apart are at the same place.
        rows[-1] = self.knots[-1]
        return rows

    def _on_curves(self, where: se2.FloatArray) -> se2.FloatArray:
        """Return the states, shape (m, 3), ``where`` (m,) metres along the path."""
        if len(self.knots) == 1:
            return np.repeat(self.knots, len(where), axis=0)
        ends = self._ends
        knot = np.searchsorted(ends, where, side="right") - 1
        curve = np.minimum(knot, len(ends) - 2)
        along = (where - ends[curve])[:, None]
        found = self.steering.states(self.knots[curve], self.knots[curve + 1], along)[:, 0]
        # Knots themselves, without rounding.
        exact = (ends[knot] == where) | (knot > curve)
        found[exact] = self.knots[knot[exact]]
        found[where == 0.0] = self.knots[0]
        return found


def path_of(motion: Motion, states: se2.FloatArray) -> Path:
    """Return the path that a kind of motion drives over states, shape (n, 3); a car's has them as its knots."""
    driven = motion.driven(states)
    return CurvePath(driven, motion.steering) if isinstance(motion, CurveMotion) else Path(driven)
