"""The published landmarks (:mod:`trailmark.landmarks.paper`) as nodes that a robot can stand at."""

# Tested by tests/planning/test_methods.py.

from __future__ import annotations

import numpy as np

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks.paper import algorithm_2
from trailmark.landmarks.repair import repair_centres
from trailmark.se2 import FloatArray

__all__ = ["published_landmarks"]


def published_landmarks(
    checker: StateChecker, start: FloatArray, points: int, count: int, rng: np.random.Generator
) -> FloatArray:
    """Return Algorithm 2's landmarks, each at its widest heading, shape (k, 3); (0, 3) if it finds no free points.

    The world is known here, so the obstacles' boxes are those of their true outlines. A centre at which the robot
    cannot stand gives way to the nearest point at which it can.

    Args:
        checker: world and robot.
        start: where the robot begins, shape (3,); what boxes enclose, seen from there, is left out.
        points: drawn.
        count: landmarks.
        rng: source of randomness.
    """
    corners = [np.reshape(shape.bounding_box(), (2, 2)) for shape in checker.world.obstacles]
    try:
        found = algorithm_2(corners, checker.world.bounds, points, count, random_state=rng, robot=start[:2])
        return repair_centres(checker, found.centres, found.samples[~found.forbidden]).configurations
    except ConfigurationError:
        # Boxes cover nearly all, or the robot can stand at none of the points.
        return np.empty((0, 3))
