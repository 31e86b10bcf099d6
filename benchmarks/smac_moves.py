"""Moves of a hybrid A* (benchmarks/smac_like.py): each drive's, what leads to the goal, what hits an obstacle."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from benchmarks.costmap import Costmap, cell_of
from trailmark.collision import StateChecker
from trailmark.compiled import njit
from trailmark.curves.shortest import curve_length, shortest_word
from trailmark.curves.words import unit_length, walk
from trailmark.heading import turn, wrapped
from trailmark.se2 import ROTATION_WEIGHT, FloatArray
from trailmark.world import Robot

__all__ = ["HEADINGS", "Moves", "Outline", "ahead_of", "analytic", "apply", "hits", "moves_of", "outline_of"]

HEADINGS = 72
"""Headings that are told apart: five degrees each."""

DIRECTIONS = np.array([(a, b) for a in range(-2, 3) for b in range(-2, 3) if max(abs(a), abs(b)) == 2])
"""Moves of a robot that moves in every direction, cells: sixteen directions, each into another cell."""

OMNIDIRECTIONAL, DIFFERENTIAL, CAR = range(3)


class Moves(NamedTuple):
    """What a robot does between two nodes.

    Attributes:
        steps: changes of x, y (metres) and heading (radians), and what each costs (metres), shape (n, 4).
        drive: OMNIDIRECTIONAL, whose changes of x and y are the map's, DIFFERENTIAL or CAR, whose are the robot's.
        radius: turning radius of a car, metres.
        reverse: whether it drives backwards.
    """

    steps: FloatArray
    drive: int
    radius: float
    reverse: bool


class Outline(NamedTuple):
    """A footprint's outline.

    Attributes:
        points: at most half a cell apart, in the robot's frame, shape (n, 2).
        reach: of the farthest, metres.
        inscribed: radius of the largest disc about the reference point within it, 0 if that lies outside; metres.
    """

    points: FloatArray
    reach: float
    inscribed: float


def moves_of(robot: Robot, size: float) -> Moves:
    """Return the moves of a robot over cells of ``size`` metres.

    An arc leads into another cell, and turns by a whole number of headings, as the primitives of Smac do: its angle is
    at least that of a chord as long as a cell's diagonal, 2 asin(√2 size / 2 radius).
    """
    chord, bin_size = math.sqrt(2.0) * size, 2.0 * math.pi / HEADINGS
    spin = [(0.0, 0.0, sign * bin_size, ROTATION_WEIGHT * bin_size) for sign in (-1.0, 1.0)]
    directions = (1.0, -1.0) if robot.reverse else (1.0,)
    if robot.turning_radius is None:
        if robot.drive == "differential":
            ahead = [(direction * chord, 0.0, 0.0, chord) for direction in directions]
            return Moves(np.array(ahead + spin), DIFFERENTIAL, 0.0, robot.reverse)
        shifts = [(size * i, size * j, 0.0, size * math.hypot(i, j)) for i, j in DIRECTIONS.tolist()]
        return Moves(np.array(shifts + spin), OMNIDIRECTIONAL, 0.0, True)
    radius = robot.turning_radius
    angle = bin_size * math.ceil(2.0 * math.asin(min(1.0, 0.5 * chord / radius)) / bin_size)
    x, y = radius * math.sin(angle), radius * (1.0 - math.cos(angle))
    arcs = [(direction * chord, 0.0, 0.0, chord) for direction in directions]
    arcs += [(d * x, side * y, d * side * angle, radius * angle) for d in directions for side in (-1.0, 1.0)]
    return Moves(np.array(arcs), CAR, radius, robot.reverse)


def outline_of(checker: StateChecker, size: float) -> Outline:
    """Return the outline of a checker's robot, for cells of ``size`` metres."""
    ring = checker.robot.outline.rings()[0]
    step = 0.5 * size
    points = []
    for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        n = max(1, math.ceil(float(np.hypot(*(b - a))) / step))
        points.append(a + (b - a) * (np.arange(n) / n)[:, None])
    x, y = (ring - np.roll(ring, -1, axis=0)).T
    along = np.clip(-((np.roll(ring, -1, axis=0) * np.column_stack([x, y])).sum(axis=1)) / (x**2 + y**2), 0.0, 1.0)
    foot = np.roll(ring, -1, axis=0) + along[:, None] * np.column_stack([x, y])
    disc = checker.robot.inscribed_disc
    holds = math.hypot(*disc.center) < disc.radius
    inscribed = float(np.hypot(*foot.T).min()) if holds else 0.0
    return Outline(np.concatenate(points), float(checker.robot.circumradius), inscribed)


