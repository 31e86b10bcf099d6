"""What is known of the world: a grid of cells that are free, occupied, or not known yet.

A cell is occupied as a whole, wherever in it a surface was met, so that a passage is known to two cells.
"""

from __future__ import annotations

from math import hypot
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.grid import first_step
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_matching import point_cloud
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray, compose
from trailmark.shapes import Rectangle, Shape
from trailmark.world import World

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "Agreement", "KnownMap"]

UNKNOWN: Final = 0
FREE: Final = 1
OCCUPIED: Final = 2

LOST: Final = 0
MET: Final = 1
NOTHING: Final = 2

TILE: Final = 16
"""Cells: side of the squares in which the planner's world is drawn anew where a cell changed."""

NUDGE: Final = 1e-6
"""Cells by which an end point is moved on along its beam: a surface between two cells belongs to the one behind it."""

HIT: Final = 3
"""Beams that clearly go through a cell and outweigh one that ends in it."""

MOST: Final = 24
"""Beams that have to go through a cell, at most, before what stood there counts as gone."""

SURE: Final = 6
"""The same without noise, when a surface is never met in the wrong cell."""

LEAST: Final = -6
"""What beams through a free cell count together with noise: it takes three that end in it for it to be occupied."""

NOISY: Final = 0.05
"""Cells: standard deviation of end points up to which they are exact."""

STEEP: Final = 0.5
"""Sine of the angle to a surface up to which a beam that passes it says nothing against it."""

JOINED: Final = 3.0
"""Gaps between beams from one end point to the next on one surface: it is met at 20 degrees or more."""

NEAR: Final = 2
"""Cells from an end point within which a surface is the one that it lies on."""


class Agreement(NamedTuple):
    """How many beams of a scan agree with a map."""

    met: int
    """End at surfaces that are known."""
    through: int
    """Go through surfaces that are known."""
    new: int
    """End in the midst of what is known to be free."""
    beams: int
    """All that met something."""

    @property
    def against(self) -> int:
        """Beams that speak against the map."""
        return self.through + self.new

    @property
    def is_strange(self) -> bool:
        """Whether most of what could agree does not, and not only by things that are new."""
        known = self.met + self.against
        return self.against > 0.5 * known and (self.through > 0.1 * known or self.met < 0.2 * known)

    @property
    def is_sure(self) -> bool:
        """Whether much of it agrees, and little speaks against it: not by chance."""
        return self.met > 4 * self.against and self.met > 0.25 * self.beams


