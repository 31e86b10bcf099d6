"""What changes in a planner when its world does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from trailmark.changes import Changes
from trailmark.se2 import FloatArray

__all__ = ["Boxes", "Update"]


@dataclass(frozen=True)
class Update:
    """What a change of the world changed in a planner.

    Attributes:
        changes: obstacles that were added, removed, moved or refined.
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
    def of(cls, changes: Changes) -> Boxes:
        """Return the boxes of the obstacles that changed."""
        before = [item.before.bounding_box() for item in changes.items if item.before is not None]
        after = [item.after.bounding_box() for item in changes.items if item.after is not None]
        return cls(np.array(before).reshape(-1, 4), np.array(after).reshape(-1, 4))

    @property
    def all(self) -> FloatArray:
        """Both, shape (r + a, 4)."""
        return np.concatenate(self)
