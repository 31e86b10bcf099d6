"""PointwiseChecker: one configuration or motion per call, for callers that need one at a time, such as OMPL's planners.

To pass the checker's ten arrays to compiled code takes longer (4 µs) than most answers. Here they are joined to a few
beforehand.
"""

from __future__ import annotations

from math import isfinite, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision import kernels
from trailmark.collision.certify import BUDGET, EXACT, motion, new_queue
from trailmark.collision.checker import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.curves import Steering
from trailmark.curves.shortest import MAX_WORDS
from trailmark.curves.words import PIECES
from trailmark.jit import array_callee, callee, njit
from trailmark.motion.base import Scratch, certified
from trailmark.motion.curve import Curve

__all__ = [
    "Configuration",
    "Packed",
    "PackedChecker",
    "PointwiseChecker",
    "is_configuration",
    "scratch_of",
    "unpacked",
]

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
        return self._motion_valid(self.packed, a, b)

    def step_valid(self, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> bool:
        """Return whether b is valid and the motion from a, known to be valid, to b is certified."""
        packed = self.packed
        if self.steering is None:
            answer = _step(*packed.arrays, ax, ay, at, bx, by, bt)
            if answer != kernels.UNDECIDED:
                return bool(answer == kernels.FREE)
        return _state_valid(packed, bx, by, bt) and self._motion_valid(packed, (ax, ay, at), (bx, by, bt))

    def _motion_valid(self, packed: PackedChecker, a: Configuration, b: Configuration) -> bool:
        if self.steering is not None:
            return bool(_curve(*packed.arrays, *a, *b, self.steering.radius, self.steering.reverse))
        return bool(_straight(*packed.arrays, *a, *b) == kernels.FREE)


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
    memory = [kernels.workspace(robot), new_queue(), np.empty((2, 3)), np.empty((MAX_WORDS * 2, PIECES))]
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
    numbers = _table(floats, places, 10)[0]
    segments, discs = _table(floats, places, 0), _table(floats, places, 1)
    starts, items, winding = _table(integers, places, 11), _table(integers, places, 12)[0], _table(integers, places, 13)
    columns, rows = places[14, 1], places[14, 2]
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
    return Scratch(_table(floats, places, 6), _table(floats, places, 7), words), _table(floats, places, 8)


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
def _straight(
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
) -> int:
    """Return FREE or BLOCKED for the straight motion from a to b."""
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return kernels.BLOCKED
    packed = Packed(floats, integers, distance, places)
    (grid, field, robot), (scratch, ends) = unpacked(packed), scratch_of(packed)
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    # As :func:`trailmark.motion.base.certified` does it, whose many words of arguments take a tenth of the time.
    return int(motion(grid, field, robot, scratch.placed, scratch.queue, ends[0], ends[1], EXACT, BUDGET))


@njit
def _curve(
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
) -> bool:
    """Return whether the shortest curve from a to b is certified."""
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return False
    packed = Packed(floats, integers, distance, places)
    (grid, field, robot), (scratch, ends) = unpacked(packed), scratch_of(packed)
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    return certified(Curve(grid, field, robot, radius, reverse, 0.0, 0.0), scratch, ends[0], ends[1], BUDGET)


@njit
def _step(
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
) -> int:
    """Return FREE or BLOCKED for the end b and the straight motion to it; UNDECIDED where b is left to FCL."""
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return kernels.BLOCKED
    packed = Packed(floats, integers, distance, places)
    (grid, field, robot), (scratch, ends) = unpacked(packed), scratch_of(packed)
    answer = int(kernels.state(grid, field, robot, scratch.placed, bx, by, bt))
    if answer != kernels.FREE:
        return answer
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    return int(motion(grid, field, robot, scratch.placed, scratch.queue, ends[0], ends[1], EXACT, BUDGET))
