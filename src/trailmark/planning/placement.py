"""Landmarks of one query: placed where short paths are likely, joined to a roadmap, and searched for a path."""

from __future__ import annotations

from time import perf_counter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.collision import StateChecker
from trailmark.errors import ConfigurationError
from trailmark.landmarks import k_means_landmarks, repair_centres
from trailmark.landmarks.band import Band
from trailmark.landmarks.paper import algorithm_2
from trailmark.path import Path
from trailmark.planning.incumbent import Incumbent
from trailmark.planning.query import Query
from trailmark.planning.verification import Verification
from trailmark.roadmap import Roadmap
from trailmark.se2 import FloatArray

__all__ = ["Placement", "path_over_landmarks", "published_landmarks"]


class Placement:
    """Places landmarks for one query.

    Args:
        query: under way.
        band: where short paths are likely.
    """

    def __init__(self, query: Query, band: Band) -> None:
        self.query, self.band = query, band
        # What the last landmarks took, seconds each.
        self._seconds = 0.0

    def place(self, roadmap: Roadmap, widening: float, count: int) -> None:
        """Join landmarks to a roadmap, if there is time for it.

        Args:
            roadmap: to add them to.
            widening: how much longer than the relaxed shortest path the band's paths may be, as a share of it.
            count: landmarks.
        """
        # The more landmarks, the longer each takes.
        if self._seconds * self.query.settings.landmark_growth * count > self.query.seconds_left():
            return
        begin = perf_counter()
        # Not those that are hardly another place than a node that is joined already.
        apart = self.query.settings.duplicate * self.query.checker.robot.inscribed_disc.radius
        roadmap.add(roadmap.fresh(self._landmarks(widening, count), apart))
        self._seconds = (perf_counter() - begin) / count

    def _landmarks(self, widening: float, count: int) -> FloatArray:
        """Return so many valid configurations, shape (n, 3), or fewer."""
        query, settings = self.query, self.query.settings
        if settings.placement == "none":
            return np.empty((0, 3))
        samples = settings.samples_per_landmark * count
        if settings.placement == "paper":
            return published_landmarks(query.checker, query.ends[0], samples, count, query.rng)
        if not settings.uses("bands"):
            widening = np.inf
        if settings.placement == "samples":
            return self.band.samples(count, widening, query.rng)
        return k_means_landmarks(
            self.band.samples(samples, widening, query.rng),
            count,
            radius=query.motion.radius,
            steps=settings.lloyd_steps,
            random_state=query.rng,
        )

    def widening(self) -> float:
        """Return how much longer than the relaxed shortest path the paths may be that better the best one."""
        longest = float(self.query.motion.longest(self.query.incumbent.cost))
        return max(0.02, longest / max(self.band.shortest, 1e-9) - 1.0)

    def search(self, roadmap: Roadmap, nodes: NDArray[np.int64], banned: NDArray[np.bool_] | None = None) -> None:
        """Offer a roadmap's shortest path between two nodes, shortened.

        Args:
            roadmap: to search.
            nodes: of start and goal, shape (2,).
            banned: nodes not to be used, shape (n,); then the path may cost more than the best one.
        """
        query, (start, goal) = self.query, nodes.tolist()
        to_go = roadmap.distances_to(goal)
        if not query.solved:
            # The relaxed problem leads to a first path soon; it may overestimate, so what betters one goes without.
            to_go = np.maximum(to_go, self.band.costs_to_goal(roadmap.configurations))
        limit = query.incumbent.cost if banned is None else np.inf
        found = roadmap.shortest_path(
            start, goal, to_go=to_go, banned=banned, limit=limit, seconds=query.seconds_left()
        )
        query.take(roadmap.configurations[found.nodes])


# --- The published landmarks (:mod:`trailmark.landmarks.paper`) as nodes at which a robot can stand, with paths.


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
