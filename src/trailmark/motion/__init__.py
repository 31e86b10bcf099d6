"""Motions between configurations: translations, straight motions, a car's curves."""

from typing import Literal

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.motion.base import Motion
from trailmark.motion.curve import CurveMotion
from trailmark.motion.straight import StraightMotion
from trailmark.motion.translation import TranslationMotion
from trailmark.motion.weighted import WeightedMotion
from trailmark.objective import Objective
from trailmark.shapes import Disc
from trailmark.world import Robot, World
from trailmark.zones import CostZone, OneWayZone

__all__ = [
    "CurveMotion",
    "Kind",
    "Motion",
    "StraightMotion",
    "TranslationMotion",
    "WeightedMotion",
    "is_weighted",
    "kind_of",
    "motion_of",
]

Kind = Literal["translation", "straight", "curve"]


def kind_of(robot: Robot) -> Kind:
    """Return a robot's kind of motion: a car's curves if it has a turning radius, translations if it is a disc."""
    if robot.turning_radius is not None:
        return "curve"
    return "translation" if isinstance(robot.footprint, Disc) else "straight"


def motion_of(checker: StateChecker, steering: Steering | None = None, objective: Objective | None = None) -> Motion:
    """Return the motion of a checker's robot: a car's curves if it has a turning radius, else straight motions.

    Args:
        checker: decides which configurations are valid.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.
        objective: what motions cost; their length by default.
    """
    motion: Motion
    if steering is not None or checker.robot.turning_radius is not None:
        motion = CurveMotion(checker, steering, objective)
    else:
        motion = TranslationMotion(checker) if checker.footprint.is_disc else StraightMotion(checker)
    objective = Objective() if objective is None else objective
    return WeightedMotion(motion, objective) if is_weighted(checker.world, objective) else motion


def is_weighted(world: World, objective: Objective) -> bool:
    """Return whether a metre's cost differs from place to place or from its length, or its direction matters."""
    return objective.charges_places or any(isinstance(zone, CostZone | OneWayZone) for zone in world.zones)
