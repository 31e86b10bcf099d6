"""What is known of the world: cells that are free, occupied, or not known yet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.logs.records import Scan
from trailmark.estimation.scans.clouds import point_cloud
from trailmark.exploration.beams import (
    FREE,
    LOST,
    MET,
    NOTHING,
    NUDGE,
    OCCUPIED,
    TILE,
    UNKNOWN,
    WHOLE,
    Cells,
    enter_scan,
)
from trailmark.se2 import FloatArray, compose
from trailmark.shapes import Rectangle
from trailmark.world import World

__all__ = ["FREE", "OCCUPIED", "UNKNOWN", "KnownMap"]

PARTS = 8
"""Parts of a cell's side to which the box of its surface is widened: the fewer, the fewer obstacles change."""

Boxes = list[list[int]]
"""x and y of two corners each, in parts of a cell."""


class KnownMap:
    """A grid of cells, each unknown, free or occupied, and the planner's world that follows it.

    Attributes:
        origin: x, y of the outer corner of cell (0, 0), metres.
        cell: side of a cell, metres.
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
        self.revision, self._scans = 0, 0
        # What the planner's world has, by tile: ids, and the cells that they stand for.
        self._obstacles = dict[tuple[int, int], list[str]]()
        self._drawn = dict[tuple[int, int], bytes]()
        self._count = 0

    @property
    def state(self) -> NDArray[np.uint8]:
        """UNKNOWN, FREE or OCCUPIED, shape (rows, columns); row 0 has the smallest y."""
        return self._cells.state

    def set_state(self, state: NDArray[np.uint8]) -> None:
        """Take over the state of all cells; those that are occupied are so as a whole."""
        if not np.array_equal(state, self.state):
            cells = self._cells
            cells.state[:], cells.box[:], cells.level[:], cells.facing[:] = state, (0, 0, 255, 255), WHOLE + 1, 0
            cells.changed[:] = True
            self.revision += 1

    def clear(self) -> None:
        """Forget what is known of all cells."""
        rows, columns = self.state.shape
        self._cells, self._scans = Cells.unknown(rows, columns), 0
        self.revision += 1

    def add_scan(self, scan: Scan, pose: FloatArray, max_range: float, tolerance: float = 0.0) -> None:
        """Enter a scan: cells that a beam went through are free, those in which surfaces were met are occupied.

        What is occupied becomes free again after three scans in a row with beams that went on behind its surface.

        Args:
            scan: its beams in the order of their angles.
            pose: of the robot when it was taken, shape (3,).
            max_range: metres; what was met farther away shows free space up to there.
            tolerance: metres that a beam must have come beyond a surface to speak against it: what ranges and poses
                err by.
        """
        ranges = np.asarray(scan.ranges, dtype=np.float64)
        limit = min(float(scan.range_max), float(np.nextafter(max_range, np.inf)))
        readable = ranges > 0.0
        met = readable & (ranges < limit)
        kinds = np.where(met, MET, np.where(readable, NOTHING, LOST)).astype(np.uint8)
        scanner = compose(pose, scan.mount)
        angles = scanner[2] + scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        length = np.where(readable, np.minimum(ranges, min(scan.range_max, max_range)), 0.0)
        length = (length + np.where(met, NUDGE * self.cell, 0.0)) / self.cell
        start = (scanner[:2] - self.origin) / self.cell
        ends = start + length[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        normals = np.zeros_like(ends)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        normals[met] = point_cloud(scan, max_range).normals @ np.array([[cos, sin], [-sin, cos]])
        before = self._cells.changed.copy()
        self._cells.changed[:] = False
        self._scans += 1
        enter_scan(
            self._cells, self._scans, start, ends, kinds, normals, abs(scan.angle_increment),
            max(tolerance / self.cell, 0.1),
        )  # fmt: skip
        self.revision += int(self._cells.changed.any())
        self._cells.changed[:] |= before

    def cells_of(self, points: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows and columns, shape (n,) each, of the cells that hold points, shape (n, 2), or the nearest."""
        rows, columns = self.state.shape
        place = np.floor((np.asarray(points) - np.asarray(self.origin)) / self.cell).astype(np.intp)
        return np.clip(place[..., 1], 0, rows - 1), np.clip(place[..., 0], 0, columns - 1)

    def centres(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> FloatArray:
        """Return the centres of cells, shape (n, 2), metres."""
        return np.asarray(np.asarray(self.origin) + self.cell * (np.column_stack([columns, rows]) + 0.5))

    @property
    def free_area(self) -> float:
        """Square metres of the cells that are free."""
        return float((self.state == FREE).sum()) * self.cell**2

    def follow(self, world: World) -> World:
        """Return the world with the obstacles of the tiles that changed since the last call replaced.

        Its obstacles have ids: ``occupied-…`` and ``unknown-…``. Unknown cells are obstacles, so that no valid path
        leads through what is not known, and of occupied cells the boxes of the surfaces in them, where beams lay close
        enough together to leave no other unseen.
        """
        remove, add = list[str](), dict[str, Rectangle]()
        for i, j in np.argwhere(self._cells.changed).tolist():
            part = np.s_[i * TILE : (i + 1) * TILE, j * TILE : (j + 1) * TILE]
            unknown, boxes = self._cells.state[part] == UNKNOWN, self._boxes(part)
            content = unknown.tobytes() + boxes.tobytes()
            if self._drawn.get((i, j)) == content:
                continue
            corner = self.origin[0] + j * TILE * self.cell, self.origin[1] + i * TILE * self.cell
            shapes = {"unknown": rectangles(unknown, corner, self.cell), "occupied": joined(boxes, corner, self.cell)}
            own = dict[str, Rectangle]()
            for name, found in shapes.items():
                for shape in found:
                    self._count += 1
                    own[f"{name}-{self._count}"] = shape
            remove += self._obstacles.pop((i, j), [])
            self._obstacles[i, j], self._drawn[i, j] = list(own), content
            add |= own
        self._cells.changed[:] = False
        return world.edited(add=add, remove=remove) if add or remove else world

    def _boxes(self, part: tuple[slice, slice]) -> NDArray[np.int64]:
        """Return the surfaces in the occupied cells of a tile, rows row, column, x0, y0, x1, y1, in parts of a cell."""
        cells = self._cells
        at = np.argwhere(cells.state[part] == OCCUPIED)
        box, level = cells.box[part][at[:, 0], at[:, 1]].astype(np.int64), cells.level[part][at[:, 0], at[:, 1]]
        low, high = box[:, :2] * PARTS // 255, -(-box[:, 2:] * PARTS // 255)
        # A surface along a cell's side has a thickness, too.
        low, high = np.minimum(low, PARTS - 1), np.maximum(high, 1)
        high = np.maximum(high, low + 1)
        whole = level > WHOLE
        low[whole], high[whole] = 0, PARTS
        return np.column_stack([low + PARTS * at[:, ::-1], high + PARTS * at[:, ::-1]])


def joined(boxes: NDArray[np.int64], origin: tuple[float, float], cell: float) -> list[Rectangle]:
    """Return boxes, in parts of a cell from an origin, as rectangles: those of equal sides that touch are joined."""
    for low, high in ((0, 2), (1, 3)):
        merged = Boxes()
        others = [column for column in range(4) if column not in (low, high)]
        for box in sorted(boxes.tolist(), key=lambda box: (*(box[k] for k in others), box[low])):
            last = merged[-1] if merged else None
            if last is not None and all(last[k] == box[k] for k in others) and last[high] == box[low]:
                last[high] = box[high]
            else:
                merged.append(box)
        boxes = np.array(merged, dtype=np.int64).reshape(-1, 4)
    (x, y), part = origin, cell / PARTS
    return [
        Rectangle((x + 0.5 * part * (x0 + x1), y + 0.5 * part * (y0 + y1)), part * (x1 - x0), part * (y1 - y0))
        for x0, y0, x1, y1 in boxes.tolist()
    ]


def rectangles(mask: NDArray[np.bool_], origin: tuple[float, float], cell: float) -> list[Rectangle]:
    """Return rectangles that cover the cells of a mask exactly: runs of a row, joined to the equal ones below."""
    found, open_runs = list[tuple[int, int, int, int]](), dict[tuple[int, int], int]()
    for r in range(len(mask) + 1):
        runs = set[tuple[int, int]]()
        if r < len(mask):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], mask[r], [False]]).astype(np.int8))).tolist()
            runs = set(zip(edges[::2], edges[1::2], strict=True))
        for run in [run for run in open_runs if run not in runs]:
            found.append((run[0], open_runs.pop(run), run[1], r))
        for run in runs:
            open_runs.setdefault(run, r)
    x, y = origin
    return [
        Rectangle((x + 0.5 * (c0 + c1) * cell, y + 0.5 * (r0 + r1) * cell), (c1 - c0) * cell, (r1 - r0) * cell)
        for c0, r0, c1, r1 in found
    ]
