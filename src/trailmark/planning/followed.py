"""What is left of a path being followed, from where the robot is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.motion import Motion
from trailmark.path import Path
from trailmark.planning.updating import Boxes
from trailmark.roadmap.revalidation import edges_near, few_boxes
from trailmark.se2 import FloatArray

__all__ = ["Passed", "Rest", "located", "rest_of", "vertices_of"]

PLACES = 256
"""Places at which a car's path is compared with where the car is."""

NO_CHANGES = Boxes(np.empty((0, 4)), np.empty((0, 4)))


def vertices_of(motion: Motion, path: Path) -> FloatArray:
    """Return the states, shape (n, 3), that motions of a kind join along a path."""
    states = np.array(path.knots if isinstance(path, CurvePath) else path.states)
    if not motion.turns:
        states[:, 2] = 0.0
    return states


class Passed(NamedTuple):
    """A path that passed the final check.

    Attributes:
        vertices: states that motions join, shape (n, 3).
        checker: of the world that it passed it in.
        changes: boxes that hold what changed since.
    """

    vertices: FloatArray
    checker: StateChecker
    changes: Boxes = NO_CHANGES

    def after(self, changes: Boxes) -> Passed:
        """Return the same path in a world that changed."""
        both = (few_boxes(np.concatenate(pair)) for pair in zip(self.changes, changes, strict=True))
        return self._replace(changes=Boxes(*both))


class Rest(NamedTuple):
    """What is left of a path from where the robot is.

    Attributes:
        vertices: states that motions join, shape (n, 3); the first is the robot's own.
        free: which motions are certified in the world as it is, shape (n - 1,).
        checked: which motions were looked at now, shape (n - 1,).
        freed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed since the path passed the final check,
            shape (f, 4).
        before: the checker of the world that it passed it in; None if that is not known.
    """

    vertices: FloatArray
    free: NDArray[np.bool_]
    checked: NDArray[np.bool_]
    freed: FloatArray
    before: StateChecker | None


def rest_of(motion: Motion, path: Path, start: FloatArray, passed: Passed | None) -> Rest:
    """Return what is left of a path, and where it is blocked.

    Motions that passed the final check in a world, and that nothing came near since, are free without being looked at.

    Args:
        motion: of the robot, in the world as it is.
        path: being followed.
        start: where the robot is, shape (3,), valid.
        passed: the path that passed last.
    """
    vertices, checker = vertices_of(motion, path), motion.checker
    before, unknown, freed = None, np.ones(len(vertices) - 1, np.bool_), np.array([checker.world.bounds])
    if passed is not None and np.array_equal(passed.vertices, vertices):
        before, (freed, added) = passed.checker, passed.changes
        pairs = np.column_stack([np.arange(len(unknown)), np.arange(1, len(vertices))]).astype(np.int32)
        lengths = motion.longest(motion.costs(vertices[:-1], vertices[1:]))
        unknown = edges_near(vertices, pairs, lengths, float(checker.robot.circumradius), added, unknown)
    here = start if motion.turns else start * np.array([1.0, 1.0, 0.0])
    if len(vertices) > 1:
        nearest = located(motion, path, vertices, start)
        # The first motion is another one, unless the robot stands exactly at a state of the path.
        same = bool(np.array_equal(here, vertices[nearest]))
        vertices, unknown = np.vstack([here, vertices[nearest + 1 :]]), unknown[nearest:].copy()
        unknown[0] |= not same
    else:
        vertices, unknown = np.vstack([here, vertices]), np.ones(1, np.bool_)
    # Where the robot stands at the path's next state, or at its end, there is no motion to it.
    moves = (vertices[1:] != vertices[:-1]).any(axis=1)
    moves[-1] |= not moves.any()
    vertices, unknown = vertices[np.append(True, moves)], unknown[moves]
    free = ~unknown
    free[unknown] = motion.motions_valid(vertices[:-1][unknown], vertices[1:][unknown])
    return Rest(vertices, free, unknown, freed, before)


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
