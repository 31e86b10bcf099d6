"""Motions between configurations: translations, straight motions, a car's curves."""

from typing import Literal

from trailmark.collision import StateChecker
from trailmark.curves import Steering
from trailmark.motion.base import Motion
from trailmark.motion.curve import CurveMotion
from trailmark.motion.straight import StraightMotion
from trailmark.motion.translation import TranslationMotion
from trailmark.shapes import Disc
from trailmark.world import Robot

__all__ = ["CurveMotion", "Kind", "Motion", "StraightMotion", "TranslationMotion", "kind_of", "motion_of"]

Kind = Literal["translation", "straight", "curve"]


def kind_of(robot: Robot) -> Kind:
    """Return a robot's kind of motion: a car's curves if it has a turning radius, translations if it is a disc."""
    if robot.turning_radius is not None:
        return "curve"
    return "translation" if isinstance(robot.footprint, Disc) else "straight"


def motion_of(checker: StateChecker, steering: Steering | None = None) -> Motion:
    """Return the motion of a checker's robot: a car's curves if it has a turning radius, else straight motions.

    Args:
        checker: decides which configurations are valid.
        steering: turning radius, and whether the car reverses; that of the checker's robot if None.
    """
    if steering is not None or checker.robot.turning_radius is not None:
        return CurveMotion(checker, steering)
    return TranslationMotion(checker) if checker.footprint.is_disc else StraightMotion(checker)
