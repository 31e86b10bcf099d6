"""The loop of an exploration: sense, refine, choose a landmark, drive there, until nothing more can be seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Literal, get_args

import numpy as np

from trailmark.arguments import brief, callback, each_of, one_of, whole
from trailmark.errors import ConfigurationError, as_raised
from trailmark.estimation.records import Detection, Log, Pose, Record, Scan
from trailmark.estimation.virtual_sensors import Detector, Scanner
from trailmark.exploration.background import postponed_interrupts
from trailmark.exploration.cells import quarters
from trailmark.exploration.course import Course
from trailmark.exploration.detection_mapper import DetectionMapper
from trailmark.exploration.exploration_folder import SavedExploration
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.following import PathFollower
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.mapper import Intake, Mapper
from trailmark.exploration.result import ExplorationProgress, ExplorationResult, Status
from trailmark.exploration.scan_mapper import ScanMapper
from trailmark.exploration.simulated_robot import (
    DriveReport,
    ExploringRobot,
    SimulatedRobot,
    disc_detector,
    laser_scanner,
)
from trailmark.exploration.strategies import Strategy, strategy_of
from trailmark.exploration.visible_area import evaluate
from trailmark.planning import LandmarkPlanner
from trailmark.se2 import FloatArray, configurations, difference
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["Explorer", "check_visible", "mapper_for", "sensor_of"]

SILENCE = 5.0
"""Seconds of the robot's clock without a reading after which the sensor is silent."""

MAX_BLOCKED = 5
"""Commands in a row that a robot does not carry out because something is in its way, before it is stuck."""

MAX_STILL = 50
"""Commands in a row that lead a robot nowhere, although it does not say that something is in its way."""

STILL = 0.01
"""Metres, and radians, that it moves at least unless it stays where it is."""


