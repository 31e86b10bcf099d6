"""What is known of the world: a grid of cells that are free, occupied, or not known yet.

A cell is occupied as a whole, wherever in it a surface was met, so that a passage is known to two cells.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.grid import first_step
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_matching import point_cloud
from trailmark.formats.grid import CellObstacles, cells_of
from trailmark.jit import callee, njit
from trailmark.se2 import FloatArray, compose
from trailmark.world import World

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "Agreement", "KnownMap", "next_cell"]

UNKNOWN: Final = 0
FREE: Final = 1
OCCUPIED: Final = 2
LOST: Final = 0
MET: Final = 1
NOTHING: Final = 2
# Cells by which an end point is moved on along its beam: a surface between two cells belongs to the one behind it.
NUDGE: Final = 1e-6
HIT: Final = 3  # Beams that clearly go through a cell and outweigh one that ends in it.
MOST: Final = 24  # Beams that have to go through a cell, at most, before what stood there counts as gone.
SURE: Final = 6  # The same without noise, when a surface is never met in the wrong cell.
# What beams through a free cell count together with noise: it takes three that end in it for it to be occupied.
LEAST: Final = -6
NOISY: Final = 0.05  # Cells: standard deviation of end points up to which they are exact.
STEEP: Final = 0.5  # Sine of the angle to a surface up to which a beam that passes it says nothing against it.
BEAMS: Final = 180  # Of a scan, at most, that are asked whether they agree with the map.
# Gaps between beams from one end point to the next on one surface: it is met at 20 degrees or more.
JOINED: Final = 3.0
NEAR: Final = 2  # Cells from an end point within which a surface is the one that it lies on.


class Agreement(NamedTuple):
    """How many beams of a scan agree with a map."""

    met: int  # End at surfaces that are known.
    through: int  # Go through surfaces that are known.
    new: int  # End in the midst of what is known to be free.
    beams: int  # All that met something.

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
        chosen = np.flatnonzero((kinds != LOST) & (np.hypot(*(ends - start).T) > 1e-9))
        chosen = chosen[:: -(-len(chosen) // BEAMS) or 1]
        ends, met = ends[chosen], kinds[chosen] == MET
        reach, shape = ends - start, np.array(self.state.shape[::-1])
        length = np.hypot(*reach.T)
        # What beams come to, half a cell after the other; of that what is occupied.
        along = np.arange(0.0, length.max(initial=0.0), 0.5)
        cells = np.floor(start + (reach / length[:, None])[:, None] * along[:, None]).astype(np.intp)
        inside = (along < length[:, None]) & ((cells >= 0) & (cells < shape)).all(axis=2)
        row, column = cells[..., 1][inside], cells[..., 0][inside]
        beam = np.nonzero(inside)[0][self.state[row, column] == OCCUPIED]
        row, column = (at[self.state[row, column] == OCCUPIED] for at in (row, column))
        u, off = (reach / length[:, None])[beam], np.column_stack([column, row]) + 0.5 - start
        normal = self._normal[row, column].astype(np.float64)
        normal = np.where(normal.any(axis=1)[:, None], normal, u)
        steep, behind = (normal * u).sum(axis=1), ((reach[beam] - off) * normal).sum(axis=1)
        aside = np.abs(u[:, 0] * off[:, 1] - u[:, 1] * off[:, 0])
        least = 0.5 * np.abs(normal).sum(axis=1) + 3.0 * self.noise / self.cell + 2.0
        through = np.zeros(len(ends), np.bool_)
        through[beam[(np.abs(steep) >= STEEP) & (aside <= 0.5) & (behind * np.sign(steep) >= least)]] = True
        # Ends at known surfaces, and in the midst of what is free. Beams that ended right before a wall just out of
        # range have shown its cells as free, not what is behind.
        end = np.floor(ends).astype(np.intp)
        judged = met & ~through & ((end >= -1) & (end <= shape)).all(axis=1)
        amid = ((end >= NEAR) & (end < shape - NEAR)).all(axis=1)
        window = np.stack(np.meshgrid(*[np.arange(-NEAR, NEAR + 1)] * 2), axis=-1).reshape(-1, 2)
        around = np.clip(np.clip(end, 0, shape - 1)[:, None] + window, 0, shape - 1)
        states = self.state[around[..., 1], around[..., 0]]
        near = (states == OCCUPIED).any(axis=1)
        new = judged & ~near & amid & (states == FREE).all(axis=1)
        return Agreement(int((judged & near).sum()), int(through.sum()), int(new.sum()), int(met.sum()))

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
        """Return the world with all that is not free as its obstacles; the same one if nothing changed.

        What is not known is an obstacle as what is occupied, so that no valid path leads through it.
        """
        blocked, before = self.state != FREE, cells_of(world.obstacles)
        if before is not None and np.array_equal(before.occupied, blocked):
            return world
        return replace(world, obstacles=CellObstacles(blocked, self.cell, (*self.origin, 0.0)).as_tuple())


@callee
def next_cell(i, j, step_i, step_j, next_i, next_j, each_i, each_j):  # type: ignore[no-untyped-def]  # numba infers the types
    """Return the next column and row along a line, and where those after it begin; see :func:`first_step`.

    Cells that the line only touches in a corner are left out.
    """
    nearest = min(next_i, next_j) + 1e-12
    if next_i <= nearest:
        i, next_i = i + step_i, next_i + each_i
    if next_j <= nearest:
        j, next_j = j + step_j, next_j + each_j
    return i, j, next_i, next_j


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
        # On to the next end point, where both lie on one surface: no hole is left between the beams.
        if k + 1 < len(ends) and kinds[k + 1] == MET:
            nx, ny = ends[k + 1]
            if hypot(nx - ex, ny - ey) < JOINED * hypot(ex - sx, ey - sy) * gap:
                ox, oy = nx, ny
        i, j, last_i, last_j, step_i, step_j, next_i, next_j, each_i, each_j = first_step(ex, ey, ox, oy)
        share = 0.0
        for step in range(abs(last_i - i) + abs(last_j - j) + 1):
            if step > 0 and ((i == last_i and j == last_j) or share >= 1.0):
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
            i, j, next_i, next_j = next_cell(i, j, step_i, step_j, next_i, next_j, each_i, each_j)
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
            if min(next_i, next_j) >= 1.0:
                break
            i, j, next_i, next_j = next_cell(i, j, step_i, step_j, next_i, next_j, each_i, each_j)
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
