"""Motions between configurations: translations, straight motions, a car's curves, a differential drive's."""

from typing import Literal

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.motion.base import Motion
from trailmark.motion.curve import CurveMotion
from trailmark.motion.differential import DifferentialMotion
from trailmark.motion.straight import StraightMotion
from trailmark.motion.translation import TranslationMotion
from trailmark.motion.weighted import WeightedMotion
from trailmark.objective import Objective
from trailmark.world import Robot, World
from trailmark.zones import CostZone, OneWayZone

__all__ = [
    "CurveMotion",
    "DifferentialMotion",
    "Kind",
    "Motion",
    "StraightMotion",
    "TranslationMotion",
    "WeightedMotion",
    "is_weighted",
    "kind_of",
    "motion_of",
]

Kind = Literal["translation", "straight", "curve", "differential"]


def kind_of(robot: Robot) -> Kind:
    """Return a robot's kind of motion: by its drive, and translations if its heading makes no difference."""
    if robot.drive == "differential":
        return "differential"
    if robot.drive == "car":
        return "curve"
    return "straight" if robot.heading_matters else "translation"


def motion_of(checker: StateChecker, steering: Steering | None = None, objective: Objective | None = None) -> Motion:
    """Return the motion of a checker's robot, by its drive.

    Args:
        checker: decides which configurations are valid.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.
        objective: what motions cost; their length by default.
    """
    motion: Motion
    if steering is not None or checker.robot.turning_radius is not None:
        motion = CurveMotion(checker, steering, objective)
    elif checker.robot.drive == "differential":
        motion = DifferentialMotion(checker)
    else:
        motion = TranslationMotion(checker) if checker.footprint.is_disc else StraightMotion(checker)
    objective = Objective() if objective is None else objective
    return WeightedMotion(motion, objective) if is_weighted(checker.world, objective) else motion


def is_weighted(world: World, objective: Objective) -> bool:
    """Return whether a metre's cost differs from place to place or from its length, or its direction matters."""
    return objective.position_dependent or any(isinstance(zone, CostZone | OneWayZone) for zone in world.zones)
