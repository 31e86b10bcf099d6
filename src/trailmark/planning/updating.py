"""What changes in a planner when its world does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.formats.grid import CellObstacles, cells_of
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["Boxes", "Update"]


@dataclass(frozen=True)
class Update:
    """What a change of the world changed in a planner.

    Attributes:
        changes: obstacles that were added, removed, moved or refined; of a grid map, cells that differ.
        checked: edges of the roadmap that were looked at again.
        gained: of those, edges that are certified now and were not before.
        lost: of those, edges that are certified no more, those of landmarks that were dropped included.
        landmarks_dropped: landmarks that are valid no more.
        landmarks_retracted: of those, landmarks that came back beside the obstacle.
        landmarks_added: landmarks in freed space.
        seconds: that all this took.
    """

    changes: int = 0
    checked: int = 0
    gained: int = 0
    lost: int = 0
    landmarks_dropped: int = 0
    landmarks_retracted: int = 0
    landmarks_added: int = 0
    seconds: float = 0.0


class Boxes(NamedTuple):
    """Boxes xmin, ymin, xmax, ymax (metres) that hold what changed.

    Attributes:
        removed: of obstacles as they were, shape (r, 4).
        added: of obstacles as they are now, shape (a, 4).
    """

    removed: FloatArray
    added: FloatArray

    @classmethod
    def between(cls, before: World, after: World) -> tuple[Boxes, int]:
        """Return the boxes for two worlds, and how many obstacles, or cells of a grid map, differ."""
        old, new = cells_of(before), cells_of(after)
        if old is not None and new is not None and old.covers_as(new):
            gone, come = old.occupied & ~new.occupied, new.occupied & ~old.occupied
            return cls(_boxes_of_cells(gone, old), _boxes_of_cells(come, old)), int(np.count_nonzero(gone | come))
        items = before.difference(after).items
        gone_, come_ = (
            np.array([shape.bounding_box() for shape in shapes if shape is not None]).reshape(-1, 4)
            for shapes in ([item.before for item in items], [item.after for item in items])
        )
        return cls(gone_, come_), len(items)


PARTS = 16
"""Of a grid map along its longer side: changed cells of one part share a box."""


def _boxes_of_cells(changed: NDArray[np.bool_], cells: CellObstacles) -> FloatArray:
    """Return boxes (metres), shape (b, 4), that hold the changed cells of a grid map, (rows, columns)."""
    side = -(-max(changed.shape) // PARTS)
    starts = [np.arange(0, count, side) for count in changed.shape]
    parts = np.logical_or.reduceat(np.logical_or.reduceat(changed, starts[0], axis=0), starts[1], axis=1)
    boxes = []
    for row, column in np.argwhere(parts) * side:
        block = changed[row : row + side, column : column + side]
        rows, columns = row + np.flatnonzero(block.any(axis=1)), column + np.flatnonzero(block.any(axis=0))
        boxes.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
    found: FloatArray = np.array(boxes).reshape(-1, 4) * cells.cell + np.tile(cells.origin[:2], 2)
    return found
