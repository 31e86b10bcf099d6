"""PointwiseChecker: one configuration or motion per call, for callers that need one at a time, such as OMPL's planners.

To pass the checker's arrays to compiled code takes longer (4 µs) than most answers. Here they are passed once, as
addresses in one array of integers; a call then passes the address of that array and the coordinates (less than 1 µs).
"""

from __future__ import annotations

from math import isfinite, pi
from typing import Any, NamedTuple

import numpy as np
from numba import carray, types  # type: ignore[attr-defined]  # numba does export carray
from numba.extending import intrinsic
from numpy.typing import NDArray

from trailmark.collision import kernels
from trailmark.collision.certify import BUDGET, motion, new_queue
from trailmark.collision.checker import StateChecker
from trailmark.collision.field import ClearanceField
from trailmark.collision.footprint import Footprint
from trailmark.collision.obstacles import ObstacleGrid
from trailmark.compiled import njit
from trailmark.curves import Steering
from trailmark.curves.shortest import MAX_WORDS
from trailmark.curves.words import PIECES
from trailmark.motion.base import Scratch, certified
from trailmark.motion.curve import Curve

__all__ = [
    "Configuration",
    "PackedChecker",
    "PointwiseChecker",
    "is_configuration",
    "pointer",
    "scratch_at",
    "unpacked",
]

FloatArray = NDArray[np.float64]
Configuration = tuple[float, float, float]


class PackedChecker(NamedTuple):
    """A checker and where compiled code finds its arrays; whoever uses the address holds this meanwhile.

    Attributes:
        checker: the checker.
        address: of the array that names all others (:func:`unpacked`).
        memory: the arrays, kept alive.
    """

    checker: StateChecker
    address: int
    memory: list[NDArray[Any]]


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
        # Memory for the kernels to work in. One call at a time uses it, since none releases the interpreter's lock.
        words = np.empty((MAX_WORDS, 2, PIECES))
        self._scratch = [kernels.workspace(checker.footprint), new_queue(), words, np.empty((2, 3))]
        self.packed = _packed(checker, self._scratch)
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
        self.packed = _packed(checker, self._scratch)

    def _warm_up(self) -> None:
        """Call every kernel once."""
        address = self.packed.address
        xmin, ymin, xmax, ymax = self.checker.world.bounds
        inside = (0.5 * (xmin + xmax), 0.5 * (ymin + ymax), 0.0)
        _valid(address, *inside)
        _clearance(address, *inside)
        self.motion_valid(inside, inside)
        self.step_valid(*inside, *inside)
        self.checker.scene.collides(np.array(inside))

    def valid(self, x: float, y: float, theta: float) -> bool:
        """Return whether a configuration is valid (metres, radians)."""
        return _state_valid(self.packed, x, y, theta)

    def clearance(self, x: float, y: float, theta: float) -> float:
        """Return the distance (metres) to the nearest obstacle or bound, beyond the clearance that the robot keeps."""
        return float(_clearance(self.packed.address, x, y, theta))

    def motion_valid(self, a: Configuration, b: Configuration) -> bool:
        """Return whether the motion from a to b, both known to be valid, is certified free of collision."""
        return self._motion_valid(self.packed, a, b)

    def step_valid(self, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> bool:
        """Return whether b is valid and the motion from a, known to be valid, to b is certified."""
        packed = self.packed
        if self.steering is None:
            answer = _step(packed.address, ax, ay, at, bx, by, bt)
            if answer != kernels.UNDECIDED:
                return bool(answer == kernels.FREE)
        return _state_valid(packed, bx, by, bt) and self._motion_valid(packed, (ax, ay, at), (bx, by, bt))

    def _motion_valid(self, packed: PackedChecker, a: Configuration, b: Configuration) -> bool:
        if self.steering is not None:
            return bool(_curve(packed.address, *a, *b, self.steering.radius, self.steering.reverse))
        return bool(_straight(packed.address, *a, *b) == kernels.FREE)


def _state_valid(packed: PackedChecker, x: float, y: float, theta: float) -> bool:
    answer = _valid(packed.address, x, y, theta)
    if answer == kernels.UNDECIDED:
        return not packed.checker.scene.collides(np.array([x, y, theta]))
    return bool(answer == kernels.FREE)


def _packed(checker: StateChecker, scratch: list[FloatArray]) -> PackedChecker:
    """Pack a checker, whose FCL scene is built now, and not within a call."""
    _ = checker.scene
    arrays, numbers = _arrays(checker), np.array(_numbers(checker))
    rows = [(array.ctypes.data, *array.shape, 1)[:3] for array in arrays]
    memory = [len(scratch[0]), *(array.ctypes.data for array in (*scratch, numbers))]
    places = np.array([*np.ravel(rows), checker.grid.columns, checker.grid.rows, *memory], dtype=np.int64)
    return PackedChecker(checker, places.ctypes.data, [*arrays, numbers, places])


def _arrays(checker: StateChecker) -> list[NDArray[Any]]:
    """Return the arrays that the kernels read, in the order in which :func:`unpacked` takes them."""
    grid, robot = checker.grid, checker.footprint
    return [
        grid.segments,
        grid.discs,
        grid.cell_start,
        grid.items,
        grid.winding,
        checker.field.distance,
        robot.outline,
        robot.core,
        robot.cover,
        robot.inner,
    ]


def _numbers(checker: StateChecker) -> list[float]:
    """Return the numbers that the kernels read, in the order in which :func:`unpacked` takes them."""
    grid, field, robot = checker.grid, checker.field, checker.footprint
    return [
        grid.x0,
        grid.y0,
        grid.size,
        field.x0,
        field.y0,
        field.size,
        field.slack,
        robot.core_gap,
        robot.circumradius,
        robot.sweep_radius,
        robot.dilation,
        robot.rim,
    ]


def _to_pointer(typing_context: Any, address: Any) -> Any:
    """Turn an address into a pointer, in compiled code."""

    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], context.get_value_type(types.voidptr))

    return types.voidptr(address), build


