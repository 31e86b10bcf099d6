"""Corners rounded: straight motions in SE(2) become straight motions and parabolas that meet with one velocity.

A corner is replaced by the parabola that leaves one motion and joins the next at the same distance from it, so that x,
y and heading all change without a jump. Shortest paths turn where they touch obstacles, where the inside of the corner
is blocked: there the corner is moved outwards first, so that the parabola passes beside where the corner was. Each
corner is tried with smaller and smaller parabolas, cut or swung outwards, until all pieces are certified; what remains
is the corner itself, at which the robot stops.
"""

# Tested by tests/trajectories/test_smooth.py.

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.path import Path
from trailmark.se2 import FloatArray
from trailmark.trajectories.certificate import certified
from trailmark.trajectories.one_way import one_way_respected
from trailmark.trajectories.pieces import Pieces, joined, straight

__all__ = ["rounded"]

SIZES = 0.5 ** np.arange(8)
"""Of parabolas, as shares of half of the shorter motion beside the corner, largest first."""

SWINGS = (-1.0, 0.1, 0.5, 1.5)
"""How far outside of the corner a parabola passes, in the distance by which it would cut it; -1: it cuts it."""

ROUNDING = 1e-12
"""Share of a motion below which nothing of it is left between two parabolas."""

ROUNDS = 4
"""Of moving all corners, each of which moves the parabolas of its neighbours."""

REVERSAL = -0.98
"""Cosine of the angle between two motions from which on there is a stop, not a hairpin."""


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
    if len(corners) < 3:
        return straight(corners[:-1], np.diff(corners, axis=0))
    groups = _groups(corners, checker.robot.circumradius)
    known: dict[bytes, bool] = {}
    while True:
        merged = np.array([corners[0], *(corners[group].mean(axis=0) for group in groups), corners[-1]])
        pieces, stops = _rounded(checker, merged, max_curvature, known)
        if not any(stop and len(group) > 1 for group, stop in zip(groups, stops, strict=True)):
            return pieces
        groups = [
            part
            for group, stop in zip(groups, stops, strict=True)
            for part in (np.array_split(group, 2) if stop and len(group) > 1 else [group])
        ]


def _groups(corners: FloatArray, reach: float) -> list[NDArray[np.intp]]:
    """Return the corners, ends left out, in groups no longer than ``reach`` metres from first to last."""
    moves = np.diff(corners, axis=0)
    length = np.hypot(*moves[:, :2].T)
    groups, along = [[1]], 0.0
    for i in range(2, len(corners) - 1):
        along += length[i - 1]
        # Turns in place stay.
        if along <= reach and length[i - 1] > reach * abs(moves[i - 1, 2]):
            groups[-1].append(i)
        else:
            groups.append([i])
            along = 0.0
    return [np.array(group) for group in groups]


def _rounded(
    checker: StateChecker, corners: FloatArray, max_curvature: float, known: dict[bytes, bool]
) -> tuple[Pieces, NDArray[np.bool_]]:
    """Return the pieces with corners, shape (n + 2, 3), rounded, and at which of the n the robot stops.

    Where it does not stop, and between two stops that are the path's own corners, the pieces are certified.
    """
    _, first, _, length, _ = straight(corners[:-1], np.diff(corners, axis=0), keep=True)
    moving = np.hypot(*first[:, :2].T) > 0.5
    may = moving[:-1] & moving[1:] & ((first[:-1, :2] * first[1:, :2]).sum(axis=1) > REVERSAL)
    room = 0.5 * np.minimum(length[:-1], length[1:])
    levels = len(SIZES) * len(SWINGS)
    level = np.where(may, 0, levels)
    while True:
        size = np.where(level < levels, SIZES[np.minimum(level // len(SWINGS), len(SIZES) - 1)] * room, 0.0)
        swing = np.where(level < levels, np.array(SWINGS)[level % len(SWINGS)], -1.0)
        moved = _moved(corners, size, swing)
        pieces = _cut(moved, size)
        free = _free(checker, pieces, known) & (pieces.curvature() <= max_curvature)
        # Straight motions are the even pieces; parabolas, of length 0 where there is a stop, stand between them.
        failed = ~free[1::2]
        beside = ~free[0::2]
        failed |= beside[:-1] | beside[1:]
        failed &= level < levels
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


def _moved(corners: FloatArray, size: FloatArray, swing: FloatArray) -> FloatArray:
    """Return the corners, shape (n + 2, 3), moved so that parabolas of the sizes (n,) pass where they should."""
    moved = corners.copy()
    for number in range(ROUNDS):
        pieces = _cut(moved, size)
        first, cut = pieces.first[0::2], 0.5 * pieces.length[1::2, None]
        missing = 0.25 * cut * (first[:-1] - first[1:])
        if number == 0:
            wanted = corners[1:-1] + swing[:, None] * missing
        swung = swing >= 0.0
        moved[1:-1][swung] = (wanted + missing)[swung]
    return moved


def _cut(moved: FloatArray, size: FloatArray) -> Pieces:
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
    return Pieces(start, first, second, length, np.zeros(2 * n - 1, np.int8))


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
    answer &= one_way_respected(asked, checker.world.zones)
    known.update((keys[i], bool(free)) for i, free in zip(new, answer, strict=True))
    return np.array([known[key] for key in keys])
