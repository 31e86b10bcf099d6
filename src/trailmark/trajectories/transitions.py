"""Transition curves: a car's arcs and straight lines become arcs, lines and clothoids between them.

On a clothoid the curvature changes at a constant rate, so that a car need not stop to steer. It takes room: a clothoid
of length c from a line to an arc of radius r shifts the two apart by about c²/24r, as railway engineers know. Here the
circles stay where they are, and the lines between two of them move outwards. Each line is tried with shorter and
shorter clothoids until everything is certified; without any, the car stops at its ends to steer. It also stops where an
arc meets another one, and at a line that begins or ends where the path does or the car reverses.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.se2 import FloatArray
from trailmark.trajectories.certificate import certified, one_way_respected
from trailmark.trajectories.pieces import Pieces, pieces_of

__all__ = ["with_transitions"]

LENGTHS = 2.0 * 0.5 ** np.arange(7)
"""Of clothoids, in turning radii, longest first."""

ROUNDING = 1e-9
"""Metres by which a part of an arc may reach over its ends."""

Row = tuple[float, float, float, float, float, float, float]
"""A driven piece: x, y, heading at its start, curvature, its rate of change, length, direction."""


class _Line(NamedTuple):
    """A line between two circles, with the clothoids at both of its ends.

    Attributes:
        heading: of travel, radians, not wrapped.
        turn: by which each clothoid turns, radians.
        start: where the first clothoid begins, shape (2,).
        begin: where the line begins, shape (2,).
        length: of the line, metres.
        end: where the second clothoid ends, shape (2,).
        clothoid: length of each, metres.
    """

    heading: float
    turn: float
    start: FloatArray
    begin: FloatArray
    length: float
    end: FloatArray
    clothoid: float


def with_transitions(checker: StateChecker, path: CurvePath) -> Pieces:
    """Return the pieces of a car's path with clothoids where there is room for them.

    Args:
        checker: certifies the pieces.
        path: whose curves are certified.
    """
    pieces, radius = _merged(pieces_of(path)), path.steering.radius
    n = len(pieces.length)
    side, direction = np.sign(pieces.first[:, 2]), pieces.direction
    # Of travel: a car that reverses travels against its heading.
    heading = pieces.start[:, 2] + np.where(direction < 0, np.pi, 0.0)
    centers = pieces.start[:, :2] + (side * radius)[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])
    between = [
        i
        for i in range(1, n - 1)
        if side[i] == 0.0 and side[i - 1] != 0.0 != side[i + 1] and direction[i - 1] == direction[i] == direction[i + 1]
    ]
    level = dict.fromkeys(between, 0)
    known: dict[Row, bool] = {}
    while True:
        lines = {
            i: _line(centers[i - 1], side[i - 1], centers[i + 1], side[i + 1], heading[i], radius, LENGTHS[level[i]])
            for i in between
            if level[i] < len(LENGTHS)
        }
        rows: list[tuple[Row, tuple[int, ...]]] = []
        failed = {i for i, line in lines.items() if line is None}
        for i in range(n):
            if side[i] == 0.0:
                rows += [(row, (i,)) for row in _line_rows(pieces, i, lines.get(i), side, radius)]
                continue
            before, after = lines.get(i - 1), lines.get(i + 1)
            start, begin, end = pieces.start[i, :2], heading[i], heading[i] + pieces.first[i, 2] * pieces.length[i]
            if before is not None:
                start, begin = before.end, before.heading + side[i] * before.turn
            if after is not None:
                end = after.heading - side[i] * after.turn
            length = side[i] * (end - begin) * radius
            ends = tuple(k for k in (i - 1, i + 1) if k in lines)
            if length < 0.0:
                failed.update(ends)
            row = _row(start, begin, side[i] / radius, 0.0, max(length, 0.0), direction[i])
            rows.append((row, ends))
            # A part of the path's own arc is as free as that.
            own = side[i] * np.array([begin - heading[i], end - heading[i]]) * radius
            if own[0] >= -ROUNDING and own[1] <= pieces.length[i] + ROUNDING:
                known[row] = True
        if not failed:
            failed = _not_free(checker, rows, lines, known)
            if not failed:
                return _pieces([row for row, _ in rows if row[5] > 0.0])
        for i in failed:
            level[i] += 1


def _line(
    a: FloatArray, side_a: float, b: FloatArray, side_b: float, near: float, radius: float, share: float
) -> _Line | None:
    """Return the line from a circle about a to one about b, with clothoids of a share of the radius; None if none fits.

    Args:
        a: centre of the first circle, shape (2,).
        side_a: 1 if the car turns left on it, -1 if right.
        b: centre of the second circle.
        side_b: likewise.
        near: heading of the line without clothoids, radians.
        radius: of both circles, metres.
        share: length of each clothoid, in radii.
    """
    clothoid = share * radius
    turn = 0.5 * share
    end = _pieces([(0.0, 0.0, 0.0, 0.0, 1.0 / (radius * clothoid), clothoid, 1.0)]).ends()[0]
    # Seen from where a clothoid leaves a line to the left, the circle's centre.
    ahead, beside = end[0] - radius * np.sin(turn), end[1] + radius * np.cos(turn)
    apart = b - a
    distance = float(np.hypot(*apart))
    across = (side_b - side_a) * beside
    if distance <= abs(across):
        return None
    heading = float(np.arctan2(apart[1], apart[0]) - np.arcsin(across / distance))
    heading += 2.0 * np.pi * round((near - heading) / (2.0 * np.pi))
    length = float(np.sqrt(distance**2 - across**2) - 2.0 * ahead)
    if length < 0.0:
        return None
    along, left = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    begin = a - side_a * beside * left + ahead * along
    leave, join = heading - side_a * turn, heading + side_b * turn
    start = a - side_a * radius * np.array([-np.sin(leave), np.cos(leave)])
    finish = b - side_b * radius * np.array([-np.sin(join), np.cos(join)])
    return _Line(heading, turn, start, begin, length, finish, clothoid)


def _line_rows(pieces: Pieces, i: int, line: _Line | None, side: FloatArray, radius: float) -> list[Row]:
    """Return the clothoids and the line in the place of the path's piece i; that piece itself if there is none."""
    direction = pieces.direction[i]
    if line is None:
        return list(_rows(pieces.take(np.array([i]))))
    rate = 1.0 / (radius * line.clothoid)
    leave, last = (
        line.heading - side[i - 1] * line.turn,
        line.begin + line.length * np.array([np.cos(line.heading), np.sin(line.heading)]),
    )
    return [
        _row(line.start, leave, side[i - 1] / radius, -side[i - 1] * rate, line.clothoid, direction),
        _row(line.begin, line.heading, 0.0, 0.0, line.length, direction),
        _row(last, line.heading, 0.0, side[i + 1] * rate, line.clothoid, direction),
    ]


