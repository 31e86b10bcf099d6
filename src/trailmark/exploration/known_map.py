"""What is known of the world: cells that are free, occupied, or not known yet."""

# Kernels are made of this file too: trailmark.jit counts it.
from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.records import Scan
from trailmark.estimation.scan_matching import point_cloud
from trailmark.exploration.beams import NUDGE, agreement, enter_scan
from trailmark.exploration.cells import (
    FREE,
    LOST,
    MET,
    NOTHING,
    OCCUPIED,
    SEEN,
    TILE,
    TOUCHED,
    UNKNOWN,
    WHOLE,
    Cells,
    boxes_in_sight,
    rectangles,
)
from trailmark.se2 import FloatArray, compose
from trailmark.shapes import Rectangle, Shape
from trailmark.world import Robot, World

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "UNKNOWN_ID",
    "Agreement",
    "KnownMap",
    "bounds_margins",
    "cells_that_meet",
    "strips_along",
]

UNKNOWN_ID = "unknown-"
"""Begins the ids of obstacles in the planner's world that stand for what is not known."""

PARTS = 8
"""Parts of a cell's side, at most, to which the box of its surface is widened: with fewer, fewer change."""

Box = tuple[int, int, int, int]
"""x and y of two corners, in cells or in parts of one."""


STRIP_PARTS: Final = 4
"""Of a cell's side, to a whole number of which strips are widened: few readings change them."""


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
        origin: x, y of the outer corner of cell (0, 0), metres.
        cell: side of a cell, metres.
        noise: metres, standard deviation of end points: a surface is told to about that, at best.
        revision: grows whenever a cell's state, or the surface in it, changes.

    Args:
        bounds: xmin, ymin, xmax, ymax, metres, of what is to be explored: known beforehand, as the start is.
        cell: side of a cell, metres.
    """

    def __init__(self, bounds: tuple[float, float, float, float], cell: float) -> None:
        xmin, ymin, xmax, ymax = bounds
        self.bounds, self.cell, self.origin = bounds, float(cell), (float(xmin), float(ymin))
        shape = int(np.ceil((ymax - ymin) / cell - 1e-9)), int(np.ceil((xmax - xmin) / cell - 1e-9))
        self._cells = Cells.unknown(*shape)
        self.noise, self.revision, self._scans = 0.0, 0, 0
        # What the planner's world has, by tile: ids, and the cells that they stand for.
        self._obstacles = dict[tuple[int, int], dict[tuple[str, int, int, int, int], str]]()
        self._drawn = dict[tuple[int, int], bytes]()
        self._count = 0
        self._shapes, self._drawn_shapes = dict[str, Shape](), dict[str, Shape]()
        self._contacts = np.zeros(shape, dtype=np.bool_)
        self._lines_of_sight: tuple[int, NDArray[np.uint8]] | None = None

    @property
    def state(self) -> NDArray[np.uint8]:
        """UNKNOWN, FREE or OCCUPIED, shape (rows, columns); row 0 has the smallest y."""
        return self._cells.state

    @property
    def contacts(self) -> FloatArray:
        """Centres of the cells in which the robot ran into something, shape (n, 2), metres."""
        return self.centres(*np.nonzero(self._contacts))

    def set_state(self, state: NDArray[np.uint8], shapes: Mapping[str, Shape] | None = None) -> None:
        """Take over the state of all cells; those that are occupied are so as a whole, or by shapes.

        Args:
            state: UNKNOWN, FREE or OCCUPIED, shape as before.
            shapes: obstacles by name, that stand for the occupied cells.
        """
        cells, shapes = self._cells, dict(shapes) if shapes else {}
        state = np.where(self._contacts, OCCUPIED, state).astype(np.uint8)
        if np.array_equal(state, cells.state) and shapes == self._shapes:
            return
        new = state != cells.state
        cells.changed[:] |= np.logical_or.reduceat(
            np.logical_or.reduceat(new, np.arange(0, new.shape[0], TILE), 0), np.arange(0, new.shape[1], TILE), 1
        )
        cells.state[:], cells.level[:], cells.facing[:] = state, WHOLE, 0
        cells.box[:] = (255, 255, 0, 0) if shapes else (0, 0, 255, 255)
        cells.seen[:] = np.where(state == UNKNOWN, 0, SEEN)
        self._shapes = shapes
        self._enter_contacts()

    def snapshot(self) -> KnownMap:
        """Return a map of the same cells and surfaces, which no reading changes."""
        still, cells = copy(self), self._cells
        still._cells = cells._replace(state=cells.state.copy(), box=cells.box.copy())
        return still

    def clear(self) -> None:
        """Forget what is known of all cells."""
        rows, columns = self.state.shape
        self._cells, self._scans = Cells.unknown(rows, columns), 0
        self._enter_contacts()

    def refined(self) -> KnownMap:
        """Return a map of cells of half the side, of which nothing is known but what the robot ran into."""
        finer = KnownMap(self.bounds, 0.5 * self.cell)
        finer.noise = self.noise
        quarters = 0.25 * self.cell * np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
        finer.add_contact((self.contacts[:, None] + quarters).reshape(-1, 2))
        return finer

    def add_contact(self, points: FloatArray) -> bool:
        """Enter what the robot ran into, points of shape (n, 2): their cells stay occupied, whatever beams tell.

        Returns:
            Whether any of them was not entered before.
        """
        at = self.cells_of(points)
        new = not self._contacts[at].all()
        self._contacts[at] = True
        self._enter_contacts()
        return new

    def _enter_contacts(self) -> None:
        cells, at = self._cells, np.nonzero(self._contacts)
        cells.state[at], cells.level[at], cells.facing[at], cells.box[at] = OCCUPIED, TOUCHED, 0, (0, 0, 255, 255)
        cells.changed[at[0] // TILE, at[1] // TILE] = True
        self.revision += 1

    def add_scan(self, scan: Scan, pose: FloatArray, max_range: float) -> None:
        """Enter a scan: cells that a beam went through are free, those in which surfaces were met are occupied.

        Where a surface lies is refined by what is met within three times the noise of it. What is occupied becomes free
        again after three scans in a row with beams that went on behind its surface by more than three times the noise,
        or after twelve with beams that went on by more than the noise.

        Args:
            scan: its beams in the order of their angles.
            pose: of the robot when it was taken, shape (3,).
            max_range: metres; what was met farther away shows free space up to there.
        """
        start, ends, kinds = self._beams(scan, pose, max_range)
        normals = np.zeros_like(ends)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        normals[kinds == MET] = point_cloud(scan, max_range).normals @ np.array([[cos, sin], [-sin, cos]])
        before = self._cells.changed.copy()
        self._cells.changed[:] = False
        self._scans += 1
        gate = 3.0 * self.noise / self.cell
        gap, tolerance = abs(scan.angle_increment), max(gate, 0.1)
        enter_scan(self._cells, self._scans, start, ends, kinds, normals, gap, tolerance, gate)
        self.revision += int(self._cells.changed.any())
        self._cells.changed[:] |= before

    def agreement(self, scan: Scan, pose: FloatArray, max_range: float) -> Agreement:
        """Return how a scan that was taken from a pose would agree with what is known; see :meth:`add_scan`."""
        tolerance = 3.0 * self.noise / self.cell + 2.0
        start, ends, kinds = self._beams(scan, pose, max_range)
        met, through, new = agreement(self._cells, start, ends, kinds, tolerance)
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

    @property
    def parts(self) -> int:
        """Of a cell's side, to which the boxes of surfaces are widened: no more than the noise lets tell apart."""
        return 2 * max(1, min(PARTS, round(self.cell / max(self.noise, 1e-9))) // 2)

    def surfaces(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.int64]:
        """Return the boxes of the surfaces in cells, shape (n, 4): x0, y0, x1, y1 in parts of it; x1 < x0 for none."""
        box, parts = self._cells.box[rows, columns].astype(np.int64), self.parts
        # A surface along a cell's side has a thickness, too.
        low = np.minimum(box[:, :2] * parts // 255, parts - 1)
        high = np.maximum(-(-box[:, 2:] * parts // 255), low + 1)
        found = np.column_stack([low, high])
        none = (self.state[rows, columns] != OCCUPIED) | (box[:, 0] > box[:, 2])
        found[none] = parts, parts, 0, 0
        return found

    def centres(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray:
        """Return the centres of cells, shape (n, 2), metres."""
        return np.asarray(np.asarray(self.origin) + self.cell * (np.column_stack([columns, rows]) + 0.5))

    def surface_boxes(self) -> NDArray[np.uint8]:
        """Return the boxes of the surfaces in occupied cells, shape (rows, columns, 4).

        They are xmin, ymin, xmax, ymax in 255ths of a cell's side: all of the cell where beams lay too far apart to
        leave no other surface in it unseen.
        """
        if self._lines_of_sight is None or self._lines_of_sight[0] != self.revision:
            self._lines_of_sight = self.revision, boxes_in_sight(self._cells)
        return self._lines_of_sight[1]

    def follow(self, world: World) -> World:
        """Return the world with the obstacles of the tiles that changed since the last call replaced.

        Its obstacles have ids: ``occupied-…``, the boxes of the surfaces in occupied cells, and ``unknown-…``, the
        quarters of cells that no beam passed, so that no valid path leads through what is not known; the shapes that
        :meth:`set_state` took over have their own names.
        """
        remove, add = list[str](), dict[str, Shape]()
        parts = self.parts
        for i, j in np.argwhere(self._cells.changed).tolist():
            part = np.s_[i * TILE : (i + 1) * TILE, j * TILE : (j + 1) * TILE]
            seen, boxes = self._cells.seen[part], self._boxes(i * TILE, j * TILE)
            content = seen.tobytes() + boxes.tobytes()
            if self._drawn.get((i, j)) == content:
                continue
            self._drawn[i, j] = content
            boxed = {(UNKNOWN_ID[:-1], *box) for box in (parts * rectangles(_unseen(seen)) // 2).tolist()}
            boxed |= {("occupied", *box) for box in joined(boxes)}
            old = self._obstacles.get((i, j), {})
            self._obstacles[i, j] = new = {box: old[box] for box in old if box in boxed}
            remove += [identity for box, identity in old.items() if box not in boxed]
            for box in boxed - set(old):
                self._count += 1
                new[box] = f"{box[0]}-{self._count}"
                x0, y0, x1, y1 = (side / parts for side in box[1:])
                centre = j * TILE + 0.5 * (x0 + x1), i * TILE + 0.5 * (y0 + y1)
                x, y = (low + self.cell * at for low, at in zip(self.origin, centre, strict=True))
                add[new[box]] = Rectangle((x, y), self.cell * (x1 - x0), self.cell * (y1 - y0))
        self._cells.changed[:] = False
        for name, shape in self._drawn_shapes.items():
            if self._shapes.get(name) != shape:
                remove.append(name)
        for name, shape in self._shapes.items():
            if self._drawn_shapes.get(name) != shape:
                add[name] = shape
        self._drawn_shapes = dict(self._shapes)
        return world.edited(add=add, remove=remove) if add or remove else world

    def _boxes(self, row: int, column: int) -> NDArray[np.int64]:
        """Return the surfaces in the tile that begins at a cell, rows x0, y0, x1, y1, in parts of a cell."""
        at = np.argwhere(self.state[row : row + TILE, column : column + TILE] == OCCUPIED)
        found = self.surfaces(at[:, 0] + row, at[:, 1] + column)
        found += self.parts * at[:, [1, 0, 1, 0]]
        return found[found[:, 0] < found[:, 2]]


def _unseen(seen: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which quarters of cells no beam passed, twice as many rows and columns."""
    mask = np.empty((2 * seen.shape[0], 2 * seen.shape[1]), dtype=bool)
    for quarter in range(4):
        mask[quarter // 2 :: 2, quarter % 2 :: 2] = seen & (1 << quarter) == 0
    return mask


def joined(boxes: NDArray[np.int64]) -> set[Box]:
    """Return boxes, shape (n, 4), with those of equal sides that touch joined to one."""
    found = [(x0, y0, x1, y1) for x0, y0, x1, y1 in boxes.tolist()]
    for low, high, others in ((0, 2, (1, 3)), (1, 3, (0, 2))):
        merged = list[list[int]]()
        for box in sorted(found, key=lambda box: (box[others[0]], box[others[1]], box[low])):
            last = merged[-1] if merged else None
            if last is not None and all(last[k] == box[k] for k in others) and last[high] == box[low]:
                last[high] = box[high]
            else:
                merged.append(list(box))
        found = [(x0, y0, x1, y1) for x0, y0, x1, y1 in merged]
    return set(found)


def bounds_margins(covariance: FloatArray, robot: Robot, deviations: float) -> FloatArray:
    """Return how far the robot must stay away from the bounds along x and along y, metres, shape (2,).

    The bounds are known in the frame that the robot began in: no detection tells where they are. The farther it has
    driven, the less certain its pose is in that frame, so that strips become wider on the way.

    Args:
        covariance: of the robot's pose in the axes of the bounds, shape (3, 3).
        robot: whose farthest point an error of the heading moves.
        deviations: standard deviations to keep.
    """
    x, y, heading = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    # Not the root of squares: an error of the heading and the one of the place that it has led to are correlated.
    return np.asarray(deviations * (np.array([x, y]) + heading * robot.sweep_radius))


def strips_along(known: KnownMap, margins: FloatArray) -> dict[str, Rectangle]:
    """Return strips along the inside of the bounds, by name, at least as wide as the margins along x and y, metres."""
    xmin, ymin, xmax, ymax = known.bounds
    width, height, part = xmax - xmin, ymax - ymin, known.cell / STRIP_PARTS
    dx, dy = np.minimum(part * np.ceil(margins / part), (width, height)).tolist()
    x, y, strips = 0.5 * (xmin + xmax), 0.5 * (ymin + ymax), dict[str, Rectangle]()
    if dx > 0.0:
        strips["bounds-left"] = Rectangle((xmin + 0.5 * dx, y), dx, height)
        strips["bounds-right"] = Rectangle((xmax - 0.5 * dx, y), dx, height)
    if dy > 0.0:
        strips["bounds-bottom"] = Rectangle((x, ymin + 0.5 * dy), width, dy)
        strips["bounds-top"] = Rectangle((x, ymax - 0.5 * dy), width, dy)
    return strips


def cells_that_meet(known: KnownMap, strip: Rectangle) -> tuple[slice, slice]:
    """Return the rows and columns of the cells that a strip meets."""
    half = 0.5 * np.array([strip.length, strip.width]) - 1e-9 * known.cell
    rows, columns = known.cells_of(np.asarray(strip.center) + np.array([-half, half]))
    return slice(int(rows[0]), int(rows[1]) + 1), slice(int(columns[0]), int(columns[1]) + 1)
