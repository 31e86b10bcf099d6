"""How well an obstacle is known, and for which risk a world's obstacles were grown.

:mod:`trailmark.estimation.risk` makes worlds of such obstacles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import Probability, checked, number, number_array, one_of
from trailmark.errors import WorldError, expected_name
from trailmark.robot import Robot
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc, Polygon, Rectangle, Shape

__all__ = ["FRAMES", "Frame", "ObstacleEstimate", "RiskBound"]

Frame = Literal["start", "map"]
"""What the covariances of a map are relative to: where the robot stood first, or the map itself."""
FRAMES: tuple[Frame, ...] = get_args(Frame)


class _Value:
    """What compares by its fields, arrays included."""

    def _contents(self) -> tuple[Any, ...]:
        # Adding 0 makes -0.0 to 0.0: the two are equal, so their bytes must be.
        return tuple((v + 0.0).tobytes() if isinstance(v, np.ndarray) else v for v in self.__dict__.values())

    def __eq__(self, other: object) -> bool:
        return self._contents() == other._contents() if isinstance(other, type(self)) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._contents())


@dataclass(frozen=True, eq=False)
class ObstacleEstimate(_Value):
    """An obstacle that is known from noisy readings: its mean shape, and the covariance of the numbers that place it.

    Those numbers are, in this order, a disc's x, y and radius; a rectangle's x, y, heading, length and width; a
    polygon's shift in x and y and its turn about the mean of its outline's vertices. The covariance is that of the
    first k of them; the others count as known exactly.

    Attributes:
        mean: the most likely shape.
        covariance: shape (k, k), 2 <= k <= 5 (rectangle) or 3; metres and radians.
        share: the part of the world's risk that it may take, above 0 and at most 1; None if not shared out.
        frame: what the covariance is relative to: "start", where the robot stood first, or "map", the obstacles
            themselves; None where nothing is said.

    Raises:
        WorldError: a covariance of another shape, not finite, not symmetric or with a negative variance; a share
            out of range.
    """

    mean: Shape
    covariance: FloatArray
    share: float | None = None
    frame: Frame | None = None

    def __post_init__(self) -> None:
        one_of(self.mean, (Disc, Rectangle, Polygon), "estimate: mean:", error=WorldError)
        name = f"estimate of a {type(self.mean).__name__.lower()}: covariance"
        covariance = _covariance(self.covariance, name, range(2, 6 if isinstance(self.mean, Rectangle) else 4))
        object.__setattr__(self, "covariance", covariance)
        if self.share is not None:
            share = number(self.share, "estimate: share", above=0.0, maximum=1.0, error=WorldError)
            object.__setattr__(self, "share", share)
        if self.frame not in (None, *FRAMES):
            raise WorldError(f"estimate: frame: {expected_name(str(self.frame), FRAMES)}")


@dataclass(frozen=True, eq=False)
class RiskBound(_Value):
    """What a world's obstacles are grown for.

    Attributes:
        confidence: least probability, above 0 and below 1, with which a valid path meets none of the true obstacles.
        pose_covariance: shape (3, 3), of the robot's x, y and theta in the world's frame about where it takes itself
            to be; None if that counts as exact.
        reach: metres that a radian of heading moves the robot's outline at most (``Robot.sweep_radius``), >= 0.

    Raises:
        WorldError: a value out of these ranges.
    """

    confidence: float
    pose_covariance: FloatArray | None = None
    reach: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "confidence", checked(self.confidence, Probability, "risk: confidence", WorldError))
        object.__setattr__(self, "reach", number(self.reach, "risk: reach", minimum=0.0, unit="m", error=WorldError))
        if self.pose_covariance is not None:
            covariance = _covariance(self.pose_covariance, "risk: pose_covariance", (3,))
            object.__setattr__(self, "pose_covariance", covariance)

    def covers(self, robot: Robot) -> bool:
        """Return whether obstacles grown for this bound keep it for that robot too: a heading error moves it less."""
        pose = self.pose_covariance
        return pose is None or pose[2, 2] == 0.0 or robot.sweep_radius <= (1.0 + 1e-9) * self.reach


def _covariance(value: ArrayLike, name: str, sizes: Sequence[int]) -> FloatArray:
    """Return a symmetric matrix without negative eigenvalues, read-only, or say what is wrong."""
    matrix = number_array(value, name, "no matrix of numbers given", error=WorldError)
    if matrix.shape not in {(k, k) for k in sizes}:
        allowed = " or ".join(f"({k}, {k})" for k in sizes)
        raise WorldError(f"{name}: expected shape {allowed}, got {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise WorldError(f"{name}: holds a value that is not a finite number")
    slack = 1e-9 * float(np.abs(matrix).max())
    if np.abs(matrix - matrix.T).max() > slack:
        raise WorldError(f"{name}: expected a symmetric matrix, got {matrix.tolist()}")
    matrix = 0.5 * (matrix + matrix.T)
    if float(np.linalg.eigvalsh(matrix)[0]) < -slack:
        raise WorldError(f"{name}: expected a matrix without negative eigenvalues, got {matrix.tolist()}")
    matrix.flags.writeable = False
    return matrix
