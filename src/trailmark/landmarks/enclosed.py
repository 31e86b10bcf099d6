"""Regions that occupied cells enclose completely: the robot cannot reach them, so they count as occupied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Rectangle", "enclosed_cells", "enclosed_points"]

FloatArray = NDArray[np.float64]

Rectangle = tuple[float, float, float, float]
"""xmin, ymin, xmax, ymax in metres."""

MAX_LINES = 4096
"""Maximum number of grid lines at the edges of boxes, along either axis; more are replaced by equally spaced lines."""


def enclosed_cells(occupied: NDArray[np.bool_], robot: tuple[int, int] | None = None) -> NDArray[np.bool_]:
    """Return which free or unknown cells are enclosed by occupied ones.

    Cells are connected by their sides only: between two occupied cells that meet in a corner there is no passage.

    Args:
        occupied: shape (rows, columns); all other cells are free or unknown.
        robot: the robot's row and column. The robot does not leave the grid, so that every cell not connected to its
            own is enclosed. If this is None, or the cell is occupied, regions at the grid's edge are not enclosed.

    Returns:
        Shape (rows, columns), True only where ``occupied`` is False.
    """
    from scipy import ndimage

    labels, count = ndimage.label(~np.asarray(occupied, dtype=np.bool_))
    reached = np.zeros(count + 1, dtype=np.bool_)
    if robot is not None and labels[robot]:
        reached[labels[robot]] = True
    else:
        for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
            reached[edge] = True
    reached[0] = True  # the label of the occupied cells
    return np.asarray(~reached[labels])


def enclosed_points(
    points: FloatArray, boxes: FloatArray, rectangle: Rectangle, robot: FloatArray | None = None
) -> NDArray[np.bool_]:
    """Return which points lie in regions of a rectangle that boxes enclose.

    The grid's lines are the edges of the boxes, so that boxes cover its cells completely or not at all: there is no
    resolution to choose. Boxes less than a billionth of the rectangle apart leave no gap.

    Args:
        points: shape (n, 2), metres, in the rectangle.
        boxes: shape (m, 4), rows xmin, ymin, xmax, ymax in metres; they may overlap and extend beyond the rectangle.
        rectangle: the region that the robot does not leave.
        robot: its position, shape (2,); see :func:`enclosed_cells`.

    Returns:
        Shape (n,).
    """
    if len(boxes) == 0:
        return np.zeros(len(points), dtype=np.bool_)
    low, high = np.array(rectangle[:2]), np.array(rectangle[2:])
    slack = 1e-9 * float((high - low).max())
    lower, upper = np.clip(boxes[:, :2] - slack, low, high), np.clip(boxes[:, 2:] + slack, low, high)
    x, y = (_lines(lower[:, axis], upper[:, axis], low[axis], high[axis]) for axis in (0, 1))
    first = np.column_stack([np.searchsorted(x, lower[:, 0], "right"), np.searchsorted(y, lower[:, 1], "right")]) - 1
    last = np.column_stack([np.searchsorted(x, upper[:, 0]), np.searchsorted(y, upper[:, 1])])
    occupied = np.zeros((len(y) - 1, len(x) - 1), dtype=np.bool_)
    for (i0, j0), (i1, j1) in zip(first, last, strict=True):
        occupied[j0:j1, i0:i1] = True

    def cells(at: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        row, column = np.searchsorted(y, at[..., 1], "right") - 1, np.searchsorted(x, at[..., 0], "right") - 1
        return np.clip(row, 0, len(y) - 2), np.clip(column, 0, len(x) - 2)

    home = None
    if robot is not None:
        row, column = cells(np.asarray(robot))
        home = int(row), int(column)
    return np.asarray(enclosed_cells(occupied, home)[cells(points)])


def _lines(lower: FloatArray, upper: FloatArray, low: float, high: float) -> FloatArray:
    lines = np.unique(np.concatenate([lower, upper, [low, high]]))
    return lines if len(lines) <= MAX_LINES else np.linspace(low, high, MAX_LINES)