def _not_free(
    checker: StateChecker,
    rows: list[tuple[Row, tuple[int, ...]]],
    lines: dict[int, _Line | None],
    known: dict[Row, bool],
) -> set[int]:
    """Return the lines with clothoids because of which pieces are not certified."""
    new = [row for row, causes in rows if row not in known and row[5] > 0.0 and any(i in lines for i in causes)]
    if new:
        pieces = _pieces(new)
        free = certified(checker, pieces) & one_way_respected(pieces, checker.world.zones)
        known.update(zip(new, free.tolist(), strict=True))
    return {i for row, causes in rows if not known.get(row, True) for i in causes if i in lines}


def _merged(pieces: Pieces) -> Pieces:
    """Return pieces of which neighbours differ in curvature or direction."""
    rows: list[Row] = []
    for row in _rows(pieces):
        if rows and rows[-1][3] == row[3] and rows[-1][6] == row[6]:
            rows[-1] = (*rows[-1][:5], rows[-1][5] + row[5], row[6])
        else:
            rows.append(row)
    merged = _pieces(rows)
    # Headings go on from one to the next.
    for i, j in pairwise(range(len(rows))):
        end = merged.start[i, 2] + merged.first[i, 2] * merged.length[i]
        merged.start[j, 2] += 2.0 * np.pi * round((end - merged.start[j, 2]) / (2.0 * np.pi))
    return merged


def _row(place: FloatArray, travel: float, curvature: float, rate: float, length: float, direction: int) -> Row:
    heading = travel - (np.pi if direction < 0 else 0.0)
    return float(place[0]), float(place[1]), float(heading), float(curvature), float(rate), length, float(direction)


def _rows(pieces: Pieces) -> list[Row]:
    columns = (*pieces.start.T, pieces.first[:, 2], pieces.second[:, 2], pieces.length, pieces.direction)
    return list(zip(*(np.asarray(column, dtype=np.float64).tolist() for column in columns), strict=True))


def _pieces(rows: list[Row]) -> Pieces:
    """Return driven pieces."""
    values = np.array(rows, dtype=np.float64).reshape(-1, 7)
    first, second = np.zeros((len(values), 3)), np.zeros((len(values), 3))
    first[:, 2], second[:, 2] = values[:, 3], values[:, 4]
    return Pieces(values[:, :3].copy(), first, second, values[:, 5].copy(), values[:, 6].astype(np.int8))
