"""Whether the robot itself, without a margin, may get through some passage of the known map to see more."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from math import pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import StateChecker
from trailmark.exploration.frontiers import Frontiers, places_in_sight
from trailmark.exploration.known_map import OCCUPIED, UNKNOWN, KnownMap, rectangles
from trailmark.exploration.reachability import HALF, cells_away, connected
from trailmark.se2 import FloatArray, wrap
from trailmark.shapes import Disc, Polygon, Rectangle, Shape
from trailmark.world import Robot, World

__all__ = ["doubtful_passage", "way_towards"]

DRAWS, DENSE = 64, 0.5
"""Places that see an edge, at most, that are asked at once; cells between rays, so that no place is left out."""

LEVELS, ROUND = ((1, 64), (3, 256)), ((3, 1), (9, 1))
"""Parts of a cell, along either side, and of a turn: at first, and where these do not decide; likewise of a disc."""

AT_ONCE, MOST_ASKED = 40, 300_000
"""Places to which a way is sought at once; configurations of a robot that are looked at, at most, before it is left
open: less than a second."""

POINT: Final = 1e-3
"""Cells: radius of a point where a beam ended."""


def doubtful_passage(
    known: KnownMap, been: NDArray[np.bool_], robot: Robot, frontiers: Frontiers, farthest: FloatArray
) -> tuple[float, float] | None:
    """Return x, y of where the robot perhaps gets through to see an edge, None where it is proven that it does not.

    Args:
        known: the map.
        been: cells where the robot's reference point is or was.
        robot: without any clearance.
        frontiers: what is left to be seen.
        farthest: from which each edge is looked at, in cells, shape (m,).
    """
    inner, left = robot.reference_radius / known.cell, MOST_ASKED
    # A disc about its reference point may not touch what is unknown; a surface lies anywhere in an occupied cell.
    passed = cells_away(known.state == UNKNOWN) >= inner + 0.5 - HALF
    passed &= cells_away(known.state == OCCUPIED, outside=False) >= inner - 2.0 * HALF
    possible = connected(passed, been)
    while True:
        ranks = possible.astype(np.uint8)
        found = places_in_sight(known.state, ranks, frontiers.edges, farthest, DRAWS, DENSE)
        places = np.column_stack(np.divmod(np.unique(found[found >= 0]), ranks.shape[1]))
        if not len(places):
            return None
        places = places[:: -(-len(places) // AT_ONCE)]
        passage, asked = way_towards(known, been, robot, places, left)
        if passage is not None:
            return passage
        left -= asked
        possible[tuple(places.T)] = False


def way_towards(
    known: KnownMap, been: NDArray[np.bool_], robot: Robot, places: NDArray[np.intp], most: int = MOST_ASKED
) -> tuple[tuple[float, float] | None, int]:
    """Return x, y of where a way from some places may come to where the robot was; None if, proven, none does.

    Parts of cells with intervals of headings are followed from the places on, wave by wave. One is passed if the robot
    fits in its middle, so much smaller that it is within itself whatever configuration in it the robot has. Motions of
    a robot that cannot move in every direction are among those.

    Args:
        known: the map.
        been: cells where the robot's reference point is or was.
        robot: without any clearance.
        places: rows and columns of cells, shape (n, 2), at least one.
        most: configurations to look at; then it is left open where the last ones are.

    Returns:
        With how many configurations were looked at.
    """
    around, asked = np.array(list(product((-1, 0, 1), repeat=3))), 0
    passage: tuple[float, float] | None = None
    for parts, turns in LEVELS if robot.sweep_radius > 0.0 else ROUND:
        checkers = _checkers(known, robot, HALF / parts * known.cell + robot.sweep_radius * pi / turns)
        inside = np.array(list(product(range(parts), range(parts), range(turns))))
        wave = (np.append(parts * places, np.zeros((len(places), 1), np.intp), axis=1)[:, None] + inside).reshape(-1, 3)
        shape = *(parts * size for size in been.shape), turns
        last, before = np.empty((2, 0), np.int64)
        passage = None
        while passage is None:
            keys = np.setdiff1d(np.ravel_multi_index(tuple(wave.T), shape), np.concatenate([last, before]))
            asked += len(keys)
            new = np.column_stack(np.unravel_index(keys, shape))
            xy = np.asarray(known.origin) + known.cell / parts * (new[:, 1::-1] + 0.5)
            states = np.column_stack([xy, wrap(new[:, 2] * (2.0 * pi / turns))])
            for checker in checkers:
                fits = checker.states_free(states)
                new, states = new[fits], states[fits]
            if not len(new):
                return None, asked
            if not len(last):
                places = np.unique(new[:, :2] // parts, axis=0)  # the others are not where the robot fits
            there = been[tuple(new[:, :2].T // parts)]
            if there.any() or asked > most:
                passage = float(states[there.argmax(), 0]), float(states[there.argmax(), 1])
            # A wave's neighbours are of the wave before, of itself, or of the next.
            before, last = last, np.ravel_multi_index(tuple(new.T), shape)
            wave = (new[:, None] + around).reshape(-1, 3)
            wave[:, 2] %= turns
            wave = wave[((wave >= 0) & (wave < shape)).all(axis=1)]
        if asked > most:
            break
    return passage, asked


def _checkers(known: KnownMap, robot: Robot, less: float) -> list[StateChecker]:
    """Return what tells together whether a robot, smaller by so much, meets what is known to stand in its way.

    It is what is unknown, points where beams ended, and occupied cells in which none did if they are covered.
    """
    origin, cell = np.asarray(known.origin), known.cell
    occupied, met = known.state == OCCUPIED, np.isfinite(known.points[..., 0])
    ended = np.argwhere(occupied & met)[:, ::-1] + known.points[occupied & met]
    whole = np.argwhere(occupied & ~met)[:, ::-1] + 0.5
    boxes = rectangles(known.state == UNKNOWN).astype(np.float64)
    middles = origin + 0.5 * cell * (boxes[:, :2] + boxes[:, 2:])
    sides = cell * (boxes[:, 2:] - boxes[:, :2])
    unknown: list[Shape] = [
        Rectangle((x, y), *side) for (x, y), side in zip(middles.tolist(), sides.tolist(), strict=True)
    ]
    points, centres = (
        list[Shape](Disc((x, y), POINT * cell) for x, y in (origin + cell * some).tolist()) for some in (ended, whole)
    )
    checkers = list[StateChecker]()
    for obstacles, more in (([*unknown, *points], less), (centres, less + HALF * cell)):
        smaller = _smaller(robot, more + POINT * cell)
        if smaller is not None and obstacles:
            checkers.append(StateChecker(World("known", known.bounds, tuple(obstacles)), smaller))
    return checkers


def _smaller(robot: Robot, less: float) -> Robot | None:
    """Return a robot within another one, so much away from its outline; None if nothing is left."""
    if isinstance(robot.footprint, Disc):
        radius = robot.footprint.radius - less
        return Robot(replace(robot.footprint, radius=radius)) if radius > 0.0 else None
    # Buffers are right to a hundredth; around a mitre more is taken away.
    left = robot.outline.shapely().buffer(-1.01 * less, join_style="mitre")
    largest = max(getattr(left, "geoms", [left]), key=lambda part: part.area, default=None)
    if largest is None or largest.is_empty:
        return None
    return Robot(Polygon(np.array(largest.exterior.coords)[:-1]))