class Explorer:
    """Explores: a robot without a map drives from landmark to landmark until nothing more can be seen.

    At each reading the mapper brings pose and map up to date. When the robot has come to its landmark, or has seen what
    it was chosen for, or its path is blocked, the planner's world follows the map (:meth:`LandmarkPlanner.update`), the
    free space is clustered anew, and the strategy chooses the next landmark. Paths lead through what is known to be
    free alone, and are certified.

    Args:
        world_or_robot: a hidden world, explored by a simulated robot; or a robot (:class:`ExploringRobot`).
        robot: footprint and drive; the world's own if None.
        sensor: ``laser``, ``detections``, or the sensor's description.
        strategy: a name that the shell takes, or a function that chooses from an :class:`Outlook`.
        sensor_range: metres, of a sensor that is given by its name. No sensor reaches farther than from one corner of
            ``bounds`` to the opposite one.
        start: where the robot stands, shape (3,), which it knows; by default that of the world's first query.
        bounds: xmin, ymin, xmax, ymax of what is to be explored; the world's own if None.
        settings: numbers that a person may change.
        noise: of a simulated robot: times the stated noise of odometry and sensor; 0 for none.
        seed: of what is drawn.
        resumed: an exploration to go on with, of the same world, robot, sensor and settings.

    Raises:
        ConfigurationError: an argument out of range or of another kind, a start that is not free, or a world that the
            sensor cannot see.
        WorldError: neither ``robot`` nor a robot in the world.
    """

    def __init__(
        self,
        world_or_robot: World | ExploringRobot,
        robot: Robot | None = None,
        sensor: Literal["laser", "detections"] | Scanner | Detector = "laser",
        *,
        strategy: str | Strategy = "tour",
        sensor_range: float = 5.0,
        start: Sequence[float] | FloatArray | None = None,
        bounds: tuple[float, float, float, float] | None = None,
        settings: ExplorationSettings | None = None,
        noise: float = 1.0,
        seed: int = 0,
        resumed: SavedExploration | None = None,
    ) -> None:
        self.settings = one_of(settings or ExplorationSettings(), ExplorationSettings, "settings:")
        self.strategy, choose = strategy_of(strategy)
        self.seed = whole(seed, "seed:", 0)
        world = world_or_robot if isinstance(world_or_robot, World) else None
        own = robot if robot is not None else None if world is None else world.robot
        if own is None:
            raise ConfigurationError("explore: expected a robot, got none, and none in the world")
        self.robot = one_of(own, Robot, "robot:")
        if world is not None:
            start = world.query().start if start is None else start
            bounds = world.bounds if bounds is None else bounds
        if start is None or bounds is None:
            raise ConfigurationError("explore: expected start= and bounds= with a robot of your own")
        self.start = configurations(start, name="start").reshape(3)
        described = sensor_of(sensor, sensor_range, self.settings.cell_side(self.robot, bounds), bounds)
        if world is None:
            self._driver: ExploringRobot = world_or_robot  # type: ignore[assignment]  # no world, so it is a robot
        else:
            check_visible(world, described)
            # A sensor that reaches far shows as much more a second if the robot is as much faster.
            speed = max(1.0, described.max_range / 10.0)
            simulated = SimulatedRobot(
                world, self.robot, self.start, described, noise=noise, seed=self.seed, speed=speed
            )
            self._driver, described = simulated, simulated.sensor
        self.name = "exploration" if world is None else world.name
        radii = {i: s.radius for i, s in enumerate(world.obstacles) if isinstance(s, Disc)} if world else None
        self.mapper: Mapper = mapper_for(described, self.robot, self.start, bounds, self.settings, radii)
        self.sensor_range = described.max_range
        self._course = Course(
            self.mapper, self.robot, self.start, described, choose, self.settings, self.seed, self.name
        )
        self._time, self._last_reading, self._distance = 0.0, 0.0, 0.0
        self._moved, self._blocked, self._still, self._stood = 0.0, 0, 0, self.start
        self._began: float | None = None  # by the robot's clock, which need not begin at 0
        self._ended: tuple[Status, str] | None = None
        self._history: list[ExplorationProgress] = []
        self._seconds = 0.0
        self._first_known = np.full(self.mapper.known.state.shape, np.inf, dtype=np.float32)
        self._revision = -1
        if resumed is not None:
            self._resume(resumed)

    @property
    def ended(self) -> tuple[Status, str] | None:
        """Why the exploration is over, in a word and in a sentence; None while it is not."""
        return self._ended

    @property
    def history(self) -> Sequence[ExplorationProgress]:
        """One entry for each step so far."""
        return self._history

    @property
    def planner(self) -> LandmarkPlanner:
        """Plans in the map as it was known when a landmark was last chosen, or a path led around something."""
        return self._course.planner

    @as_raised
    def run(self, on_progress: Callable[[ExplorationProgress], None] | None = None) -> ExplorationResult:
        """Explore until it is over, and return the outcome; Ctrl-C ends it with what is known so far.

        Args:
            on_progress: called after each step; :attr:`ended` says whether it was the last one, which is the moment to
                keep what :meth:`saved` returns, for building the final map takes a while.
        """
        callback(on_progress, "on_progress:")
        with postponed_interrupts() as interrupted:
            try:
                while self._ended is None:
                    progress = self.step()
                    if interrupted() and self._ended is None:
                        self._ended = "interrupted", "interrupted"
                    if on_progress is not None:
                        on_progress(progress)
            except KeyboardInterrupt:  # a caller's function raised it, or Ctrl-C was pressed twice
                self._ended = "interrupted", "interrupted"
        return self.result()

    def step(self) -> ExplorationProgress:
        """Sense once, and drive on for one period; choose where to if there is need."""
        begin = perf_counter()
        intake = self._sense()
        events = list(intake.refused)
        if self._ended is None and intake.lost:
            events.append("lost: the readings do not fit the map here")
            if self.mapper.relocate():
                events.append("found again in the map")
                self._course.follower = None
            else:
                self._ended = "stuck", "the robot is lost: its readings fit the map nowhere"
        driven = None
        if self._ended is None and intake.readings:
            events += self._course.update(self._moved, intake.moved, self._blocked > 0)
            self._moved, self._ended = 0.0, self._course.ended
            if self._course.follower is not None and self._ended is None:
                driven = self._drive(self._course.follower)
        self._note_known()
        if self._ended is None and driven is None:
            self._driver.drive(np.zeros((1, 3)), self.settings.sense_period)
            self._time += self.settings.sense_period
        progress = self._progress("; ".join(events))
        self._history.append(progress)
        self._seconds += perf_counter() - begin
        return progress

    def result(self) -> ExplorationResult:
        """Return what was found so far; building the final map takes a while."""
        if self._ended is not None:
            self._course.stop()
        status, reason = self._ended or ("interrupted", "not over")
        saved, known, evaluation = self.saved(), self.mapper.known, None
        log = self.mapper.finished_log(saved.log)
        nothing = not any(isinstance(record, Scan | Detection) for record in saved.log.records)
        empty = World(self.name, known.bounds, robot=self.robot)
        if isinstance(self._driver, SimulatedRobot):
            evaluation = evaluate(self._driver, known, self.mapper.trajectory, self.mapper.covariances)
        return ExplorationResult(
            status=status,
            reason=reason,
            world=empty if nothing else self.mapper.finished_map(log),
            known=known,
            first_known=saved.first_known,
            roadmap=self._course.current_planner().roadmap,
            log=log,
            history=saved.history,
            strategy=self.strategy,
            seed=self.seed,
            settings=self.settings,
            seconds=saved.seconds,
            decisions=saved.decisions,
            robot_state=saved.robot_state,
            evaluation=evaluation,
        )

    def log(self) -> Log:
        """Return all that was recorded and used, with the truth where a simulator knows it."""
        records, scanned = list(self.mapper.records), any(isinstance(record, Scan) for record in self.mapper.records)
        if isinstance(self._driver, SimulatedRobot):
            records += (Pose(t, x, y, theta, truth=True) for t, x, y, theta in self._driver.truth.tolist())
            records.sort(key=lambda record: record.t)
        return Log(self.name, tuple(records), np.empty((0, 3)), cell=self.mapper.known.cell if scanned else None)

    def saved(self) -> SavedExploration:
        """Return all that another explorer of the same world, robot and sensor needs to go on (``resumed``)."""
        state = self._driver.state() if isinstance(self._driver, SimulatedRobot) else None
        decisions = np.array(self._course.decisions)
        found = self.log(), tuple(self._history), self._first_known.copy(), self.mapper.known.contacts
        return SavedExploration(*found, state, self._seconds, decisions, {})

    def _resume(self, saved: SavedExploration) -> None:
        """Take over what was recorded and found before."""
        shape = saved.first_known.shape
        while self.mapper.known.state.shape != shape and self._course.refine():
            pass  # its cells had been divided
        if self.mapper.known.state.shape != shape:
            raise ConfigurationError(f"resume: expected a map of {self._first_known.shape} cells, got {shape}")
        for records in _readings(saved.log.records):
            self.mapper.take(records)
        self.mapper.known.add_contact(saved.contacts)
        self._history, last = list(saved.history), saved.history[-1]
        self._began = saved.log.records[0].t
        self._time = self._last_reading = last.time
        self._distance, self._seconds = last.distance, saved.seconds
        self._course.landmarks, self._course.decisions = last.landmarks, saved.decisions.tolist()
        self._first_known = saved.first_known.copy()
        if isinstance(self._driver, SimulatedRobot) and saved.robot_state is not None:
            self._driver.restore(saved.robot_state)

    def _sense(self) -> Intake:
        """Take in what was sensed; end where the sensor is silent or a limit is reached."""
        s = self.settings
        records: tuple[Record, ...] = each_of(self._driver.sense(), get_args(Record), "sense")
        intake = self.mapper.take(records)
        if times := [record.t for record in records if np.isfinite(record.t)]:
            if self._began is None:
                self._began = self._last_reading = min(times)
            self._time = max(self._time, *times)
        if intake.readings:
            self._last_reading = self._time
        elif self._time - self._last_reading >= SILENCE:
            heard = any(isinstance(record, Scan | Detection) for record in records)
            what = "its readings cannot be used" if heard else "no reading"
            self._ended = "silent", f"{what} for {self._time - self._last_reading:.1f} s"
        if self._ended is None and self._time - (self._began or 0.0) >= s.time_limit:
            self._ended = "time", f"the time limit of {s.time_limit:g} s is used up"
        if self._ended is None and self._distance >= s.distance_limit:
            self._ended = "distance", f"the distance limit of {s.distance_limit:g} m is used up"
        return intake

    def _note_known(self) -> None:
        """Take note of when each cell was known first."""
        known = self.mapper.known
        if self._first_known.shape != known.state.shape:  # its cells have been divided
            self._first_known, self._revision = quarters(self._first_known, known.state.shape), -1
        if known.revision != self._revision:
            self._revision = known.revision
            new = (known.state != 0) & np.isinf(self._first_known)
            self._first_known[new] = self._time

    def _drive(self, follower: PathFollower) -> DriveReport:
        """Drive on along the path for one period."""
        pose = self.mapper.pose
        states = follower.command(pose)
        off = np.abs(difference(self._stood, pose))
        self._still += 1
        if max(np.hypot(*off[:2]), off[2]) >= STILL:
            self._still, self._stood = 0, pose
        report = one_of(self._driver.drive(states, self.settings.sense_period), DriveReport, "drive:")
        self._moved += report.distance
        self._distance += report.distance
        self._blocked = self._blocked + 1 if report.blocked else 0
        if self._blocked >= MAX_BLOCKED:
            self._ended = "stuck", "something that is not in the map is in the robot's way"
        elif self._still >= MAX_STILL:
            self._ended = "stuck", f"the robot stays where it is, {MAX_STILL} commands in a row"
        if report.arrived:
            self._course.follower = None
        return report

    def _progress(self, event: str) -> ExplorationProgress:
        known, follower = self.mapper.known, self._course.follower
        # In the frame of the start: beside the map around it, and what that has drifted since.
        around, drifts = self.mapper.covariance, self.mapper.drifts
        drifted = float(drifts[0, 1]) if len(drifts) else 0.0
        return ExplorationProgress(
            time=self._time,
            distance=self._distance,
            area=float((known.state != 0).sum()) * known.cell**2,
            landmarks=self._course.landmarks,
            sigma=float(np.sqrt(max(0.0, np.linalg.eigvalsh(around[:2, :2])[-1]) + drifted**2)),
            pose=self.mapper.pose.copy(),
            target=None if follower is None else follower.target,
            path=None if follower is None else follower.rest,
            event=event if self._ended is None else "; ".join(filter(None, [event, self._ended[1]])),
        )


