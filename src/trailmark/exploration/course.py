"""Where an exploring robot goes: the landmark that was chosen, and the certified path that leads there."""

# Tested by tests/exploration/test_explorer.py.

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from threading import Event
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.arguments import brief
from trailmark.errors import ConfigurationError
from trailmark.estimation.simulation.virtual_sensors import Detector, Scanner
from trailmark.exploration.certainty import places_of
from trailmark.exploration.contact import contact_points
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.following import PathFollower
from trailmark.exploration.landmark_ways import plan_to
from trailmark.exploration.mapper import Mapper
from trailmark.exploration.outlook import Outlook, Strategy
from trailmark.exploration.result import Status
from trailmark.exploration.survey import Memory, Survey, survey
from trailmark.exploration.way_back import BACK, WayBack, way_back, way_back_to
from trailmark.path import Path
from trailmark.planning import LandmarkPlanner
from trailmark.planning.escape import way_out
from trailmark.planning.result import PlanResult, ReplanResult
from trailmark.se2 import FloatArray, wrap
from trailmark.world import Robot, World

__all__ = ["Course"]

SEEN = 0.8
"""Share of what a landmark was chosen for that, once it has been seen, makes driving on to it pointless."""

LEAST_DRIVE = 0.2
"""Share of the sensor's range that is driven at least before that is asked: near a frontier each reading sees most."""

DECISION = 0.1
"""Seconds after which a way that is being looked for is waited for no longer, and no other landmark is chosen, before
the sensor has been read again."""

WAIT = 0.03
"""Seconds that it is waited for at least: most ways are found sooner, and others are asked for at the next reading."""

ON_PATH = 2e-3
"""Metres that a robot may be beside its path in any case: rounding, and rows of a car's curves."""

MAX_FAILED = 100
"""Ways in a row that are not found, or given up before anything is driven, before the robot is stuck: by then each
place has been looked at again and again, and the sensor's noise goes on changing what is known of it."""

MAX_SEARCH = 150.0
"""Planning times that may be spent on them, likewise: the last ones are looked for much longer than the first."""


class Look(NamedTuple):
    """A way that is being looked for, in a thread beside the sensing."""

    future: Future[PlanResult]
    """Tells what comes of it."""
    then: Callable[[PlanResult], list[str]]
    """To go on with; returns what happened."""
    revision: int
    """Of the map that it is looked for in."""


