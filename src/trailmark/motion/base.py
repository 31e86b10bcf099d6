"""How robots move from one configuration to another, in compiled code, for roadmaps, searches and shortening.

A disc is translated; any shape moves straight in SE(2); a differential drive turns, drives ahead and turns; a car
drives along the shortest curves of Dubins, or of Reeds and Shepp if it reverses. Kernels take which of them it is, and
what it costs where, as one tuple, :class:`MotionModel`, and branch when they run: of one type, they are compiled once.
Python uses a :class:`trailmark.motion.Motion`, which holds that tuple.
"""

from __future__ import annotations

from math import atan2, expm1, fabs, hypot, inf, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.certify import BUDGET, EXACT, curve_motion, motion, new_queue
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.kernels import FREE, state, workspace
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves.shortest import MAX_WORDS, curve_length, shortest_word
from trailmark.curves.words import PIECES, unit_length, walk
from trailmark.heading import turn, wrapped
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.density import Density, line_cost, near_border
from trailmark.motion.one_way import OneWays, curve_allowed, straight_allowed
from trailmark.se2 import ROTATION_WEIGHT, FloatArray

__all__ = [
    "ALIGNED",
    "CURVE",
    "DIFFERENTIAL",
    "STRAIGHT",
    "TRANSLATION",
    "MotionModel",
    "Scratch",
    "certified",
    "charged",
    "cost",
    "costs",
    "embedding_radius",
    "extra",
    "extra_along",
    "facing",
    "interpolate",
    "least_cost",
    "motions_free",
    "new_scratch",
    "obeys_triangle",
    "path_cost",
    "weighted_cost",
    "word_extra",
]

TRANSLATION, STRAIGHT, DIFFERENTIAL, CURVE = 0, 1, 2, 3
"""Kinds of motion."""

ALIGNED = 1e-9
"""Radians by which a drive may be off the heading: less is not turned by, since it is rounding."""

CHORD = 0.1
"""Metres: a curve is charged as chords of at most this length, and of a tenth of its turning radius."""


class MotionModel(NamedTuple):
    """How a robot moves in a world, as compiled code takes it.

    Whether ``car`` and ``weighted`` are empty compiled code knows by their types: what it would not run goes from it.

    Attributes:
        grid: the obstacles.
        field: their clearance field.
        robot: the footprint.
        drive: TRANSLATION, STRAIGHT, DIFFERENTIAL or CURVE.
        embedding: see :func:`embedding_radius`, metres.
        car: one element if it is a CURVE, else empty.
        radius: a car's turning radius, metres.
        reverse: whether a car or a differential drive goes backwards too.
        direction_change: what a car's change of direction costs, metres.
        reverse_metre: what a car's metre in reverse costs beyond its length, metres.
        weighted: one element if ``density`` says what a metre costs and ``one_way`` which way it leads, else empty.
        density: what a metre costs at a place.
        one_way: zones with a direction of travel.
    """

    grid: ObstacleGrid
    field: ClearanceField
    robot: Footprint
    drive: int
    embedding: float
    car: tuple[bool, ...]
    radius: float
    reverse: bool
    direction_change: float
    reverse_metre: float
    weighted: tuple[bool, ...]
    density: Density
    one_way: OneWays


class Scratch(NamedTuple):
    """Memory for the compiled code of one thread to work in.

    Attributes:
        placed: (v, 2), the placed outline.
        queue: (128, 2), gaps of a motion.
        words: (w, 2, 5), a car's curves, the one that was asked for first.
        stops: (4, 3), configurations on the way.
    """

    placed: FloatArray
    queue: FloatArray
    words: FloatArray
    stops: FloatArray


@array_callee
def new_scratch(kind: MotionModel) -> Scratch:
    """Return memory for one thread to work in."""
    words = np.empty((MAX_WORDS if len(kind.car) else 0, 2, PIECES))
    return Scratch(workspace(kind.robot), new_queue(), words, np.empty((4, 3)))


# --- what a motion is ------------------------------------------------------------------------------------------------