class KnownMap:
    """A grid of cells, each unknown, free or occupied, and the planner's world that follows it.

    Attributes:
        state: UNKNOWN, FREE or OCCUPIED, shape (rows, columns); row 0 has the smallest y.
        origin: x, y of the outer corner of cell (0, 0), metres.
        cell: side of a cell, metres.
        noise: metres, standard deviation of end points.
        revision: grows whenever a cell's state changes.

    Args:
        bounds: xmin, ymin, xmax, ymax, metres, of what is to be explored: known beforehand, as the start is.
        cell: side of a cell, metres.
    """

    def __init__(self, bounds: tuple[float, float, float, float], cell: float) -> None:
        xmin, ymin, xmax, ymax = bounds
        self.bounds, self.cell, self.origin = bounds, float(cell), (float(xmin), float(ymin))
        shape = int(np.ceil((ymax - ymin) / cell - 1e-9)), int(np.ceil((xmax - xmin) / cell - 1e-9))
        self.noise, self.revision, self._scans = 0.0, 0, 0
        self.state = np.zeros(shape, np.uint8)
        self._contacts = np.zeros(shape, np.bool_)
        self.clear()
        # What the planner's world has: the cells that are not free, and by tile the ids of the boxes that cover them.
        self._drawn = np.zeros(shape, np.bool_)
        self._ids = dict[tuple[int, int], dict[tuple[int, ...], str]]()
        self._count = 0

    @property
    def contacts(self) -> FloatArray:
        """Centres of the cells in which the robot ran into something, shape (n, 2), metres."""
        return self.centres(*np.nonzero(self._contacts))

    @property
    def points(self) -> NDArray[np.float32]:
        """Where a beam ended last in each cell, x, y from the cell's corner, in cells, shape (rows, columns, 2).

        Not a number where none did.
        """
        return self._point

    def set_state(self, state: NDArray[np.uint8]) -> None:
        """Take over the state of all cells, shape as before; what the robot ran into stays."""
        state = np.where(self._contacts, OCCUPIED, state).astype(np.uint8)
        self.revision += int(not np.array_equal(state, self.state))
        self.state[:] = state

    def clear(self) -> None:
        """Forget what is known of all cells, but for what the robot ran into."""
        shape = self.state.shape
        self._evidence, self._stamp = np.zeros(shape, np.int8), np.full(shape, -1, np.int32)
        self._normal, self._point = np.zeros((*shape, 2), np.float32), np.full((*shape, 2), np.nan, np.float32)
        self.state[:] = np.where(self._contacts, OCCUPIED, UNKNOWN)
        self.revision += 1

    def add_contact(self, points: FloatArray) -> bool:
        """Enter what the robot ran into, points of shape (n, 2): their cells stay occupied, whatever beams tell.

        Returns:
            Whether any of them was not entered before.
        """
        at = self.cells_of(points)
        new = not self._contacts[at].all()
        self._contacts[at] = True
        self.set_state(self.state)
        return new

    def add_scan(self, scan: Scan, pose: FloatArray, max_range: float) -> None:
        """Enter a scan: cells whose middles beams came past are free, those in which surfaces were met are occupied.

        What is occupied becomes free again by beams that cross its surface steeply and end behind the cell.

        Args:
            scan: its beams in the order of their angles.
            pose: of the robot when it was taken, shape (3,).
            max_range: metres; what was met farther away shows free space up to there.
        """
        start, ends, kinds = self._beams(scan, pose, max_range)
        normals = np.zeros_like(ends)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        normals[kinds == MET] = point_cloud(scan, max_range).normals @ np.array([[cos, sin], [-sin, cos]])
        self._scans += 1
        cells = self.state, self._evidence, self._normal, self._point, self._stamp, self._contacts
        gap = abs(scan.angle_increment)
        self.revision += int(enter_scan(*cells, self._scans, start, ends, kinds, normals, gap, self.noise / self.cell))

    def agreement(self, scan: Scan, pose: FloatArray, max_range: float) -> Agreement:
        """Return how a scan that was taken from a pose would agree with what is known; see :meth:`add_scan`."""
        start, ends, kinds = self._beams(scan, pose, max_range)
        tolerance = 3.0 * self.noise / self.cell + 2.0
        met, through, new = agreement(self.state, self._normal, start, ends, kinds, tolerance)
        return Agreement(met, through, new, int((kinds == MET).sum()))

    def _beams(
        self, scan: Scan, pose: FloatArray, max_range: float
    ) -> tuple[FloatArray, FloatArray, NDArray[np.uint8]]:
        """Return where the scanner stands, where its beams end, in cells, and what they are."""
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        limit = min(float(scan.range_max), float(np.nextafter(max_range, np.inf)))
        readable = ranges > 0.0
        met = readable & (ranges < limit)
        kinds = np.where(met, MET, np.where(readable, NOTHING, LOST)).astype(np.uint8)
        scanner = compose(pose, scan.mount)
        angles = scanner[2] + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        length = np.where(readable, np.minimum(ranges, min(scan.range_max, max_range)), 0.0)
        length = (length + np.where(met, NUDGE * self.cell, 0.0)) / self.cell
        start = np.asarray((scanner[:2] - self.origin) / self.cell)
        return start, start + length[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]), kinds

    def cells_of(self, points: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows and columns, shape (n,) each, of the cells that hold points, shape (n, 2), or the nearest."""
        rows, columns = self.state.shape
        place = np.floor((np.asarray(points) - np.asarray(self.origin)) / self.cell).astype(np.intp)
        return np.clip(place[..., 1], 0, rows - 1), np.clip(place[..., 0], 0, columns - 1)

    def centres(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray:
        """Return the centres of cells, shape (n, 2), metres."""
        return np.asarray(np.asarray(self.origin) + self.cell * (np.column_stack([columns, rows]) + 0.5))

    def follow(self, world: World) -> World:
        """Return the world with its obstacles, all that is not free, replaced where cells changed since the last call.

        What is not known is an obstacle as what is occupied, so that no valid path leads through it.
        """
        remove, add = list[str](), dict[str, Shape]()
        blocked = self.state != FREE
        changed = np.unique(np.argwhere(blocked != self._drawn) // TILE, axis=0)
        tiles = [(i, j) for i, j in changed.tolist()]
        if not self._ids:
            tiles = [(i, j) for i in range(-(-blocked.shape[0] // TILE)) for j in range(-(-blocked.shape[1] // TILE))]
        self._drawn = blocked
        for i, j in tiles:
            boxes = rectangles(blocked[i * TILE : (i + 1) * TILE, j * TILE : (j + 1) * TILE])
            old, new = self._ids.get((i, j), {}), dict[tuple[int, ...], str]()
            for box in map(tuple, boxes.tolist()):
                if box in old:
                    new[box] = old[box]
                    continue
                self._count += 1
                new[box] = f"cells-{self._count}"
                x0, y0, x1, y1 = box
                x, y = self.origin[0] + self.cell * j * TILE, self.origin[1] + self.cell * i * TILE
                centre = x + 0.5 * self.cell * (x0 + x1), y + 0.5 * self.cell * (y0 + y1)
                add[new[box]] = Rectangle(centre, self.cell * (x1 - x0), self.cell * (y1 - y0))
            remove += [name for box, name in old.items() if box not in new]
            self._ids[i, j] = new
        return world.edited(add=add, remove=remove) if add or remove else world


@njit
def rectangles(mask):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return boxes x0, y0, x1, y1, shape (n, 4), that cover a mask exactly: runs of a row, joined to equal ones above.

    Args:
        mask: shape (rows, columns) of bool.
    """
    rows, columns = mask.shape
    found, count = np.empty((mask.size, 4), dtype=np.int64), 0
    open_at = np.full(columns, -1, dtype=np.int64)  # by its first column, the box that the row before ended
    for r in range(rows):
        c = 0
        while c < columns:
            if not mask[r, c]:
                open_at[c] = -1
                c += 1
                continue
            first = c
            while c < columns and mask[r, c]:
                if c > first:
                    open_at[c] = -1
                c += 1
            k = open_at[first]
            if k >= 0 and found[k, 2] == c and found[k, 3] == r:
                found[k, 3] = r + 1
                continue
            found[count, 0], found[count, 1], found[count, 2], found[count, 3] = first, r, c, r + 1
            open_at[first] = count
            count += 1
    return found[:count].copy()


@njit(nogil=True)
def enter_scan(state, evidence, normal, point, stamp, fixed, now, start, ends, kinds, normals, gap, sigma):  # type: ignore[no-untyped-def]  # numba infers the types
    """Enter a scan, all of it in cells from the grid's corner on; return whether the state of any cell changed.

    Args:
        state: UNKNOWN, FREE or OCCUPIED of each cell, shape (rows, columns).
        evidence: beams that ended in it, HIT times as many, less those that went through it.
        normal: across the surface in it; zero where that is not known.
        point: where a beam ended in it last, from the cell's corner on.
        stamp: the last scan that met something in it.
        fixed: which stay as they are.
        now: the scan's number.
        start: where the scanner stands, shape (2,).
        ends: of its beams in their order, shape (n, 2).
        kinds: LOST, MET or NOTHING, shape (n,).
        normals: across the surfaces that were met, shape (n, 2); zero where that is not known.
        gap: radians from one beam to the next.
        sigma: standard deviation of end points.
    """
    rows, columns = state.shape
    noisy, changed = sigma > NOISY, False
    weight, most, least = (HIT, MOST, LEAST) if noisy else (SURE, SURE, 0)
    sx, sy = start
    for k in range(len(ends)):
        if kinds[k] != MET:
            continue
        ex, ey = ends[k]
        ox, oy = ex, ey
        width = hypot(ex - sx, ey - sy) * gap
        # On to the next end point, where both lie on one surface: no hole is left between the beams.
        if (
            k + 1 < len(ends)
            and kinds[k + 1] == MET
            and hypot(ends[k + 1, 0] - ex, ends[k + 1, 1] - ey) < (JOINED * width)
        ):
            ox, oy = ends[k + 1]
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(ex, ey, ox, oy)
        share = 0.0
        for step in range(abs(last_i - i) + abs(last_j - j) + 1):
            if step > 0 and i == last_i and j == last_j:
                break  # it is entered with the next beam
            # What noise puts beyond the bounds belongs to the cells along them.
            if -1 <= j <= rows and -1 <= i <= columns:
                r, c = min(max(j, 0), rows - 1), min(max(i, 0), columns - 1)
                evidence[r, c] = min(most, evidence[r, c] + weight)
                stamp[r, c] = now
                # In cells in between, in the middle of the line through them.
                along = 0.5 * (share + min(next_i, next_j)) if step > 0 else 0.0
                point[r, c, 0], point[r, c, 1] = ex + along * (ox - ex) - c, ey + along * (oy - ey) - r
                if normals[k, 0] != 0.0 or normals[k, 1] != 0.0:
                    normal[r, c] = normals[k]
                if state[r, c] != OCCUPIED and evidence[r, c] > 0:
                    state[r, c], changed = OCCUPIED, True
            share = min(next_i, next_j)
            if next_i < next_j:
                next_i += each_i
                i += step_i
            else:
                next_j += each_j
                j += step_j
    for k in range(len(ends)):
        ex, ey = ends[k]
        length = hypot(ex - sx, ey - sy)
        if kinds[k] == LOST or length < 1e-9:
            continue
        ux, uy = (ex - sx) / length, (ey - sy) / length
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(sx, sy, ex, ey)
        for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
            if kinds[k] == MET and i == last_i and j == last_j:
                break
            if 0 <= i < columns and 0 <= j < rows:
                x, y = i + 0.5 - sx, j + 0.5 - sy
                width = (x * ux + y * uy) * gap
                if state[j, i] == UNKNOWN:
                    if abs(ux * y - uy * x) <= 0.5 * max(1.0, width):
                        state[j, i], changed = FREE, True
                elif (
                    width <= 1.0
                    and not fixed[j, i]
                    and (state[j, i] == OCCUPIED or evidence[j, i] > least)
                    # A surface in part of a cell may be met by some beams alone; those that err are weighed.
                    and (noisy or stamp[j, i] != now)
                ):
                    beyond = sigma if noisy else 0.5
                    if _is_passed(normal[j, i], x, y, ux, uy, ex - sx, ey - sy, beyond):
                        evidence[j, i] -= 1
                        if state[j, i] == OCCUPIED and evidence[j, i] <= 0:
                            state[j, i], changed = FREE, True
            if next_i < next_j:
                next_i += each_i
                i += step_i
            else:
                next_j += each_j
                j += step_j
    return changed


@callee
def _is_passed(normal, x, y, ux, uy, ex, ey, beyond):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return whether a beam crosses the surface in a cell, wherever in it that lies, and ends so far behind the cell.

    The cell's middle (x, y) and the beam's end are told from the scanner on, in cells.
    """
    nx, ny = normal[0], normal[1]
    if nx == 0.0 and ny == 0.0:
        nx, ny = ux, uy
    steep = nx * ux + ny * uy
    behind = ((ex - x) * nx + (ey - y) * ny) * (1.0 if steep > 0.0 else -1.0)
    return abs(steep) >= STEEP and abs(ux * y - uy * x) <= 0.5 and behind >= 0.5 * (abs(nx) + abs(ny)) + beyond


@njit(nogil=True)
def agreement(state, normal, start, ends, kinds, tolerance):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return how many beams end at known surfaces, go through them, and end where nothing was known to be.

    Args:
        state: UNKNOWN, FREE or OCCUPIED of each cell, shape (rows, columns).
        normal: across the surface in it; zero where that is not known.
        start: where the scanner stands, shape (2,), in cells from the grid's corner.
        ends: of its beams, shape (n, 2), likewise.
        kinds: LOST, MET or NOTHING, shape (n,).
        tolerance: cells beyond a surface up to which a beam has not gone through it.
    """
    rows, columns = state.shape
    met, through, new = 0, 0, 0
    sx, sy = start
    for k in range(len(ends)):
        ex, ey = ends[k]
        length = hypot(ex - sx, ey - sy)
        if kinds[k] == LOST or length < 1e-9:
            continue
        ux, uy = (ex - sx) / length, (ey - sy) / length
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(sx, sy, ex, ey)
        passed = False
        for _ in range(abs(last_i - i) + abs(last_j - j) + 1):
            if 0 <= i < columns and 0 <= j < rows and state[j, i] == OCCUPIED:
                x, y = i + 0.5 - sx, j + 0.5 - sy
                passed = _is_passed(normal[j, i], x, y, ux, uy, ex - sx, ey - sy, tolerance)
                if passed:
                    break
            if next_i < next_j:
                next_i += each_i
                i += step_i
            else:
                next_j += each_j
                j += step_j
        if passed:
            through += 1
        elif kinds[k] == MET and -1 <= last_i <= columns and -1 <= last_j <= rows:
            last_i, last_j, near = min(max(last_i, 0), columns - 1), min(max(last_j, 0), rows - 1), False
            # Beams that ended right before a wall just out of range have shown its cells as free, not what is behind.
            amid = NEAR <= last_i < columns - NEAR and NEAR <= last_j < rows - NEAR
            for r in range(max(0, last_j - NEAR), min(rows, last_j + NEAR + 1)):
                for c in range(max(0, last_i - NEAR), min(columns, last_i + NEAR + 1)):
                    near = near or state[r, c] == OCCUPIED
                    amid = amid and state[r, c] == FREE
            if near:
                met += 1
            elif amid:
                new += 1
    return met, through, new
