"""Rest: what is left of a path from where the robot is, and where it is blocked."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.path import Path
from trailmark.planning.followed import FollowedPath, located, vertices_of
from trailmark.planning.world_model import WorldModel
from trailmark.se2 import FloatArray

__all__ = ["Rest", "rest_of"]


class Rest(NamedTuple):
    """What is left of a path from where the robot is.

    Attributes:
        known: of it, as it is once all of it is free; its first state is the robot's own.
        free: which motions are certified in the world as it is, shape (n - 1,).
        checked: which motions were looked at now, shape (n - 1,).
    """

    known: FollowedPath
    free: NDArray[np.bool_]
    checked: NDArray[np.bool_]

    @property
    def vertices(self) -> FloatArray:
        """States that motions join, shape (n, 3)."""
        return self.known.vertices


def rest_of(model: WorldModel, path: Path, start: FloatArray) -> Rest:
    """Return what is left of a path, and where it is blocked.

    Motions that passed the final check, and that no change came near since, are free without being looked at.

    Args:
        model: of the world as it is.
        path: being followed.
        start: where the robot is, shape (3,), valid.
    """
    motion, known = model.motion, model.followed
    vertices = vertices_of(motion, path)
    if known is None or not np.array_equal(known.vertices, vertices):
        # Whatever its world was, anything may have come and gone since.
        anywhere = np.array([model.checker.world.bounds])
        known = FollowedPath(vertices, np.ones(len(vertices) - 1, np.bool_), anywhere)
    unknown = known.touched
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
    a, b = vertices[:-1][unknown], vertices[1:][unknown]
    if len(a):
        free[unknown] = model.checker.states_free(a) & model.checker.states_free(b)
        check = np.flatnonzero(unknown & free)
        free[check] = motion.motions_between_valid(vertices[check], vertices[check + 1])
    known = replace(known, vertices=vertices, touched=np.zeros(len(free), np.bool_))
    return Rest(known, free, unknown)
