"""What was told on the way, as arrays: to be kept in a file, and to be shown in a page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.exploration.result import ExplorationProgress
from trailmark.se2 import FloatArray

__all__ = ["History"]


class History(NamedTuple):
    """The n rows of an exploration's history; equal paths in a row are kept once."""

    figures: FloatArray
    """Shape (n, 8): time, distance, area, landmarks, sigma, x, y, theta."""
    targets: FloatArray
    """Shape (n, 3), NaN where there was none."""
    path_of: NDArray[np.int32]
    """Which path was followed, shape (n,); -1 for none."""
    path_ends: NDArray[np.int32]
    """Rows of ``paths`` up to the end of each path, shape (k,)."""
    paths: FloatArray
    """The states of all paths, one after the other, shape (m, 3)."""
    events: tuple[tuple[int, str], ...]
    """Rows at which something happened, and what."""

    @classmethod
    def of(cls, history: Sequence[ExplorationProgress]) -> History:
        """Return a history as arrays."""
        n = len(history)
        figures = np.array([[*row[:5], *row.pose] for row in history], dtype=np.float64).reshape(n, 8)
        targets = np.array([np.full(3, np.nan) if row.target is None else row.target for row in history])
        paths, path_of = list[FloatArray](), np.full(n, -1, dtype=np.int32)
        for i, row in enumerate(history):
            if row.path is not None:
                if not paths or not np.array_equal(paths[-1], row.path):
                    paths.append(np.asarray(row.path, dtype=np.float64))
                path_of[i] = len(paths) - 1
        ends = np.cumsum([len(path) for path in paths], dtype=np.int32)
        states = np.concatenate([np.empty((0, 3)), *paths])
        events = tuple((i, row.event) for i, row in enumerate(history) if row.event)
        return cls(figures, targets.reshape(n, 3), path_of, ends, states, events)

    def progress(self) -> tuple[ExplorationProgress, ...]:
        """Return the history that these are the arrays of."""
        paths = np.split(self.paths, self.path_ends[:-1])
        said = dict(self.events)
        found = list[ExplorationProgress]()
        for i, (row, target, path) in enumerate(zip(self.figures, self.targets, self.path_of.tolist(), strict=True)):
            time, distance, area, landmarks, sigma = row[:5].tolist()
            aim = None if np.isnan(target).any() else target
            way = None if path < 0 else paths[path]
            found.append(
                ExplorationProgress(time, distance, area, int(landmarks), sigma, row[5:], aim, way, said.get(i, ""))
            )
        return tuple(found)

    def landmarks(self) -> FloatArray:
        """Return the landmarks that were driven to, shape (k, 3), in their order."""
        counted = np.diff(self.figures[:, 3], prepend=0.0) > 0.0
        chosen = np.where(np.isnan(self.targets), self.figures[:, 5:], self.targets)
        return chosen[counted]
