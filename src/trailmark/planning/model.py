"""What a planner keeps about its world: checker, motion, roadmap, relaxed problem, lower bounds, and all after changes.

A world with moving obstacles has two models: one with the regions that they sweep, one of what stands.
"""

from __future__ import annotations

import pickle
from collections.abc import Container
from contextlib import ExitStack
from dataclasses import replace
from time import perf_counter
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.changes import Change, Changes
from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.formats.grid import CellObstacles, cells_of
from trailmark.landmarks import Relaxation
from trailmark.lock import Lock
from trailmark.motion import Motion, motion_of
from trailmark.objective import Objective
from trailmark.planning.growth import SharedRoadmap
from trailmark.planning.proofs import LowerBound, lower_bound_of
from trailmark.planning.proofs.prover import in_time
from trailmark.planning.result import Update
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.verification import Verification
from trailmark.roadmap.revalidation import few_boxes
from trailmark.se2 import FloatArray
from trailmark.shapes import Disc
from trailmark.world import Robot, World, keep_outs, with_keep_outs
from trailmark.zones import KeepOutZone

__all__ = ["Boxes", "Passed", "WorldModel", "WorldModels", "zones_at"]

BOUND_SHARE = 0.25
"""Of the time left: what making lower bounds ready for many queries may take of it."""

PARTS = 16
"""Of a grid map along its longer side: changed cells of one part share a box."""


class Boxes(NamedTuple):
    """Boxes xmin, ymin, xmax, ymax (metres) that hold what changed.

    Attributes:
        removed: of obstacles as they were, shape (r, 4).
        added: of obstacles as they are now, shape (a, 4).
    """

    removed: FloatArray
    added: FloatArray

    @classmethod
    def between(cls, before: World, after: World) -> tuple[Boxes, int]:
        """Return the boxes for two worlds, and how many obstacles, or cells of a grid map, differ."""
        old, new = cells_of(before), cells_of(after)
        if old is not None and new is not None and old.covers_as(new):
            gone, come = old.occupied & ~new.occupied, new.occupied & ~old.occupied
            return cls(_boxes_of_cells(gone, old), _boxes_of_cells(come, old)), int(np.count_nonzero(gone | come))
        items = before.difference(after).items
        went, came = (
            np.array([shape.bounding_box() for shape in shapes if shape is not None]).reshape(-1, 4)
            for shapes in ([item.before for item in items], [item.after for item in items])
        )
        return cls(went, came), len(items)