def _readings(records: Sequence[Record]) -> Iterator[list[Record]]:
    """Yield a log's records, the truth left out, up to each reading of the sensor."""
    some = list[Record]()
    read = False
    for record in records:
        if isinstance(record, Pose):
            continue
        is_reading = isinstance(record, Scan | Detection)
        if read and (not is_reading or record.t > some[-1].t):
            yield some
            some, read = [], False
        some.append(record)
        read = read or is_reading
    if some:
        yield some


def mapper_for(
    sensor: Scanner | Detector,
    robot: Robot,
    start: FloatArray,
    bounds: tuple[float, float, float, float],
    settings: ExplorationSettings,
    radii: Mapping[int, float] | None = None,
) -> Mapper:
    """Return a mapper that knows nothing yet.

    Args:
        sensor: its range, and the noise that there is.
        robot: of the world.
        start: where it stands first, shape (3,).
        bounds: of what is to be explored.
        settings: of the exploration.
        radii: of the discs that a detector reads, by their identity, metres.

    Raises:
        ConfigurationError: a detector of discs of any size, and no radii.
    """
    known = KnownMap(bounds, settings.cell_side(robot, bounds))
    if isinstance(sensor, Detector):
        return DetectionMapper(start, known, sensor, robot, settings, radii)
    return ScanMapper(start, known, sensor, robot, settings)


