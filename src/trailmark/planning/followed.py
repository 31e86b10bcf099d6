"""FollowedPath: the path that a planner returned last, and where changes of the world may have touched it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.curves import CurvePath
from trailmark.motion import Motion
from trailmark.path import Path
from trailmark.roadmap.search import edges_near
from trailmark.se2 import FloatArray

__all__ = ["FollowedPath", "located", "vertices_of"]

PLACES = 256
"""Places at which a car's path is compared with where the car is."""


def vertices_of(motion: Motion, path: Path) -> FloatArray:
    """Return the states, shape (n, 3), that motions of a kind join along a path."""
    states = np.array(path.knots if isinstance(path, CurvePath) else path.states)
    if not motion.turns:
        states[:, 2] = 0.0
    return states


@dataclass(frozen=True)
class FollowedPath:
    """A path that passed the final check in some world, seen from a later one.

    Attributes:
        vertices: states that motions join, shape (n, 3).
        touched: motions, shape (n - 1,), along which the robot may meet what was added since.
        freed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed since the last look for a better path,
            shape (f, 4).
        growth: how many times dearer it is for being led around what came since it was last compared with paths that
            lead elsewhere.
        looks: closer looks for a better path that are due, for what was removed.
        dearer: how many times longer it is than the inscribed disc's shortest way, as far as all such looks are done.
    """

    vertices: FloatArray
    touched: NDArray[np.bool_]
    freed: FloatArray
    growth: float = 1.0
    looks: int = 0
    dearer: float = 1.0

    @classmethod
    def of(cls, motion: Motion, path: Path) -> FollowedPath:
        """Return a path that passed the final check in the world as it is."""
        vertices = vertices_of(motion, path)
        count = len(vertices) - 1
        return cls(vertices, np.zeros(count, np.bool_), np.empty((0, 4)))

    def after(self, motion: Motion, removed: FloatArray, added: FloatArray) -> FollowedPath:
        """Return the path after changes of the world.

        Args:
            motion: of the robot.
            removed: boxes that hold what was removed, shape (r, 4).
            added: boxes that hold what was added, shape (a, 4).
        """
        count = len(self.touched)
        pairs = np.column_stack([np.arange(count), np.arange(1, count + 1)]).astype(np.int32)
        lengths = motion.longest(motion.costs(self.vertices[:-1], self.vertices[1:]))
        reach = float(motion.checker.robot.circumradius)
        touched = self.touched | edges_near(self.vertices, pairs, lengths, reach, added, ~self.touched)
        return replace(self, touched=touched, freed=np.concatenate([self.freed, removed]))


def located(motion: Motion, path: Path, vertices: FloatArray, q: FloatArray) -> int:
    """Return the motion of a path, an index below n - 1, on which or nearest to which a configuration lies.

    Args:
        motion: of the robot.
        path: with those vertices.
        vertices: shape (n, 3), n >= 2.
        q: shape (3,).
    """
    if isinstance(path, CurvePath):
        fractions = np.linspace(0.0, 1.0, PLACES)
        nearest = int(np.argmin(se2.distance(path.at(fractions), q)))
        ends = np.cumsum(path.curves.lengths)
        return int(np.clip(np.searchsorted(ends, fractions[nearest] * ends[-1], side="right"), 0, len(vertices) - 2))
    a, b = vertices[:-1], vertices[1:]
    move = se2.difference(a, b)
    from_a = se2.difference(a, np.broadcast_to(q, a.shape))
    if not motion.turns:
        move[:, 2] = from_a[:, 2] = 0.0
    weight = np.array([1.0, 1.0, se2.ROTATION_WEIGHT])
    square = ((move * weight) ** 2).sum(axis=1)
    share = np.clip(((move * weight) * (from_a * weight)).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    off = np.abs(from_a - share[:, None] * move) @ weight
    # The last of those that are as near: a path may pass a place twice, and its vertices belong to two motions.
    return int(len(off) - 1 - np.argmin(off[::-1] - 1e-9 * np.arange(len(off))[::-1]))
