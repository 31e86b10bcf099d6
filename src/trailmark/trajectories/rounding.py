"""Corners rounded: straight motions in SE(2) become straight motions and parabolas that meet with one velocity.

A corner is replaced by the parabola that leaves one motion and joins the next at the same distance from it, so that x,
y and heading all change without a jump. Shortest paths turn where they touch obstacles, where the inside of the corner
is blocked: there the corner is moved outwards first, so that the parabola passes beside where the corner was. Each
corner is tried with smaller and smaller parabolas, cut or swung outwards, until all pieces are certified; what remains
is the corner itself, at which the robot stops. A differential drive goes round a corner on two clothoids, which meet in
its middle, along its heading; where it turns in place it stops.

A car's arcs and straight lines become arcs, lines and clothoids between them, on which the curvature changes at a
constant rate, so that it need not stop to steer. That takes room: a clothoid of length c from a line to an arc of
radius r shifts the two apart by about c²/24r, as railway engineers know. Here the circles stay where they are, and the
lines between two of them move outwards. Each line is tried with shorter and shorter clothoids until everything is
certified; without any, the car stops at its ends to steer. It also stops where an arc meets another one, and at a line
that begins or ends where the path does or the car reverses.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.curves import CurvePath
from trailmark.motion.differential import ALIGNED
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.trajectories.pieces import (
    STANDING,
    Pieces,
    certified,
    joined,
    one_way_respected,
    pieces_of,
    straight,
)

__all__ = ["rounded", "with_transitions"]

SIZES = 0.5 ** np.arange(8)
"""Where a corner's curve begins and ends, as shares of half of the shorter motion beside it, largest first."""

SWINGS = (-1.0, 0.1, 0.5, 1.5)
"""How far outside of the corner the curve passes, in the distance by which it would cut it; -1: it cuts it."""

ROUNDING = 1e-12
"""Share of a motion below which nothing of it is left between two parabolas."""

ROUNDS = 4
"""Of moving all corners, each of which moves the parabolas of its neighbours."""

REVERSAL = -0.98
"""Cosine of the angle between two motions from which on there is a stop, not a hairpin."""

STRAIGHT = 1e-6
"""Radians by which a corner turns below which it is rounded as if it did not: formulas divide by its sine."""

LENGTHS = 2.0 * 0.5 ** np.arange(7)
"""Of a car's clothoids, in turning radii, longest first."""

OVER = 1e-9
"""Metres by which a part of a car's arc may reach over its ends."""


class _Cut(NamedTuple):
    """Pieces with n corners rounded.

    Attributes:
        pieces: k, those of length 0 among them.
        missing: (n, 3), from where each corner's curve passes to the corner.
        corners: (k, 2) or (k, 3), the corners that make a piece what it is; n for none.
    """

    pieces: Pieces
    missing: FloatArray
    corners: NDArray[np.intp]


Cutter = Callable[[FloatArray, FloatArray], _Cut]
"""Takes corners (n + 2, 3), ends included, and how far from each (n,) its curve begins and ends, metres."""


def rounded(checker: StateChecker, path: Path, max_curvature: float) -> Pieces:
    """Return the pieces of a path of straight motions with its corners rounded where there is room.

    Shortest paths go around one place by several corners close together, which leave no room for each other. They are
    tried as one, and taken apart where that cannot be rounded.

    Args:
        checker: certifies the pieces.
        path: whose motions are certified.
        max_curvature: of the reference point's way, 1/m.
    """
    corners = _corners(checker, path)
    moves = np.diff(corners, axis=0)
    moving = np.hypot(*moves[:, :2].T) > STANDING * np.abs(moves[:, 2])
    drives = _Drives.of(corners, moving) if checker.robot.drive == "differential" and moving.any() else None
    if drives is None:
        may = moving[:-1] & moving[1:]
    else:
        corners, may = drives.corners, drives.sign[:-1] == drives.sign[1:]
    if len(corners) < 3:
        pieces = straight(corners[:-1], moves) if drives is None else drives.cut(corners, np.zeros(0)).pieces
        return pieces.take(pieces.length > 0.0)
    groups = _groups(corners, checker.robot.circumradius, may)
    known: dict[bytes, bool] = {}
    while True:
        merged = np.array([corners[0], *(corners[group].mean(axis=0) for group in groups), corners[-1]])
        cut = _parabolas if drives is None else drives.at([0, *(group[-1] for group in groups), len(corners) - 1]).cut
        ahead = np.array([may[group - 1].all() for group in groups])
        pieces, stops = _rounded(checker, merged, ahead, cut, max_curvature, known)
        if not any(stop and len(group) > 1 for group, stop in zip(groups, stops, strict=True)):
            return pieces
        groups = [
            part
            for group, stop in zip(groups, stops, strict=True)
            for part in (np.array_split(group, 2) if stop and len(group) > 1 else [group])
        ]


