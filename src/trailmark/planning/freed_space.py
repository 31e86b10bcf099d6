"""Landmarks where obstacles changed: pushed out of what came, and spread over what went."""

from __future__ import annotations

import numpy as np

from trailmark.collision import StateChecker
from trailmark.landmarks import k_means_landmarks
from trailmark.landmarks.retraction import retract_all
from trailmark.landmarks.sampling import draw
from trailmark.planning.settings import PlannerSettings
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["beside_obstacles", "freed_landmarks"]

MAX_LANDMARKS = 64
"""That one change of the world places: more would hold up who waits for it."""


def beside_obstacles(checker: StateChecker, q: FloatArray) -> FloatArray:
    """Return those of invalid configurations, shape (n, 3), that a short push makes valid, as they are then."""
    if len(q) == 0:
        return q
    pushed = retract_all(checker, q, checker.robot.circumradius)
    return np.asarray(pushed[checker.states_free(pushed)])


def freed_landmarks(
    roadmap: Roadmap, removed: FloatArray, nodes: int, settings: PlannerSettings, rng: np.random.Generator
) -> FloatArray:
    """Return K-means centres of valid configurations where obstacles were, as dense as elsewhere.

    Args:
        roadmap: as it is without them.
        removed: boxes xmin, ymin, xmax, ymax (metres) that hold what was removed, shape (r, 4).
        nodes: of the roadmap when it was spread over all free space.
        settings: numbers that a person may change.
        rng: source of randomness.

    Returns:
        Shape (n, 3); none where the robot still cannot be, or where there are as many nodes already.
    """
    checker, found = roadmap.checker, [np.empty((0, 3))]
    xmin, ymin, xmax, ymax = checker.world.bounds
    density = nodes / ((xmax - xmin) * (ymax - ymin))
    for box in removed:
        low = np.maximum(box[:2] - checker.robot.circumradius, (xmin, ymin))
        high = np.minimum(box[2:] + checker.robot.circumradius, (xmax, ymax))
        if (low >= high).any():
            continue
        q = roadmap.configurations[:, :2]
        there = int(np.count_nonzero(((q >= low) & (q <= high)).all(axis=1)))
        # Rounded at random: small obstacles that come and go would each leave a landmark behind.
        count = min(MAX_LANDMARKS, int(density * float(np.prod(high - low)) + rng.random()) - there)
        if count <= 0:
            continue
        samples = draw((*low, *high), settings.samples_per_landmark * count, random_state=rng)
        if not roadmap.motion.turns:
            samples[:, 2] = 0.0
        samples = samples[checker.states_free(samples)]
        if len(samples):
            radius = roadmap.motion.radius
            found.append(k_means_landmarks(samples, count, radius=radius, steps=settings.lloyd_steps, random_state=rng))
    return np.concatenate(found)
