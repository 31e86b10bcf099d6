"""WorldModel: all that a planner keeps about one world: checker, motion, roadmap, relaxed problem, lower bounds."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import replace
from time import perf_counter

import numpy as np
import shapely
from numpy.typing import ArrayLike

from trailmark import se2
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation
from trailmark.motion import motion_of
from trailmark.objective import Objective
from trailmark.planning.followed import Passed
from trailmark.planning.proofs import LowerBound, lower_bound_of
from trailmark.planning.proofs.prover import in_time
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.shared_roadmap import SharedRoadmap
from trailmark.planning.updating import Boxes, Update
from trailmark.planning.verification import Verification
from trailmark.shapes import Disc
from trailmark.world import World, keep_outs
from trailmark.zones import KeepOutZone

__all__ = ["WorldModel", "zones_at"]

PROOF_SHARE = 0.25
"""Of the time left: what making lower bounds ready for many queries may take of it."""


class WorldModel:
    """What queries in one world share. A query uses one model from its beginning to its end.

    Args:
        checker: of the world and the robot.
        rng: source of randomness.
        seed: that it began with, for reports of errors.
        settings: numbers that a person may change.
        landmarks: to be spread over all free space before the first query.
        objective: what paths cost.
        before: the model of a world that differs in its obstacles, and boxes that hold what does, if there is one.

    Attributes:
        checker: as given.
        motion: how the robot moves.
        verification: checks what is about to be returned.
        shared: the roadmap, and the lock of those who let it grow.
        bound: proves lower bounds; what it computes is kept from query to query.
        relaxation: the relaxed problem's grid, kept from query to query.
        revalidated: what became of the roadmap of the world before.
        passed: the path that was returned last, in this world or one that differs in its obstacles; None without one.
    """

    def __init__(
        self,
        checker: StateChecker,
        rng: np.random.Generator,
        seed: int,
        settings: PlannerSettings,
        landmarks: int,
        objective: Objective,
        before: tuple[WorldModel, Boxes] | None = None,
    ) -> None:
        self.checker, self.rng, self.seed, self.settings = checker, rng, seed, settings
        self.objective, self.motion = objective, motion_of(checker, objective=objective)
        self.passed: Passed | None = None
        self._without: tuple[tuple[str, ...], WorldModel] | None = None
        self.verification, self.relaxation = Verification(checker, self.motion, seed), Relaxation(checker)
        self.bound = lower_bound_of(self.motion)
        if before is None:
            self.shared, self.revalidated = SharedRoadmap(self.motion, rng, settings, landmarks), Update()
        else:
            model, boxes = before
            self.shared, self.revalidated = model.shared.edited(self.motion, boxes)
            self.passed = None if model.passed is None else model.passed.after(boxes)

    def edited(self, world: World) -> tuple[WorldModel, Update]:
        """Return the model of another world, and what changed; this one stays as it is.

        Where only obstacles differ, the roadmap is kept, and looked at again where the changes reach.
        """
        begin, old = perf_counter(), self.checker.world
        before, changes, to_place = None, 0, self.shared.to_place
        if world.differs_in_obstacles_only(old):
            boxes, changes = Boxes.between(old, world)
            before = self, boxes
        checker = self.checker.edited(world)
        model = WorldModel(checker, self.rng, self.seed, self.settings, to_place, self.objective, before)
        return model, replace(model.revalidated, changes=changes, seconds=perf_counter() - begin)

    def without(self, zones: tuple[str, ...]) -> WorldModel:
        """Return the model of the world without some keep-out zones; the last one is kept."""
        if self._without is None or self._without[0] != zones:
            world = self.checker.world.edited(remove=zones)
            # The others stand there as obstacles.
            others = tuple(zone for zone in world.zones if not isinstance(zone, KeepOutZone))
            self._without = zones, self.edited(replace(world, zones=others))[0]
        return self._without[1]

    def keeping(self, clearance: float) -> WorldModel:
        """Return a model for a robot that keeps another clearance (metres); this one if it is the same."""
        checker = self.checker
        if clearance == checker.robot.clearance:
            return self
        checker = StateChecker(checker.world, checker.robot, clearance=clearance, cell=checker.cell)
        return WorldModel(checker, np.random.default_rng(self.seed), self.seed, self.settings, 0, self.objective)

    def valid_pair(self, start: ArrayLike, goal: ArrayLike) -> se2.FloatArray:
        """Return start and goal, shape (2, 3), both valid, or raise a ConfigurationError."""
        ends = [se2.configurations(start, name="start"), se2.configurations(goal, name="goal", by_hand=True)]
        if all(q.ndim == 1 for q in ends):
            pair = np.array(ends)
            if self.checker.states_free(pair).all():
                return pair
        # Says what is wrong with which.
        return np.array([self.checker.require_valid(q, name) for q, name in zip(ends, ("start", "goal"), strict=True)])

    def valid_ends(self, starts: ArrayLike, goals: ArrayLike, any_goal: Container[int] = ()) -> se2.FloatArray:
        """Return starts and goals, shape (n, 2, 3), all valid, or raise a ConfigurationError.

        A start in keep-out zones is valid if it is without them; the goals of ``any_goal`` are not looked at.
        """
        rows = [
            np.atleast_2d(se2.configurations(q, name=name, by_hand=True))
            for q, name in ((starts, "starts"), (goals, "goals"))
        ]
        if rows[0].shape != rows[1].shape:
            raise ConfigurationError(f"goals: expected {len(rows[0])}, as many as starts, got {len(rows[1])}")
        # FCL, which decides what touches, is one thread's at a time.
        with self.shared.lock:
            for states, name in zip(rows, ("start", "goal"), strict=True):
                for i in np.flatnonzero(~self.checker.valid(states)):
                    if name == "goal" and i in any_goal:
                        continue
                    zones = zones_at(self.checker, states[i]) if name == "start" else ()
                    checker = self.without(zones).checker if zones else self.checker
                    checker.require_valid(states[i], f"{name} {i}")
        return np.stack(rows, axis=1)

    def bound_of_all(self, ends: se2.FloatArray, seconds: float) -> LowerBound | None:
        """Return what proves lower bounds, with all computed that queries share; None if that may take too long."""
        with self.shared.lock:
            in_time(PROOF_SHARE * seconds, lambda stop: self.bound.of(ends[0], ends[1], stop=stop))
            return self.bound if self.bound.ready else None


def zones_at(checker: StateChecker, q: ArrayLike) -> tuple[str, ...]:
    """Return the names of the keep-out zones that the robot would overlap in a configuration, shape (3,).

    Raises:
        ConfigurationError: no configuration.
    """
    world, state = checker.world, se2.configurations(q, name="start")
    if state.ndim != 1 or not keep_outs(world) or checker.valid(state):
        return ()
    robot, reach = checker.robot, checker.robot.clearance
    if isinstance(robot.footprint, Disc):
        body, reach = shapely.Point(state[:2]), reach + robot.footprint.radius
    else:
        body = shapely.Polygon(se2.transform(state, robot.outline.vertices))
    # One that it only touches is left, too.
    return tuple(name for name, region in keep_outs(world).items() if shapely.dwithin(region.shapely(), body, reach))
