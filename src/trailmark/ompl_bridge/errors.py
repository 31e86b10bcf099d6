"""Errors of the parts that plug into an OMPL program."""

from __future__ import annotations

from trailmark.errors import ConfigurationError, TrailmarkError

__all__ = ["BoundsError", "BridgeError", "LandmarkError", "ObjectiveError", "PlannerNameError", "SpaceError"]


class BridgeError(TrailmarkError):
    """Base class of the bridge's errors."""


class SpaceError(BridgeError, TypeError):
    """A state space that is not made of x, y and heading."""


class BoundsError(BridgeError, ValueError):
    """A state space that reaches beyond the world that it is to be checked in."""


class PlannerNameError(BridgeError, ValueError):
    """A planner that the installed OMPL does not have."""


class ObjectiveError(BridgeError, ValueError):
    """An optimisation objective that the landmark planner does not know."""


class LandmarkError(BridgeError, ConfigurationError):
    """Landmarks that cannot be sampled: wrong array shape, not finite, not valid, out of bounds."""
