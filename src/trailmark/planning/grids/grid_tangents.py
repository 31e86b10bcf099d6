"""GridTangents: a disc among the cells of a grid map, its shortest paths and lower bounds on their length.

A shortest path of the disc's centre is made of arcs of circles about corners and of segments that touch two of them.
Round a corner it turns one way, left (the corner lies on its left) or right: a node is a corner and a way to turn.
A segment from circle to circle lies in a strip as wide as the disc, whose edges the corners lie on: so the one corner
sees the other, and only corners that are seen come into question.

In A* over these tangents each step is an arc and a tangent. A way that reaches a node is left out only where another
has reached it earlier on its circle at no higher cost. With the straight distance for guide, no path is shorter than
the least key that is waiting, at any time: the search may end whenever there is no more time, and has proven something.

Source: Liu & Arimoto, "Path planning using a tangent graph for mobile robots among polygonal and curved obstacles",
International Journal of Robotics Research 11(4), 1992.
"""

from __future__ import annotations

from functools import cached_property
from math import atan2, ceil, cos, floor, hypot, inf, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import distance_transform
from trailmark.formats.grid import CellObstacles, cells_of
from trailmark.heap import NO_LABELS, WAITING, Labels, add_label, entry_of, heap_pop, new_labels, with_room
from trailmark.jit import callee, njit
from trailmark.landmarks.grid_search import CLOSED, UNIT, flood
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["GridTangents", "TangentSearch"]

IntArray = NDArray[np.int64]
Int32Array = NDArray[np.int32]

MARGIN, CERTAIN = 2e-6, 1e-6
"""Metres by which circles are smaller than the disc, as in other proofs, and by which a tangent may be nearer still."""

WIDEST = 16.0
"""Radius in cells from which on too many corners lie where no disc goes."""

ROUNDING = 1e-7
"""Relative error that lengths may have, by rounding and by tangents that turn back by a hair; taken off."""

ARC = np.pi / 16.0
"""Angle of an arc that two tangents stand for at most: they are 0.5 % of the radius outside of it."""

MANY = 5_000
"""Corners of a path from which on its arcs are drawn half as finely: it takes long to check."""

AHEAD = 1e-9
"""By how much (sine of an angle) a path may seem to turn back, for rounding."""

GRAZING = 1e-12
"""Difference of slopes below which nothing is seen between two obstacles: those of vertices differ by far more."""


