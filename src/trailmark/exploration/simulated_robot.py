# ruff: noqa: N806 # the filter's own symbol: Q
"""A simulated robot in a world that is hidden from whoever explores it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import Count, NonNegative, Positive, PositiveOrInfinite, Seed, Share, checked_arguments
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.estimation.models import PoseIncrement, RangeBearing
from trailmark.estimation.records import Increment, Record
from trailmark.estimation.simulation import Drive
from trailmark.estimation.virtual_sensors import Detector, RayCaster, Scanner
from trailmark.se2 import FloatArray, between, compose, configurations, interpolate, motion_bound
from trailmark.world import World
from trailmark.world.robot import Robot

__all__ = ["DriveReport", "ExploringRobot", "SimulatedRobot", "disc_detector", "laser_scanner"]


# 2 cm and 0.01 rad after a metre, 0.02 rad after a radian, growing as the root of what is driven: a wheeled robot
# indoors. What each record adds (0.2 mm, 0.2 mrad) keeps the covariance of a turn on the spot regular.
ODOMETRY: Final = PoseIncrement(2e-4, 2e-4, 2e-4, growth=(4e-4, 1e-4, 4e-4))
PERIOD = 0.1  # Seconds between records of odometry, at most.
INSTANT = 1e-9  # Seconds: what is closer together is simultaneous.
LEAST_STATED = 0.01  # Share of the noise that records state when there is less: filters cannot use a covariance of 0.
EXACT = 1e-9  # Share of the noise that sensors have when there is none: a detector's model has no deviation of 0.
STOP = 1e-3  # Metres before a contact at which a robot comes to a stop, at most.
# Share of the inscribed radius that a robot has to be away from what it met for the next contact to count.
APART = 0.05


class DriveReport(NamedTuple):
    """The result of a command to drive, as the robot itself knows it."""

    distance: float
    """Metres that it drove, by its odometry."""
    arrived: bool
    """Whether it drove to the path's end."""
    blocked: bool
    """Whether it cannot go on: a bumper, a motor that stalls."""


class ExploringRobot(Protocol):
    """A robot that explores: two methods."""

    def sense(self) -> Sequence[Record]:
        """Return what was recorded since the last call, in the order of time.

        That is odometry (``Increment``, with its covariance if it is known, or ``Odometry``) and the readings of one
        sensor (``Scan``, or ``Detection``). Without readings the sensor is silent.
        """

    def drive(self, states: FloatArray, seconds: float) -> DriveReport:
        """Drive along a path for a while, then stop or be told to go on.

        Args:
            states: shape (n, 3), in the robot's own frame as it is now: x ahead, y to the left, metres and radians. The
                first row is (0, 0, 0); one row means to stand still.
            seconds: how long to drive at most.
        """


def laser_scanner(max_range: Positive, cell: Positive, most: Count = 1000) -> Scanner:
    """Return a laser scanner that sees all around, for a map of cells.

    Args:
        max_range: metres.
        cell: metres that neighbouring beams are apart at that range.
        most: beams, at most.
    """
    beams = min(most, max(16, math.ceil(2.0 * math.pi * max_range / cell)))
    return Scanner(beams, 2.0 * math.pi, max_range, sigma=0.01)


def disc_detector(max_range: Positive) -> Detector:
    """Return a sensor that sees discs all around, and tells them apart: 2 cm and 0.01 rad."""
    return Detector(RangeBearing(0.02, 0.01), max_range)


