"""StateChecker: whether configurations are valid, their clearance, and whether motions are free of collision."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from math import cos, sin
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark import se2
from trailmark.arguments import number, one_of
from trailmark.collision import certify, kernels
from trailmark.collision.explain import invalid_reason, worst_overlap
from trailmark.collision.fcl_scene import FclScene
from trailmark.collision.field import ClearanceField, build_field
from trailmark.collision.footprint import Footprint, build_footprint
from trailmark.collision.obstacles import ObstacleGrid, build_grid, cell_size_for
from trailmark.errors import ConfigurationError, WorldError
from trailmark.world import Robot, World, with_keep_outs

__all__ = ["StateChecker"]


class StateChecker:
    """Collision checks for one robot in one world.

    A configuration is valid if the robot overlaps no obstacle by more than 1e-7 m and reaches over ``bounds``
    and ``boundary`` by no more than that, sharp tips included: touching is allowed. A motion is certified if no
    configuration along it collides; nothing is sampled, so that no collision is missed
    (:mod:`trailmark.collision.certify`). A motion that comes within 1e-6 m of an obstacle more than 1 mm from its ends
    is not certified, nor is one that needs more than 20,000 distances (40 m at 1 mm from a wall); its first and last
    1e-6 m (1e-4 of the inscribed radius of a robot of less than 2 cm) count as free, as its ends are.

    A robot that keeps a clearance (:attr:`trailmark.Robot.clearance`) is valid where nothing is nearer than that; all
    the above then holds of its footprint dilated by as much.

    The clearance field decides what it can prove, exact distances in compiled code decide most of the rest, and FCL
    decides what lies within 3e-7 m of touching.

    Args:
        world: obstacles, bounds, boundary.
        robot: footprint; the world's own robot if None.
        clearance: metres that the robot keeps from obstacles, bounds and boundary; the robot's own if None.
        cell: edge of the field's cells in metres; by default a tenth of the robot's inscribed diameter, larger
            where that would take more than 2^18 cells (2^20 where cells would be larger than the robot).

    Raises:
        WorldError: neither ``robot`` nor ``world.robot`` is given; the world's obstacles were grown for the errors of a
            robot that reaches less far (:meth:`trailmark.world.RiskBound.covers`).
    """

    def __init__(
        self,
        world: World,
        robot: Robot | None = None,
        *,
        clearance: float | None = None,
        cell: float | None = None,
    ) -> None:
        one_of(world, World, "world:", hint=" (World.load reads one)", error=WorldError)
        one_of(
            robot, (Robot, type(None)), "robot:", hint=" (Robot.parse('disc:0.2') makes one of text)", error=WorldError
        )
        chosen = robot or world.robot
        if chosen is None:
            raise WorldError(f"world {world.name!r} names no robot: expected one, such as disc:0.2, got none")
        if clearance is not None:
            chosen = chosen.keeping(clearance)
        _require_covered(world, chosen)
        if cell is not None:
            cell = number(cell, "cell:", above=0.0, unit="m", error=WorldError)
        self.robot: Robot = chosen
        self.cell = cell
        self._build(with_keep_outs(world))
        self.footprint: Footprint = build_footprint(chosen)
        self.bare_footprint = self.footprint if chosen.clearance == 0.0 else build_footprint(chosen.keeping(0.0))

    def _build(self, world: World) -> None:
        """Make all that depends on the world."""
        self.world, radius = world, self.robot.inscribed_disc.radius
        wanted = 0.2 * radius if self.cell is None else self.cell
        self.grid: ObstacleGrid = build_grid(world, cell_size_for(world, wanted, 1.5 * radius))
        self.field: ClearanceField = build_field(self.grid)
        self._scene: FclScene | None = None

    def __getstate__(self) -> dict[str, Any]:
        # FCL's objects cannot be pickled, and are made again when they are needed.
        return {**self.__dict__, "_scene": None}

    def edited(self, world: World) -> StateChecker:
        """Return a checker for another world, of the same robot and with the same ``cell``; this one stays as it is.

        All that depends on the world is made anew: 5 ms with 200 polygons, 10 ms with 2,000 or a map of 1,000 x 1,000
        cells.

        Raises:
            WorldError: the obstacles were grown for the errors of a robot that reaches less far.
        """
        one_of(world, World, "world:", error=WorldError)
        world = with_keep_outs(world)
        if world is self.world:
            return self
        _require_covered(world, self.robot)
        new = copy(self)
        new._build(world)
        return new

    @property
    def scene(self) -> FclScene:
        """The FCL scene, built when it is first needed."""
        if self._scene is None:
            self._scene = FclScene(self.world, self.robot)
        return self._scene

    @overload
    def valid(self, q: tuple[float, float, float]) -> bool: ...

    @overload
    def valid(self, q: Sequence[Sequence[float]]) -> NDArray[np.bool_]: ...

    @overload
    def valid(self, q: ArrayLike) -> Any: ...

    def valid(self, q: ArrayLike) -> Any:
        """Return whether configurations are valid.

        Args:
            q: shape (3,) or (n, 3); metres and radians.

        Returns:
            bool for one configuration, a bool array of shape (n,) for n.

        Raises:
            ConfigurationError: another shape, or values that are not finite.
        """
        states = se2.configurations(q)
        free = self.states_free(np.atleast_2d(states))
        return free if states.ndim == 2 else bool(free[0])

    @overload
    def clearance(self, q: tuple[float, float, float], *, cap: float = np.inf) -> float: ...

    @overload
    def clearance(self, q: Sequence[Sequence[float]], *, cap: float = np.inf) -> se2.FloatArray: ...

    @overload
    def clearance(self, q: ArrayLike, *, cap: float = np.inf) -> Any: ...

    def clearance(self, q: ArrayLike, *, cap: float = np.inf) -> Any:
        """Return the distance (metres) from the robot to the nearest obstacle or bound; 0 on contact or overlap.

        That of the robot itself, whatever clearance it is to keep.

        Args:
            q: shape (3,) or (n, 3).
            cap: larger distances are returned as this value; a small cap is faster.

        Returns:
            float for one configuration, a float array of shape (n,) for n.

        Raises:
            ConfigurationError: another shape, values that are not finite, or a negative cap.
        """
        states = se2.configurations(q)
        cap = number(cap, "clearance: cap", minimum=0.0, infinite=True)
        rows = np.atleast_2d(states)
        found = kernels.clearances(self.grid, self.field, self.bare_footprint, rows, float(cap))
        return found if states.ndim == 2 else float(found[0])

    def motions_valid(self, a: ArrayLike, b: ArrayLike) -> NDArray[np.bool_]:
        """Return which motions are certified free of collision, ends included.

        Args:
            a: starts, shape (n, 3).
            b: ends, shape (n, 3).

        Returns:
            Shape (n,), True only if no configuration along the motion collides.

        Raises:
            ConfigurationError: other shapes, different lengths, or values that are not finite.
        """
        starts, ends = se2.ends_of_motions(a, b)
        free = self.states_free(starts) & self.states_free(ends)
        free[free] = self.motions_between_valid(starts[free], ends[free])
        return free

    def motion_valid(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return whether the motion from a to b, each of shape (3,), is certified free of collision."""
        ends = se2.configurations(a, name="motion: start"), se2.configurations(b, name="motion: end")
        if ends[0].ndim != 1 or ends[1].ndim != 1:
            raise ConfigurationError(f"motion: expected shapes (3,), got {ends[0].shape} and {ends[1].shape}")
        return bool(self.motions_valid(*ends)[0])

    def motions_between_valid(self, a: se2.FloatArray, b: se2.FloatArray) -> NDArray[np.bool_]:
        """Return which motions between configurations known to be valid are certified; shapes (n, 3)."""
        return self.motions_free(*se2.ends_of_motions(a, b))

    def motions_free(self, a: se2.FloatArray, b: se2.FloatArray) -> NDArray[np.bool_]:
        """Return what :meth:`motions_between_valid` does, for arrays (n, 3) that are not checked."""
        # Copies: read-only arrays would be another type to the kernels, and compiled for anew.
        answer = certify.motions_certified(self.grid, self.field, self.footprint, np.array(a), np.array(b), True)
        return np.asarray(answer == kernels.FREE)

    def motions_by_field(self, a: se2.FloatArray, b: se2.FloatArray) -> NDArray[np.uint8]:
        """Return what the field alone proves about motions between valid configurations: FREE, BLOCKED, UNDECIDED."""
        a, b = se2.ends_of_motions(a, b)
        return np.asarray(certify.motions_certified(self.grid, self.field, self.footprint, a, b, False))

    def disc_center(self, q: se2.FloatArray) -> tuple[float, float]:
        """Return where the centre of the robot's inscribed disc is (metres) in a configuration of shape (3,)."""
        q = _one(q, "disc_center")
        x, y = self.robot.inscribed_disc.center
        c, s = cos(q[2]), sin(q[2])
        return float(q[0] + c * x - s * y), float(q[1] + s * x + c * y)

    def require_valid(self, q: ArrayLike, name: str) -> se2.FloatArray:
        """Return q as an array of shape (3,) if it is valid.

        Raises:
            ConfigurationError: it is not; the message says which obstacle or bound, and by how much.
        """
        state = _one(q, name)
        if not self.valid(state):
            at = ", ".join(f"{v:g}" for v in state)
            raise ConfigurationError(
                f"{name} ({at}) is not valid: the robot ({self.robot.describe()}) {self.fault(state)}"
            )
        return state

    def fault(self, q: se2.FloatArray) -> str:
        """Return a clause that says why a configuration, shape (3,), is not valid."""
        kept, bare = self.robot.clearance, copy(self)
        bare.robot, bare.footprint, bare._scene = self.robot.keeping(0.0), self.bare_footprint, None
        if kept > 0.0 and bare.valid(q):
            return f"has a clearance of {self.clearance(q):.6g} m there, less than the {kept:g} m that it is to keep"
        return invalid_reason(self.world, self.robot, q)

    def nearest_to_valid(self, states: se2.FloatArray, over: Callable[[], bool]) -> se2.FloatArray:
        """Return, of configurations (n, 3) that are not valid, the one that lacks least of it, shape (3,).

        Args:
            states: n >= 1.
            over: asked whether to look at no more of them.
        """
        room = self.clearance(states, cap=max(self.robot.clearance, 1e-9))
        if room.max() > 0.0:
            return np.array(states[np.argmax(room)])
        best, least = states[0], np.inf
        for state in states:
            depth = worst_overlap(self.world, self.robot, state)[0]
            if depth < least:
                best, least = state, depth
            if over():
                break
        return np.array(best)

    def require_for(self, world: World, robot: Robot | None = None) -> None:
        """Raise unless this checker is for a world and, where one is given, a robot: its answers would be wrong.

        Raises:
            ConfigurationError: it is for another world or robot.
        """
        one_of(world, World, "world:", error=WorldError)
        one_of(robot, (Robot, type(None)), "robot:", error=WorldError)
        mine, world = self.world, with_keep_outs(world)
        if mine is not world and mine.with_robot(self.robot) != world.with_robot(self.robot):
            raise ConfigurationError(
                f"checker: expected one for world {world.name!r} as it is, got one for another ({mine.name!r})"
            )
        if robot is not None and robot != self.robot:
            raise ConfigurationError(
                f"checker: expected one for robot {robot.describe()}, got one for {self.robot.describe()}"
                " (leave robot out, and the checker's counts)"
            )

    def __repr__(self) -> str:
        return f"StateChecker({self.robot.describe()} in world {self.world.name!r})"

    def states_free(self, q: se2.FloatArray) -> NDArray[np.bool_]:
        """Return which configurations are valid, shape (n,): :meth:`valid` for an array (n, 3) that is not checked."""
        answer = kernels.states_free(self.grid, self.field, self.footprint, q)
        for i in np.flatnonzero(answer == kernels.UNDECIDED):
            answer[i] = kernels.BLOCKED if self.scene.collides(q[i]) else kernels.FREE
        return np.asarray(answer == kernels.FREE)


def _require_covered(world: World, robot: Robot) -> None:
    """Raise a WorldError if the world's obstacles were grown for the errors of a robot that reaches less far."""
    if world.risk is not None and not world.risk.covers(robot):
        raise WorldError(
            f"world {world.name!r}: grown for a robot that reaches {world.risk.reach:g} m: expected one that "
            "reaches no farther, or trailmark.estimation.regrow(world.with_robot(robot), confidence), got robot "
            f"{robot.describe()}"
        )


def _one(q: ArrayLike, name: str) -> se2.FloatArray:
    """Return one configuration, shape (3,)."""
    state = se2.configurations(q, name=name)
    if state.ndim != 1:
        raise ConfigurationError(f"{name}: expected shape (3,), got {state.shape}")
    return state