pointer: Any = intrinsic(_to_pointer)


@njit(cache=True)
def _numbers_at(address: int) -> FloatArray:
    return carray(pointer(carray(pointer(address), (38,), np.int64)[37]), (12,), np.float64)


@njit(cache=True)
def unpacked(address: int) -> tuple[ObstacleGrid, ClearanceField, Footprint]:
    """Return the kernels' arguments: of each array there are address, rows and columns, then the numbers' address."""
    places, numbers = carray(pointer(address), (38,), np.int64), _numbers_at(address)
    grid = ObstacleGrid(
        carray(pointer(places[0]), (places[1], places[2]), np.float64),
        carray(pointer(places[3]), (places[4], places[5]), np.float64),
        carray(pointer(places[6]), (places[7], places[8]), np.int32),
        carray(pointer(places[9]), (places[10],), np.int32),
        carray(pointer(places[12]), (places[13], places[14]), np.int32),
        numbers[0],
        numbers[1],
        numbers[2],
        places[30],
        places[31],
    )
    field = ClearanceField(
        carray(pointer(places[15]), (places[16], places[17]), np.float32),
        numbers[3],
        numbers[4],
        numbers[5],
        numbers[6],
    )
    robot = Footprint(
        carray(pointer(places[18]), (places[19], places[20]), np.float64),
        carray(pointer(places[21]), (places[22], places[23]), np.float64),
        numbers[7],
        carray(pointer(places[24]), (places[25], places[26]), np.float64),
        carray(pointer(places[27]), (places[28], places[29]), np.float64),
        numbers[8],
        numbers[9],
        numbers[10],
        numbers[11],
    )
    return grid, field, robot


@njit(cache=True)
def scratch_at(address: int) -> tuple[Scratch, FloatArray]:
    """Return memory to work in, and for a motion's ends, shape (2, 3)."""
    places = carray(pointer(address), (38,), np.int64)
    scratch = Scratch(
        carray(pointer(places[33]), (places[32], 2), np.float64),
        carray(pointer(places[34]), (128, 2), np.float64),
        carray(pointer(places[35]), (MAX_WORDS, 2, PIECES), np.float64),
    )
    return scratch, carray(pointer(places[36]), (2, 3), np.float64)


@njit(cache=True)
def is_configuration(x: float, y: float, theta: float) -> bool:
    """Return whether numbers are a configuration: kernels would take what compares false with everything for free."""
    return isfinite(x + y) and -pi <= theta <= pi


@njit(cache=True)
def _valid(address: int, x: float, y: float, theta: float) -> int:
    if not is_configuration(x, y, theta):
        return kernels.BLOCKED
    grid, field, robot = unpacked(address)
    return int(kernels.state(grid, field, robot, scratch_at(address)[0].placed, x, y, theta))


@njit(cache=True)
def _clearance(address: int, x: float, y: float, theta: float) -> float:
    if not is_configuration(x, y, theta):
        return 0.0
    grid, field, robot = unpacked(address)
    q = np.empty((1, 3))
    q[0, 0], q[0, 1], q[0, 2] = x, y, theta
    return float(kernels.clearances(grid, field, robot, q, np.inf)[0])


@njit(cache=True)
def _straight(address: int, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> int:
    """Return FREE or BLOCKED for the straight motion from a to b."""
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return kernels.BLOCKED
    grid, field, robot = unpacked(address)
    scratch, ends = scratch_at(address)
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    # As :func:`trailmark.motion.base.certified` does it, whose many words of arguments take a tenth of the time.
    return int(motion(grid, field, robot, scratch.placed, scratch.queue, ends[0], ends[1], True))


@njit(cache=True)
def _curve(
    address: int,
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
    grid, field, robot = unpacked(address)
    scratch, ends = scratch_at(address)
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    return certified(Curve(grid, field, robot, radius, reverse, 0.0, 0.0), scratch, ends[0], ends[1], BUDGET)


@njit(cache=True)
def _step(address: int, ax: float, ay: float, at: float, bx: float, by: float, bt: float) -> int:
    """Return FREE or BLOCKED for the end b and the straight motion to it; UNDECIDED where b is left to FCL."""
    if not (is_configuration(ax, ay, at) and is_configuration(bx, by, bt)):
        return kernels.BLOCKED
    grid, field, robot = unpacked(address)
    scratch, ends = scratch_at(address)
    answer = int(kernels.state(grid, field, robot, scratch.placed, bx, by, bt))
    if answer != kernels.FREE:
        return answer
    ends[0, 0], ends[0, 1], ends[0, 2] = ax, ay, at
    ends[1, 0], ends[1, 1], ends[1, 2] = bx, by, bt
    return int(motion(grid, field, robot, scratch.placed, scratch.queue, ends[0], ends[1], True))
