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
    """The n rows of an exploration's history; what is left of a path is not kept anew."""

    figures: FloatArray
    """Shape (n, 8): time, distance, area, landmarks, sigma, x, y, theta."""
    targets: FloatArray
    """Shape (n, 3), NaN where there was none."""
    spans: NDArray[np.int32]
    """First and last row of ``paths``, the last one left out, that were to be followed, shape (n, 2); -1 for none."""
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
        paths, count, spans = list[FloatArray](), 0, np.full((n, 2), -1, dtype=np.int32)
        for i, row in enumerate(history):
            if row.path is not None:
                left = len(row.path)
                if not paths or not np.array_equal(paths[-1][-left:], row.path):
                    paths.append(np.asarray(row.path, dtype=np.float64))
                    count += left
                spans[i] = count - left, count
        states = np.concatenate([np.empty((0, 3)), *paths])
        events = tuple((i, row.event) for i, row in enumerate(history) if row.event)
        return cls(figures, targets.reshape(n, 3), spans, states, events)

    def progress(self) -> tuple[ExplorationProgress, ...]:
        """Return the history that these are the arrays of."""
        said = dict(self.events)
        found = list[ExplorationProgress]()
        for i, (row, target, span) in enumerate(zip(self.figures, self.targets, self.spans.tolist(), strict=True)):
            time, distance, area, landmarks, sigma = row[:5].tolist()
            aim = None if np.isnan(target).any() else target
            way = None if span[0] < 0 else self.paths[slice(*span)]
            found.append(
                ExplorationProgress(time, distance, area, int(landmarks), sigma, row[5:], aim, way, said.get(i, ""))
            )
        return tuple(found)

    def landmarks(self) -> FloatArray:
        """Return the landmarks that were driven to, shape (k, 3), in their order."""
        counted = np.diff(self.figures[:, 3], prepend=0.0) > 0.0
        chosen = np.where(np.isnan(self.targets), self.figures[:, 5:], self.targets)
        return chosen[counted]