class GridTangents:
    """Shortest paths of a disc in one grid map; :meth:`of` makes it.

    Args:
        cells: the obstacles.
        radius: of the disc, metres.
    """

    def __init__(self, cells: CellObstacles, radius: float) -> None:
        self.radius, self._cell = radius, cells.cell
        # One more row and column of cells around, which are blocked as all that lies beyond the bounds.
        self._origin = np.array(cells.origin[:2]) - cells.cell
        self._cells = cells

    @classmethod
    def of(cls, world: World, radius: float) -> GridTangents | None:
        """Return it for a world and a disc's radius (metres); None unless the world is a grid map and no more."""
        cells = cells_of(world)
        if cells is None or world.boundary is not None or not CERTAIN + MARGIN < radius <= WIDEST * cells.cell:
            return None
        rows, columns = cells.occupied.shape
        x, y = cells.origin[:2]
        covered = x, y, x + columns * cells.cell, y + rows * cells.cell
        if np.abs(np.subtract(covered, world.bounds)).max() > 1e-9 * cells.cell:
            return None
        return cls(cells, radius)

    @cached_property
    def grid(self) -> Corners:
        """The cells and their corners."""
        return Corners(*_corners_of(np.pad(self._cells.occupied, 1, constant_values=True)))

    def search(
        self,
        a: FloatArray,
        b: FloatArray,
        *,
        spare: float | None = None,
        guide: NDArray[np.float32] | None = None,
    ) -> TangentSearch:
        """Return a search for the shortest path between two points, shape (2,).

        Args:
            a: where the disc's centre starts, metres.
            b: where it is to get, metres.
            spare: share by which the disc is larger; None for one that is never too large, which proves something.
            guide: of these ends, times a factor: soon there, but neither is the path the shortest nor anything proven.
        """
        radius = (self.radius - MARGIN if spare is None else (1.0 + spare) * self.radius) / self._cell
        given = np.empty((0, 0), np.float32) if guide is None else guide.astype(np.float32)
        start, goal = self._in_cells(a, b)
        return TangentSearch(_Task(self.grid, start, goal, radius, radius - CERTAIN / self._cell, given))

    def guide(self, a: FloatArray, b: FloatArray) -> NDArray[np.float32]:
        """Return the lengths to b by steps from cell to cell, as far as they matter from a, shape (rows, columns)."""
        columns = self.grid.blocked.shape[1]
        start, goal = (int(point[1]) * columns + int(point[0]) for point in self._in_cells(a, b))
        return np.asarray(flood(self._open, goal, start, 0)[0])

    def certified(self, bends: FloatArray) -> bool:
        """Return whether the disc is free along a path of bends, shape (n, 2), metres, with a micrometre to spare."""
        return bool(_all_fit(self.grid, (bends - self._origin) / self._cell, (self.radius + CERTAIN) / self._cell))

    def bound(self, search: TangentSearch) -> float:
        """Return the length (metres) that no path is shorter than, as far as an unguided search has come."""
        return max(0.0, search.bound * self._cell * (1.0 - ROUNDING) - CERTAIN)

    def bends(self, search: TangentSearch, spare: float) -> FloatArray:
        """Return the bends of the path that a search has found, for a disc larger by a share ``spare``; shape (n, 2).

        Arcs are replaced by tangents: it keeps the larger disc's radius from the corners that it passes.
        """
        corners = search.corners().astype(np.float64)
        circles = np.vstack([[*search.task.start, -1.0], corners, [*search.task.goal, -1.0]])
        arc = ARC if len(corners) < MANY else 2.0 * ARC
        found = _bends(circles, (1.0 + spare) * self.radius / self._cell, arc)
        return np.asarray(found * self._cell + self._origin)

    def _in_cells(self, a: FloatArray, b: FloatArray) -> list[FloatArray]:
        return [(np.asarray(point, np.float64) - self._origin) / self._cell for point in (a, b)]

    @cached_property
    def _open(self) -> Int32Array:
        """What crossing each cell costs in whose middle the disc may be, or nearly, shape (rows, columns)."""
        blocked = self.grid.blocked
        if self.radius > 0.5 * self._cell:
            blocked = distance_transform(blocked, 1.0) < self.radius / self._cell
        return np.where(blocked, CLOSED, UNIT).astype(np.int32)


class TangentSearch:
    """A search for a disc's shortest path from one point to another, which may be interrupted.

    Args:
        task: what is looked for.

    Attributes:
        limit: cells: ways that are no shorter are left out from now on.
        length: of the path that was found, cells; infinite before.
        bound: no path is shorter, cells, without a guide; no less than the limit once all is exhausted.
        expanded: how many labels have been expanded.
    """

    def __init__(self, task: _Task) -> None:
        self.task, self.limit, self.expanded = task, inf, 0
        self.length, self.bound = inf, float(np.hypot(*(task.goal - task.start)))
        self._end, self._labels = -1, NO_LABELS
        if _fits(task.grid, task.start[0], task.start[1], task.goal[0], task.goal[1], task.needed):
            self.limit = self.length = self.bound

    def run(self, labels: int) -> bool:
        """Go on until that many more labels have been expanded; return whether the search has ended."""
        ended, end, key, expanded, arrays = _search(self.task, self._labels, self.limit, labels)
        self._labels = Labels(*arrays)
        self.expanded += int(expanded)
        if end >= 0:
            self.length, self._end = float(key), int(end)
        if not self.task.guide.size:
            self.bound = max(self.bound, min(float(key), self.limit))
        return bool(ended)

    def corners(self) -> IntArray:
        """Return the corners of the path that was found: columns column, row, whether on its right; shape (n, 3)."""
        nodes: list[int] = []
        if self._end >= 0:
            label = int(self._labels.parent[self._end])
            while label >= 0:
                nodes.append(int(self._labels.node[label]))
                label = int(self._labels.parent[label])
        node = np.array(nodes[::-1], np.int64)
        row, column = np.divmod(node >> 1, self.task.grid.side.shape[1])
        return np.column_stack([column, row, node & 1])