def _groups(corners: FloatArray, reach: float, may: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return the corners, ends left out, in groups no longer than ``reach`` metres from first to last.

    Those that may not be rounded (n,) are groups of their own.
    """
    moves = np.diff(corners, axis=0)
    length = np.hypot(*moves[:, :2].T)
    groups, along = [[1]], 0.0
    for i in range(2, len(corners) - 1):
        along += length[i - 1]
        # Turns in place stay.
        if may[i - 2 : i].all() and along <= reach and length[i - 1] > reach * abs(moves[i - 1, 2]):
            groups[-1].append(i)
        else:
            groups.append([i])
            along = 0.0
    return [np.array(group) for group in groups]


def _rounded(
    checker: StateChecker,
    corners: FloatArray,
    may: NDArray[np.bool_],
    cutter: Cutter,
    max_curvature: float,
    known: dict[bytes, bool],
) -> tuple[Pieces, NDArray[np.bool_]]:
    """Return the pieces with corners, shape (n + 2, 3), rounded where they may be, and at which of n the robot stops.

    Where it does not stop, and between two stops that are the path's own corners, the pieces are certified.
    """
    _, first, _, length, _ = straight(corners[:-1], np.diff(corners, axis=0), keep=True)
    may = may & ((first[:-1, :2] * first[1:, :2]).sum(axis=1) > REVERSAL)
    room = 0.5 * np.minimum(length[:-1], length[1:])
    levels = len(SIZES) * len(SWINGS)
    level = np.where(may, 0, levels)
    while True:
        size = np.where(level < levels, SIZES[np.minimum(level // len(SWINGS), len(SIZES) - 1)] * room, 0.0)
        swing = np.where(level < levels, np.array(SWINGS)[level % len(SWINGS)], -1.0)
        pieces, _, causes = cutter(_moved(corners, size, swing, cutter), size)
        free = _free(checker, pieces, known) & (pieces.curvature() <= max_curvature)
        failed = np.zeros(len(level) + 1, np.bool_)
        failed[causes[~free]] = True
        failed = failed[:-1] & (level < levels)
        if not failed.any():
            return pieces.take(pieces.length > 0.0), level == levels
        level = np.where(failed, level + 1, level)


def _corners(checker: StateChecker, path: Path) -> FloatArray:
    """Return the path's states, shape (n, 3), headings not wrapped, without those that motions only pass through."""
    moves = se2.difference(path.states[:-1], path.states[1:])
    pieces = straight(path.states[:-1], moves)
    moves = moves[(moves != 0.0).any(axis=1)]
    states: FloatArray = path.states[0] + np.vstack([np.zeros((1, 3)), np.cumsum(moves, axis=0)])
    if len(pieces.length) != len(moves) or len(moves) == 0:
        return states
    states[:-1, :2], states[-1, :2] = pieces.start[:, :2], path.states[-1, :2]
    corner = np.concatenate([[True], ~joined(pieces, True), [True]])
    fewer: FloatArray = states[corner]
    if corner.all() or (np.abs(np.diff(fewer[:, 2])) >= np.pi).any():
        return states
    return fewer if checker.motions_valid(fewer[:-1], fewer[1:]).all() else states


def _moved(corners: FloatArray, size: FloatArray, swing: FloatArray, cutter: Cutter) -> FloatArray:
    """Return the corners, shape (n + 2, 3), moved so that curves of the sizes (n,) pass where they should."""
    moved = corners.copy()
    for number in range(ROUNDS):
        missing = cutter(moved, size).missing
        if number == 0:
            wanted = corners[1:-1] + swing[:, None] * missing
        swung = swing >= 0.0
        moved[1:-1][swung] = (wanted + missing)[swung]
    return moved


def _parabolas(moved: FloatArray, size: FloatArray) -> _Cut:
    """Return straight motions and, between them, the parabolas of the sizes (n,) at moved corners (n + 2, 3)."""
    lines = straight(moved[:-1], np.diff(moved, axis=0), keep=True)
    size = np.minimum(size, 0.5 * np.minimum(lines.length[:-1], lines.length[1:]))
    n = len(lines.length)
    start, first, second = np.empty((2 * n - 1, 3)), np.empty((2 * n - 1, 3)), np.zeros((2 * n - 1, 3))
    length = np.empty(2 * n - 1)
    before, after = np.append(0.0, size), np.append(size, 0.0)
    start[0::2] = moved[:-1] + before[:, None] * lines.first
    start[1::2] = moved[1:-1] - size[:, None] * lines.first[:-1]
    first[0::2], first[1::2] = lines.first, lines.first[:-1]
    length[0::2] = np.where(lines.length - before - after > ROUNDING * lines.length, lines.length - before - after, 0.0)
    length[1::2] = 2.0 * size
    round_ = size > 0.0
    second[1::2][round_] = (np.diff(lines.first, axis=0)[round_]) / length[1::2][round_, None]
    pieces = Pieces(start, first, second, length, np.zeros(2 * n - 1, np.int8))
    own = np.concatenate([[n - 1], np.arange(n - 1), [n - 1]])
    causes = np.empty((2 * n - 1, 2), np.intp)
    causes[0::2], causes[1::2] = np.column_stack([own[:-1], own[1:]]), own[1:-1, None]
    return _Cut(pieces, 0.25 * size[:, None] * (lines.first[:-1] - lines.first[1:]), causes)


class _Drives(NamedTuple):
    """What a differential drive does along a path, of which the drives' ends may be moved.

    Attributes:
        corners: (m + 1, 3), where m drives begin and end: metres, and 0 for the heading.
        sign: (m,), 1 ahead, -1 backwards.
        before: (m + 1,), heading with which the robot comes to each, radians, not wrapped.
        turn: (m + 1,), by which it turns there in place, radians.
    """

    corners: FloatArray
    sign: FloatArray
    before: FloatArray
    turn: FloatArray

    @classmethod
    def of(cls, states: FloatArray, moving: NDArray[np.bool_]) -> _Drives:
        """Return the drives among states, shape (n, 3), headings not wrapped, of which motions (n - 1,) are some."""
        moves, drive = np.diff(states, axis=0), np.flatnonzero(moving)
        leave = np.append(drive, len(states) - 1)
        heading, before = states[drive, 2], states[np.append(0, drive + 1), 2]
        ahead = moves[drive, 0] * np.cos(heading) + moves[drive, 1] * np.sin(heading)
        turn = states[leave, 2] - before
        # After whole turns each heading there is known to be free.
        turn = np.where(np.abs(turn) > 2.0 * np.pi, se2.wrap(turn), turn)
        return cls(states[leave] * [1.0, 1.0, 0.0], np.sign(ahead), before, turn)

    def at(self, places: list[int]) -> _Drives:
        """Return the drives between some of the corners, the ends among them."""
        return _Drives(self.corners[places], self.sign[places[:-1]], self.before[places], self.turn[places])

    def cut(self, moved: FloatArray, size: FloatArray) -> _Cut:
        """Return the pieces with clothoids of the sizes (n,) at moved corners (n + 2, 3), turns in place elsewhere.

        At each corner, the ends among them, are two: halves of the turn, or clothoids. The drives follow.
        """
        n, m = len(size), len(self.sign)
        way = np.diff(moved[:, :2], axis=0)
        length = np.hypot(*way.T)
        along = way / np.where(length > 0.0, length, 1.0)[:, None]
        size = np.minimum(size, 0.5 * np.minimum(length[:-1], length[1:]))
        # By how much each drive is turned from what it was, seen from either end: merged corners leave some out.
        heading = np.arctan2(way[:, 1], way[:, 0]) + np.where(self.sign < 0.0, np.pi, 0.0)
        leave, come = self.before + self.turn, self.before.copy()
        off = np.stack([se2.wrap(heading - leave[:-1]), se2.wrap(heading - come[1:])])
        off[np.abs(off) <= ALIGNED] = 0.0
        leave[:-1] += off[0]
        come[1:] += off[1]
        turn = np.where(np.abs(leave - come) > ALIGNED, leave - come, 0.0)
        places = np.column_stack([moved[:, :2], come]).repeat(2, axis=0)
        places[1::2, 2] += 0.5 * turn
        halves = np.column_stack([np.zeros((m + 1, 2)), 0.5 * turn]).repeat(2, axis=0)
        curves = straight(places, halves, keep=True)
        ends = np.concatenate([[0.0], size, [0.0]])
        left = length - ends[:-1] - ends[1:]
        left[left <= ROUNDING * length] = 0.0
        lines = straight(
            np.column_stack([moved[:-1, :2] + ends[:-1, None] * along, leave[:-1]]), np.zeros((m, 3)), keep=True
        )
        lines.first[:, :2], lines.length[:] = along, left

        # A clothoid of length 1, which turns by half of the corner, ends at x, y.
        bent = np.asarray(se2.wrap(np.diff(np.arctan2(way[:, 1], way[:, 0]))))
        unit = straight(np.zeros((n, 3)), np.zeros((n, 3)), keep=True)._replace(
            second=np.column_stack([np.zeros((n, 2)), np.abs(bent)]), length=np.ones(n), direction=np.ones(n, np.int8)
        )
        x, y, _ = unit.ends().T
        clothoid = size / (x + y * np.tan(0.5 * np.abs(bent)))
        sine = np.sin(np.abs(bent))
        share = np.where(sine > STRAIGHT, y / np.where(sine > STRAIGHT, sine, 1.0), 1.0 / 6.0)
        missing = np.zeros((n, 3))
        missing[:, :2] = (clothoid * share)[:, None] * (along[:-1] - along[1:])
        bends = np.flatnonzero(size > 0.0)
        first, second = 2 * (bends + 1), 2 * (bends + 1) + 1
        rate = bent[bends] / clothoid[bends]
        curves.start[first, :2] = moved[bends + 1, :2] - size[bends, None] * along[bends]
        curves.start[first, 2] = come[bends + 1]
        curves.first[first], curves.first[second] = 0.0, np.column_stack([np.zeros((len(bends), 2)), rate])
        curves.first[first, :2] = along[bends]
        curves.second[first, 2], curves.second[second, 2] = rate / clothoid[bends], -rate / clothoid[bends]
        curves.length[first] = curves.length[second] = clothoid[bends]
        curves.direction[first] = curves.direction[second] = self.sign[bends]
        curves.start[second] = curves.take(first).ends()

        own = np.concatenate([[n], np.arange(n), [n]])
        padded = np.concatenate([[n], own, [n]])
        # How much is turned in place depends on the drives on both sides, and so on the corners at their other ends.
        causes = np.column_stack([padded[:-2], own, padded[2:]]).repeat(2, axis=0)
        causes[first] = causes[second] = own[bends + 1, None]
        causes = np.concatenate([causes, np.column_stack([own[:-1], own[1:], own[1:]])])
        pieces = Pieces(*(np.concatenate(both) for both in zip(curves, lines, strict=True)))  # type: ignore[arg-type]  # each keeps its type
        at = np.arange(m)
        order = np.append(np.column_stack([2 * at, 2 * at + 1, 2 * m + 2 + at]).ravel(), [2 * m, 2 * m + 1])
        return _Cut(pieces.take(order), missing, causes[order])


def _free(checker: StateChecker, pieces: Pieces, known: dict[bytes, bool]) -> NDArray[np.bool_]:
    """Return which pieces are certified, shape (n,); ``known`` holds what was found before."""
    keys = [row.tobytes() for row in np.column_stack([pieces.start, pieces.first, pieces.second, pieces.length])]
    new = np.array([i for i, key in enumerate(keys) if key not in known], dtype=np.intp)
    asked = pieces.take(new)
    lines = (asked.second == 0.0).all(axis=1)
    answer = np.zeros(len(new), np.bool_)
    a, b = asked.start[lines], asked.ends()[lines]
    answer[lines] = checker.motions_valid(a, b) & (np.abs(b - a)[:, 2] <= np.pi)
    answer[~lines] = certified(checker, asked.take(~lines))
    answer &= one_way_respected(checker, asked)
    known.update((keys[i], bool(free)) for i, free in zip(new, answer, strict=True))
    return np.array([known[key] for key in keys])


# --- A car's clothoids.

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
            if own[0] >= -OVER and own[1] <= pieces.length[i] + OVER:
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
        free = certified(checker, pieces) & one_way_respected(checker, pieces)
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
