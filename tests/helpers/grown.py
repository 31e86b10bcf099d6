"""Worlds of estimated obstacles, grown for a stated risk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from trailmark.estimation import regrow
from trailmark.shapes import Shape
from trailmark.world import ObstacleEstimate, World

__all__ = ["grown_world"]


def grown_world(
    estimates: Sequence[ObstacleEstimate],
    bounds: tuple[float, float, float, float],
    confidence: float,
    *,
    fixed: Sequence[Shape] = (),
    weights: Any = None,
    pose_covariance: Any = None,
    **parts: Any,
) -> World:
    """Return a world of these obstacles in which a valid path meets none with at least the stated probability.

    Args:
        estimates: the obstacles.
        bounds: of the world.
        confidence: above 0 and below 1.
        fixed: further obstacles, which count as known.
        weights: how the risk is shared out.
        pose_covariance: of the robot's own pose.
        parts: further arguments of World.
    """
    obstacles = (*(estimate.mean for estimate in estimates), *fixed)
    plain = World("map", bounds, obstacles, estimates=(*estimates, *(None for _ in fixed)), **parts)
    return regrow(plain, confidence, weights=weights, pose_covariance=pose_covariance)
