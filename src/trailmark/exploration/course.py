"""Where an exploring robot goes: the landmark that was chosen, and the certified path that leads there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.virtual_sensors import Detector, Scanner
from trailmark.exploration.background import Background, Result
from trailmark.exploration.exploration_settings import ExplorationSettings
from trailmark.exploration.following import BACK, PathFollower, contact_points, turned_around, way_back, way_back_to
from trailmark.exploration.known_map import KnownMap
from trailmark.exploration.landmark_ways import plan_to
from trailmark.exploration.mapper import Draw, Mapper
from trailmark.exploration.result import Status
from trailmark.exploration.strategies import Strategy, choice_of
from trailmark.exploration.survey import Memory, Survey, survey
from trailmark.exploration.travel import open_loop, places_of
from trailmark.planning import LandmarkPlanner
from trailmark.planning.escape import way_out
from trailmark.planning.result import PlanResult, ReplanResult
from trailmark.se2 import FloatArray
from trailmark.trajectories import Path
from trailmark.world import Robot, World

__all__ = ["Course", "Divided", "divided", "planner_in"]


SEEN = 0.95
"""Share of what a landmark was chosen for that, once it has been seen, makes driving on to it pointless."""

LEAST_DRIVE = 0.2
"""Share of the sensor's range that is driven at least before that is asked: near a frontier each reading sees most."""

DECISION = 0.1
"""Seconds after which a way that is being looked for is waited for no longer, and no other landmark is chosen, before
the sensor has been read again."""

ON_PATH = 2e-3
"""Metres that a robot may be beside its path in any case: rounding, and rows of a car's curves."""

MAX_FAILED = 100
"""Ways in a row that are not found, or given up before anything is driven, before the robot is stuck: by then each
place has been looked at again and again, and the sensor's noise goes on changing what is known of it."""

MAX_SEARCH = 150.0
"""Planning times that may be spent on them, likewise: the last ones are looked for much longer than the first."""


class Divided(NamedTuple):
    """A map, its cells divided, and what goes with it."""

    known: KnownMap
    planner: LandmarkPlanner
    memory: Memory


def planner_in(known: KnownMap, name: str, robot: Robot, seed: int, clearance: float) -> LandmarkPlanner:
    """Return a planner in a map as it is.

    Args:
        known: the map.
        name: of the planner's world.
        robot: that it plans for.
        seed: of what is drawn.
        clearance: metres that paths keep.
    """
    world = known.follow(World(name, known.bounds, robot=robot))
    return LandmarkPlanner(world, robot, seed=seed, clearance=clearance)


def divided(
    draw: Draw,
    stopped: Callable[[], bool],
    planner: LandmarkPlanner,
    robot: Robot,
    memory: Memory,
    state: NDArray[np.uint8],
) -> Divided:
    """Draw a map of smaller cells, and what goes with it; in any thread, as long as the robot stands.

    Args:
        draw: draws it.
        stopped: asked between scans whether to end early, with part of a map.
        planner: in the map before.
        robot: that it plans for, without the clearance that it keeps.
        memory: of the exploration.
        state: of the cells before, UNKNOWN, FREE or OCCUPIED, shape (rows, columns).
    """
    known = draw(stopped)
    finer = planner_in(known, planner.world.name, robot, planner.seed, planner.robot.clearance)
    remembered = memory.divided(state, known)
    remembered.find_levels(known, finer.robot)
    return Divided(known, finer, remembered)