# --- What is seen from a point among blocked cells, and whether a disc fits along a segment; compiled. Lengths are in
# cells. A cell (row, column) covers [column, column + 1] x [row, row + 1]; the outermost are blocked. A corner is a
# vertex of the grid at which exactly one of four cells is blocked: nowhere else does a disc's shortest path turn.


class Corners(NamedTuple):
    """Cells, and what is found at their vertices."""

    blocked: NDArray[np.bool_]  # (rows, columns), the outermost ones blocked
    # (rows, columns) first column from each cell on that is blocked where the cell is free, or the reverse
    right: Int32Array
    left: Int32Array  # (rows, columns) last column before each cell, likewise
    # (rows + 1, columns + 1) which of the four cells at a vertex is the only one blocked: 0 lower left, 1 lower right,
    # 2 upper left, 3 upper right; -1 where the vertex is no corner
    side: NDArray[np.int8]
    following: Int32Array  # (rows + 1, columns + 1) column of the first corner in the row from each vertex on
    total: int  # number of corners


@njit(nogil=True)
def _corners_of(
    blocked: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], Int32Array, Int32Array, NDArray[np.int8], Int32Array, int]:
    """Return the attributes of :class:`Corners` for blocked cells, shape (rows, columns)."""
    rows, columns = blocked.shape
    right, left = np.empty((rows, columns), np.int32), np.empty((rows, columns), np.int32)
    side = np.full((rows + 1, columns + 1), -1, np.int8)
    following, count = np.full((rows + 1, columns + 1), columns + 1, np.int32), 0
    for row in range(rows):
        for column in range(columns):
            same = column > 0 and blocked[row, column - 1] == blocked[row, column]
            left[row, column] = left[row, column - 1] if same else column - 1
        for column in range(columns - 1, -1, -1):
            same = column < columns - 1 and blocked[row, column + 1] == blocked[row, column]
            right[row, column] = right[row, column + 1] if same else column + 1
    for row in range(1, rows):
        for column in range(columns - 1, 0, -1):
            a, b = blocked[row - 1, column - 1], blocked[row - 1, column]
            c, d = blocked[row, column - 1], blocked[row, column]
            following[row, column] = following[row, column + 1]
            if int(a) + int(b) + int(c) + int(d) == 1:
                side[row, column] = 0 if a else 1 if b else 2 if c else 3
                following[row, column], count = column, count + 1
        following[row, 0] = following[row, 1]
    return blocked, right, left, side, following, count


@callee
def _in_row(grid: Corners, row: int, low: float, high: float, found: Int32Array, count: int) -> int:
    """Write the corners of a row between two x coordinates, and return how many are written in all."""
    column = grid.following[row, max(0, ceil(low))] if low < grid.side.shape[1] - 1 else grid.side.shape[1]
    while column <= high and column < grid.side.shape[1] - 1:
        found[count, 0], found[count, 1] = column, row
        count += 1
        column = grid.following[row, column + 1]
    return count


