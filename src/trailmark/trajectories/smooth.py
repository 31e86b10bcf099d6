"""SmoothPath: a path whose corners are rounded."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.errors import ConfigurationError
from trailmark.motion import motion_of
from trailmark.path import Path, fractions
from trailmark.se2 import FloatArray
from trailmark.trajectories.pieces import (
    FINER,
    Pieces,
    certified,
    dense_places,
    joined,
    one_way_respected,
    row_counts,
)
from trailmark.trajectories.rounding import rounded, with_transitions

__all__ = ["SmoothPath", "smoothed"]


@dataclass(frozen=True, eq=False, repr=False)
class SmoothPath(Path):
    """A path along pieces that meet without corners, but for :attr:`stops`.

    What is driven are the pieces. ``states`` lie on them, so many that no point of the robot is farther than 1e-4 m
    from where it is on the straight motions from state to state; near obstacles and one-way zones, 5e-8 m.

    Attributes:
        states: shape (n, 3); the ends of all pieces, and places on curved ones. Read-only.
        start: configuration at the beginning, shape (3,).
        goal: configuration at the end, shape (3,).
        pieces: the curves that are driven.
        rows: (n,), of states on each piece.
    """

    states: FloatArray = field(init=False)
    start: FloatArray
    goal: FloatArray
    pieces: Pieces
    rows: NDArray[np.intp]

    def __post_init__(self) -> None:
        rows = self.pieces.states(*self._places)
        states = np.vstack([self.start, rows[1:], self.goal]) if len(rows) else self.start[None]
        object.__setattr__(self, "states", states)
        super().__post_init__()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SmoothPath):
            return False if isinstance(other, Path) else NotImplemented
        return np.array_equal(self.states, other.states)

    __hash__ = Path.__hash__

    @cached_property
    def _places(self) -> tuple[NDArray[np.intp], FloatArray]:
        return dense_places(self.pieces, self.rows)

    @property
    def length(self) -> float:
        """Distance that the reference point travels, in metres."""
        return float(self.pieces.travelled().sum())

    @property
    def rotation(self) -> float:
        """Total turning, Σ |Δθ|, in radians."""
        return float(self.pieces.turned().sum())

    @property
    def cost(self) -> float:
        """Length + 0.5·rotation, in metres; of a car's path the length alone."""
        return self.length if self.pieces.direction.all() else super().cost

    @cached_property
    def stops(self) -> FloatArray:
        """Where the robot has to stop on its way, since its direction or turn rate jumps: shape (k, 3)."""
        found = self.pieces.start[1:][~joined(self.pieces, True)] if len(self.pieces.length) else np.zeros((0, 3))
        return np.column_stack([found[:, :2], se2.wrap(found[:, 2])])

    @property
    def max_curvature(self) -> float:
        """Largest curvature (1/m) of the reference point's way where it moves on."""
        return float(self.pieces.curvature().max(initial=0.0))

    def at(self, fraction: ArrayLike) -> FloatArray:
        """Return the configurations at fractions of the cost along the path, found to about the distance of states.

        Args:
            fraction: values in [0, 1], shape (m,) or a scalar; values outside are clipped.

        Returns:
            Shape (m, 3), or (3,) for a scalar; on the pieces.
        """
        where = np.clip(fractions(fraction), 0.0, 1.0)
        if len(self.states) == 1:
            return np.broadcast_to(self.start, (*where.shape, 3)).copy()
        piece, s = self._places
        along = np.concatenate([[0.0], np.cumsum(se2.distance(self.states[:-1], self.states[1:]))])
        place = where.ravel() * along[-1]
        row = np.clip(np.searchsorted(along, place, side="right") - 1, 0, len(piece) - 1)
        share = (place - along[row]) / np.where(along[row + 1] > along[row], along[row + 1] - along[row], 1.0)
        ends = np.append(s[1:], 0.0)
        last = np.append(piece[1:] != piece[:-1], True)
        ends[last] = self.pieces.length[piece[last]]
        found = self.pieces.states(piece[row], s[row] + np.clip(share, 0.0, 1.0) * (ends - s)[row])
        found[:, 2] = se2.wrap(found[:, 2])
        found[place <= 0.0], found[place >= along[-1]] = self.start, self.goal
        return found.reshape(*where.shape, 3)

    def resample(self, step: float) -> Path:
        """Return states on the pieces at most ``step`` metres of cost apart as a plain path, the states among them."""
        step = self._checked_step(step)
        cost = self.pieces.travelled() + se2.ROTATION_WEIGHT * self.pieces.turned()
        finer = self.rows * np.maximum(1, np.ceil(2.0 * cost / (step * self.rows))).astype(np.intp)
        rows = self.pieces.states(*dense_places(self.pieces, finer))
        return Path(np.vstack([self.start, rows[1:], self.goal]) if len(rows) else self.states)

    def reversed(self) -> SmoothPath:
        """Return the path from its end to its start."""
        pieces = self.pieces
        back = Pieces(
            pieces.ends(),
            -(pieces.first + pieces.length[:, None] * pieces.second),
            pieces.second,
            pieces.length,
            -pieces.direction,
        )
        order = np.arange(len(pieces.length))[::-1]
        return SmoothPath(self.goal, self.start, back.take(order), self.rows[order])


def smoothed(path: Path, checker: StateChecker, max_curvature: float) -> SmoothPath:
    """Return a path with its corners rounded where there is room.

    Args:
        path: of straight motions, or a car's.
        checker: certifies what is returned.
        max_curvature: of the reference point's way, 1/m, above 0; infinity for none. A car's turning radius is another.

    Raises:
        ConfigurationError: the path is not certified free of collision, is smooth already, or is one of straight
            motions although the robot is a car.
    """
    if isinstance(path, SmoothPath):
        raise ConfigurationError("smooth: expected a path with corners, got one that is smooth already")
    motion = motion_of(checker, path.steering if isinstance(path, CurvePath) else None)
    knots = path.knots if isinstance(path, CurvePath) else path.states
    if checker.robot.drive == "car" and not isinstance(path, CurvePath):
        raise ConfigurationError("smooth: expected a car's path, got one of straight motions")
    free = checker.valid(knots).all() and motion.motions_valid(knots[:-1], knots[1:])
    if not np.all(free):
        where = "its only state" if len(knots) == 1 else f"motion {int(np.argmin(free))}"
        raise ConfigurationError(f"smooth: expected a path that is certified free of collision; {where} is not")
    if isinstance(path, CurvePath):
        pieces = with_transitions(checker, path)
    else:
        pieces = rounded(checker, motion.path(path.states), max_curvature)
    rows = row_counts(pieces, checker.footprint.sweep_radius)
    near = (rows > 1) & ~(certified(checker, pieces) & one_way_respected(checker, pieces, 1))
    return SmoothPath(path.states[0], path.states[-1], pieces, np.where(near, FINER * rows, rows))