class Course:
    """The choice of landmarks, and the path that is followed.

    A way that is not found at once is looked for while the robot stands and senses.

    Args:
        mapper: says where the robot is, and what is known.
        robot: footprint and drive.
        start: where it began, shape (3,).
        sensor: of the robot. One that does not see all around is turned around at landmarks.
        strategy: chooses the next landmark.
        settings: of the exploration.
        seed: of what is drawn.
        name: of the planner's world.

    Attributes:
        planner: plans in the map as it was known at the last choice.
        follower: of the path to the landmark; None where there is none.
        landmarks: how many were chosen.
        decisions: seconds of each reading at which a landmark was chosen, or the way to it looked for.
        ended: why there is nowhere to go, in a word and in a sentence; None as long as there is.
    """

    def __init__(
        self,
        mapper: Mapper,
        robot: Robot,
        start: FloatArray,
        sensor: Scanner | Detector,
        strategy: Strategy,
        settings: ExplorationSettings,
        seed: int,
        name: str,
    ) -> None:
        self.follower: PathFollower | None = None
        self.landmarks, self.decisions = 0, list[float]()
        self.ended: tuple[Status, str] | None = None
        self._mapper, self._start, self._range = mapper, start, sensor.max_range
        self._sees_around = self._looked_around = sensor.field_of_view >= 2.0 * np.pi - 1e-9
        self._choose, self._settings = strategy, settings
        self._rng, self._memory = np.random.default_rng(seed), Memory(mapper.known)
        self._expected: tuple[NDArray[np.intp], NDArray[np.intp]] | None = None
        self._since, self._failures, self._searched = 0.0, 0, 0.0
        world = mapper.known.follow(World(name, mapper.known.bounds, robot=robot))
        # A path that touches something is none for a robot that may be beside it.
        self.planner = LandmarkPlanner(world, robot, seed=seed, clearance=max(mapper.margin, ON_PATH))
        self._look: Look | None = None
        self._stopped, self._threads = Event(), ThreadPoolExecutor(1, "looking for a way")

    def update(self, moved: float, redrawn: bool, blocked: bool = False) -> list[str]:
        """See to it that there is a path to follow, as long as any landmark is left; return what happened.

        Args:
            moved: metres driven since the last call.
            redrawn: whether the map was drawn anew.
            blocked: whether the robot ran into something, and stands there.
        """
        follower, known = self.follower, self._mapper.known
        self._since += moved
        if moved > 0.0:
            self._failures, self._searched, self._memory.confirmed = 0, 0.0, False
        if follower is None:
            return self._timed(self._decide if self._look is None else self._looked)
        off = follower.advance(self._mapper.pose, moved)
        if blocked:
            return self._back_off(follower)
        if self._expected is not None and self._since >= LEAST_DRIVE * self._range and self._pointless():
            return self._timed(self._decide)
        if redrawn or off > self.tolerance or follower.endangered(known):
            return self._replan(follower, perf_counter() + DECISION)
        return []

    def current_planner(self) -> LandmarkPlanner:
        """Return the planner, its world as the map is."""
        if (world := self._mapper.known.follow(self.planner.world)) is not self.planner.world:
            self.planner.update(world)
        return self.planner

    @property
    def tolerance(self) -> float:
        """Metres that the robot may be beside its path."""
        return max(0.5 * self._mapper.margin, ON_PATH)

    def stop(self) -> None:
        """Look for no way any longer, once the exploration has ended."""
        self._stopped.set()
        self._threads.shutdown()

    def _timed(self, decide: Callable[[float], list[str]]) -> list[str]:
        """Return what happens in a decision, and keep how long it takes."""
        begin = perf_counter()
        events = decide(begin + DECISION)
        self.decisions.append(perf_counter() - begin)
        return events

    def _decide(self, until: float) -> list[str]:
        """Choose the next landmark and plan to it, or begin to."""
        s = self._settings
        planner, known = self.current_planner(), self._mapper.known
        here, escape = self._free(planner, self._mapper.pose)
        home = self._start if s.return_home else None
        events = list[str]()
        # A sensor that does not see all around has done so where a path, with the turn at its end, was driven.
        self._looked_around = self._sees_around or (self.follower is None and self._expected is not None)
        self.follower = self._expected = None
        while self.ended is None and self.follower is None and self._look is None:
            begin = perf_counter()
            found = survey(
                known,
                planner,
                planner.robot,
                here,
                home,
                self._range,
                s,
                self._rng,
                self._memory,
                self._mapper.trajectory[:, 1:] if self._sees_around else None,
                looked_around=self._looked_around,
                visited=places_of(self._mapper.trajectory, self._mapper.covariances),
            )
            if not len(found.outlook.landmarks):
                events += self._go_home(found, planner, here, escape, until)
                break
            index = self._index(found.outlook)
            plan = partial(plan_to, known, planner, found, index, s, self._memory, self._stopped.is_set)
            events += self._look_for(plan, partial(self._begin, planner, escape, found.expected[index]), until)
            if 2.0 * perf_counter() - begin >= until:
                break  # another one would take too long
        return events

    def _look_for(
        self, plan: Callable[[], PlanResult], then: Callable[[PlanResult], list[str]], until: float
    ) -> list[str]:
        """Look for a way, and go on by what comes of it: at once, or after further readings."""

        def timed() -> PlanResult:
            begin = perf_counter()
            try:
                return plan()
            finally:
                self._searched += perf_counter() - begin

        self._look = Look(self._threads.submit(timed), then, self._mapper.known.revision)
        return self._looked(until)

    def _looked(self, until: float) -> list[str]:
        """Go on by what comes of the way that is being looked for, if that is known soon."""
        look = self._look
        assert look is not None  # noqa: S101 # the caller has looked
        wait([look.future], max(until - perf_counter(), WAIT))
        if not look.future.done():
            return []
        self._look = None
        events = look.then(look.future.result())
        follower = self.follower
        if follower and not isinstance(follower, WayBack) and self._mapper.known.revision != look.revision:
            # It was planned before the last readings.
            events += self._replan(follower, until)
        return events

    def _begin(
        self,
        planner: LandmarkPlanner,
        escape: FloatArray,
        expected: tuple[NDArray[np.intp], NDArray[np.intp]],
        planned: PlanResult,
    ) -> list[str]:
        """Begin the way to a landmark that was chosen."""
        if planned.path is None:
            self._count_failure()
            return [f"no path to a landmark: {self._memory.refusal}", *self._leave()]
        self._follow(planned.path, escape, planner, turn=not self._sees_around)
        self._since, self._expected, self.landmarks = 0.0, expected, self.landmarks + 1
        return []

    def _count_failure(self) -> None:
        """End where nothing but changes of the map comes of looking for ways."""
        self._failures += 1
        if self._failures >= MAX_FAILED or self._searched >= MAX_SEARCH * self._settings.planning_time:
            tried = f"{self._failures} searches in a row, {self._searched:.1f} s in all"
            self.ended = "stuck", f"no way that could be driven was found in {tried}, while the map went on changing"

    def _index(self, outlook: Outlook) -> int:
        """Return the strategy's choice."""
        index, count = self._choose(outlook), len(outlook.landmarks)
        if not isinstance(index, int | np.integer) or not 0 <= index < count:
            raise ConfigurationError(f"strategy: expected the index of one of {count} landmarks, got {brief(index)}")
        return int(index)

    def _go_home(
        self, found: Survey, planner: LandmarkPlanner, here: FloatArray, escape: FloatArray, until: float
    ) -> list[str]:
        """End, after the way home where that is asked for."""
        target = self._start
        if self._settings.return_home:
            target, _ = self._free(planner, target)
        away = float(np.hypot(*(here - target)[:2]))
        if not self._settings.return_home or away <= self.tolerance:
            self.ended = self.ended or (found.status, found.ended)
            return []

        def then(planned: PlanResult) -> list[str]:
            if planned.path is None:
                self.ended = "stuck", f"{found.ended}; no path home was found"
            else:
                self._follow(planned.path, escape, planner)
            return []

        return self._look_for(partial(planner.plan, here, target, self._settings.planning_time, gap=0.05), then, until)

    def _follow(self, path: Path, escape: FloatArray, planner: LandmarkPlanner, turn: bool = False) -> None:
        """Begin a path, after the way out of contact that leads to its first state; with a turn at its end."""
        if turn:
            turned = np.repeat(path.states[-1:], 5, axis=0)
            turned[:, 2] = wrap(turned[:, 2] + 0.5 * np.pi * np.arange(5))
            if planner.checker.motions_valid(turned[:-1], turned[1:]).all():
                path = Path(np.concatenate([path.states, turned[1:]]))
        if len(escape) > 1:
            path = Path(np.concatenate([escape[:-1], path.states]))
        self.follower = PathFollower(path, planner.robot, planner.checker.footprint)
        self.follower.endangered(self._mapper.known)

    def _replan(self, follower: PathFollower, until: float) -> list[str]:
        """Lead the path around what has come into its way, or give it up."""
        planner, pose = self.current_planner(), self._mapper.pose
        self.follower = None

        def then(result: PlanResult) -> list[str]:
            assert isinstance(result, ReplanResult)  # noqa: S101 # of a replan
            if result.path is None:
                self._count_failure()
                return [f"path given up: {result.reason}"]
            turn = not self._sees_around and not result.kept and self._expected is not None
            self._follow(result.path, pose[None], planner, turn)
            return [] if result.kept else [f"path replanned: {result.reason}"]

        plan = partial(planner.replan, pose, follower.target, follower.path, self._settings.planning_time, escape=True)
        return self._look_for(plan, then, until)

    def _back_off(self, follower: PathFollower) -> list[str]:
        """Mark what the robot ran into, and begin the way back, along which it came."""
        known, robot, poses = self._mapper.known, self.planner.robot, self._mapper.trajectory[:, 1:]
        self.follower = self._expected = None
        if not known.add_contact(contact_points(robot, np.vstack([self._mapper.pose, follower.rest]), known.cell)):
            self.ended = "stuck", "the robot runs into what it ran into before, whichever way it goes"
            return []
        away = BACK * robot.circumradius + 2.0 * known.cell + self._mapper.margin
        self._follow(Path(way_back(poses, away, robot.circumradius)), self._mapper.pose[None], self.planner)
        return ["ran into something that is not in the map: it is marked, and the robot backs off"]

    def _leave(self) -> list[str]:
        """Begin the way back, along which the robot came, out of a place in which the map closes it in."""
        memory, mapper, planner = self._memory, self._mapper, self.planner
        if memory.closed_in:
            memory.closed_in, footprint, driven = False, planner.checker.footprint, mapper.trajectory[:, 1:]
            self.follower = way_back_to(memory.main_room(), driven, mapper.known, planner.robot, footprint)
        if self.follower is None:
            return []
        memory.forget_failures()
        return ["it drives back the way that it came"]

    def _pointless(self) -> bool:
        """Return whether most of what the landmark was chosen for has been seen."""
        assert self._expected is not None  # noqa: S101 # the caller has looked
        rows, columns = self._expected
        return bool(len(rows)) and float((self._mapper.known.state[rows, columns] != 0).mean()) >= SEEN

    def _free(self, planner: LandmarkPlanner, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return a valid configuration, the pose itself if it is one, and the states that lead there from the pose."""
        if planner.checker.valid(pose):
            return pose, pose[None]
        out = way_out(planner.checker, pose)
        if out is None:
            self.ended = "stuck", "the map has no room for the robot where it stands, and no way out was found"
            return pose, pose[None]
        return out[-1], out