@callee
def _seen(
    grid: Corners,
    x: float,
    y: float,
    along_x: int,
    along_y: int,
    most_x: float,
    most_y: float,
    found: Int32Array,
    count: int,
    stack: FloatArray,
) -> int:
    """Write the corners seen from a point in a quadrant, up to so far along x and y; return how many there are in all.

    Sight passes between two blocked cells that touch in a vertex alone: no disc goes there. Rows are gone through from
    the point on, each cutting the slopes at which it is passed into fewer and narrower intervals, which are stacked.
    """
    first = floor(y) if along_y > 0 else ceil(y) - 1
    column = floor(x) if along_x > 0 else ceil(x) - 1
    if not (0 <= first < grid.blocked.shape[0] and 0 <= column < grid.blocked.shape[1]):
        return count
    if y == floor(y) and not grid.blocked[first, column]:
        # Along the axis itself.
        if along_x > 0:
            end = min(float(grid.right[first, column]), x + most_x)
            count = _in_row(grid, int(y), floor(x) + 1.0, end, found, count)
        else:
            end = max(float(grid.left[first, column] + 1), x - most_x)
            count = _in_row(grid, int(y), end, ceil(x) - 1.0, found, count)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0.0, 0.0, inf
    size = 1
    while size > 0:
        size -= 1
        k, low, high = int(stack[size, 0]), stack[size, 1], stack[size, 2]
        row = first + k * along_y
        near, far = (row - y, row + 1 - y) if along_y > 0 else (y - row - 1, y - row)
        near = max(near, 0.0)
        if low * near > most_x:
            continue
        # The cell that the lowest ray enters first; none lies behind the point.
        u = low * near
        at = floor(x + u) if along_x > 0 else ceil(x - u) - 1
        while True:
            end = grid.right[row, at] if along_x > 0 else grid.left[row, at] + 1
            away = (end - x) * along_x
            if grid.blocked[row, at]:
                # Rays between these slopes enter the run's interior: those that stay below it go on.
                low = max(low, inf if near == 0.0 else away / near)
                if not low < high:
                    break
            else:
                top = min(high, away / far)
                if top - low > GRAZING and far <= most_y:
                    # Corners on the far side of the row, within the interval.
                    a, b = low * far - 1e-9, min(top * far + 1e-9, most_x)
                    a, b = (x + a, x + b) if along_x > 0 else (x - b, x - a)
                    count = _in_row(grid, row + 1 if along_y > 0 else row, a, b, found, count)
                    if far < most_y:
                        stack[size, 0], stack[size, 1], stack[size, 2] = k + 1, low, top
                        size += 1
                if away / far >= high or away > most_x + 1.0:
                    break
            at = end if along_x > 0 else end - 1
    return count


