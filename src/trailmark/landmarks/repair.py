"""Centres that the robot cannot use, and what replaces them: K-means takes no account of obstacles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.collision.footprint import build_footprint
from trailmark.collision.kernels import FREE, states_free
from trailmark.errors import ConfigurationError
from trailmark.shapes import Disc
from trailmark.world import Robot

__all__ = ["Repair", "repair_centres", "widest_headings"]

HEADINGS = 72
"""Headings tried at a place: one every five degrees."""

SPECK = 1e-6
"""Radius (metres) of the disc that stands for a point."""

BATCH = 1000
"""Places whose headings are tried at a time."""


class Repair(NamedTuple):
    """Which K-means centres a robot can use, and valid configurations in their place.

    Attributes:
        in_obstacle: shape (k,), whether the centre itself lies in an obstacle or out of bounds or boundary.
        invalid: shape (k,), whether the robot can stand there at none of the headings that were tried.
        configurations: shape (k, 3), all valid: the centre at its widest heading, or where that is invalid, the
            sample nearest to it at which the robot can stand.
    """

    in_obstacle: NDArray[np.bool_]
    invalid: NDArray[np.bool_]
    configurations: se2.FloatArray


def repair_centres(checker: StateChecker, centres: ArrayLike, samples: ArrayLike) -> Repair:
    """Return which centres the robot cannot use, and valid configurations in the place of all.

    Args:
        checker: decides what is valid.
        centres: shape (k, 2), metres.
        samples: places that may replace them, shape (n, 2), metres.

    Raises:
        ConfigurationError: other shapes, or no sample at which the robot can stand though a centre needs one.
    """
    places, replacements = _places(centres, "centres"), _places(samples, "samples")
    at_zero = np.ascontiguousarray(np.column_stack([places, np.zeros(len(places))]))
    speck = build_footprint(Robot.disc(SPECK))
    in_obstacle = np.asarray(states_free(checker.grid, checker.field, speck, at_zero) != FREE)
    q, valid = widest_headings(checker, places)
    if not valid.all():
        q[~valid] = _nearest_standing(checker, places[~valid], replacements)
    return Repair(in_obstacle, ~valid, q)


def _nearest_standing(checker: StateChecker, places: se2.FloatArray, samples: se2.FloatArray) -> se2.FloatArray:
    """Return the widest configuration at the sample (m, 2) nearest to each place (n, 2) at which the robot can stand.

    Shape (n, 3). Each sample is checked once at most.

    Raises:
        ConfigurationError: it can stand at none.
    """
    from scipy.spatial import cKDTree

    tree, nearest = cKDTree(samples), np.full(len(places), -1)
    checked, standing = np.zeros(len(samples), dtype=np.bool_), np.zeros(len(samples), dtype=np.bool_)
    q = np.zeros((len(samples), 3))

    def check(among: NDArray[np.int64]) -> None:
        new = np.unique(among[~checked[among]])
        q[new], standing[new] = widest_headings(checker, samples[new])
        checked[new] = True

    # Mostly one of the nearest few is suitable.
    for count in (16, 256):
        left = np.flatnonzero(nearest < 0)
        among = np.asarray(tree.query(places[left], np.arange(1, min(count, len(samples)) + 1))[1])
        check(among.ravel())
        suits = standing[among]
        nearest[left] = np.where(suits.any(axis=1), among[np.arange(len(left)), suits.argmax(axis=1)], -1)
    left = np.flatnonzero(nearest < 0)
    if len(left):
        check(np.arange(len(samples)))
        suitable = np.flatnonzero(standing)
        if not len(suitable):
            raise ConfigurationError(
                f"samples: expected one at which the robot ({checker.robot.describe()}) can stand, "
                f"got {len(samples)} at which it cannot"
            )
        nearest[left] = suitable[cKDTree(samples[suitable]).query(places[left])[1]]
    return np.asarray(q[nearest])


def widest_headings(checker: StateChecker, places: se2.FloatArray) -> tuple[se2.FloatArray, NDArray[np.bool_]]:
    """Return the configuration with the largest clearance at each place (n, 2), shape (n, 3), and whether it is valid.

    HEADINGS headings are tried; for a disc only 0.
    """
    count = 1 if isinstance(checker.robot.footprint, Disc) else HEADINGS
    headings = np.asarray(se2.wrap(2.0 * np.pi * np.arange(count) / count))
    best, valid = np.zeros((len(places), 3)), np.zeros(len(places), dtype=np.bool_)
    cap = 2.0 * checker.robot.circumradius
    for begin in range(0, len(places), BATCH):
        part = slice(begin, begin + BATCH)
        q = np.column_stack([np.repeat(places[part], count, axis=0), np.tile(headings, len(places[part]))])
        clearance = np.where(checker.valid(q), checker.clearance(q, cap=cap), -1.0).reshape(-1, count)
        widest = np.argmax(clearance, axis=1)
        rows = np.arange(len(widest))
        best[part] = q.reshape(-1, count, 3)[rows, widest]
        valid[part] = clearance[rows, widest] >= 0.0
    return best, valid


def _places(values: ArrayLike, name: str) -> se2.FloatArray:
    places = np.asarray(values, dtype=np.float64)
    if places.ndim != 2 or places.shape[1] != 2 or not len(places) or not np.isfinite(places).all():
        raise ConfigurationError(f"{name}: expected shape (n, 2), n >= 1, of finite numbers, got {places.shape}")
    return np.ascontiguousarray(places)
