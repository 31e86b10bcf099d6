"""The clearance field: for every cell of a grid, proven bounds on the distance to the nearest obstacle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.obstacles import ObstacleGrid

__all__ = ["ClearanceField", "build_field", "clearance_at"]


class ClearanceField(NamedTuple):
    """Distances from cell centres to the nearest occupied cell's centre.

    A cell is occupied if any part of an obstacle or of the outside touches it. For every point p of a cell
    with value D the distance to the nearest obstacle lies in [D - slack, D + slack]: p and the obstacle's
    point are each at most half a cell's diagonal from their cells' centres.

    Attributes:
        distance: (rows, columns) float32, metres; 0 in occupied cells.
        x0: left edge of the first column, metres.
        y0: lower edge of the first row, metres.
        size: edge of a cell, metres.
        slack: one cell diagonal and the rounding of float32, metres.
    """

    distance: NDArray[np.float32]
    x0: float
    y0: float
    size: float
    slack: float

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """The occupied cells, shape (rows, columns)."""
        return np.asarray(self.distance == 0.0)


def build_field(grid: ObstacleGrid) -> ClearanceField:
    """Return the clearance field on the cells of ``grid``, by an exact Euclidean distance transform.

    Source: Maurer, Qi & Raghavan (2003), as implemented in ``scipy.ndimage.distance_transform_edt``.
    """
    from scipy.ndimage import distance_transform_edt

    touched = np.diff(grid.cell_start) > 0
    occupied = (touched | (grid.winding > 0)).reshape(grid.rows, grid.columns)
    distance = np.asarray(distance_transform_edt(~occupied, sampling=grid.size), dtype=np.float32)
    # The cells that an item touches are found with 1e-6 of a cell to spare; float32 keeps 1e-7 of a value.
    slack = grid.size * np.sqrt(2.0) * (1.0 + 1e-5) + 1e-6 * float(distance.max(initial=0.0))
    return ClearanceField(distance, grid.x0, grid.y0, grid.size, float(slack))


def clearance_at(field: ClearanceField, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the field's (unproven, nearest-cell) distance at points of shape (..., 2); 0 outside the grid."""
    column = np.floor((points[..., 0] - field.x0) / field.size).astype(np.int64)
    row = np.floor((points[..., 1] - field.y0) / field.size).astype(np.int64)
    rows, columns = field.distance.shape
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    value = field.distance[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)]
    return np.where(inside, value, 0.0).astype(np.float64)
