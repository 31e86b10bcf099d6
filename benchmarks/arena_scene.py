"""A field of discs that move, bounce off its walls and change direction at random, and a judge of contact.

Nothing here knows the library's checks: contact is decided from positions and velocities, in continuous time.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator
from itertools import islice
from math import cos, hypot, inf, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["DISCS", "DISC_RADIUS", "SIZE", "SPEED", "TURNS_PER_SECOND", "Leg", "Scene", "first_contact"]

FloatArray = NDArray[np.float64]

SIZE = 32.0
"""Side of the square field, metres."""

DISCS, DISC_RADIUS, SPEED = 15, 0.7, 4.0
"""How many discs there are, their radius (metres; 1 m with that of a disc robot of 0.3 m) and speed (m/s)."""

TURNS_PER_SECOND = 2.0 / 3.0
"""Mean rate at which each disc takes a new direction, any with the same probability (a Poisson process)."""

Piece = tuple[float, float, float, float, float, float]

FREE_START = 5.0
"""Metres about the robot's start in which no disc's centre begins."""


class Leg(NamedTuple):
    """A straight motion of the robot from a to b, each x, y, heading, between two moments in seconds."""

    begin: float
    end: float
    a: FloatArray
    b: FloatArray


class Scene:
    """The motions of all discs.

    Args:
        seed: of what is random.
        start: where the robot begins, x, y.
        seconds: how long to go on.
        discs: how many.
    """

    def __init__(self, seed: int, start: tuple[float, float], seconds: float, discs: int = DISCS) -> None:
        rng = np.random.default_rng(seed)
        self.pieces = [list(_pieces(rng, start, seconds)) for _ in range(discs)]
        self._ends = [[piece[1] for piece in pieces] for pieces in self.pieces]

    def at(self, time: float) -> FloatArray:
        """Return where the discs' centres are, shape (k, 2)."""
        of = zip(self.pieces, self._ends, strict=True)
        return np.array([_place(pieces[bisect_left(ends, time)], time) for pieces, ends in of])

    def during(
        self, begin: float, end: float, near: tuple[float, float, float]
    ) -> Iterator[tuple[float, float, FloatArray, FloatArray]]:
        """Yield (begin, end, from, to) for each straight piece of a disc's motion between two moments.

        Pieces all of which lie farther from a place than a distance (``near``: x, y, metres) may be left out.
        """
        for pieces, ends in zip(self.pieces, self._ends, strict=True):
            for piece in islice(pieces, bisect_left(ends, begin), None):
                if piece[0] >= end:
                    break
                low, high = max(begin, piece[0]), min(end, piece[1])
                x, y = piece[2] + (low - piece[0]) * piece[4], piece[3] + (low - piece[0]) * piece[5]
                away = hypot(x - near[0], y - near[1]) - SPEED * (high - low)
                if low < high and away <= near[2]:
                    yield low, high, _place(piece, low), _place(piece, high)


def _pieces(rng: np.random.Generator, start: tuple[float, float], seconds: float) -> Iterator[Piece]:
    """Yield the straight pieces (begin, end, x, y, vx, vy) of one disc's motion."""
    low, high = DISC_RADIUS, SIZE - DISC_RADIUS
    x, y = rng.uniform(low, high, 2)
    while hypot(x - start[0], y - start[1]) < FREE_START:
        x, y = rng.uniform(low, high, 2)
    time = 0.0
    while time < seconds:
        angle, turn = rng.uniform(0.0, 2.0 * np.pi), time + rng.exponential(1.0 / TURNS_PER_SECOND)
        vx, vy = SPEED * cos(angle), SPEED * sin(angle)
        while time < turn:
            to_x = ((high if vx > 0.0 else low) - x) / vx
            to_y = ((high if vy > 0.0 else low) - y) / vy
            span = max(0.0, min(to_x, to_y, turn - time))
            if span > 0.0:
                yield time, time + span, x, y, vx, vy
            x, y, time = x + span * vx, y + span * vy, time + span
            if time < turn:
                vx, vy = (-vx if to_x <= to_y else vx), (-vy if to_y <= to_x else vy)
            if turn - time < 1e-12:
                break
        time = max(time, turn)


def _place(piece: Piece, time: float) -> FloatArray:
    begin, _, x, y, vx, vy = piece
    return np.array([x + (time - begin) * vx, y + (time - begin) * vy])


def first_contact(scene: Scene, legs: list[Leg], half: tuple[float, float], radius: float) -> float:
    """Return when the robot first meets a disc, seconds; infinite if it never does.

    Args:
        scene: the discs.
        legs: the robot's motions.
        half: half of the length and width of the rectangle that is the robot; (0, 0) for a disc.
        radius: of the robot, 0 for a rectangle.
    """
    first = inf
    for leg in legs:
        reach = hypot(*(leg.b - leg.a)[:2]) + hypot(*half) + radius + DISC_RADIUS
        for begin, end, p, q in scene.during(leg.begin, leg.end, (leg.a[0], leg.a[1], 1.001 * reach)):
            a, b = _part(leg, begin), _part(leg, end)
            if half == (0.0, 0.0):
                met = _points_meet(a[:2] - p, b[:2] - q, DISC_RADIUS + radius)
            else:
                met = _rectangle_meets(a, b, p, q, half, DISC_RADIUS)
            if met < inf:
                first = min(first, begin + met * (end - begin))
    return first


def _part(leg: Leg, time: float) -> FloatArray:
    share = (time - leg.begin) / (leg.end - leg.begin) if leg.end > leg.begin else 0.0
    turn = (leg.b[2] - leg.a[2] + np.pi) % (2.0 * np.pi) - np.pi
    return np.array([*(leg.a[:2] + share * (leg.b - leg.a)[:2]), leg.a[2] + share * turn])


def _points_meet(a: FloatArray, b: FloatArray, radius: float) -> float:
    """Return the share of the way from a to b at which a point comes nearer to the origin than a radius; or inf."""
    move = b - a
    square, along, off = float(move @ move), float(a @ move), float(a @ a) - radius * radius
    if off < 0.0:
        return 0.0
    root = along * along - square * off
    if square == 0.0 or root <= 0.0 or along >= 0.0:
        return inf
    share = (-along - root**0.5) / square
    return share if share <= 1.0 else inf


def _rectangle_meets(
    a: FloatArray, b: FloatArray, p: FloatArray, q: FloatArray, half: tuple[float, float], radius: float
) -> float:
    """Return the share of its motion at which a rectangle that goes from a to b meets a disc from p to q; or inf.

    Intervals are halved until the disc is farther away in their middle than the two can come nearer in half of them.
    """
    move = b - a
    rate = hypot(*(move[:2] - (q - p))) + abs(move[2]) * hypot(*half)
    intervals = [(0.0, 1.0)]
    while intervals:
        low, high = intervals.pop()
        middle = 0.5 * (low + high)
        pose, center = a + middle * move, p + middle * (q - p)
        dx, dy = center - pose[:2]
        c, s = cos(pose[2]), sin(pose[2])
        gap = hypot(max(abs(c * dx + s * dy) - half[0], 0.0), max(abs(c * dy - s * dx) - half[1], 0.0)) - radius
        if gap >= 0.5 * (high - low) * rate:
            continue
        if (high - low) * rate <= 1e-9:
            return middle
        intervals += [(middle, high), (low, middle)]
    return inf
