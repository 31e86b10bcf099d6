"""The outcome of an exploration, and what is told of it on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.logs.records import Log
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.known_map import KnownMap
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray
from trailmark.world import World

__all__ = ["Evaluation", "ExplorationProgress", "ExplorationResult", "Status"]

Status = Literal["complete", "time", "distance", "stuck", "silent", "interrupted"]


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
