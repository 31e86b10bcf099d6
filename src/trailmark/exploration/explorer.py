"""The loop of an exploration: sense, update the map, then follow a path, or choose a landmark and plan."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
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
from trailmark.planning.result import PlanProgress, PlanResult
from trailmark.se2 import FloatArray, configurations, difference
from trailmark.shapes import Disc
from trailmark.trajectories.path import Path
from trailmark.world import Robot, World
from trailmark.world.goals import Goal

__all__ = ["Explorer", "Phase", "check_visible", "mapper_for", "sensor_of"]

SILENCE = 5.0
"""Seconds of the robot's clock without a reading after which the sensor is silent."""

MAX_BLOCKED = 5
"""Commands in a row that a robot does not carry out because something is in its way, before it is stuck."""

MAX_STILL = 50
"""Commands in a row that lead a robot nowhere, although it does not say that something is in its way."""

STILL = 0.01
"""Metres, and radians, that it moves at least unless it stays where it is."""

SEEN = 0.95
"""Share of what a landmark was chosen for that, once it has been seen, makes driving on to it pointless."""

LEAST_DRIVE = 0.2
"""Share of the sensor's range that is driven at least before that is asked: near a frontier each reading sees most."""

ON_PATH = 2e-3
"""Metres that a robot may be beside its path in any case: rounding, and rows of a car's curves."""

FIRST = 0.15
"""Of the planning time, where it is not certain that there is a way; twice as long after each landmark in a row to
which none was found, up to all of it."""

PATIENCE, LONGEST = 0.05, 0.2
"""Seconds of computing after which a way is good enough, if one has been found that is about as long as the cells tell;
and after which any is."""

SEARCH = 0.2
"""Likewise after which none is looked for any longer, where it is not certain that there is one."""

DETOUR = 1.1
"""Times as long as the cells tell that such a way is at most, but for turns: a first one may be ten times as long."""

GAP = 0.02
"""Share by which a way may be longer than the shortest."""

DOUBTFUL = 3
"""Landmarks in a row to which no way was found, from which on the robot drives back to where it came from."""


class Phase(Enum):
    """What an explorer does with the next reading."""

    CHOOSE = "choose"
    """Choose a landmark, and plan to it; the robot stands meanwhile."""
    FOLLOW = "follow"
    """Follow the path, or plan anew where it is blocked or has become pointless."""
    OVER = "over"