class SimulatedRobot:
    """An :class:`trailmark.exploration.simulated_robot.ExploringRobot` in a hidden world.

    Its odometry records the commanded steps; the true steps have noise added, as the filters assume, and now and then a
    part of a step is lost (the wheels slip). Collisions are found in the true world with the true footprint, for each
    small true motion as a whole (:class:`trailmark.collision.StateChecker`); the robot then stops at the last free
    place.

    Args:
        world: the hidden world; its zones are ignored.
        robot: footprint; its clearance is ignored.
        start: pose at time 0, shape (3,).
        sensor: a laser, or a detector of discs. Its ``period`` is not used: each call of :meth:`sense` is a reading.
        odometry: noise of a step.
        slip: probability that a part of a step of 0.1 s is lost, uniformly from none to all of it. The recorded
            covariances include it.
        speed: metres per second.
        turn_rate: radians per second.
        seed: of all noise.
        noise: factor on all standard deviations; with 0, odometry and readings are exact and nothing slips.

    Attributes:
        world: as it is now.
        robot: as given, without a clearance.
        sensor: as given, with the noise that there is; a hundredth of what was given where there is less.
        time: seconds since the start.
        pose: true pose, shape (3,).
        collisions: times that it met something; standing in contact, or one contact after the other without having been
            free in between, counts once.

    Raises:
        ConfigurationError: the start is not valid in the world.
    """

    @checked_arguments(ConfigurationError)
    def __init__(
        self,
        world: World,
        robot: Robot,
        start: ArrayLike,
        sensor: Scanner | Detector,
        *,
        odometry: PoseIncrement = ODOMETRY,
        slip: Share = 0.01,
        speed: Positive = 1.0,
        turn_rate: Positive = 1.0,
        seed: Seed = 0,
        noise: NonNegative = 1.0,
    ) -> None:
        self.robot, self.time, self.collisions = robot.keeping(0.0), 0.0, 0
        self.sensor, self._drawn = _scaled(sensor, max(noise, LEAST_STATED)), _scaled(sensor, max(noise, EXACT))
        self.change_world(world)
        self.pose: FloatArray = self._checker.require_valid(start, "start")
        self._odometry, self._slip, self._noise = odometry, slip if noise > 0.0 else 0.0, noise
        self._speed, self._turn_rate = speed, turn_rate
        self._generators = np.random.default_rng(seed).spawn(3)
        self._odometry_rng, self._slip_rng, self._sensor_rng = self._generators
        self._truth: list[tuple[float, ...]] = [(0.0, *self.pose)]
        self._increments: list[Increment] = []
        self._sensed, self._touches = -1.0, False  # when it read last

    @property
    def truth(self) -> FloatArray:
        """Where it was, shape (n, 4), rows t, x, y, theta."""
        return np.array(self._truth)

    def state(self) -> dict[str, Any]:
        """Return all that :meth:`restore` needs, plain numbers, texts, lists and dictionaries, as JSON has them.

        The world is not part of it.
        """
        return {
            "truth": [list(row) for row in self._truth],
            "collisions": self.collisions,
            "touches": self._touches,
            "sensed": self._sensed,
            "unread": [[*step[:4], np.asarray(step.covariance).tolist()] for step in self._increments],
            "random": [rng.bit_generator.state for rng in self._generators],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on where another robot of the same arguments was when it returned this :meth:`state`.

        Raises:
            ConfigurationError: it does not fit there.
        """
        pose = self._checker.require_valid(state["truth"][-1][1:], "the robot's place")
        for rng, numbers in zip(self._generators, state["random"], strict=True):
            rng.bit_generator.state = numbers
        self._truth = [tuple(row) for row in state["truth"]]
        self._increments = [Increment(t, dx, dy, dtheta, np.array(Q)) for t, dx, dy, dtheta, Q in state["unread"]]
        self.collisions, self._touches, self._sensed = state["collisions"], state["touches"], state["sensed"]
        self.time, self.pose = self._truth[-1][0], pose

    def change_world(self, world: World) -> None:
        """Let the world be another one from now on: doors close, things are moved.

        Raises:
            ConfigurationError: the robot stands where something is now.
        """
        checker = StateChecker(replace(world, zones=()), self.robot)
        if hasattr(self, "pose"):
            checker.require_valid(self.pose, "the robot's place")
        self.world, self._checker = world, checker
        self._caster = RayCaster(world, bounds=not isinstance(self.sensor, Scanner) or self.sensor.bounds)
        self._features = self.sensor.features(world) if isinstance(self.sensor, Detector) else np.empty((0, 4))

    def carry(self, pose: ArrayLike) -> None:
        """Put the robot elsewhere, shape (3,), without its odometry noticing.

        Raises:
            ConfigurationError: it does not fit there.
        """
        self.pose = self._checker.require_valid(pose, "pose")
        self._truth.append((self.time, *self.pose))

    def sense(self) -> Sequence[Record]:
        """Return the odometry since the last call, and a reading from where the robot is, if time has passed."""
        records: list[Record] = [*self._increments]
        if self.time > self._sensed:
            records += self._read()
        self._increments, self._sensed = [], self.time
        return records

    @checked_arguments(ConfigurationError)
    def drive(self, states: ArrayLike, seconds: PositiveOrInfinite) -> DriveReport:
        """Drive along a path: x and y linearly, theta along the shorter arc, as fast as the two speeds allow.

        A drive that is blocked, or that stands still, takes all of its time.

        Args:
            states: shape (n, 3), in the robot's own frame; the first row is (0, 0, 0).
            seconds: at most; finite for one that stands still.

        Raises:
            ConfigurationError: no such path.
        """
        path = np.atleast_2d(configurations(states, name="states"))
        if not np.allclose(path[0], 0.0, atol=1e-9):
            raise ConfigurationError(f"states: expected the first row (0, 0, 0), got {path[0].tolist()}")
        moves = np.abs(between(path[:-1], path[1:]))
        durations = np.maximum(np.hypot(moves[:, 0], moves[:, 1]) / self._speed, moves[:, 2] / self._turn_rate)
        whole = float(durations.sum())
        if whole == 0.0 and not math.isfinite(seconds):
            raise ConfigurationError(f"seconds: expected a finite number to stand still, got {seconds}")
        # A path to a far landmark comes as a whole each time: only what there is time for is looked at.
        soon = 2 + int(np.searchsorted(np.cumsum(durations), seconds))
        drive = Drive(path[:soon], self._speed, self._turn_rate, holonomic=True)
        end = min(float(drive.times[-1]), seconds)
        times = np.sort(np.concatenate([np.arange(0.0, end, PERIOD), drive.times[drive.times < end], [end]]))
        times = times[np.append(np.diff(times) > INSTANT, True)]
        planned = drive.poses(times)
        steps, begin, distance, share = between(planned[:-1], planned[1:]), self.time, 0.0, 1.0
        for t, duration, step in zip(times.tolist(), np.diff(times).tolist(), steps, strict=False):
            there = self._moved(step, duration)
            share = self._free_share(there)
            self.pose = interpolate(self.pose, there, share) if share < 1.0 else there
            if share > 0.0:
                self._record(begin + t + share * duration, share * step)
                distance += share * float(np.hypot(*step[:2]))
            if share < 1.0:
                break
        blocked = share < 1.0
        self._count(blocked)
        whole_time = min(seconds, whole) if whole and not blocked else seconds
        if math.isfinite(whole_time) and begin + whole_time > self._truth[-1][0] + INSTANT:
            self._record(begin + whole_time, np.zeros(3))
        self.time = self._truth[-1][0]
        return DriveReport(distance, not blocked and whole <= seconds + INSTANT, blocked)

    def _moved(self, step: FloatArray, duration: float) -> FloatArray:
        """Return where a step, shape (3,), truly leads from where the robot is."""
        w = self._noise * np.sqrt(np.diag(self._odometry.Q(step))) * self._odometry_rng.standard_normal(3)
        chance, lost = self._slip_rng.random(2)
        kept = 1.0 - lost if chance < self._slip * duration / PERIOD else 1.0
        return np.asarray(compose(self.pose, kept * step + w))

    def _free_share(self, there: FloatArray) -> float:
        """Return which share of the motion from where the robot is is free."""
        if self._checker.motion_valid(self.pose, there):
            return 1.0
        share, width = 0.0, 1.0
        while width * float(motion_bound(self.pose, there, self.robot.circumradius)) > STOP:
            width *= 0.5
            if self._checker.motion_valid(self.pose, interpolate(self.pose, there, share + width)):
                share += width
        return share

    def _record(self, t: float, step: FloatArray) -> None:
        """Write down a step of the odometry, shape (3,), with its covariance, and where it truly led."""
        Q = self._odometry.Q(step) * max(self._noise, LEAST_STATED) ** 2 + self._slip / 3.0 * np.outer(step, step)
        dx, dy, dtheta = step.tolist()
        self._increments.append(Increment(t, dx, dy, dtheta, Q))
        self._truth.append((t, *self.pose.tolist()))

    def _count(self, blocked: bool) -> None:
        """Count a contact, unless the last one has not ended."""
        if blocked:
            self.collisions += not self._touches
            self._touches = True
        elif self._touches:
            away = APART * self.robot.inscribed_disc.radius
            self._touches = bool(self._checker.clearance(self.pose, cap=away) < away)

    def _read(self) -> list[Record]:
        """Return a reading of the sensor."""
        if isinstance(self._drawn, Scanner):
            return [self._drawn.sweep(self.time, self.pose, self._caster, self._sensor_rng)]
        found = self._drawn.sweep(self.time, self.pose, self._features, self._caster, self._sensor_rng)
        factor = max(self._noise, LEAST_STATED) ** 2 / max(self._noise, EXACT) ** 2
        return [d if d.covariance is None else d._replace(covariance=factor * d.covariance) for d in found]


def _scaled(sensor: Scanner | Detector, noise: float) -> Scanner | Detector:
    """Return a sensor with so much of its noise."""
    if isinstance(sensor, Scanner):
        return replace(sensor, sigma=noise * sensor.sigma)
    model = sensor.model
    scaled = replace(model, sigma_range=noise * model.sigma_range, sigma_bearing=noise * model.sigma_bearing)
    return replace(sensor, model=scaled)