@njit(numbers=True)
def _fits(grid: Corners, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Return whether no blocked cell is nearer than ``radius`` to a segment, all in cells."""
    rows, columns = grid.blocked.shape
    low, high = min(ay, by) - radius, max(ay, by) + radius
    for row in range(max(0, floor(low)), min(rows - 1, floor(high)) + 1):
        # The part of the segment from which this row can be nearer than the radius.
        x1, x2 = ax, bx
        if ay != by:
            t1, t2 = (row - radius - ay) / (by - ay), (row + 1 + radius - ay) / (by - ay)
            t1, t2 = max(0.0, min(t1, t2) - 1e-9), min(1.0, max(t1, t2) + 1e-9)
            x1, x2 = ax + t1 * (bx - ax), ax + t2 * (bx - ax)
        at, last = max(0, floor(min(x1, x2) - radius)), min(columns - 1, floor(max(x1, x2) + radius))
        while at <= last:
            if not grid.blocked[row, at]:
                at = grid.right[row, at]
            elif _near(ax, ay, bx, by, float(at), float(row), radius):
                return False
            else:
                at += 1
    return True


@njit(nogil=True)
def _all_fit(grid: Corners, points: FloatArray, radius: float) -> bool:
    """Return whether no blocked cell is nearer than ``radius`` to a path over points (n, 2), all in cells."""
    for i in range(len(points) - 1):
        if not _fits(grid, points[i, 0], points[i, 1], points[i + 1, 0], points[i + 1, 1], radius):
            return False
    return True


@callee
def _near(ax: float, ay: float, bx: float, by: float, left: float, low: float, radius: float) -> bool:
    """Return whether a segment comes nearer than ``radius`` to the unit square at (left, low)."""
    for x, y in ((ax, ay), (bx, by)):
        dx, dy = max(left - x, 0.0, x - left - 1.0), max(low - y, 0.0, y - low - 1.0)
        if dx * dx + dy * dy < radius * radius:
            return True
    ex, ey = bx - ax, by - ay
    length = hypot(ex, ey)
    if length == 0.0:
        return False
    above = below = False
    for i in range(2):
        for j in range(2):
            wx, wy = left + i - ax, low + j - ay
            along, across = (wx * ex + wy * ey) / length, (ex * wy - ey * wx) / length
            if 0.0 <= along <= length and abs(across) < radius:
                return True
            above, below = above or across > 0.0, below or across < 0.0
    if not (above and below):
        return False
    # The line passes through the square: the segment does where their boxes overlap along both axes.
    return min(ax, bx) < left + 1.0 and max(ax, bx) > left and min(ay, by) < low + 1.0 and max(ay, by) > low


# --- Tangents of circles about corners, compiled. A node's number: (row * columns of vertices + column) * 2, and 1 more
# for turning right.

_BLOCKED_X = np.array([-1, 1, -1, 1])
_BLOCKED_Y = np.array([-1, -1, 1, 1])


@callee
def _quadrant(grid: Corners, column: int, row: int, right: int) -> tuple[int, int]:
    """Return the signs of x and y of all directions in which a path passes a corner; ``right`` is 1, or 0 for left."""
    side = grid.side[row, column]
    bx, by = _BLOCKED_X[side], _BLOCKED_Y[side]
    return (-by, bx) if right else (by, -bx)


@callee
def _last_direction(qx: int, qy: int, right: int) -> tuple[float, float]:
    """Return the direction in which a path leaves a corner, whose quadrant this is, after going all the way round."""
    # To the left of an axis direction lies the quadrant's other axis, or not.
    turn = -1 if right else 1
    return (0.0, float(qy)) if qx * qy == turn else (float(qx), 0.0)


@callee
def _tangent(
    ax: float, ay: float, right_a: int, bx: float, by: float, right_b: int, radius: float
) -> tuple[float, float, float]:
    """Return the tangent from circle a to circle b: its direction and its length, which is negative if there is none.

    Each circle's centre lies on the path's right (1) or left (0), or is a point instead (-1).
    """
    ex, ey = bx - ax, by - ay
    # How far right of the tangent each centre lies: by the difference the tangent slants against the centres' line.
    off_a = 0.0 if right_a < 0 else radius if right_a else -radius
    off_b = 0.0 if right_b < 0 else radius if right_b else -radius
    off = off_b - off_a
    square = ex * ex + ey * ey - off * off
    if square <= 0.0:
        return 0.0, 0.0, -1.0
    length, norm = sqrt(square), ex * ex + ey * ey
    # e = length * d + off * (right of d), with right of d = (dy, -dx).
    return (length * ex - off * ey) / norm, (length * ey + off * ex) / norm, length


@callee
def _touching(x: float, y: float, right: int, dx: float, dy: float, radius: float) -> tuple[float, float]:
    """Return where a path in a direction touches a circle (or the point itself)."""
    off = 0.0 if right < 0 else -radius if right else radius
    return x + off * dy, y - off * dx


@njit
def _bends(circles: FloatArray, radius: float, arc: float) -> FloatArray:
    """Return the bends (n, 2) of a path along circles (k, 3: x, y, and its side as of tangents), in cells."""
    most = 2 + int(np.ceil(np.pi / arc))
    found, n = np.empty((most * len(circles), 2)), 1
    found[0] = circles[0, :2]
    before = 0.0
    for k in range(1, len(circles)):
        x, y, side = circles[k - 1]
        dx, dy, _ = _tangent(x, y, int(side), circles[k, 0], circles[k, 1], int(circles[k, 2]), radius)
        after = atan2(dy, dx)
        if k > 1:
            sign = -1.0 if side > 0.0 else 1.0
            turn = sign * ((after - before + np.pi) % (2.0 * np.pi) - np.pi)
            # Where the tangents at the arc's ends, and between, meet: on a larger circle. Without an arc, where they
            # touch the circle.
            count = max(1, int(np.ceil(turn / arc)))
            out = radius / cos(0.5 * turn / count) if turn > 0.0 else radius
            for i in range(count if turn > 0.0 else 2):
                at = before + sign * ((i + 0.5) * turn / count if turn > 0.0 else i * turn) - sign * 0.5 * pi
                found[n, 0], found[n, 1] = x + out * cos(at), y + out * sin(at)
                n += 1
        before = after
    found[n] = circles[-1, :2]
    return found[: n + 1]


# --- The search over them, compiled.


class _Task(NamedTuple):
    """What is looked for, all in cells."""

    grid: Corners  # cells and corners
    start: FloatArray  # column and row coordinates, shape (2,)
    goal: FloatArray  # likewise
    radius: float  # of the circles
    needed: float  # distance to cells that is kept for certain; less than the radius by rounding
    # (rows, columns) of estimated lengths to the goal instead of the straight distance, which alone proves anything;
    # (0, 0) for none
    guide: NDArray[np.float32]


DX, DY, LEFT, OTHER = range(4)
"""What a label knows beside its cost, the length up to where the circle is reached: the direction there, what is left
of the turn, radians, and the label before of the same node, or -1."""

TO_GOAL = -2
"""In place of a node: the goal."""


@njit(nogil=True)
def _search(task: _Task, labels: Labels, limit: float, most: int) -> tuple[bool, int, float, int, tuple[Any, ...]]:
    """Return whether a search has ended, the goal's label or -1, the least key, labels expanded, and all of them."""
    grid, goal, expanded, ended, end, key = task.grid, task.goal, 0, False, -1, inf
    # What is not written to takes no memory, but addresses. A corner is seen in four quadrants, or two, at most once.
    found = np.empty((4 * grid.total + 4, 2), np.int32)
    stack = np.empty((grid.blocked.size // 2 + grid.blocked.shape[0] + 2, 3))
    if len(labels.node) == 0:
        labels, count = new_labels(1 << 10, 4), 0
        for k in range(4):
            along_x, along_y = 1 if k % 2 else -1, 1 if k > 1 else -1
            count = _seen(grid, task.start[0], task.start[1], along_x, along_y, inf, inf, found, count, stack)
        labels = with_room(labels, 2 * count)
        _lead_on(task, labels, -1, task.start[0], task.start[1], 0, 0, found, count, limit)
    while expanded < most:
        if labels.counts[WAITING] == 0:
            ended = True
            break
        key, label = labels.keys[0], labels.values[0]
        node = labels.node[label]
        if node == TO_GOAL:
            ended, end = True, label
            break
        labels.counts[WAITING] = heap_pop(labels.keys, labels.values, labels.counts[WAITING])
        if labels.closed[label]:
            continue
        expanded += 1
        right, row, column = node & 1, (node >> 1) // grid.side.shape[1], (node >> 1) % grid.side.shape[1]
        qx, qy = _quadrant(grid, column, row, right)
        x, y, strip = float(column), float(row), 2.0 * task.radius + 1e-6
        count = _seen(grid, x, y, qx, qy, inf, inf, found, 0, stack)
        # Beyond the first direction, tangents that change sides lead to what lies in a strip beside it.
        if _last_direction(qx, qy, right)[0] == 0.0:
            count = _seen(grid, x, y, qx, -qy, inf, strip, found, count, stack)
        else:
            count = _seen(grid, x, y, -qx, qy, strip, inf, found, count, stack)
        labels = with_room(labels, 2 * count + 1)
        _lead_on(task, labels, label, x, y, qx, qy, found, count, limit)
        dx, dy, length = _tangent(x, y, right, goal[0], goal[1], -1, task.radius)
        further = _further(labels, label, qx, qy, dx, dy, length, task.radius)
        px, py = _touching(x, y, right, dx, dy, task.radius)
        if further < limit and _fits(grid, px, py, goal[0], goal[1], task.needed):
            add_label(labels, entry_of(labels, TO_GOAL), TO_GOAL, label, further, further)
    if end < 0:
        key = labels.keys[0] if labels.counts[WAITING] > 0 else inf
    return ended, end, key, expanded, labels[:]


@callee
def _lead_on(
    task: _Task,
    labels: Labels,
    label: int,
    x: float,
    y: float,
    qx: int,
    qy: int,
    found: Int32Array,
    count: int,
    limit: float,
) -> None:
    """Add labels for what tangents lead to of corners seen, from a label's circle about (x, y), or for -1 the start."""
    radius, right = task.radius, labels.node[label] & 1 if label >= 0 else -1
    for k in range(count):
        column, row = found[k, 0], found[k, 1]
        for side in range(2):
            dx, dy, length = _tangent(x, y, right, float(column), float(row), side, radius)
            ux, uy = _quadrant(task.grid, column, row, side)
            if dx * ux < -AHEAD or dy * uy < -AHEAD:
                continue
            cost = _further(labels, label, qx, qy, dx, dy, length, radius)
            px, py = _touching(float(column), float(row), side, dx, dy, radius)
            rest = hypot(task.goal[0] - px, task.goal[1] - py)
            if cost + rest >= limit:
                continue
            ex, ey = _last_direction(ux, uy, side)
            left = atan2(abs(dx * ey - dy * ex), dx * ex + dy * ey)
            node = (row * task.grid.side.shape[1] + column) * 2 + side
            entry = entry_of(labels, node)
            newest = labels.table[entry]
            if _no_better(labels, newest, cost, left, radius, False):
                continue
            if not _fits(task.grid, px - length * dx, py - length * dy, px, py, task.needed):
                continue
            _no_better(labels, newest, cost, left, radius, True)
            if task.guide.size:
                value = float(task.guide[int(py), int(px)])
                rest = max(rest, value) if value < inf else 2.0 * rest
            new = add_label(labels, entry, node, label, cost, cost + rest)
            labels.more[new, DX], labels.more[new, DY] = dx, dy
            labels.more[new, LEFT], labels.more[new, OTHER] = left, newest


@callee
def _further(labels: Labels, label: int, qx: int, qy: int, dx: float, dy: float, length: float, radius: float) -> float:
    """Return the length of the way to the end of a tangent from a label's circle; infinite if it turns back there."""
    if length < 0.0:
        return inf
    if label < 0:
        return length
    ex, ey, turn = labels.more[label, DX], labels.more[label, DY], -1.0 if labels.node[label] & 1 else 1.0
    across, along = turn * (ex * dy - ey * dx), ex * dx + ey * dy
    if dx * qx < -AHEAD or dy * qy < -AHEAD or across < -AHEAD:
        return inf
    return float(labels.cost[label] + radius * max(0.0, atan2(across, along)) + length)


@callee
def _no_better(labels: Labels, other: int, cost: float, left: float, radius: float, closing: bool) -> bool:
    """Return whether one of a node's labels is no worse, at the turn's end, than a way; or close those no better."""
    turned = cost + radius * left
    while other >= 0:
        other_left = labels.more[other, LEFT]
        other_turned = labels.cost[other] + radius * other_left
        if closing and other_turned >= turned and other_left <= left:
            labels.closed[other] = 1
        elif not closing and other_turned <= turned and other_left >= left:
            return True
        other = int(labels.more[other, OTHER])
    return False