def _boxes_of_cells(changed: NDArray[np.bool_], cells: CellObstacles) -> FloatArray:
    """Return boxes (metres), shape (b, 4), that hold the changed cells of a grid map, (rows, columns)."""
    side = -(-max(changed.shape) // PARTS)
    starts = [np.arange(0, count, side) for count in changed.shape]
    parts = np.logical_or.reduceat(np.logical_or.reduceat(changed, starts[0], axis=0), starts[1], axis=1)
    boxes = []
    for row, column in np.argwhere(parts) * side:
        block = changed[row : row + side, column : column + side]
        rows, columns = row + np.flatnonzero(block.any(axis=1)), column + np.flatnonzero(block.any(axis=0))
        boxes.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
    found: FloatArray = np.array(boxes).reshape(-1, 4) * cells.cell + np.tile(cells.origin[:2], 2)
    return found


class Passed(NamedTuple):
    """A path that passed the final check.

    Attributes:
        vertices: states that motions join, shape (n, 3).
        checker: of the world that it passed it in.
        changes: boxes that hold what changed since.
    """

    vertices: FloatArray
    checker: StateChecker
    changes: Boxes = Boxes(np.empty((0, 4)), np.empty((0, 4)))

    def after(self, changes: Boxes) -> Passed:
        """Return the same path in a world that changed."""
        both = (few_boxes(np.concatenate(pair)) for pair in zip(self.changes, changes, strict=True))
        return self._replace(changes=Boxes(*both))


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
            self.shared, self.revalidated = model.shared.edited(self.motion, *boxes)
            self.passed = None if model.passed is None else model.passed.after(boxes)

    def edited(self, world: World) -> tuple[WorldModel, Update]:
        """Return the model of another world, and what changed; this one stays as it is.

        Where only obstacles differ, the roadmap is kept, and looked at again where the changes reach.
        """
        begin, old = perf_counter(), self.checker.world
        before, changes = None, 0
        if world.differs_in_obstacles_only(old):
            boxes, changes = Boxes.between(old, world)
            before = self, boxes
        to_place, checker = self.shared.to_place, self.checker.edited(world)
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
        return self.of(StateChecker(checker.world, checker.robot, clearance=clearance, cell=checker.cell))

    def of(self, checker: StateChecker) -> WorldModel:
        """Return a new model with another checker, which knows nothing of this one's."""
        return WorldModel(checker, np.random.default_rng(self.seed), self.seed, self.settings, 0, self.objective)

    def valid_pair(self, start: ArrayLike, goal: ArrayLike) -> FloatArray:
        """Return start and goal, shape (2, 3), both valid, or raise a ConfigurationError."""
        ends = [se2.configurations(start, name="start"), se2.configurations(goal, name="goal", by_hand=True)]
        if all(q.ndim == 1 for q in ends):
            pair = np.array(ends)
            if self.checker.states_free(pair).all():
                return pair
        # Says what is wrong with which.
        return np.array([self.checker.require_valid(q, name) for q, name in zip(ends, ("start", "goal"), strict=True)])

    def valid_ends(self, starts: ArrayLike, goals: ArrayLike, any_goal: Container[int] = ()) -> FloatArray:
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

    def bound_of_all(self, ends: FloatArray, seconds: float) -> LowerBound | None:
        """Return what proves lower bounds, with all computed that queries share; None if that may take too long."""
        with self.shared.lock:
            in_time(BOUND_SHARE * seconds, lambda stop: self.bound.of(ends[0], ends[1], stop=stop))
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


class WorldModels:
    """The models of one world, each brought up to date from that of an earlier one when it is first asked for.

    Args:
        world: as it is.
        full: a model of it, or of an earlier one.
        standing: a model of it without its moving obstacles, or of an earlier one; None makes it anew.
        placed: the world in which its keep-out zones are obstacles, too; by default that of ``full``.
    """

    def __init__(
        self, world: World, full: WorldModel, standing: WorldModel | None = None, placed: World | None = None
    ) -> None:
        self.world, self._full, self._standing = world, full, standing
        self._placed = full.checker.world if placed is None else placed
        self._stands: World | None = None
        self._lock = Lock()

    def __getstate__(self) -> bytes:
        with ExitStack() as held:
            # While a query or a change is under way, half of it would be copied.
            for lock in (self._lock, *(model.shared.lock for model in (self._full, self._standing) if model)):
                held.enter_context(lock)
            return pickle.dumps(self.__dict__)

    def __setstate__(self, state: bytes) -> None:
        self.__dict__.update(pickle.loads(state))  # noqa: S301  # part of a pickle that is being read already

    @property
    def robot(self) -> Robot:
        """The robot that moves in it."""
        return self._full.checker.robot

    @property
    def motion(self) -> Motion:
        """How the robot moves."""
        return self._full.motion

    @property
    def objective(self) -> Objective:
        """What a path costs, in whatever world."""
        return self._full.objective

    @property
    def full(self) -> WorldModel:
        """The model in which a moving obstacle is the region that it sweeps up to its horizon."""
        if self._full.checker.world is not self._placed:
            with self._lock:
                if self._full.checker.world is not self._placed:
                    self._full = self._full.edited(self._placed)[0]
        return self._full

    @property
    def standing(self) -> WorldModel:
        """The model of what stands."""
        with self._lock:
            if self._stands is None:
                moving = [i for i, each in enumerate(self._placed.moving) if each is not None]
                self._stands = self._placed.edited(remove=moving)
            model, checker = self._standing, self._full.checker
            if model is None:
                model = self._full.of(StateChecker(self._stands, checker.robot, cell=checker.cell))
            elif model.checker.world is not self._stands:
                model = model.edited(self._stands)[0]
            self._standing = model
        return model

    def updated(self, changes: Changes | World) -> tuple[WorldModels, Update]:
        """Return the models of the world after changes, or of another world, and what changed; these stay as they are.

        What moved before and moves now is nothing to the model of what stands; in the other one it is taken into
        account when that one is needed.
        """
        begin, old = perf_counter(), self.world
        world = changes if isinstance(changes, World) else old.apply(changes)
        moving = bool(old.moving or world.moving) and world.differs_in_obstacles_only(old)
        items = old.difference(world).items if moving else ()
        if items and all(self._moves(item) for item in items):
            new = WorldModels(world, self._full, self._standing, with_keep_outs(world))
            new._stands, update = self._stands, Update(changes=len(items))
        else:
            full, update = self.full.edited(with_keep_outs(world))
            new = WorldModels(world, full, self._standing)
        return new, replace(update, seconds=perf_counter() - begin)

    def _moves(self, item: Change) -> bool:
        """Return whether an obstacle moves before and after, as far as it is there."""
        if item.index_before is not None and not (self.world.moving and self.world.moving[item.index_before]):
            return False
        return item.after is None or item.moving is not None
