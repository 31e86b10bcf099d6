"""The loop of an exploration: sense, update the map, then follow a path, or choose a landmark and plan."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from enum import Enum
from time import perf_counter, thread_time
from types import FrameType
from typing import Literal, get_args

import numpy as np

from trailmark.arguments import brief, callback, each_of, one_of, whole
from trailmark.errors import ConfigurationError, as_raised
from trailmark.estimation.records import Detection, Log, Pose, Record, Scan
from trailmark.estimation.virtual_sensors import Detector, Scanner
from trailmark.exploration.detection_mapper import DetectionMapper
from trailmark.exploration.following import BACK, PathFollower, contact_points, turned_around, way_back, way_back_to
from trailmark.exploration.known_map import UNKNOWN, KnownMap
from trailmark.exploration.mapper import Belief, Mapper
from trailmark.exploration.result import (
    ExplorationProgress,
    ExplorationResult,
    ExplorationSettings,
    SavedExploration,
    Status,
)
from trailmark.exploration.scan_mapper import ScanMapper
from trailmark.exploration.simulated_robot import (
    DriveReport,
    ExploringRobot,
    SimulatedRobot,
    disc_detector,
    laser_scanner,
)
from trailmark.exploration.strategies import Strategy, choice_of, strategy_of
from trailmark.exploration.survey import Cells, Memory, Survey, survey
from trailmark.exploration.visible_area import evaluate
from trailmark.planning import LandmarkPlanner
from trailmark.planning.escape import way_out
from trailmark.planning.result import PlanProgress
from trailmark.se2 import FloatArray, configurations, difference
from trailmark.shapes import Disc
from trailmark.trajectories.path import Path
from trailmark.world import Robot, World
from trailmark.world.goals import Goal

__all__ = ["Explorer", "Phase"]

SILENCE = 5.0  # Seconds of the robot's clock without a reading after which the sensor is silent.
# Commands in a row that a robot does not carry out because something is in its way, and that lead it nowhere although
# it does not say so, before it is stuck.
MAX_BLOCKED, MAX_STILL = 5, 50
STILL = 0.01  # Metres, and radians, that it moves at least unless it stays where it is.
SEEN = 0.95  # Share of what a landmark was chosen for that, once it has been seen, makes driving on to it pointless.
# Share of the sensor's range that is driven at least before that is asked: near a frontier each reading sees most.
LEAST_DRIVE = 0.2
ON_PATH = 2e-3  # Metres that a robot may be beside its path in any case: rounding, and rows of a car's curves.
# Seconds of computing after which a way is good enough, if one has been found that is about as long as the cells tell;
# and after which any is, and none is looked for any longer where it is not certain that there is one.
PATIENCE, LONGEST = 0.05, 0.2
# Times as long as the cells tell that such a way is at most, but for turns: a first one may be ten times as long.
DETOUR = 1.1
GAP = 0.02  # Share by which a way may be longer than the shortest.
DOUBTFUL = 3  # Landmarks in a row to which no way was found, from which on the robot drives back to where it came from.


class Phase(Enum):
    """What an explorer does with the next reading."""

    CHOOSE = "choose"  # Choose a landmark, and plan to it; the robot stands meanwhile.
    FOLLOW = "follow"  # Follow the path, or plan anew where it is blocked or has become pointless.
    OVER = "over"


@dataclass
class State:
    """Where an exploration stands, beside the map."""

    stood: FloatArray  # Where the robot was last when it had moved, shape (3,).
    phase: Phase = Phase.CHOOSE
    ended: tuple[Status, str] | None = None  # Why it is over, in a word and in a sentence.
    follower: PathFollower | None = None  # Of the path to the landmark.
    expected: Cells | None = None  # The unknown cells that the landmark is to show; None on the way home or back.
    began: float | None = None  # By the robot's clock, which need not begin at 0.
    time: float = 0.0
    last_reading: float = 0.0
    distance: float = 0.0  # Metres driven, by odometry; ``moved`` since the last reading, ``since`` the last choice.
    moved: float = 0.0
    since: float = 0.0
    landmarks: int = 0
    blocked: int = 0  # Commands in a row that were not carried out; ``still``: that led nowhere.
    still: int = 0
    events: list[str] = field(default_factory=list)  # Of this step.
    seconds: float = 0.0
    decisions: list[float] = field(default_factory=list)


class Explorer:
    """Explores: a robot without a map drives from landmark to landmark until nothing more can be seen.

    At each reading the mapper brings pose and map up to date. When the robot has come to its landmark, or has seen what
    it was chosen for, the planner's world follows the map (:meth:`LandmarkPlanner.update`), the free space is clustered
    anew, the strategy chooses the next landmark, and the way there is planned while the robot stands. Paths lead
    through what is known to be free alone, and are certified.

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
        cell = self.settings.cell_side(self.robot, bounds)
        described = _sensor_of(sensor, sensor_range, cell, bounds)
        if world is None:
            self._driver: ExploringRobot = world_or_robot  # type: ignore[assignment]  # no world, so it is a robot
        else:
            _check_visible(world, described)
            simulated = SimulatedRobot(world, self.robot, self.start, described, noise=noise, seed=self.seed)
            self._driver, described = simulated, simulated.sensor
        self.name = "exploration" if world is None else world.name
        known = KnownMap(bounds, cell)
        if isinstance(described, Detector):
            radii = {i: s.radius for i, s in enumerate(world.obstacles) if isinstance(s, Disc)} if world else None
            self.mapper: Mapper = DetectionMapper(self.start, known, described, self.robot, self.settings, radii)
        else:
            self.mapper = ScanMapper(self.start, known, described, self.robot, self.settings)
        self.sensor_range = described.max_range
        self._sees_around = described.field_of_view >= 2.0 * np.pi - 1e-9
        self._choose, self._rng = choose, np.random.default_rng(self.seed)
        # A path that touches something is none for a robot that may be beside it.
        clearance = max(self.mapper.margin, ON_PATH)
        unknown = known.follow(World(self.name, known.bounds, robot=self.robot))
        self.planner = LandmarkPlanner(unknown, self.robot, seed=self.seed, clearance=clearance)
        self._memory, self._state = Memory.of(known), State(self.start)
        self._history: list[ExplorationProgress] = []
        self._first_known = np.full(known.state.shape, np.inf, dtype=np.float32)
        self._revision = -1
        if resumed is not None:
            self._resume(resumed)

    @property
    def ended(self) -> tuple[Status, str] | None:
        """Why the exploration is over, in a word and in a sentence; None while it is not."""
        return self._state.ended

    @property
    def history(self) -> Sequence[ExplorationProgress]:
        """One entry for each step so far."""
        return self._history

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
                while self.ended is None:
                    progress = self.step()
                    if interrupted() and self.ended is None:
                        self._end("interrupted", "interrupted")
                    if on_progress is not None:
                        on_progress(progress)
            except KeyboardInterrupt:  # a caller's function raised it, or Ctrl-C was pressed twice
                self._end("interrupted", "interrupted")
        return self.result()

    def step(self) -> ExplorationProgress:
        """Sense once; then follow the path for one period, or choose where to go and plan."""
        begin, state = perf_counter(), self._state
        belief, driven = self._sense(), False
        state.events = list(belief.refused)
        if self.ended is None and belief.lost:
            state.events.append("lost: the readings do not fit the map here")
            if self.mapper.relocate():
                state.events.append("found again in the map")
                self._stop_following()
            else:
                self._end("stuck", "the robot is lost: its readings fit the map nowhere")
        if belief.readings:
            if state.phase is Phase.FOLLOW:
                self._follow_on(belief.redrawn)
            if state.phase is Phase.CHOOSE:
                self._timed(self._choose_next)
            state.moved, driven = 0.0, state.phase is Phase.FOLLOW
            if driven:
                self._drive()
        if self.ended is None and not driven:
            self._driver.drive(np.zeros((1, 3)), self.settings.sense_period)
            state.time += self.settings.sense_period
        self._history.append(self._progress())
        state.seconds += perf_counter() - begin
        return self._history[-1]

    def result(self) -> ExplorationResult:
        """Return what was found so far; building the final map takes a while."""
        status, reason = self.ended or ("interrupted", "not over")
        saved, known, evaluation = self.saved(), self.mapper.known, None
        log = self.mapper.finished_log(saved.log)
        read = any(isinstance(record, Scan | Detection) for record in saved.log.records)
        if isinstance(self._driver, SimulatedRobot):
            evaluation = evaluate(self._driver, known, self.mapper.trajectory, self.mapper.covariances)
        return ExplorationResult(
            **{**vars(saved), "log": log},
            status=status,
            reason=reason,
            world=self.mapper.finished_map(log) if read else World(self.name, known.bounds, robot=self.robot),
            known=known,
            roadmap=self._current_planner().roadmap,
            strategy=self.strategy,
            seed=self.seed,
            settings=self.settings,
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
        return SavedExploration(
            log=self.log(),
            history=tuple(self._history),
            first_known=self._first_known.copy(),
            contacts=self.mapper.known.contacts,
            robot_state=self._driver.state() if isinstance(self._driver, SimulatedRobot) else None,
            seconds=self._state.seconds,
            decisions=np.array(self._state.decisions),
        )

    def _resume(self, saved: SavedExploration) -> None:
        """Take over what was recorded and found before."""
        if saved.first_known.shape != self._first_known.shape:
            shapes = f"{self._first_known.shape} cells, got {saved.first_known.shape}"
            raise ConfigurationError(f"resume: expected a map of {shapes}")
        for records in _readings(saved.log.records):
            self.mapper.take(records)
        self.mapper.known.add_contact(saved.contacts)
        self._history, last = list(saved.history), saved.history[-1]
        self._first_known = saved.first_known.copy()
        self._state = State(
            self.mapper.pose,
            began=saved.log.records[0].t,
            time=last.time,
            last_reading=last.time,
            distance=last.distance,
            landmarks=last.landmarks,
            seconds=saved.seconds,
            decisions=saved.decisions.tolist(),
        )
        if isinstance(self._driver, SimulatedRobot) and saved.robot_state is not None:
            self._driver.restore(saved.robot_state)

    def _end(self, status: Status, reason: str) -> None:
        self._stop_following()
        self._state.phase, self._state.ended = Phase.OVER, (status, reason)

    def _stop_following(self) -> None:
        self._state.phase, self._state.follower, self._state.expected = Phase.CHOOSE, None, None

    def _timed(self, decide: Callable[[], None]) -> None:
        """Decide, and keep how long it takes; the proof that ends all is no decision."""
        begin = perf_counter()
        decide()
        if self.ended is None:
            self._state.decisions.append(perf_counter() - begin)

    def _sense(self) -> Belief:
        """Take in what was sensed; end where the sensor is silent or a limit is reached."""
        s, state = self.settings, self._state
        records: tuple[Record, ...] = each_of(self._driver.sense(), get_args(Record), "sense")
        belief = self.mapper.take(records)
        if times := [record.t for record in records if np.isfinite(record.t)]:
            if state.began is None:
                state.began = state.last_reading = min(times)
            state.time = max(state.time, *times)
        if belief.readings:
            state.last_reading = state.time
        if state.time - state.last_reading >= SILENCE:
            heard = any(isinstance(record, Scan | Detection) for record in records)
            what = "its readings cannot be used" if heard else "no reading"
            self._end("silent", f"{what} for {state.time - state.last_reading:.1f} s")
        elif state.time - (state.began or 0.0) >= s.time_limit:
            self._end("time", f"the time limit of {s.time_limit:g} s is used up")
        elif state.distance >= s.distance_limit:
            self._end("distance", f"the distance limit of {s.distance_limit:g} m is used up")
        return belief

    @property
    def _tolerance(self) -> float:
        """Metres that the robot may be beside its path."""
        return max(0.5 * self.mapper.margin, ON_PATH)

    def _current_planner(self) -> LandmarkPlanner:
        """Return the planner, its world as the map is."""
        if (world := self.mapper.known.follow(self.planner.world)) is not self.planner.world:
            self.planner.update(world)
        return self.planner

    def _follow_on(self, redrawn: bool) -> None:
        """See to it that the path is still one to follow, or that another is chosen."""
        state, known = self._state, self.mapper.known
        follower = state.follower
        assert follower is not None  # noqa: S101 # in this phase
        state.since += state.moved
        strays = follower.advance(self.mapper.pose, state.moved) > self._tolerance or follower.endangered(known)
        driven = state.expected is not None and state.since >= LEAST_DRIVE * self.sensor_range
        seen = known.state[state.expected] != UNKNOWN if driven else np.zeros(0, np.bool_)
        if state.blocked:
            self._back_off(follower)
        elif seen.size and seen.mean() >= SEEN:
            state.phase = Phase.CHOOSE
        elif redrawn or strays:
            self._timed(self._replan)

    def _choose_next(self) -> None:
        """Choose the next landmark and plan the way there, or end."""
        state, memory, planner = self._state, self._memory, self._current_planner()
        escape = self._way_out(self.mapper.pose)
        here = escape[-1]
        if not planner.checker.valid(here):
            self._end("stuck", "the map has no room for the robot where it stands, and no way out was found")
            return
        # A sensor that does not see all around has done so where a path, with the turn at its end, was driven.
        looked = self._sees_around or (state.follower is None and state.expected is not None)
        self._stop_following()
        found = survey(
            self.mapper.known,
            planner.checker,
            here,
            self.start if self.settings.return_home else None,
            self.sensor_range,
            self._rng,
            memory,
            self.mapper.trajectory[:, 1:],
            sees_around=self._sees_around,
            looked_around=looked,
        )
        if not len(found.outlook.landmarks):
            self._finish(found, here, escape)
            return
        index = choice_of(self._choose, found.outlook)
        landmark, any_heading = found.outlook.landmarks[index], bool(found.any_heading[index])
        goal = Goal(pose=tuple(landmark[: 2 if any_heading else 3].tolist()))
        about = DETOUR * float(found.outlook.costs[index]) + (0.5 * np.pi if self.robot.heading_matters else 0.0)
        path, proven = self._way(here, goal, about, math.inf if any_heading else LONGEST)
        reason = "that there is none is proven" if proven else "none was found in time"
        if path is not None and not (self.robot.reverse or self._comes_back(path.states[-1])):
            reason = "no way back from there was found, and the robot does not drive backwards"
        elif path is not None:
            self._begin(path, escape, turn=not self._sees_around)
            memory.failed, memory.aim = 0, (landmark[:2], found.expected[index])
            state.since, state.expected, state.landmarks = 0.0, found.expected[index], state.landmarks + 1
            return
        memory.refuse(self.mapper.known, landmark, proven and any_heading)
        state.events.append(f"no path to a landmark: {reason}")
        if memory.failed >= DOUBTFUL:
            self._leave()

    def _way(self, here: FloatArray, goal: Goal, about: float, longest: float = math.inf) -> tuple[Path | None, bool]:
        """Return a way that is about the shortest, or the best found in time, and whether it is proven that none leads.

        One that costs no more than about as much is good enough after PATIENCE, any after LONGEST; where none is found
        it is looked for no more after ``longest`` seconds of computing.
        """
        best, begin = math.inf, thread_time()

        def note(progress: PlanProgress) -> None:
            nonlocal best
            best = best if progress.cost is None else progress.cost

        def stop() -> bool:
            enough = PATIENCE if best <= about else LONGEST if best < math.inf else longest
            return thread_time() - begin > enough

        result = self.planner.plan(here, goal, self.settings.planning_time, gap=GAP, stop=stop, on_progress=note)
        return result.path, result.status == "infeasible"

    def _comes_back(self, end: FloatArray) -> bool:
        """Return whether a way is found from a place to where there is most room of where the robot was."""
        known, reach = self.mapper.known, self._memory.reach
        assert reach is not None  # noqa: S101 # surveyed before
        main, driven = reach.main_room(), self.mapper.trajectory[:, 1:]
        there = driven[main[known.cells_of(driven[:, :2])]]
        row, column = known.cells_of(end[None, :2])
        if not len(there) or main[row[0], column[0]]:
            return True
        nearest = there[np.argmin(np.hypot(*(there - end)[:, :2].T))]
        goal = known.centres(*known.cells_of(nearest[None, :2]))[0]  # with room for any heading
        return self._way(end, Goal(pose=tuple(goal.tolist())), math.inf)[0] is not None

    def _finish(self, found: Survey, here: FloatArray, escape: FloatArray) -> None:
        """End, with the proof that all has been seen or without; before that, go back or home if there is need."""
        known, memory = self.mapper.known, self._memory
        if memory.refused.any() and self._leave():
            return
        if found.doubts is not None and self._state.blocked:
            self._end("stuck", "something that is not in the map is in the robot's way, and no way around it was found")
            return
        status: Status = "complete" if found.doubts is None else "complete-at-confidence"
        reason = "everything has been seen that can be seen from where the robot can get to"
        if found.doubts is not None:
            x, y = found.doubts
            room = f" and {2.0 * self.mapper.margin:.3g} m to be safe" if self.mapper.margin > 0.0 else ""
            reason += (
                f", but perhaps not what is in sight near ({x:.2f}, {y:.2f}): a passage leads there that is narrower "
                f"than the robot and two cells of {known.cell:.3g} m{room}, or to which no way was found; a smaller "
                "--cell tells more"
            )
        target = self._way_out(self.start)[-1]
        if not self.settings.return_home or np.hypot(*(here - target)[:2]) <= self._tolerance:
            self._end(status, reason)
            return
        home = None
        if self.planner.checker.valid(target):
            home = self.planner.plan(here, target, self.settings.planning_time, gap=0.05).path
        if home is None:
            self._end("stuck", f"{reason}; no path home was found")
            return
        self._begin(home, escape)
        self._state.events.append("drives home")

    def _begin(self, path: Path, escape: FloatArray, turn: bool = False) -> None:
        """Begin a path, after the way out of contact that leads to its first state; with a turn at its end."""
        if turn:
            path = turned_around(path, self.planner.checker)
        if len(escape) > 1:
            path = Path(np.concatenate([escape[:-1], path.states]))
        follower = PathFollower(path, self.planner.robot, self.planner.checker.footprint)
        follower.endangered(self.mapper.known)
        self._state.phase, self._state.follower = Phase.FOLLOW, follower

    def _replan(self) -> None:
        """Lead the path around what has come into its way, or give it up."""
        state, planner, pose = self._state, self._current_planner(), self.mapper.pose
        follower = state.follower
        assert follower is not None  # noqa: S101 # of the path that is followed
        seconds = self.settings.planning_time
        result = planner.replan(pose, follower.target, follower.path, seconds, escape=True)
        if result.path is None:
            if self._memory.reach is not None:
                self._memory.refuse(self.mapper.known, follower.target, certainly=False)
            self._stop_following()
            state.events.append(f"path given up: {result.reason}")
            return
        self._begin(result.path, pose[None], turn=not (self._sees_around or result.kept or state.expected is None))
        if not result.kept:
            state.events.append(f"path replanned: {result.reason}")

    def _back_off(self, follower: PathFollower) -> None:
        """Mark what the robot ran into, and begin the way back, along which it came."""
        known, robot, poses = self.mapper.known, self.planner.robot, self.mapper.trajectory[:, 1:]
        self._stop_following()
        points = contact_points(robot, np.vstack([self.mapper.pose, follower.rest]), known.cell)
        if not len(points):
            return  # it is as good as at the path's end: the next one tells where something stands
        if not known.add_contact(points):
            self._end("stuck", "the robot runs into what it ran into before, whichever way it goes")
            return
        away = BACK * robot.circumradius + 2.0 * known.cell + self.mapper.margin
        self._begin(Path(way_back(poses, away, robot.circumradius)), self.mapper.pose[None])
        self._state.events.append("ran into something that is not in the map: it is marked, and the robot backs off")

    def _leave(self) -> bool:
        """Begin the way back, along which the robot came, out of a place in which the map closes it in; if so, True."""
        memory, planner = self._memory, self.planner
        assert memory.reach is not None  # noqa: S101 # surveyed before
        if planner.checker.valid(self.mapper.pose) and self._comes_back(self.mapper.pose):
            return False
        driven = self.mapper.trajectory[:, 1:]
        back = way_back_to(memory.reach.main_room(), driven, self.mapper.known, planner.robot)
        if back is None:
            return False
        memory.refused[:] = memory.failed = 0  # the robot stood where no way leads out
        self._begin(back, self.mapper.pose[None])
        self._state.events.append("it drives back the way that it came")
        return True

    def _way_out(self, pose: FloatArray) -> FloatArray:
        """Return states from a pose to a valid one, shape (n, 3); the pose alone if it is valid, or no way is found."""
        checker = self.planner.checker
        out = None if checker.valid(pose) else way_out(checker, pose)
        return pose[None] if out is None else out

    def _drive(self) -> None:
        """Drive on along the path for one period."""
        state, pose = self._state, self.mapper.pose
        assert state.follower is not None  # noqa: S101 # in this phase
        states = state.follower.command(pose)
        off = np.abs(difference(state.stood, pose))
        state.still += 1
        if max(np.hypot(*off[:2]), off[2]) >= STILL:
            state.still, state.stood = 0, pose
        report = one_of(self._driver.drive(states, self.settings.sense_period), DriveReport, "drive:")
        state.moved += report.distance
        state.distance += report.distance
        state.blocked = state.blocked + 1 if report.blocked else 0
        if state.blocked >= MAX_BLOCKED:
            self._end("stuck", "something that is not in the map is in the robot's way")
        elif state.still >= MAX_STILL:
            self._end("stuck", f"the robot stays where it is, {MAX_STILL} commands in a row")
        elif report.arrived:
            state.phase, state.follower = Phase.CHOOSE, None

    def _progress(self) -> ExplorationProgress:
        known, state = self.mapper.known, self._state
        if known.revision != self._revision:
            self._revision = known.revision
            self._first_known[(known.state != UNKNOWN) & np.isinf(self._first_known)] = state.time
        return ExplorationProgress(
            time=state.time,
            distance=state.distance,
            area=float((known.state != UNKNOWN).sum()) * known.cell**2,
            landmarks=state.landmarks,
            sigma=float(np.sqrt(max(0.0, np.linalg.eigvalsh(self.mapper.covariance[:2, :2])[-1]))),
            pose=self.mapper.pose.copy(),
            target=None if state.follower is None else state.follower.target,
            path=None if state.follower is None else state.follower.rest,
            event="; ".join([*state.events, *([] if state.ended is None else [state.ended[1]])]),
        )


@contextmanager
def postponed_interrupts() -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether Ctrl-C was pressed, which interrupts nothing; a second one does as before.

    An interrupt between any two lines would leave the map and the planner's world at odds. In threads other than the
    main one, which Ctrl-C never interrupts, the function always says no.
    """
    received = list[int]()
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    # SIGTERM likewise where somebody made an exception of it, as the shell command does; else it ends the process.
    before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    handlers = {n: handler for n, handler in before.items() if callable(handler)}

    def receive(number: int, frame: FrameType | None) -> None:
        received.append(number)
        if len(received) > 1:
            handlers[signal.Signals(number)](number, frame)

    for number in handlers:
        signal.signal(number, receive)
    try:
        yield lambda: bool(received)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


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


def _sensor_of(
    sensor: object, sensor_range: float, cell: float, bounds: tuple[float, float, float, float]
) -> Scanner | Detector:
    """Return a sensor's description; its range ends where all that is to be explored does."""
    if sensor == "laser":
        sensor = laser_scanner(sensor_range, cell)
    elif sensor == "detections":
        sensor = disc_detector(sensor_range)
    if not isinstance(sensor, Scanner | Detector):
        raise ConfigurationError(f"sensor: expected laser, detections, a Scanner or a Detector, got {brief(sensor)}")
    return replace(sensor, max_range=min(sensor.max_range, math.dist(bounds[:2], bounds[2:])))


def _check_visible(world: World, sensor: Scanner | Detector) -> None:
    """Raise if there are obstacles that a sensor never sees."""
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