@dataclass
class State:
    """Where an exploration stands, beside the map."""

    stood: FloatArray
    """Where the robot was last when it had moved, shape (3,)."""
    phase: Phase = Phase.CHOOSE
    ended: tuple[Status, str] | None = None
    """Why it is over, in a word and in a sentence."""
    follower: PathFollower | None = None
    """Of the path to the landmark."""
    expected: Cells | None = None
    """The unknown cells that the landmark is to show; None on the way home or back."""
    began: float | None = None
    """By the robot's clock, which need not begin at 0."""
    time: float = 0.0
    last_reading: float = 0.0
    distance: float = 0.0
    """Metres driven, by odometry; ``moved`` since the last reading, ``since`` the last choice."""
    moved: float = 0.0
    since: float = 0.0
    landmarks: int = 0
    blocked: int = 0
    """Commands in a row that were not carried out; ``still``: that led nowhere."""
    still: int = 0
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
        described = sensor_of(sensor, sensor_range, self.settings.cell_side(self.robot, bounds), bounds)
        if world is None:
            self._driver: ExploringRobot = world_or_robot  # type: ignore[assignment]  # no world, so it is a robot
        else:
            check_visible(world, described)
            simulated = SimulatedRobot(world, self.robot, self.start, described, noise=noise, seed=self.seed)
            self._driver, described = simulated, simulated.sensor
        self.name = "exploration" if world is None else world.name
        radii = {i: s.radius for i, s in enumerate(world.obstacles) if isinstance(s, Disc)} if world else None
        self.mapper: Mapper = mapper_for(described, self.robot, self.start, bounds, self.settings, radii)
        self.sensor_range = described.max_range
        self._sees_around = described.field_of_view >= 2.0 * np.pi - 1e-9
        self._choose, self._rng = choose, np.random.default_rng(self.seed)
        known = self.mapper.known
        # A path that touches something is none for a robot that may be beside it.
        clearance = max(self.mapper.margin, ON_PATH)
        unknown = known.follow(World(self.name, known.bounds, robot=self.robot))
        self.planner = LandmarkPlanner(unknown, self.robot, seed=self.seed, clearance=clearance)
        self._memory, self._state = Memory.of(known), State(self.start)
        self._belief = Belief(self.start, np.zeros((3, 3)), 0, (), False, False)
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
        belief = self._sense()
        events = list(belief.refused)
        if state.phase is not Phase.OVER and belief.lost:
            events.append("lost: the readings do not fit the map here")
            if self.mapper.relocate():
                events.append("found again in the map")
                self._stop_following()
            else:
                self._end("stuck", "the robot is lost: its readings fit the map nowhere")
        driven = False
        if belief.readings:
            if state.phase is Phase.FOLLOW:
                events += self._follow_on(belief.redrawn)
            if state.phase is Phase.CHOOSE:
                events += self._timed(self._choose_next)
            state.moved = 0.0
            if state.phase is Phase.FOLLOW:
                self._drive()
                driven = True
        self._note_known()
        if state.phase is not Phase.OVER and not driven:
            self._driver.drive(np.zeros((1, 3)), self.settings.sense_period)
            state.time += self.settings.sense_period
        progress = self._progress("; ".join(events))
        self._history.append(progress)
        state.seconds += perf_counter() - begin
        return progress

    def result(self) -> ExplorationResult:
        """Return what was found so far; building the final map takes a while."""
        status, reason = self.ended or ("interrupted", "not over")
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
            roadmap=self._current_planner().roadmap,
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
        driver = self._driver.state() if isinstance(self._driver, SimulatedRobot) else None
        decisions = np.array(self._state.decisions)
        found = self.log(), tuple(self._history), self._first_known.copy(), self.mapper.known.contacts
        return SavedExploration(*found, driver, self._state.seconds, decisions, {})

    def _resume(self, saved: SavedExploration) -> None:
        """Take over what was recorded and found before."""
        if saved.first_known.shape != self._first_known.shape:
            shapes = f"{self._first_known.shape} cells, got {saved.first_known.shape}"
            raise ConfigurationError(f"resume: expected a map of {shapes}")
        for records in _readings(saved.log.records):
            self._belief = self.mapper.take(records)
        self.mapper.known.add_contact(saved.contacts)
        self._history, last = list(saved.history), saved.history[-1]
        self._first_known = saved.first_known.copy()
        self._state = State(
            self._belief.pose,
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

    def _timed(self, decide: Callable[[], list[str]]) -> list[str]:
        """Return what happens in a decision, and keep how long it takes; the proof that ends all is none."""
        begin = perf_counter()
        events = decide()
        if self.ended is None:
            self._state.decisions.append(perf_counter() - begin)
        return events

    def _sense(self) -> Belief:
        """Take in what was sensed; end where the sensor is silent or a limit is reached."""
        s, state = self.settings, self._state
        records: tuple[Record, ...] = each_of(self._driver.sense(), get_args(Record), "sense")
        self._belief = self.mapper.take(records)
        if times := [record.t for record in records if np.isfinite(record.t)]:
            if state.began is None:
                state.began = state.last_reading = min(times)
            state.time = max(state.time, *times)
        if self._belief.readings:
            state.last_reading = state.time
        elif state.time - state.last_reading >= SILENCE:
            heard = any(isinstance(record, Scan | Detection) for record in records)
            what = "its readings cannot be used" if heard else "no reading"
            self._end("silent", f"{what} for {state.time - state.last_reading:.1f} s")
        if state.phase is not Phase.OVER and state.time - (state.began or 0.0) >= s.time_limit:
            self._end("time", f"the time limit of {s.time_limit:g} s is used up")
        if state.phase is not Phase.OVER and state.distance >= s.distance_limit:
            self._end("distance", f"the distance limit of {s.distance_limit:g} m is used up")
        return self._belief

    def _note_known(self) -> None:
        """Take note of when each cell was known first."""
        known = self.mapper.known
        if known.revision != self._revision:
            self._revision = known.revision
            new = (known.state != UNKNOWN) & np.isinf(self._first_known)
            self._first_known[new] = self._state.time

    @property
    def _tolerance(self) -> float:
        """Metres that the robot may be beside its path."""
        return max(0.5 * self.mapper.margin, ON_PATH)

    def _current_planner(self) -> LandmarkPlanner:
        """Return the planner, its world as the map is."""
        if (world := self.mapper.known.follow(self.planner.world)) is not self.planner.world:
            self.planner.update(world)
        return self.planner

    def _follow_on(self, redrawn: bool) -> list[str]:
        """See to it that the path is still one to follow, or that another is chosen."""
        state, known = self._state, self.mapper.known
        follower = state.follower
        assert follower is not None  # noqa: S101 # in this phase
        state.since += state.moved
        strays = follower.advance(self.mapper.pose, state.moved) > self._tolerance or follower.endangered(known)
        if state.blocked:
            return self._back_off(follower)
        if state.expected is not None and state.since >= LEAST_DRIVE * self.sensor_range:
            seen = known.state[state.expected] != UNKNOWN
            if seen.size and seen.mean() >= SEEN:
                state.phase = Phase.CHOOSE
                return []
        return self._timed(self._replan) if redrawn or strays else []

    def _choose_next(self) -> list[str]:
        """Choose the next landmark and plan the way there, or end."""
        state, memory, planner = self._state, self._memory, self._current_planner()
        escape = self._way_out(self.mapper.pose)
        here = escape[-1]
        if not planner.checker.valid(here):
            self._end("stuck", "the map has no room for the robot where it stands, and no way out was found")
            return []
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
            return self._finish(found, here, escape)
        index = choice_of(self._choose, found.outlook)
        landmark, any_heading = found.outlook.landmarks[index], bool(found.any_heading[index])
        share = 1.0 if any_heading else min(FIRST * 2**memory.failed, 1.0)
        goal = Goal(pose=tuple(landmark[: 2 if any_heading else 3].tolist()))
        about = DETOUR * float(found.outlook.costs[index]) + (0.5 * np.pi if self.robot.heading_matters else 0.0)
        longest = math.inf if any_heading else SEARCH
        result = self._way(here, goal, share * self.settings.planning_time, about, longest)
        reason = "that there is none is proven" if result.status == "infeasible" else "none was found in time"
        if result.path is not None and not (self.robot.reverse or self._comes_back(result.path.states[-1])):
            reason = "no way back from there was found, and the robot does not drive backwards"
        elif result.path is not None:
            self._begin(result.path, escape, turn=not self._sees_around)
            memory.failed, memory.aim = 0, (landmark[:2], found.expected[index])
            state.since, state.expected, state.landmarks = 0.0, found.expected[index], state.landmarks + 1
            return []
        memory.refuse(self.mapper.known, landmark, result.status == "infeasible" and any_heading)
        return [f"no path to a landmark: {reason}", *(self._leave() if memory.failed >= DOUBTFUL else [])]

    def _way(self, here: FloatArray, goal: Goal, seconds: float, about: float, longest: float = math.inf) -> PlanResult:
        """Return a way that is about the shortest, or after so many seconds the best that there is, if there is one.

        One that costs no more than about as much is good enough after PATIENCE, any after LONGEST; after so many
        seconds of computing at the longest it is looked for no more.
        """
        best, begin = math.inf, thread_time()

        def note(progress: PlanProgress) -> None:
            nonlocal best
            best = best if progress.cost is None else progress.cost

        def stop() -> bool:
            enough = PATIENCE if best <= about else LONGEST if best < math.inf else longest
            return thread_time() - begin > enough

        return self.planner.plan(here, goal, seconds, gap=GAP, stop=stop, on_progress=note)

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
        return self._way(end, Goal(pose=tuple(goal.tolist())), self.settings.planning_time, math.inf).path is not None

    def _finish(self, found: Survey, here: FloatArray, escape: FloatArray) -> list[str]:
        """End, with the proof that all has been seen or without; before that, go back or home if there is need."""
        known, memory = self.mapper.known, self._memory
        if memory.refused.any() and (left := self._leave()):
            return left
        if found.doubts is not None and self._state.blocked:
            self._end("stuck", "something that is not in the map is in the robot's way, and no way around it was found")
            return []
        status: Status = "complete" if found.doubts is None else "complete-at-confidence"
        reason = "everything has been seen that can be seen from where the robot can get to"
        if found.doubts is not None:
            x, y = found.doubts
            reason += (
                f", but not through a passage near ({x:.2f}, {y:.2f}) that is narrower than the robot and two cells of "
                f"{known.cell:.3g} m"
                + (f" and {2.0 * self.mapper.margin:.3g} m to be safe" if self.mapper.margin > 0.0 else "")
                + ", or to which no way was found; a smaller --cell tells more"
            )
        target = self._way_out(self.start)[-1]
        if not self.settings.return_home or np.hypot(*(here - target)[:2]) <= self._tolerance:
            self._end(status, reason)
            return []
        home = None
        if self.planner.checker.valid(target):
            home = self.planner.plan(here, target, self.settings.planning_time, gap=0.05).path
        if home is None:
            self._end("stuck", f"{reason}; no path home was found")
            return []
        self._begin(home, escape)
        return ["drives home"]

    def _begin(self, path: Path, escape: FloatArray, turn: bool = False) -> None:
        """Begin a path, after the way out of contact that leads to its first state; with a turn at its end."""
        if turn:
            path = turned_around(path, self.planner.checker)
        if len(escape) > 1:
            path = Path(np.concatenate([escape[:-1], path.states]))
        self._follow(PathFollower(path, self.planner.robot, self.planner.checker.footprint))

    def _follow(self, follower: PathFollower) -> None:
        follower.endangered(self.mapper.known)
        self._state.phase, self._state.follower = Phase.FOLLOW, follower

    def _replan(self) -> list[str]:
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
            return [f"path given up: {result.reason}"]
        self._begin(result.path, pose[None], turn=not (self._sees_around or result.kept or state.expected is None))
        return [] if result.kept else [f"path replanned: {result.reason}"]

    def _back_off(self, follower: PathFollower) -> list[str]:
        """Mark what the robot ran into, and begin the way back, along which it came."""
        known, robot, poses = self.mapper.known, self.planner.robot, self.mapper.trajectory[:, 1:]
        self._stop_following()
        points = contact_points(robot, np.vstack([self.mapper.pose, follower.rest]), known.cell)
        if not len(points):
            return []  # it is as good as at the path's end: the next one tells where something stands
        if not known.add_contact(points):
            self._end("stuck", "the robot runs into what it ran into before, whichever way it goes")
            return []
        away = BACK * robot.circumradius + 2.0 * known.cell + self.mapper.margin
        self._begin(Path(way_back(poses, away, robot.circumradius)), self.mapper.pose[None])
        return ["ran into something that is not in the map: it is marked, and the robot backs off"]

    def _leave(self) -> list[str]:
        """Begin the way back, along which the robot came, out of a place in which the map closes it in."""
        memory, planner = self._memory, self.planner
        assert memory.reach is not None  # noqa: S101 # surveyed before
        if planner.checker.valid(self.mapper.pose) and self._comes_back(self.mapper.pose):
            return []
        driven, footprint = self.mapper.trajectory[:, 1:], planner.checker.footprint
        back = way_back_to(memory.reach.main_room(), driven, self.mapper.known, planner.robot, footprint)
        if back is None:
            return []
        memory.forget_failures()
        self._follow(back)
        return ["it drives back the way that it came"]

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

    def _progress(self, event: str) -> ExplorationProgress:
        known, state = self.mapper.known, self._state
        return ExplorationProgress(
            time=state.time,
            distance=state.distance,
            area=float((known.state != UNKNOWN).sum()) * known.cell**2,
            landmarks=state.landmarks,
            sigma=float(np.sqrt(max(0.0, np.linalg.eigvalsh(self._belief.covariance[:2, :2])[-1]))),
            pose=self.mapper.pose.copy(),
            target=None if state.follower is None else state.follower.target,
            path=None if state.follower is None else state.follower.rest,
            event=event if state.ended is None else "; ".join(filter(None, [event, state.ended[1]])),
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