def sensor_of(
    sensor: object, sensor_range: float, cell: float, bounds: tuple[float, float, float, float]
) -> Scanner | Detector:
    """Return a sensor's description; its range ends where all that is to be explored does.

    Args:
        sensor: ``laser``, ``detections``, or a description.
        sensor_range: metres, of a sensor that is given by its name.
        cell: side of the map's cells, metres.
        bounds: of what is to be explored.

    Raises:
        ConfigurationError: no such sensor, or no such range.
    """
    if sensor == "laser":
        sensor = laser_scanner(sensor_range, cell)
    elif sensor == "detections":
        sensor = disc_detector(sensor_range)
    if not isinstance(sensor, Scanner | Detector):
        raise ConfigurationError(f"sensor: expected laser, detections, a Scanner or a Detector, got {brief(sensor)}")
    return replace(sensor, max_range=min(sensor.max_range, math.dist(bounds[:2], bounds[2:])))


def check_visible(world: World, sensor: Scanner | Detector) -> None:
    """Raise if there are obstacles that a sensor never sees.

    Raises:
        ConfigurationError: a detector of discs, and an obstacle that is none or too large for it, or a boundary.
    """
    if isinstance(sensor, Scanner):
        return
    for i, shape in enumerate(world.obstacles):
        if not (isinstance(shape, Disc) and shape.radius <= sensor.max_radius):
            raise ConfigurationError(
                f"sensor: expected discs alone for a sensor of detections, got {type(shape).__name__.lower()} "
                f"obstacles[{i}] (--sensor laser sees it)"
            )
    if world.boundary is not None:
        raise ConfigurationError("sensor: expected no boundary for a sensor of detections (--sensor laser sees it)")
