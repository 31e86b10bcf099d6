"""PointwiseChecker: one configuration or motion per call, for callers that need one at a time, such as OMPL's planners.

To pass the checker's ten arrays to compiled code takes longer (4 µs) than most answers. Here they are joined to a few
beforehand.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, fabs, isfinite, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import kernels
from trailmark.collision.certify import BUDGET, EXACT, curve_motion, motion, new_queue
from trailmark.collision.checker import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves import Steering
from trailmark.curves.shortest import MAX_WORDS, all_words, as_long, shortest_of, shortest_word
from trailmark.curves.words import PIECES, copy_word, unit_length, walk
from trailmark.errors import ConfigurationError
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.base import Scratch

__all__ = ["TIE", "Configuration", "CurveMarks", "Packed", "PackedChecker", "PointwiseChecker", "unpacked"]

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]
Int32Array = NDArray[np.int32]
Int64Array = NDArray[np.int64]
Configuration = tuple[float, float, float]


class Packed(NamedTuple):
    """A checker's arrays and memory to work in, in few arrays, which kernels take one by one: that is soonest.

    Attributes:
        floats: all arrays of float64, one behind the other.
        integers: all of int32, likewise.
        distance: that of the clearance field.
        places: (n, 3), where each begins, its rows and its columns; then rows and columns of the grid's cells.
    """

    floats: FloatArray
    integers: Int32Array
    distance: Float32Array
    places: Int64Array


class PackedChecker(NamedTuple):
    """A checker and what compiled code reads of it.

    Attributes:
        checker: the checker.
        arrays: its arrays.
    """

    checker: StateChecker
    arrays: Packed


class PointwiseChecker:
    """The answers of a StateChecker and of a motion, one at a time and with little overhead.

    Numbers that are no configuration (not finite, or a heading outside [-pi, pi]) are neither valid nor part of a
    certified motion. All that is compiled or built on first use is so on construction, before a planner's clock runs.

    Args:
        checker: whose answers these are.
        steering: of a car whose shortest curves the motions are; None for straight motions.

    Attributes:
        packed: the checker and its arrays.
        steering: as given.
    """

    def __init__(self, checker: StateChecker, steering: Steering | None = None) -> None:
        self.steering = steering
        self._curves = (0.0, False) if steering is None else (steering.radius, steering.reverse)
        # Its memory is for one call at a time, since none releases the interpreter's lock.
        self.packed = _packed(checker)
        self._warm_up()

    @property
    def checker(self) -> StateChecker:
        """Whose answers these are."""
        return self.packed.checker

    def update(self, checker: StateChecker) -> None:
        """Answer for another world from now on; a call that is under way in another thread answers for the one before.

        Args:
            checker: of the other world and the same robot.

        Raises:
            ConfigurationError: a checker for another robot.
        """
        checker.require_for(checker.world, self.checker.robot)
        self.packed = _packed(checker)

    def _warm_up(self) -> None:
        """Call every kernel once."""
        arrays = self.packed.arrays
        xmin, ymin, xmax, ymax = self.checker.world.bounds
        inside = (0.5 * (xmin + xmax), 0.5 * (ymin + ymax), 0.0)
        _valid(*arrays, *inside)
        _clearance(*arrays, *inside)
        self.motion_valid(inside, inside)
        self.step_valid(*inside, *inside)
        self.checker.scene.collides(np.array(inside))

    def valid(self, x: float, y: float, theta: float) -> bool:
        """Return whether a configuration is valid (metres, radians)."""
        return _state_valid(self.packed, x, y, theta)

    def clearance(self, x: float, y: float, theta: float) -> float:
        """Return the distance (metres) to the nearest obstacle or bound, beyond the clearance that the robot keeps."""
        return float(_clearance(*self.packed.arrays, x, y, theta))

    def motion_valid(self, a: Configuration, b: Configuration) -> bool:
        """Return whether the motion from a to b, both known to be valid, is certified free of collision."""
        return bool(_motion(*self.packed.arrays, *a, *b, *self._curves, False) == kernels.FREE)

    def step_valid(self, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> bool:
        """Return whether b is valid and the motion from a, known to be valid, to b is certified."""
        packed = self.packed
        answer = _motion(*packed.arrays, ax, ay, at, bx, by, bt, *self._curves, True)
        if answer == kernels.UNDECIDED:
            return _state_valid(packed, bx, by, bt) and self.motion_valid((ax, ay, at), (bx, by, bt))
        return bool(answer == kernels.FREE)


def _state_valid(packed: PackedChecker, x: float, y: float, theta: float) -> bool:
    answer = _valid(*packed.arrays, x, y, theta)
    if answer == kernels.UNDECIDED:
        return not packed.checker.scene.collides(np.array([x, y, theta]))
    return bool(answer == kernels.FREE)


def _packed(checker: StateChecker) -> PackedChecker:
    """Pack a checker, whose FCL scene is built now, and not within a call."""
    _ = checker.scene
    grid, field, robot = checker.grid, checker.field, checker.footprint
    numbers = [grid.x0, grid.y0, grid.size, field.x0, field.y0, field.size, field.slack, robot.core_gap]
    numbers += [robot.circumradius, robot.sweep_radius, robot.dilation, robot.rim]
    of_robot = [robot.outline, robot.core, robot.cover, robot.inner]
    memory = [
        kernels.workspace(robot),
        new_queue(),
        np.empty((2, 3)),
        np.empty((MAX_WORDS * 2, PIECES)),
        np.empty((4, 3)),
    ]
    floats = [grid.segments, grid.discs, *of_robot, *memory, np.array([numbers])]
    integers = [grid.cell_start, grid.items[None], grid.winding]
    places = [row for arrays in (floats, integers) for row in _places(arrays)]
    joined = np.concatenate([np.ravel(array) for array in floats])
    together = np.concatenate([np.ravel(array) for array in integers])
    shape = (0, grid.columns, grid.rows)
    return PackedChecker(checker, Packed(joined, together, field.distance, np.array([*places, shape], np.int64)))


def _places(arrays: list[NDArray[Any]]) -> list[tuple[int, ...]]:
    """Return where each of some arrays, of two dimensions, begins once they are joined, its rows and its columns."""
    begins = np.cumsum([0, *(array.size for array in arrays)]).tolist()
    return [(begin, *array.shape) for begin, array in zip(begins, arrays, strict=False)]


@array_callee
def _table(joined: NDArray[Any], places: NDArray[np.int64], k: int) -> Any:
    """Return an array of those that were joined, (rows, columns)."""
    begin, rows, columns = places[k, 0], places[k, 1], places[k, 2]
    return joined[begin : begin + rows * columns].reshape(rows, columns)


@array_callee
def unpacked(packed: Packed) -> tuple[ObstacleGrid, ClearanceField, Footprint]:
    """Return the kernels' arguments, in the order in which :func:`_packed` joins them."""
    floats, integers, places = packed.floats, packed.integers, packed.places
    numbers = _table(floats, places, 11)[0]
    segments, discs = _table(floats, places, 0), _table(floats, places, 1)
    starts, items, winding = _table(integers, places, 12), _table(integers, places, 13)[0], _table(integers, places, 14)
    columns, rows = places[15, 1], places[15, 2]
    grid = ObstacleGrid(segments, discs, starts, items, winding, numbers[0], numbers[1], numbers[2], columns, rows)
    field = ClearanceField(packed.distance, numbers[3], numbers[4], numbers[5], numbers[6])
    robot = Footprint(
        _table(floats, places, 2),
        _table(floats, places, 3),
        numbers[7],
        _table(floats, places, 4),
        _table(floats, places, 5),
        numbers[8],
        numbers[9],
        numbers[10],
        numbers[11],
    )
    return grid, field, robot


