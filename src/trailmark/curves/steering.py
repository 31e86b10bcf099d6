"""Steering: the curves that a car-like robot can follow, and the shortest ones between configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, overload

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
        signed_lengths: (n, 5), of each piece in metres, negative if driven backwards.
    """

    sides: NDArray[np.int8]
    signed_lengths: se2.FloatArray

    @property
    def lengths(self) -> se2.FloatArray:
        """Length of each curve, metres, shape (n,)."""
        return np.asarray(np.abs(self.signed_lengths).sum(axis=1))

    def names(self) -> list[str]:
        """Return what each curve is made of, such as ``L+S+R-``: side and direction of its pieces."""
        rows = zip(self.sides.tolist(), self.signed_lengths.tolist(), strict=True)
        return ["".join("SLR"[side] + "-+"[s > 0.0] for side, s in zip(*row, strict=True) if s) for row in rows]


@dataclass(frozen=True)
class Steering:
    """How a car moves: straight ahead or on circles, and backwards too if it reverses.

    The reference point moves along the heading. The shortest curves are those of Reeds and Shepp for a car that
    reverses (:mod:`trailmark.curves.reeds_shepp`), else those of Dubins (:mod:`trailmark.curves.dubins`). Where
    several are as short, the choice is always the same; for a car that reverses it is the same in both directions.

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

    @overload
    def lengths(self, a: tuple[float, float, float], b: tuple[float, float, float]) -> float: ...

    @overload
    def lengths(self, a: ArrayLike, b: ArrayLike) -> Any: ...

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
            along: arc lengths from a, metres, shape (k,) or (n, k), limited to the range from 0 to the curve's length.

        Returns:
            Shape (k, 3) for two configurations, else (n, k, 3).
        """
        from trailmark.curves.shortest import curve_states, curve_words

        starts, ends = _pairs(a, b)
        words = curve_words(starts, ends, self.radius, self.reverse)
        arcs = np.maximum(np.atleast_1d(number_array(along, "curves: along")), 0.0)
        if arcs.ndim > 2 or (arcs.ndim == 2 and len(arcs) not in (1, len(starts))):
            raise ConfigurationError(f"curves: along: expected shape (k,) or ({len(starts)}, k), got {arcs.shape}")
        arcs = np.array(np.broadcast_to(arcs, (len(starts), arcs.shape[-1])), order="C")
        found = curve_states(starts, words, self.radius, arcs)
        return np.asarray(found if max(np.ndim(a), np.ndim(b)) == 2 else found[0])


def _pairs(a: ArrayLike, b: ArrayLike) -> tuple[se2.FloatArray, se2.FloatArray]:
    """Return starts and ends, each of shape (n, 3)."""
    starts = np.atleast_2d(se2.configurations(a, name="curve: start"))
    ends = np.atleast_2d(se2.configurations(b, name="curve: end"))
    n = max(len(starts), len(ends))
    if {len(starts), len(ends)} - {1, n}:
        raise ConfigurationError(
            f"curves: expected as many ends as starts, got {len(starts)} starts and {len(ends)} ends"
        )
    # Copies: numba would take another memory layout for another type and compile anew for it.
    return (
        np.array(np.broadcast_to(starts, (n, 3)), order="C"),
        np.array(np.broadcast_to(ends, (n, 3)), order="C"),
    )
