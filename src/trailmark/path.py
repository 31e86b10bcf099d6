"""Path: a sequence of configurations joined by straight motions of SE(2)."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.arguments import number, number_array
from trailmark.errors import ConfigurationError

if TYPE_CHECKING:
    from trailmark.collision import StateChecker
    from trailmark.robot import Robot
    from trailmark.trajectories import SmoothPath, Trajectory
    from trailmark.world import World

__all__ = ["Path", "fractions"]

MAX_STATES = 1_000_000
"""Of a path with rows at most a step apart: more are a mistake, and do not fit into memory in the end."""


@dataclass(frozen=True, eq=False)
class Path:
    """A path through SE(2).

    Between two states x and y go linearly and theta along the shorter arc, as in OMPL's SE2StateSpace.

    Attributes:
        states: shape (n, 3), n >= 1; x, y in metres, theta in radians in (-pi, pi]. Read-only.

    Raises:
        ConfigurationError: another shape, or values that are not finite.
    """

    states: se2.FloatArray

    def __post_init__(self) -> None:
        states = se2.configurations(self.states, name="path")
        if states.ndim != 2 or len(states) == 0:
            raise ConfigurationError(f"path: expected shape (n, 3) with n >= 1, got {states.shape}")
        states.flags.writeable = False
        object.__setattr__(self, "states", states)

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        start, goal = (", ".join(f"{value:.3g}" for value in state) for state in self.states[[0, -1]])
        return f"{type(self).__name__}({len(self)} states from ({start}) to ({goal}), cost {self.cost:.4g} m)"

    def __eq__(self, other: object) -> bool:
        return np.array_equal(self.states, other.states) if isinstance(other, Path) else NotImplemented

    def __hash__(self) -> int:
        # Adding 0 makes -0.0 to 0.0: the two are equal, so their hashes must be.
        return hash((self.states + 0.0).tobytes())

    @property
    def length(self) -> float:
        """Way of the reference point, Σ ‖Δxy‖, in metres."""
        return float(np.hypot(*np.diff(self.states[:, :2], axis=0).T).sum())

    @property
    def rotation(self) -> float:
        """Total turning, Σ |Δθ|, in radians."""
        return float(np.abs(se2.wrap(np.diff(self.states[:, 2]))).sum())

    @property
    def cost(self) -> float:
        """Σ (‖Δxy‖ + 0.5·|Δθ|), in metres: the sum of OMPL's SE2StateSpace distances."""
        return self.length + se2.ROTATION_WEIGHT * self.rotation

    def at(self, fraction: ArrayLike) -> se2.FloatArray:
        """Return the configurations at fractions of the cost along the path, shape (m, 3), or (3,) for a scalar.

        ``fraction`` holds values in [0, 1], shape (m,) or a scalar; those outside are clipped.
        """
        steps = se2.distance(self.states[:-1], self.states[1:])
        along = np.concatenate([[0.0], np.cumsum(steps)])
        where = np.clip(fractions(fraction), 0.0, 1.0) * along[-1]
        if len(self.states) == 1:
            return np.broadcast_to(self.states[0], (*where.shape, 3)).copy()
        segment = np.clip(np.searchsorted(along, where, side="right") - 1, 0, len(steps) - 1)
        span = np.where(steps[segment] > 0.0, steps[segment], 1.0)
        return se2.interpolate(
            self.states[segment], self.states[segment + 1], np.clip((where - along[segment]) / span, 0.0, 1.0)
        )

    def resample(self, step: float) -> Path:
        """Return the same way with states at most ``step`` metres of cost apart; the old states are kept.

        Raises:
            ConfigurationError: a step that is no finite number above 0, or that makes more than a million states.
        """
        step = self._checked_step(step)
        a, b = self.states[:-1], self.states[1:]
        count = np.maximum(1, np.ceil(se2.distance(a, b) / step)).astype(np.intp)
        motion = np.repeat(np.arange(len(count)), count)
        before = np.cumsum(count) - count
        states = se2.interpolate(a[motion], b[motion], (np.arange(len(motion)) - before[motion]) / count[motion])
        states[before] = a
        return Path(np.concatenate([states, self.states[-1:]]))

    def _checked_step(self, step: float) -> float:
        """Return the step of :meth:`resample`, checked."""
        step = number(step, "resample: step", above=0.0)
        if not self.cost <= MAX_STATES * step:
            least = f"{self.cost / MAX_STATES:.3g} m or more ({MAX_STATES:,} states at most)"
            raise ConfigurationError(f"resample: step: expected {least}, got {step:g}")
        return step

    @classmethod
    def load(cls, file: str | FilePath) -> Path:
        """Return the states of a path file, whoever wrote it (:func:`trailmark.formats.any_path.read_any_path`).

        Raises:
            FormatError: the file cannot be read, or holds no path.
        """
        from trailmark.formats.any_path import read_any_path

        return Path(read_any_path(FilePath(file)).states)

    def save(self, file: str | FilePath, frame: str = "map") -> None:
        """Write the path in the format that the suffix tells (:func:`trailmark.formats.path_files.write_path`).

        Args:
            file: ``.json``, ``.csv``, ``.path``, ``.txt``, ``.yaml``, ``.nav2.json`` or ``.geojson``.
            frame: name of the coordinate frame, for messages and GeoJSON.

        Raises:
            OutputError: another suffix, or a path that cannot be written.
        """
        from trailmark.formats.path_files import write_path

        write_path(FilePath(file), self, frame=frame)

    def reversed(self) -> Path:
        """Return the path from its end to its start; it has the same cost."""
        return Path(self.states[::-1])

    def smooth(
        self, world: World | StateChecker, robot: Robot | None = None, *, max_curvature: float = math.inf
    ) -> SmoothPath:
        """Return the path with its corners rounded within the free space, certified.

        Straight motions are joined by parabolas in x, y and heading; where a corner touches an obstacle, they swing
        around it. A car's arcs and lines are joined by clothoids, along which its curvature changes steadily. Where
        there is no room the corner stays, and the robot stops there: ``stops`` of the result lists these places. A
        differential drive goes round corners on clothoids, too; it still turns in place where it starts and ends.

        Args:
            world: obstacles, bounds, boundary; or a :class:`trailmark.StateChecker`, which is faster for many paths.
            robot: that drives; the world's own if None.
            max_curvature: of the reference point's way, 1/m; infinity for no limit. A car has its turning radius.

        Raises:
            ConfigurationError: the path is not certified free of collision, or is smooth already.
        """
        from trailmark.collision import StateChecker
        from trailmark.trajectories.smooth import smoothed

        curvature = number(max_curvature, "smooth: max_curvature", above=0.0, infinite=True, unit="1/m")
        checker = world if isinstance(world, StateChecker) else StateChecker(world, robot)
        checker.require_for(checker.world, robot)
        return smoothed(self, checker, curvature)

    def timed(
        self,
        max_speed: float,
        max_acceleration: float,
        max_turn_rate: float,
        max_turn_acceleration: float | None = None,
        *,
        zones: Iterable[Any] = (),
        intervals: int = 48,
    ) -> Trajectory:
        """Return the fastest trajectory along the path, from rest to rest, within a robot's limits.

        The robot stops at corners, where its direction of travel jumps; :meth:`smooth` rounds them. With a limit on
        the turn acceleration it also stops where the turn rate would jump.

        Args:
            max_speed: of the reference point, m/s.
            max_acceleration: of the reference point, along the path and across it, m/s².
            max_turn_rate: rad/s.
            max_turn_acceleration: rad/s²; None for turn rates that change at once.
            zones: of the world (``world.zones``); the speed limits among them hold in their regions.
            intervals: of constant acceleration on each curved piece; more come nearer to the fastest law.

        Raises:
            ConfigurationError: limits that are not finite numbers above 0.
        """
        from trailmark.trajectories import Limits, timed

        limits = Limits(max_speed, max_acceleration, max_turn_rate, max_turn_acceleration, intervals)
        return timed(self, limits, zones)


def fractions(value: ArrayLike) -> se2.FloatArray:
    """Return fractions of a path as a float array of any shape, or say what is wrong.

    Raises:
        ConfigurationError: values that are no numbers, or NaN.
    """
    found = number_array(value, "path: fraction")
    if np.isnan(found).any():
        raise ConfigurationError("path: fraction: expected numbers from 0 to 1, got NaN")
    return found