@array_callee
def scratch_of(packed: Packed) -> tuple[Scratch, FloatArray]:
    """Return memory to work in, and for a motion's ends, shape (2, 3)."""
    floats, places = packed.floats, packed.places
    words = _table(floats, places, 9).reshape(MAX_WORDS, 2, PIECES)
    placed, queue, ends = _table(floats, places, 6), _table(floats, places, 7), _table(floats, places, 8)
    return Scratch(placed, queue, words, _table(floats, places, 10)), ends


@callee
def is_configuration(x: float, y: float, theta: float) -> bool:
    """Return whether numbers are a configuration: kernels would take what compares false with everything for free."""
    return isfinite(x + y) and -pi <= theta <= pi


@njit
def _valid(
    floats: FloatArray,
    integers: Int32Array,
    distance: Float32Array,
    places: Int64Array,
    x: float,
    y: float,
    theta: float,
) -> int:
    if not is_configuration(x, y, theta):
        return kernels.BLOCKED
    packed = Packed(floats, integers, distance, places)
    grid, field, robot = unpacked(packed)
    return int(kernels.state(grid, field, robot, scratch_of(packed)[0].placed, x, y, theta))


@njit
def _clearance(
    floats: FloatArray,
    integers: Int32Array,
    distance: Float32Array,
    places: Int64Array,
    x: float,
    y: float,
    theta: float,
) -> float:
    if not is_configuration(x, y, theta):
        return 0.0
    packed = Packed(floats, integers, distance, places)
    grid, field, robot = unpacked(packed)
    q = np.empty((1, 3))
    q[0, 0], q[0, 1], q[0, 2] = x, y, theta
    return float(kernels.clearances(grid, field, robot, q, np.inf)[0])