@callee
def certified(kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray, budget: int) -> bool:
    """Return whether the motion from a to b, both valid, is certified free of collision and travels as zones allow.

    Args:
        kind: of motion.
        scratch: memory to work in.
        a: shape (3,).
        b: shape (3,).
        budget: maximum number of configurations evaluated; a motion that needs more is not certified.
    """
    placed, queue = scratch.placed, scratch.queue
    if len(kind.car):
        shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
        word = scratch.words[0]
        if len(kind.weighted) and not curve_allowed(kind.one_way, a, word, kind.radius):
            return False
        return bool(
            curve_motion(kind.grid, kind.field, kind.robot, placed, queue, a, word, kind.radius, budget) == FREE
        )
    if len(kind.weighted) and not straight_allowed(kind.one_way, a, b):
        return False
    if kind.drive != DIFFERENTIAL:
        return bool(motion(kind.grid, kind.field, kind.robot, placed, queue, a, b, EXACT, budget) == FREE)
    heading = facing(kind, a, b)
    _write_stops(heading, a, b, scratch.stops)
    for k in range(1, 3):
        # Between two motions they are ends, at which a motion may be in contact.
        q = scratch.stops[k]
        known = _same(q, a) or _same(q, b)
        if not known and state(kind.grid, kind.field, kind.robot, placed, q[0], q[1], q[2]) != FREE:
            return False
    # The drive first: it is the longest.
    for k in (1, 0, 2):
        p, q = scratch.stops[k], scratch.stops[k + 1]
        if motion(kind.grid, kind.field, kind.robot, placed, queue, p, q, EXACT, budget) != FREE:
            return False
    return True


@callee
def interpolate(kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray, along: float, q: FloatArray) -> None:
    """Write the configuration at cost ``along`` on the motion from a to b to q.

    A cost that depends on the place is taken as evenly spread: what is made of it is charged anew.
    """
    if len(kind.weighted):
        whole = weighted_cost(kind, scratch, a, b, inf)[0]
        along = (min(1.0, along / whole) if whole > 0.0 else 0.0) * _plain_cost(kind, scratch, a, b)
    if len(kind.car):
        shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
        walk(a, scratch.words[0], kind.radius, along, q)
    elif kind.drive == DIFFERENTIAL:
        _write_stops(facing(kind, a, b), a, b, scratch.stops)
        for k in range(3):
            if _advance(scratch.stops[k], scratch.stops[k + 1], along, ROTATION_WEIGHT, q):
                return
            p, r = scratch.stops[k], scratch.stops[k + 1]
            along -= hypot(r[0] - p[0], r[1] - p[1]) + ROTATION_WEIGHT * fabs(turn(p[2], r[2]))
    else:
        _advance(a, b, along, ROTATION_WEIGHT if kind.drive == STRAIGHT else 0.0, q)


@callee
def _advance(a: FloatArray, b: FloatArray, along: float, rotation: float, q: FloatArray) -> bool:
    """Write the configuration at cost ``along`` on the straight motion from a to b to q; return False at its end."""
    turned = turn(a[2], b[2])
    length = hypot(b[0] - a[0], b[1] - a[1]) + rotation * fabs(turned)
    if along > length or length <= 0.0:
        q[0], q[1], q[2] = b[0], b[1], b[2]
        return False
    t = along / length
    q[0], q[1], q[2] = a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), wrapped(a[2] + t * turned)
    return True


