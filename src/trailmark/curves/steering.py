"""Steering: on what curves a car-like robot drives, and the shortest ones between configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import number, number_array, one_of, truth
from trailmark.errors import ConfigurationError
from trailmark.world import Robot

__all__ = ["Curves", "Steering"]


class Curves(NamedTuple):
    """n curves, each of five pieces at most; pieces of length 0 do not count.

    Attributes:
        sides: (n, 5) int8: 1 arc to the left, 0 straight, -1 arc to the right.
        ways: (n, 5), metres driven on each piece, negative: backwards.
    """

    sides: NDArray[np.int8]
    ways: se2.FloatArray

    @property
    def lengths(self) -> se2.FloatArray:
        """Length of each curve, metres, shape (n,)."""
        return np.asarray(np.abs(self.ways).sum(axis=1))

    def names(self) -> list[str]:
        """Return what each curve is made of, such as ``L+S+R-``: side and direction of its pieces."""
        rows = zip(self.sides.tolist(), self.ways.tolist(), strict=True)
        return ["".join("SLR"[side] + "-+"[way > 0.0] for side, way in zip(*row, strict=True) if way) for row in rows]


@dataclass(frozen=True)
class Steering:
    """A car's: it drives straight ahead or on circles, and backwards too if it reverses.

    The reference point moves along the heading. The shortest curves are those of Reeds and Shepp for a car that
    reverses (:mod:`trailmark.curves.reeds_shepp`), else those of Dubins (:mod:`trailmark.curves.dubins`). Where
    several are as short, the same one is always taken; that of a car that reverses is the same one both ways.

    Attributes:
        radius: of the smallest circle that the reference point can drive on, metres.
        reverse: whether the car drives backwards too.

    Raises:
        ConfigurationError: a radius that is not a finite number above 0.
    """

    radius: float
    reverse: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", number(self.radius, "turning radius", above=0.0, unit="m"))
        object.__setattr__(self, "reverse", truth(self.reverse, "reverse:"))

    @classmethod
    def of(cls, robot: Robot) -> Steering | None:
        """Return a robot's steering; None if it moves in every direction."""
        one_of(robot, Robot, "steering: robot:")
        return None if robot.turning_radius is None else cls(robot.turning_radius, robot.reverse)

    @property
    def kind(self) -> Literal["dubins", "reeds-shepp"]:
        """Name of the curves."""
        return "reeds-shepp" if self.reverse else "dubins"

    def lengths(self, a: ArrayLike, b: ArrayLike) -> Any:
        """Return the lengths (metres) of the shortest curves from a to b.

        Args:
            a: shape (3,) or (n, 3).
            b: likewise.

        Returns:
            float for two configurations, else shape (n,).
        """
        from trailmark.curves.shortest import curve_lengths

        starts, ends = _pairs(a, b)
        found = curve_lengths(starts, ends, self.radius, self.reverse)
        return found if max(np.ndim(a), np.ndim(b)) == 2 else float(found[0])

    def curves(self, a: ArrayLike, b: ArrayLike) -> Curves:
        """Return the shortest curves from a to b, each of shape (3,) or (n, 3)."""
        from trailmark.curves.shortest import curve_words

        words = curve_words(*_pairs(a, b), self.radius, self.reverse)
        # The side of a piece of length 0 means nothing.
        sides = np.where(words[:, 0] == 0.0, 0.0, words[:, 1]).astype(np.int8)
        return Curves(sides, words[:, 0] * self.radius)

    def states(self, a: ArrayLike, b: ArrayLike, along: ArrayLike) -> se2.FloatArray:
        """Return configurations on the shortest curves from a to b.

        Args:
            a: shape (3,) or (n, 3).
            b: likewise.
            along: arc lengths from a, metres, shape (k,) or (n, k); what lies before a curve's start or beyond its
                end counts as there.

        Returns:
            Shape (k, 3) for two configurations, else (n, k, 3).
        """
        from trailmark.curves.shortest import curve_states, curve_words

        starts, ends = _pairs(a, b)
        words = curve_words(starts, ends, self.radius, self.reverse)
        ways = np.maximum(np.atleast_1d(number_array(along, "curves: along")), 0.0)
        if ways.ndim > 2 or (ways.ndim == 2 and len(ways) not in (1, len(starts))):
            raise ConfigurationError(f"curves: along of shape {ways.shape} given, allowed: (k,) or ({len(starts)}, k)")
        ways = np.array(np.broadcast_to(ways, (len(starts), ways.shape[-1])), order="C")
        found = curve_states(starts, words, self.radius, ways)
        return np.asarray(found if max(np.ndim(a), np.ndim(b)) == 2 else found[0])


def _pairs(a: ArrayLike, b: ArrayLike) -> tuple[se2.FloatArray, se2.FloatArray]:
    """Return starts and ends, each of shape (n, 3)."""
    starts = np.atleast_2d(se2.configurations(a, name="curve: start"))
    ends = np.atleast_2d(se2.configurations(b, name="curve: end"))
    n = max(len(starts), len(ends))
    if {len(starts), len(ends)} - {1, n}:
        raise ConfigurationError(f"curves: {len(starts)} starts and {len(ends)} ends given, allowed: as many")
    # Copies: to the compiled kernels, another memory layout is another type and another compilation.
    return (
        np.array(np.broadcast_to(starts, (n, 3)), order="C"),
        np.array(np.broadcast_to(ends, (n, 3)), order="C"),
    )