@njit
def _motion(
    floats: FloatArray,
    integers: Int32Array,
    distance: Float32Array,
    places: Int64Array,
    ax: float,
    ay: float,
    at: float,
    bx: float,
    by: float,
    bt: float,
    radius: float,
    reverse: bool,
    with_end: bool,
) -> int:
    """Return FREE or BLOCKED for the motion from a to b; UNDECIDED where b is asked for too and left to FCL.

    It is straight where the turning radius is 0. Written out, not by :func:`trailmark.motion.base.certified`: the many
    words of its arguments take a tenth of the time.
    """
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return kernels.BLOCKED
    packed = Packed(floats, integers, distance, places)
    (grid, field, robot), (scratch, ends) = unpacked(packed), scratch_of(packed)
    placed, queue = scratch.placed, scratch.queue
    if with_end:
        answer = int(kernels.state(grid, field, robot, placed, bx, by, bt))
        if answer != kernels.FREE:
            return answer
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    if radius == 0.0:
        return int(motion(grid, field, robot, placed, queue, ends[0], ends[1], EXACT, BUDGET))
    shortest_word(ends[0], ends[1], radius, reverse, scratch.words)
    return int(curve_motion(grid, field, robot, placed, queue, ends[0], scratch.words[0], radius, BUDGET))


# --- Marks of curves

TIE, DISTINCT = 1e-8, 1e-6
"""Metres: a curve whose length differs by no more than TIE may be another program's; one that differs by more than
DISTINCT is not."""

MAX_MARKS, LONGEST_ARC, LAST = 32, 2.0, 1.0 - 2.0**-40
"""Rows for a curve's marks; radians on an arc from one to the next; fraction of the last one, just before the end."""