@callee
def facing(kind: MotionModel, a: FloatArray, b: FloatArray) -> float:
    """Return the heading (radians) in which a differential drive goes from a to b; a's own where it does not."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    if dx == 0.0 and dy == 0.0:
        return float(a[2])
    ahead = atan2(dy, dx)
    if kind.reverse:
        back = wrapped(ahead + pi)
        if (
            fabs(turn(a[2], back)) + fabs(turn(back, b[2]))
            < fabs(turn(a[2], ahead)) + fabs(turn(ahead, b[2])) - ALIGNED
        ):
            ahead = back
    # What is rounding is not turned by.
    if fabs(turn(a[2], ahead)) <= ALIGNED:
        return float(a[2])
    return float(b[2]) if fabs(turn(ahead, b[2])) <= ALIGNED else ahead


@callee
def _write_stops(heading: float, a: FloatArray, b: FloatArray, stops: FloatArray) -> None:
    """Write the four states, shape (4, 3), between which a differential drive turns, goes in a heading and turns."""
    for k in range(4):
        q = a if k < 2 else b
        stops[k, 0], stops[k, 1], stops[k, 2] = q[0], q[1], q[2] if k in (0, 3) else heading


@callee
def _same(p: FloatArray, q: FloatArray) -> bool:
    return bool(p[0] == q[0] and p[1] == q[1] and p[2] == q[2])


@callee
def embedding_radius(kind: MotionModel) -> float:
    """Return R of the embedding (x, y, R·cos θ, R·sin θ) in which near configurations are cheap to join, metres."""
    return kind.embedding


# --- what a motion costs ---------------------------------------------------------------------------------------------


@callee
def cost(kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    """Return the cost (metres) of the motion from a to b, each of shape (3,)."""
    return weighted_cost(kind, scratch, a, b, inf)[0] if len(kind.weighted) else _plain_cost(kind, scratch, a, b)


@callee
def _plain_cost(kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray) -> float:
    if len(kind.car):
        return curve_length(a, b, kind.radius, kind.reverse, scratch.words)
    length = hypot(b[0] - a[0], b[1] - a[1])
    return length if kind.drive == TRANSLATION else length + ROTATION_WEIGHT * _turned(kind, a, b)


@callee
def _turned(kind: MotionModel, a: FloatArray, b: FloatArray) -> float:
    """Return the radians by which the robot turns on the way from a to b, unless it is a car."""
    if kind.drive != DIFFERENTIAL:
        return fabs(turn(a[2], b[2]))
    heading = facing(kind, a, b)
    return fabs(turn(a[2], heading)) + fabs(turn(heading, b[2]))


@callee
def weighted_cost(
    kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray, tolerance: float
) -> tuple[float, float]:
    """Return the cost of a weighted motion from a to b, and a bound on its error.

    Args:
        kind: of motion.
        scratch: memory to work in.
        a: shape (3,).
        b: shape (3,).
        tolerance: share of the cost that the error may come to; infinite: as exact as for planning.
    """
    density = kind.density
    if len(kind.car):
        return _curve_cost(kind, scratch, a, b, tolerance)
    found, error = line_cost(density, kind.grid, kind.field, a[0], a[1], b[0], b[1], tolerance)
    return found + density.rotation * _turned(kind, a, b), error


@callee
def _curve_cost(
    kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray, tolerance: float
) -> tuple[float, float]:
    """Charge a curve as chords, each longer by what all of them fall short of the curve."""
    shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
    word, density = scratch.words[0], kind.density
    length = kind.radius * unit_length(word)
    if len(density.zones) == 0 and density.clearance == 0.0:
        found = length * (density.length + density.time / density.speed)
        return found, 1e-12 * found
    longest = min(CHORD, 0.1 * kind.radius) if tolerance == inf else min(CHORD, 0.01 * kind.radius)
    pieces = max(1, int(np.ceil(length / longest)))
    step = length / pieces
    # By so much an arc may bulge from its chord.
    bulge = step * step / (8.0 * kind.radius) * 1.001
    found, error, along = 0.0, 0.0, 0.0
    x, y, q = a[0], a[1], scratch.stops[0]
    for k in range(1, pieces + 1):
        walk(a, word, kind.radius, length * k / pieces, q)
        piece, off = line_cost(density, kind.grid, kind.field, x, y, q[0], q[1], tolerance)
        chord = hypot(q[0] - x, q[1] - y)
        # Where the car changes direction it drives beyond the chord's ends.
        beside = bulge if chord > 0.999 * step else step
        if tolerance < inf and near_border(density, x, y, q[0], q[1], beside):
            off += (density.most - density.least) * step
        if density.clearance > 0.0:
            # So much nearer to an obstacle, or farther from it, the car may be than on the chord.
            off += density.clearance * step * expm1(beside / density.decay)
        along += chord
        found, error = found + piece, error + off
        x, y = q[0], q[1]
    stretch = length / along if along > 0.0 else 1.0
    # What the chords fall short is charged like the rest, but may lie where a metre costs least or most.
    error += max(0.0, length - along) * (density.most + density.clearance - density.least)
    return found * stretch, error * stretch


@callee
def least_cost(kind: MotionModel, a: FloatArray, b: FloatArray) -> float:
    """Return a lower bound (metres) on :func:`cost` that is cheap to compute and continuous in a and b."""
    length = hypot(b[0] - a[0], b[1] - a[1])
    if len(kind.weighted):
        return kind.density.least * length
    turns = kind.drive in (STRAIGHT, DIFFERENTIAL)
    return length + ROTATION_WEIGHT * fabs(turn(a[2], b[2])) if turns else length


@callee
def obeys_triangle(kind: MotionModel) -> bool:
    """Return whether no motion costs more than two that lead to the same place."""
    return len(kind.weighted) == 0 and (kind.drive != DIFFERENTIAL or not kind.reverse)


@callee
def charged(kind: MotionModel) -> bool:
    """Return whether motions may cost more than :func:`cost`: see :func:`extra`."""
    return kind.direction_change > 0.0 or kind.reverse_metre > 0.0


@callee
def extra(kind: MotionModel, scratch: Scratch, a: FloatArray, b: FloatArray, gear: float) -> tuple[float, float]:
    """Return what the motion from a to b costs beyond :func:`cost`, and the gear at its end.

    A car is charged for its changes of direction and its metres in reverse: one driven to and fro costs more than its
    motions do one by one.

    Args:
        kind: of motion.
        scratch: memory to work in.
        a: shape (3,).
        b: shape (3,).
        gear: of the motion before: 1 forwards, -1 backwards, 0 if there is none or it makes no difference.
    """
    if len(kind.car) == 0 or not charged(kind):
        return 0.0, 0.0
    shortest_word(a, b, kind.radius, kind.reverse, scratch.words)
    return word_extra(scratch.words[0], kind.radius, kind.direction_change, kind.reverse_metre, gear)


@callee
def word_extra(
    word: FloatArray, radius: float, direction_change: float, reverse_metre: float, gear: float
) -> tuple[float, float]:
    """Return what a word, shape (2, 5), costs beyond its length (metres), and the gear at its end: :func:`extra`."""
    total = 0.0
    for k in range(PIECES):
        if word[0, k] == 0.0:
            continue
        now = 1.0 if word[0, k] > 0.0 else -1.0
        if gear * now < 0.0:
            total += direction_change
        if now < 0.0:
            total -= reverse_metre * radius * word[0, k]
        gear = now
    return total, gear


@callee
def extra_along(kind: MotionModel, scratch: Scratch, path: FloatArray, first: int, last: int) -> float:
    """Return the :func:`extra` cost of a path's motions from state ``first`` to ``last``, what is before left aside."""
    total, gear = 0.0, 0.0
    if len(kind.car) and charged(kind):
        for i in range(max(0, first), min(last, len(path) - 1)):
            more, gear = extra(kind, scratch, path[i], path[i + 1], gear)
            total += more
    return total