class Course:
    """The choice of landmarks, and the path that is followed.

    A way that is not found at once is looked for while the robot stands and senses, and so are cells divided.

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
        self._robot, self._since, self._failures = robot, 0.0, 0
        self._revisited = list[FloatArray]()
        # A path that touches something is none for a robot that may be beside it.
        self.planner = planner_in(mapper.known, name, robot, seed, max(mapper.margin, ON_PATH))
        self._background = Background()
        self._known_at_planning = mapper.known  # when the path that is followed was planned

    def update(self, moved: float, redrawn: bool, blocked: bool = False) -> list[str]:
        """See to it that there is a path to follow, as long as any landmark is left; return what happened.

        Args:
            moved: metres driven since the last call.
            redrawn: whether the map was drawn anew.
            blocked: whether the robot ran into something, and stands there.
        """
        self._since += moved
        if moved > 0.0:
            self._failures, self._background.seconds, self._memory.confirmed = 0, 0.0, False
        events = self._go_on(moved, redrawn, blocked)
        closed_in = self._memory.closed_in and not self._background.is_on
        if closed_in or (self.ended is not None and self.ended[0] == "stuck"):
            if (begun := self._divide()) is not None:
                self.ended, events = None, events + begun
            elif closed_in:
                events += self._leave()
        return events

    def _go_on(self, moved: float, redrawn: bool, blocked: bool) -> list[str]:
        """Follow the path, or see to it that there is one; return what happened. See :meth:`update`."""
        follower = self.follower
        if follower is None:
            return self._timed(self._finish if self._background.is_on else self._decide)
        stray = self._strays(follower, moved)
        if blocked:
            return self._back_off(follower)
        if self._expected is not None and self._since >= LEAST_DRIVE * self._range and self._pointless():
            return self._timed(self._decide)
        if redrawn or stray:
            return self._replan(follower, perf_counter() + DECISION)
        return []

    def current_planner(self) -> LandmarkPlanner:
        """Return the planner, its world as the map is."""
        if (world := self._mapper.known.follow(self.planner.world)) is not self.planner.world:
            self.planner.update(world)
        return self.planner

    def refine(self) -> bool:
        """Divide the map's cells at once; return whether that can be done."""
        if (draw := self._mapper.divided()) is None:
            return False
        planner, memory, state = self.planner, self._memory, self._mapper.known.state
        self._go_on_divided(divided(draw, self._background.is_stopped, planner, self._robot, memory, state))
        return True

    def _divide(self) -> list[str] | None:
        """Begin to divide cells, while the robot stands and senses; return what happened, None if they cannot be."""
        if (draw := self._mapper.divided()) is None:
            return None
        self.follower = self._expected = None
        state, memory = self._mapper.known.state.copy(), self._memory
        divide = partial(divided, draw, self._background.is_stopped, self.planner, self._robot, memory, state)
        return self._start_on(divide, self._go_on_divided, perf_counter() + DECISION)

    def _go_on_divided(self, divided: Divided) -> list[str]:
        """Go on in a map of smaller cells."""
        known, self.planner, self._memory = divided
        self._mapper.go_on_with(known)
        self._failures, self._background.seconds = 0, 0.0
        return [f"cells of {known.cell:.3g} m from now on: larger ones do not tell whether the robot fits"]

    @property
    def tolerance(self) -> float:
        """Metres that the robot may be beside its path."""
        return max(0.5 * self._mapper.margin, ON_PATH)

    def stop(self) -> None:
        """Look for no way any longer, once the exploration has ended."""
        self._background.stop()

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
        escape = self._way_out(planner, self._mapper.pose)
        if not planner.checker.valid(here := escape[-1]):
            self.ended = "stuck", "the map has no room for the robot where it stands, and no way out was found"
        home = self._start if s.return_home else None
        events = list[str]()
        # A sensor that does not see all around has done so where a path, with the turn at its end, was driven.
        self._looked_around = self._sees_around or (self.follower is None and self._expected is not None)
        self.follower = self._expected = None
        while not (self.ended or self.follower or self._background.is_on or self._memory.closed_in):
            begin = perf_counter()
            found = survey(
                known,
                planner,
                planner.robot,
                here,
                home,
                self._range,
                self._rng,
                self._memory,
                self._mapper.trajectory[:, 1:] if self._sees_around else None,
                looked_around=self._looked_around,
                visited=places_of(self._mapper.trajectory, self._mapper.covariances),
            )
            if not len(found.outlook.landmarks):
                events += self._end(found, planner, here, escape, until)
                break
            index = choice_of(self._choose, found.outlook)
            plan = partial(plan_to, known, planner, found, index, s, self._memory, self._background.is_stopped)
            events += self._start_on(plan, partial(self._begin, planner, escape, found.expected[index]), until)
            if 2.0 * perf_counter() - begin >= until:
                break  # another one would take too long
        return events

    def _start_on(self, work: Callable[[], Result], then: Callable[[Result], list[str]], until: float) -> list[str]:
        """Do a piece of work beside the sensing, and go on by what comes of it: at once, or after further readings."""
        self._background.begin(work, then)
        self._known_at_planning = self._mapper.known.snapshot()
        return self._finish(until)

    def _finish(self, until: float) -> list[str]:
        """Go on by what comes of the work that is done, if that is known soon."""
        events = [] if (go_on := self._background.outcome(until)) is None else go_on()
        # By what was read meanwhile, if that matters: with noise each reading changes the map somewhere.
        if self.follower and self._strays(self.follower):
            events += self._replan(self.follower, until)
        return events

    def _strays(self, follower: PathFollower, moved: float = 0.0) -> bool:
        """Return whether the robot is off its path, or something came near to that; take note of where the robot is."""
        return follower.advance(self._mapper.pose, moved) > self.tolerance or follower.endangered(self._mapper.known)

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
            return [f"no path to a landmark: {self._memory.refusal}"]
        self._follow(planned.path, escape, planner, turn=not self._sees_around)
        self._since, self._expected, self.landmarks = 0.0, expected, self.landmarks + 1
        return []

    def _count_failure(self) -> None:
        """End where nothing but changes of the map comes of looking for ways."""
        self._failures += 1
        if self._failures >= MAX_FAILED or self._background.seconds >= MAX_SEARCH * self._settings.planning_time:
            tried = f"{self._failures} searches in a row, {self._background.seconds:.1f} s in all"
            self.ended = "stuck", f"no way that could be driven was found in {tried}, while the map went on changing"

    def _end(
        self, found: Survey, planner: LandmarkPlanner, here: FloatArray, escape: FloatArray, until: float
    ) -> list[str]:
        """End; before that, divide cells where larger ones tell less, close loops, and go home if that is asked for."""
        if (found.narrow or found.status == "stuck") and (begun := self._divide()) is not None:
            return begun
        back = open_loop(self._mapper, self._memory.levels, planner.robot, here, self._revisited, self._range)
        target = self._way_out(planner, self._start if back is None else back)[-1]
        if back is not None:
            self._revisited.append(back)
        elif not self._settings.return_home or np.hypot(*(here - target)[:2]) <= self.tolerance:
            self.ended = found.status, found.ended
            return []

        def then(planned: PlanResult | None) -> list[str]:
            if planned is not None and planned.path is not None:
                self._follow(planned.path, escape, planner)
                return [] if back is None else ["drives to where it was before, to close a loop"]
            if back is None:
                self.ended = "stuck", f"{found.ended}; no path home was found"
            return []

        if not planner.checker.valid(target):
            return then(None)
        return self._start_on(partial(planner.plan, here, target, self._settings.planning_time, gap=0.05), then, until)

    def _follow(self, path: Path, escape: FloatArray, planner: LandmarkPlanner, turn: bool = False) -> None:
        """Begin a path, after the way out of contact that leads to its first state; with a turn at its end."""
        if turn:
            path = turned_around(path, planner.checker)
        if len(escape) > 1:
            path = Path(np.concatenate([escape[:-1], path.states]))
        self.follower = PathFollower(path, planner.robot, planner.checker.footprint)
        self.follower.endangered(self._known_at_planning)

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
        return self._start_on(plan, then, until)

    def _back_off(self, follower: PathFollower) -> list[str]:
        """Mark what the robot ran into, and begin the way back, along which it came."""
        known, robot, poses = self._mapper.known, self.planner.robot, self._mapper.trajectory[:, 1:]
        self.follower = self._expected = None
        if not known.add_contact(contact_points(robot, np.vstack([self._mapper.pose, follower.rest]), known.cell)):
            self.ended = "stuck", "the robot runs into what it ran into before, whichever way it goes"
            return []
        self._known_at_planning = known
        away = BACK * robot.circumradius + 2.0 * known.cell + self._mapper.margin
        self._follow(Path(way_back(poses, away, robot.circumradius)), self._mapper.pose[None], self.planner)
        return ["ran into something that is not in the map: it is marked, and the robot backs off"]

    def _leave(self) -> list[str]:
        """Begin the way back, along which the robot came, out of a place in which the map closes it in."""
        memory, mapper, planner = self._memory, self._mapper, self.planner
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

    def _way_out(self, planner: LandmarkPlanner, pose: FloatArray) -> FloatArray:
        """Return states from a pose to a valid one, shape (n, 3); the pose alone if it is valid, or no way is found."""
        out = None if planner.checker.valid(pose) else way_out(planner.checker, pose)
        return pose[None] if out is None else out