class CurveMarks:
    """Certified curves between two configurations, as marks, by which another program's curves are recognised.

    A program that moves along curves of its own may take another one than trailmark's of those that lead to the same
    place, by rounding or where several are as short. A mark is a row of a fraction of the length, x, y and heading. A
    curve of arcs and straight lines that is as long as a marked one and passes its marks is the same curve: nearly at
    its end, and either halfway, if no other one is as long, or all along it.

    Args:
        single: certifies the curves of its steering.

    Attributes:
        single: as given.
        steering: its steering.

    Raises:
        ConfigurationError: a checker without steering.
    """

    def __init__(self, single: PointwiseChecker) -> None:
        if single.steering is None:
            raise ConfigurationError("curve marks: expected a checker with steering, got one of straight motions")
        self.single, self.steering = single, single.steering
        rows = np.empty((MAX_MARKS + 1, 4))
        self._rows, self._length, self._marks = rows, rows[0], rows[1:]
        inside = (float(single.checker.world.bounds[0]), float(single.checker.world.bounds[1]), 0.0)
        # Compiled or loaded now, before a planner's clock runs.
        self.shortest(inside, inside)

    def shortest(self, a: Configuration, b: Configuration) -> tuple[float, list[list[float]]] | None:
        """Return length (metres) and marks of the shortest curve from a to b, both valid; None if not certified."""
        count = self._certify(a, b, 0.0, 0)
        return (float(self._length[0]), self._marks[:count].tolist()) if count > 0 else None

    def others(self, a: Configuration, b: Configuration, length: float) -> Iterator[list[list[float]]]:
        """Yield the marks of each other certified curve from a to b, both valid, that is ``length`` metres long."""
        number = 1
        while (count := self._certify(a, b, length, number)) >= 0:
            if count > 0:
                yield self._marks[:count].tolist()
            number += 1

    def _certify(self, a: Configuration, b: Configuration, length: float, number: int) -> int:
        """Certify a curve and write its marks; return what :func:`_marked_curve` does."""
        # Held meanwhile: the checker may be updated in another thread.
        steering, packed = self.steering, self.single.packed
        return int(_marked_curve(*packed.arrays, *a, *b, steering.radius, steering.reverse, length, number, self._rows))


@array_callee
def _mark(a: FloatArray, word: FloatArray, radius: float, alone: bool, marks: FloatArray) -> int:
    """Write the marks of a word from a into ``marks``, shape (MAX_MARKS, 4); return how many there are.

    The last one is nearly at the end, which curves that lead elsewhere do not pass. If another word is as long, each
    piece has a mark at its end too, a straight line one in its middle, and a long arc several: from one mark to the
    next, an arc shorter than half a turn to one side, or a straight line, is the only curve with the same turn and
    distance.
    """
    total, q = unit_length(word), np.empty(3)
    marks[0, 0], n = 0.5, 1
    if not alone:
        n, before = 0, 0.0
        for k in range(PIECES):
            length = fabs(word[0, k])
            # A piece shorter than rounding may end where the next one does.
            if length * radius > kernels.ROUNDING:
                parts = 2 if word[1, k] == 0.0 else max(1, ceil(length / LONGEST_ARC))
                for i in range(1, parts + 1):
                    marks[n, 0] = (before + length * i / parts) / total
                    n += marks[n, 0] < LAST
            before += length
    marks[n, 0] = LAST
    n += 1
    for i in range(n):
        walk(a, word, radius, marks[i, 0] * total * radius, q)
        marks[i, 1:] = q
    return n


@njit
def _marked_curve(
    floats: FloatArray,
    integers: Int32Array,
    distance: Float32Array,
    places: Int64Array,
    ax: float,
    ay: float,
    at: float,
    bx: float,
    by: float,
    bt: float,
    radius: float,
    reverse: bool,
    length: float,
    number: int,
    rows: FloatArray,
) -> int:
    """Certify one of the curves from a to b: number 0 is the shortest, the others are ``length`` metres long.

    The length of the shortest one is written to the first of the ``rows``, the curve's marks to the next ones.

    Returns:
        How many marks were written, 0 if the curve is not certified, -1 if there is no curve of that number.
    """
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return -1
    packed = Packed(floats, integers, distance, places)
    (grid, field, robot), (scratch, ends) = unpacked(packed), scratch_of(packed)
    words = scratch.words
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    n, swapped = all_words(ends[0], ends[1], radius, reverse, words)
    best, shortest = shortest_of(words, n)
    chosen = best if number == 0 else as_long(words, n, best, length / radius, TIE / radius, number)
    if chosen < 0:
        return -1
    alone = number == 0 and as_long(words, n, best, shortest, DISTINCT / radius, 1) < 0
    copy_word(words[chosen], swapped, words[0])
    word = words[0]
    if curve_motion(grid, field, robot, scratch.placed, scratch.queue, ends[0], word, radius, BUDGET) != kernels.FREE:
        return 0
    rows[0, 0] = radius * shortest
    return _mark(ends[0], word, radius, alone, rows[1:])
