"""The published landmarks (:mod:`trailmark.landmarks.paper`) as nodes at which a robot can stand, with paths."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks.paper import algorithm_2
from trailmark.landmarks.repair import repair_centres
from trailmark.path import Path
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.verification import Verification
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["path_over_landmarks", "published_landmarks"]


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


def path_over_landmarks(
    checker: StateChecker, landmarks: FloatArray, start: ArrayLike, goal: ArrayLike, *, seed: int = 0
) -> tuple[Roadmap, Path | None]:
    """Return the roadmap of landmarks, start and goal, and its shortest path; None if no certified edges lead there.

    Each node is joined to its nearest neighbours, as many as PRM* asks for. The path is neither shortened nor improved.

    Args:
        checker: world and robot.
        landmarks: valid configurations, shape (k, 3).
        start: shape (3,).
        goal: shape (3,).
        seed: named in the report of an error.

    Raises:
        ConfigurationError: start or goal is not valid.
    """
    ends = np.array([checker.require_valid(q, name) for q, name in ((start, "start"), (goal, "goal"))])
    roadmap = Roadmap(checker)
    roadmap.add(landmarks)
    nodes = roadmap.ends(roadmap.motion.ends(*ends)).tolist()
    roadmap.certify_all()
    found = roadmap.shortest_path(*nodes).nodes
    incumbent = Incumbent(roadmap.motion, ends[0], ends[1], perf_counter())
    if len(found):
        incumbent.offer(roadmap.configurations[found])
    path = incumbent.path()
    if path is not None and not Verification(checker, roadmap.motion, seed).certified(path, ends):
        path = None
    return roadmap, path
