"""The outcome of an exploration, its history, and what is told of it on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.records import Log
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import KnownMap
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["Evaluation", "ExplorationProgress", "ExplorationResult", "History", "Status"]


Status = Literal["complete", "time", "distance", "stuck", "silent", "interrupted"]


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


class ExplorationProgress(NamedTuple):
    """Where an exploration stands."""

    time: float
    """Seconds of the robot's clock."""
    distance: float
    """Metres driven, by odometry."""
    area: float
    """Square metres that are known, free or occupied."""
    landmarks: int
    """How many were driven to."""
    sigma: float
    """Standard deviation of the robot's place along its least certain direction, metres, in the frame of its start."""
    pose: FloatArray
    """Where it is, shape (3,)."""
    target: FloatArray | None
    """The landmark that it drives to, shape (3,)."""
    path: FloatArray | None
    """The way there, shape (n, 3)."""
    event: str
    """What happened, in words; empty most of the time."""


class Evaluation(NamedTuple):
    """What only a simulator can say."""

    seen: float
    """Share of the area that can be seen from where the robot can get to."""
    collisions: int
    """Times that it met something."""
    nees: float
    """Mean normalised estimation error squared of its place and heading, 3 where the covariances are right."""


@dataclass(frozen=True)
class ExplorationResult:
    """The outcome of an exploration.

    Attributes:
        status: why it ended.
        reason: the same, in a sentence.
        world: the map, its obstacles with covariances (as ``trailmark map`` makes it of the log).
        known: the cells at the end.
        first_known: seconds of the robot's clock at which each cell was known first, shape of ``known.state``,
            infinite where it is not.
        roadmap: landmarks and certified motions between them, in the map as it is known at the end.
        log: all that was recorded.
        history: one for each reading of the sensor.
        strategy: its name.
        seed: of what was drawn.
        settings: with which it was run.
        seconds: time that it took, decisions included.
        decisions: seconds of each reading at which a landmark was chosen, or the way to it looked for, shape (n,).
        evaluation: by the simulator; None with a real robot.
        robot_state: of the simulated robot at the end, so that it can go on; None with a real one.
    """

    status: Status
    reason: str
    world: World
    known: KnownMap
    first_known: NDArray[np.float32]
    roadmap: Roadmap
    log: Log
    history: tuple[ExplorationProgress, ...]
    strategy: str
    seed: int
    settings: ExplorationSettings
    seconds: float
    decisions: FloatArray
    evaluation: Evaluation | None = None
    robot_state: dict[str, Any] | None = None