# --- what Python asks ------------------------------------------------------------------------------------------------


@njit(nogil=True)
def costs(kind: MotionModel, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the costs (metres, shape (n,)) of the motions from a to b, each of shape (n, 3)."""
    scratch, result = new_scratch(kind), np.empty(len(a))
    for i in range(len(a)):
        result[i] = cost(kind, scratch, a[i], b[i])
    return result


@njit(nogil=True)
def path_cost(kind: MotionModel, states: FloatArray, tolerance: float) -> tuple[float, float, float]:
    """Return the cost of a path's motions, what it costs beyond them, and a bound on the error; states (n, 3)."""
    scratch, total, error = new_scratch(kind), 0.0, 0.0
    for i in range(len(states) - 1):
        if len(kind.weighted):
            one, off = weighted_cost(kind, scratch, states[i], states[i + 1], tolerance)
            error += off
        else:
            one = cost(kind, scratch, states[i], states[i + 1])
        total += one
    return total, extra_along(kind, scratch, states, 0, len(states) - 1), error


@njit(nogil=True)
def motions_free(kind: MotionModel, a: FloatArray, b: FloatArray) -> NDArray[np.bool_]:
    """Return which motions between valid configurations, each of shape (n, 3), are certified, shape (n,)."""
    scratch, result = new_scratch(kind), np.empty(len(a), np.bool_)
    for i in range(len(a)):
        result[i] = certified(kind, scratch, a[i], b[i], BUDGET)
    return result


@njit
def driven(kind: MotionModel, states: FloatArray) -> FloatArray:
    """Return a path of a differential drive, (m, 3), with the states between the turns and drives of each motion."""
    found, stops = np.empty((3 * len(states), 3)), np.empty((4, 3))
    found[0] = states[0]
    count = 1
    for i in range(len(states) - 1):
        _write_stops(facing(kind, states[i], states[i + 1]), states[i], states[i + 1], stops)
        for k in range(1, 4):
            if (stops[k] != found[count - 1]).any() or (i == len(states) - 2 and k == 3 and count == 1):
                found[count] = stops[k]
                count += 1
    return found[:count]
