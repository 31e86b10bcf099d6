"""WorldModels: a planner's models of its world, with the regions that moving obstacles sweep and without them."""

from __future__ import annotations

import pickle
from contextlib import ExitStack
from dataclasses import replace
from time import perf_counter

import numpy as np

from trailmark.changes import Change, Changes
from trailmark.collision import StateChecker
from trailmark.lock import Lock
from trailmark.motion import Motion
from trailmark.objective import Objective
from trailmark.planning.space_time import MovingObstacles
from trailmark.planning.updating import Update
from trailmark.planning.world_model import WorldModel
from trailmark.world import Robot, World, with_keep_outs

__all__ = ["WorldModels"]


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
        self._moving: MovingObstacles | None = None
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
                self._stands = self._placed.edited(remove=self._places())
            model = self._standing
            if model is None:
                full = self._full
                checker = StateChecker(self._stands, full.checker.robot, cell=full.checker.cell)
                model = WorldModel(
                    checker, np.random.default_rng(full.seed), full.seed, full.settings, 0, full.objective
                )
            elif model.checker.world is not self._stands:
                model = model.edited(self._stands)[0]
            self._standing = model
        return model

    @property
    def moving(self) -> MovingObstacles:
        """The moving obstacles, of which there is at least one."""
        if self._moving is None:
            obstacles = [moving for moving in self.world.moving if moving is not None]
            self._moving = MovingObstacles.of(obstacles, self._full.checker.footprint)
        return self._moving

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
            update = Update(changes=len(items))
            new._stands = self._stands
        else:
            full, update = self.full.edited(with_keep_outs(world))
            new = WorldModels(world, full, self._standing)
        return new, replace(update, seconds=perf_counter() - begin)

    def _moves(self, item: Change) -> bool:
        """Return whether an obstacle moves before and after, as far as it is there."""
        if item.index_before is not None and not (self.world.moving and self.world.moving[item.index_before]):
            return False
        return item.after is None or item.moving is not None

    def _places(self) -> list[int]:
        return [i for i, moving in enumerate(self._placed.moving) if moving is not None]