@njit(cache=True)
def apply(moves: Moves, move: int, here: FloatArray, there: FloatArray) -> None:
    """Write the configuration that a move leads to, from one to another, each of shape (3,)."""
    x, y, turned, _ = moves.steps[move]
    cos, sin = (1.0, 0.0) if moves.drive == OMNIDIRECTIONAL else (math.cos(here[2]), math.sin(here[2]))
    there[0], there[1], there[2] = here[0] + cos * x - sin * y, here[1] + sin * x + cos * y, wrapped(here[2] + turned)


@njit(cache=True)
def ahead_of(moves: Moves, far: float, here: FloatArray, goal: FloatArray, words: FloatArray) -> float:
    """Return the heuristic, metres, where the grid's way to the goal is ``far`` metres; ``words`` is memory."""
    if moves.drive == CAR:
        return max(far, curve_length(here, goal, moves.radius, moves.reverse, words))
    return far + ROTATION_WEIGHT * abs(turn(here[2], goal[2]))


@njit(cache=True)
def analytic(
    costmap: Costmap, outline: Outline, moves: Moves, here: FloatArray, goal: FloatArray, words: FloatArray
) -> FloatArray:
    """Return the states of the free motion from here to the goal, without here, shape (n, 3); none if it hits.

    It is straight, or turns in place and drives and turns in place, or is the car's shortest curve.
    """
    if moves.drive == CAR:
        word = shortest_word(here, goal, moves.radius, moves.reverse, words)
        length, state = moves.radius * unit_length(word), np.empty(3)
        steps = int(length * (1.0 + outline.reach / moves.radius) / costmap.size) + 1
        for i in range(1, steps + 1):
            walk(here, word, moves.radius, length * i / steps, state)
            if hits(costmap, outline, state[0], state[1], state[2]):
                return np.empty((0, 3))
        return goal.copy().reshape(1, 3)
    ends = np.empty((1 if moves.drive == OMNIDIRECTIONAL else 3, 3))
    ends[-1] = goal
    if moves.drive == DIFFERENTIAL:
        heading = math.atan2(goal[1] - here[1], goal[0] - here[0])
        if goal[0] == here[0] and goal[1] == here[1]:
            heading = here[2]
        elif moves.reverse and abs(turn(here[2], heading)) + abs(turn(heading, goal[2])) > math.pi:
            heading = wrapped(heading + math.pi)
        ends[0, :2], ends[1, :2], ends[:2, 2] = here[:2], goal[:2], heading
    before = here
    for end in ends:
        if not _straight_free(costmap, outline, before, end):
            return np.empty((0, 3))
        before = end
    return ends


@njit(cache=True)
def hits(costmap: Costmap, outline: Outline, x: float, y: float, theta: float) -> bool:
    """Return whether an occupied cell holds a point of the outline, or the disc about the reference point says so."""
    rows, columns = costmap.distance.shape
    row, column = cell_of(costmap, x, y)
    if row < 0 or column < 0 or row >= rows or column >= columns:
        return True
    d = costmap.distance[row, column]
    if d <= outline.inscribed:
        return True
    if d > outline.reach + 1.5 * costmap.size:
        return False
    cos, sin = math.cos(theta), math.sin(theta)
    for i in range(len(outline.points)):
        px, py = outline.points[i]
        row, column = cell_of(costmap, x + cos * px - sin * py, y + sin * px + cos * py)
        if row < 0 or column < 0 or row >= rows or column >= columns or costmap.distance[row, column] <= 0.0:
            return True
    return False


@njit(cache=True)
def _straight_free(costmap: Costmap, outline: Outline, a: FloatArray, b: FloatArray) -> bool:
    """Return whether no configuration hits on the straight motion from a to b, in steps of a cell."""
    turned = turn(a[2], b[2])
    steps = int((math.hypot(b[0] - a[0], b[1] - a[1]) + outline.reach * abs(turned)) / costmap.size) + 1
    for i in range(1, steps + 1):
        t = i / steps
        if hits(costmap, outline, a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * turned):
            return False
    return True
