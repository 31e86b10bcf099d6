"""Whether the robot itself, without a margin, may get through some passage of the known map to see more."""

from __future__ import annotations

from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.footprint import build_footprint
from trailmark.exploration.frontiers import Frontiers, places_in_sight
from trailmark.exploration.known_map import OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.reachability import HALF, cells_away, connected
from trailmark.se2 import FloatArray
from trailmark.world.robot import Robot

__all__ = ["can_get_to", "doubtful_passage", "way_towards"]

DRAWS, DENSE = 64, 0.5
"""Places that see an edge, at most, that are asked at once; cells between rays, so that no place is left out."""

FINEST: Final = 2_000_000
"""Parts of cells, at most, to which it is told where the robot provably does not get to."""

HEADINGS = 64
"""Into which a turn is divided, where a disc inside the robot does not settle that."""

PARTS = 3
"""Of a cell, along either side, likewise."""

MOST_ASKED = 200_000
"""Configurations of a robot that are looked at, at most, before it is left open."""


def doubtful_passage(
    known: KnownMap, been: NDArray[np.bool_], robot: Robot, frontiers: Frontiers, farthest: FloatArray
) -> tuple[float, float] | None:
    """Return x, y of where the robot perhaps gets through to see an edge, None where it is proven that it does not."""
    possible = can_get_to(known, been, robot)
    while True:
        ranks = possible.astype(np.uint8)
        found = places_in_sight(known.state, ranks, frontiers.edges, farthest, DRAWS, DENSE)
        places = np.column_stack(np.divmod(np.unique(found[found >= 0]), ranks.shape[1]))
        if not len(places):
            return None
        if (passage := way_towards(known, been, robot, places)) is not None:
            return passage
        possible[tuple(places.T)] = False


def can_get_to(known: KnownMap, been: NDArray[np.bool_], robot: Robot) -> NDArray[np.bool_]:
    """Return the cells to some place of which the robot is not proven unable to get, as surfaces were measured.

    It is where a disc inside it would touch what is not known, hold a point where a beam ended, or cover an occupied
    cell in which none did. Places are told to a part of a cell, as small a one as :data:`FINEST` allows.

    Args:
        known: the map.
        been: cells where the robot's reference point is or was.
        robot: without any clearance.
    """
    f = next((f for f in (9, 7, 5, 3) if known.state.size * f**2 <= FINEST), 1)
    inner, (rows, columns) = f * robot.reference_radius / known.cell, known.state.shape
    unknown, begin = (mask.repeat(f, 0).repeat(f, 1) for mask in (known.state == UNKNOWN, been))
    occupied, met = known.state == OCCUPIED, np.isfinite(known.points[..., 0])
    surfaces, whole = np.zeros((2, *unknown.shape), np.bool_)
    at = np.argwhere(occupied & met)
    parts = (f * (at + known.points[occupied & met][:, ::-1])).astype(np.intp)
    surfaces[tuple(np.clip(parts, 0, np.array(unknown.shape) - 1).T)] = True
    whole[f // 2 :: f, f // 2 :: f] = occupied & ~met
    # Half a diagonal for the place in its part; as much for the point in its own, or to the corners of a whole cell.
    passed = cells_away(unknown) >= inner + 0.5 - HALF
    passed &= cells_away(surfaces, outside=False) >= inner - 2.0 * HALF
    passed &= cells_away(whole, outside=False) >= inner - f * HALF - HALF
    reached = connected(passed, begin)
    return np.asarray(reached.reshape(rows, f, -1).any(axis=1).reshape(rows, columns, f).any(axis=2))


def way_towards(
    known: KnownMap, been: NDArray[np.bool_], robot: Robot, places: NDArray[np.intp]
) -> tuple[float, float] | None:
    """Return x, y of where a way from some places may come to where the robot was; None if, proven, none does.

    Parts of cells with intervals of headings are followed from the places on, wave by wave. One is passed unless a disc
    inside the robot meets something (:func:`can_get_to`) whatever configuration in it the robot has. Motions of a robot
    that cannot move in every direction are among those.

    Args:
        known: the map.
        been: cells where the robot's reference point is or was.
        robot: without any clearance.
        places: rows and columns of cells, shape (n, 2), at least one.
    """
    from scipy.spatial import cKDTree

    discs = build_footprint(robot).inner
    turns = HEADINGS if robot.heading_matters else 1
    away = np.hypot(discs[:, 0], discs[:, 1])
    state = np.pad(known.state, 1, constant_values=UNKNOWN)
    occupied, met = known.state == OCCUPIED, np.isfinite(known.points[..., 0])
    # Of each kind: where it is, in cells, and how much farther a disc may reach before it is certain that it meets it.
    kinds = (
        (np.argwhere(state == UNKNOWN)[:, ::-1] - 0.5, -0.5),
        (np.argwhere(occupied & met)[:, ::-1] + known.points[occupied & met], 0.0),
        (np.argwhere(occupied & ~met)[:, ::-1] + 0.5, HALF),
    )
    trees = [(cKDTree(points), more) for points, more in kinds if len(points)]
    least = (discs[:, 2] - away * np.pi / turns) / known.cell - HALF / PARTS

    def passes(wave: NDArray[np.int64]) -> NDArray[np.bool_]:
        theta = wave[:, 2] * 2.0 * np.pi / turns
        free = np.ones(len(wave), np.bool_)
        for (x, y, _), far in zip(discs, least, strict=True):
            cos, sin = np.cos(theta[free]), np.sin(theta[free])
            turned = np.column_stack([cos * x - sin * y, sin * x + cos * y]) / known.cell
            centres = (wave[free, 1::-1] + 0.5) / PARTS + turned
            for tree, more in trees:
                if far > more and len(centres):
                    clear = np.isinf(tree.query(centres, distance_upper_bound=far - more)[0])
                    free[free], centres = clear, centres[clear]
        return free

    around = np.array(list(product((-1, 0, 1), repeat=3)))
    inside = np.array(list(product(range(PARTS), range(PARTS), range(turns))))
    wave = (np.append(PARTS * places, np.zeros((len(places), 1), np.intp), axis=1)[:, None] + inside).reshape(-1, 3)
    shape = *(PARTS * size for size in been.shape), turns
    last, before, asked = *np.empty((2, 0), np.int64), 0
    while True:
        keys = np.setdiff1d(np.ravel_multi_index(tuple(wave.T), shape), np.concatenate([last, before]))
        asked += len(keys)
        new = np.column_stack(np.unravel_index(keys, shape))
        new = new[passes(new)]
        if not len(new):
            return None
        there = been[tuple(new[:, :2].T // PARTS)]
        if there.any() or asked > MOST_ASKED:
            row, column = new[there.argmax(), :2] // PARTS
            x, y = known.centres(np.array([row]), np.array([column]))[0].tolist()
            return x, y
        # A wave's neighbours are of the wave before, of itself, or of the next.
        before, last = last, np.ravel_multi_index(tuple(new.T), shape)
        wave = (new[:, None] + around).reshape(-1, 3)
        wave[:, 2] %= turns
        wave = wave[((wave >= 0) & (wave < shape)).all(axis=1)]
