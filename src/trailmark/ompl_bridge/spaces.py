"""State spaces of x, y and heading: made for a world, and required of those that come from elsewhere."""

from __future__ import annotations

from typing import Any

from ompl import base as ob

from trailmark.arguments import one_of
from trailmark.curves import Steering
from trailmark.errors import ConfigurationError
from trailmark.ompl_bridge.errors import BoundsError, SpaceError
from trailmark.ompl_bridge.states import state
from trailmark.world import Robot, World

__all__ = ["require_within", "set_bounds", "space_for", "space_of", "steering_of"]


def space_for(world: World, robot: Robot) -> Any:
    """Return the state space that a robot moves in, with the world's bounds.

    That is a ``ReedsSheppStateSpace`` for a robot with a turning radius, a ``DubinsStateSpace`` if it does not reverse,
    and an ``SE2StateSpace`` for all others.

    Raises:
        ConfigurationError: a differential drive: in OMPL's spaces it would move sideways.
    """
    if robot.drive == "differential":
        raise ConfigurationError(f"robot: expected an omnidirectional one or a car in OMPL, got {robot.describe()}")
    steering = Steering.of(robot)
    if steering is None:
        space = ob.SE2StateSpace()
    else:
        space = (ob.ReedsSheppStateSpace if steering.reverse else ob.DubinsStateSpace)(steering.radius)
    set_bounds(space, world)
    return space


def set_bounds(space: Any, world: World) -> None:
    """Set the bounds (metres) of a space of x, y and heading to the world's."""
    xmin, ymin, xmax, ymax = world.bounds
    bounds = ob.RealVectorBounds(2)
    for axis, (low, high) in enumerate(((xmin, xmax), (ymin, ymax))):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)


def space_of(information: Any) -> Any:
    """Return the state space of a ``SpaceInformation``, which is made of x, y and heading.

    Raises:
        SpaceError: it is not ``SE2StateSpace`` nor one of those derived from it (Dubins, Reeds-Shepp).
    """
    space = one_of(information, ob.SpaceInformation, "information:", error=SpaceError).getStateSpace()
    if not isinstance(space, ob.SE2StateSpace):
        raise SpaceError(
            "state space: expected SE2StateSpace, DubinsStateSpace or ReedsSheppStateSpace, "
            f"got {space.getName()!r} ({type(space).__name__})"
        )
    return space


def require_within(space: Any, world: World) -> None:
    """Raise unless a space's bounds lie within the world's.

    Raises:
        BoundsError: they do not, or were never set.
    """
    bounds = space.getBounds()
    low, high = list(bounds.low), list(bounds.high)
    xmin, ymin, xmax, ymax = world.bounds
    spare = 1e-6 * max(1.0, xmax - xmin, ymax - ymin)
    if len(low) != 2 or not all(a < b for a, b in zip(low, high, strict=True)):
        raise BoundsError(f"state space: expected bounds that are set and not empty, got {low} to {high}")
    if low[0] < xmin - spare or low[1] < ymin - spare or high[0] > xmax + spare or high[1] > ymax + spare:
        raise BoundsError(
            f"state space: expected bounds within world {world.name!r}, ({xmin:g}, {ymin:g}) to ({xmax:g}, {ymax:g}), "
            f"got ({low[0]:g}, {low[1]:g}) to ({high[0]:g}, {high[1]:g})"
        )


def steering_of(information: Any) -> Steering | None:
    """Return the steering of the cars that a space of Dubins or Reeds-Shepp curves is for; None for other spaces.

    The bindings do not tell a space's turning radius; the length of a curve does.

    Args:
        information: the ``SpaceInformation`` of the space.

    Raises:
        SpaceError: a symmetric Dubins space, whose cars drive a curve backwards if that is shorter.
    """
    space = information.getStateSpace()
    if not isinstance(space, ob.DubinsStateSpace | ob.ReedsSheppStateSpace):
        return None
    reverse = isinstance(space, ob.ReedsSheppStateSpace)
    a, b = (0.0, 0.0, 0.0), (0.0, 0.0, 1.5)
    # Turned on the spot, so that all lengths are multiples of the radius.
    unit = Steering(1.0, reverse)
    radius = _distance(information, a, b) / unit.lengths(a, b)
    ahead = (3.0 * radius, radius, 0.5)
    if (
        not reverse
        and abs(_distance(information, ahead, a) - Steering(radius, reverse).lengths(ahead, a)) > 1e-6 * radius
    ):
        raise SpaceError(
            f"state space: expected a DubinsStateSpace that is not symmetric, got the symmetric {space.getName()!r}"
        )
    return Steering(radius, reverse)


def _distance(information: Any, a: tuple[float, float, float], b: tuple[float, float, float]) -> float:
    first, second = state(information, a), state(information, b)
    return float(information.getStateSpace().distance(first, second))
