"""SharedRoadmap: a planner's own roadmap, which queries let grow one at a time and many threads read at once."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from trailmark.collision import StateChecker
from trailmark.landmarks import Relaxation, k_means_landmarks
from trailmark.landmarks.retraction import retract_all
from trailmark.landmarks.sampling import draw
from trailmark.lock import Lock
from trailmark.motion import Motion
from trailmark.planning.growth import grow_general, spread_landmarks
from trailmark.planning.settings import PlannerSettings
from trailmark.planning.updating import Boxes, Update
from trailmark.roadmap import Roadmap
from trailmark.roadmap.revalidation import revalidated
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.se2 import FloatArray

__all__ = ["SharedRoadmap", "beside_obstacles", "freed_landmarks"]

MANY_REMOVED = 64
"""Obstacles removed at once from which on the roadmap is spread anew when many queries ask for it."""

OUTGROWN = 1.1
"""Times as many nodes as a snapshot has, and another one is made."""


def _forever() -> float:
    return np.inf


class SharedRoadmap:
    """A roadmap, what it still has to be given, and a snapshot of it for many queries.

    Args:
        motion: that its edges are.
        rng: source of randomness.
        settings: numbers that a person may change.
        to_place: landmarks asked for that are to be spread over all free space.

    Attributes:
        roadmap: the roadmap itself.
        lock: held by whoever lets the roadmap grow; those who only read a snapshot do without.
        to_place: landmarks asked for that are not placed yet.
        learnt: whether a query added since the last snapshot what the roadmap did not know.
        build_seconds: spent on growing it and not yet reported with a result.
    """

    def __init__(self, motion: Motion, rng: np.random.Generator, settings: PlannerSettings, to_place: int) -> None:
        self.motion, self.to_place, self._rng, self.settings = motion, to_place, rng, settings
        self.lock = Lock()
        self.build_seconds = 0.0
        self.reset()

    def reset(self) -> None:
        """Begin anew with an empty roadmap."""
        self.roadmap = Roadmap(self.motion.checker, self.motion)
        self._snapshot: RoadmapSnapshot | None = None
        # Whether landmarks have been spread over all free space, and how many nodes there were then.
        self._spread, self._spread_nodes, self.learnt = False, 0, False

    def edited(self, motion: Motion, boxes: Boxes) -> tuple[SharedRoadmap, Update]:
        """Return the roadmap of a world in which obstacles changed, and what changed in it; this one stays as it is.

        Landmarks that are valid no more come back beside the obstacle, if a short push leads there; freed space is
        given landmarks as dense as elsewhere.

        Args:
            motion: for that world.
            boxes: that hold what changed.
        """
        changed = SharedRoadmap(motion, self._rng, self.settings, self.to_place)
        found = revalidated(self.roadmap, motion, boxes.removed, boxes.added)
        changed.roadmap, changed._spread, changed._spread_nodes = found.roadmap, self._spread, self._spread_nodes
        apart = self.settings.duplicate * motion.checker.robot.inscribed_disc.radius
        back = beside_obstacles(motion.checker, found.dropped)
        # A roadmap of a few queries' paths is not spread over free space, one in which much changed no longer.
        changed._spread &= len(boxes.removed) <= MANY_REMOVED
        removed = boxes.removed if changed._spread else boxes.removed[:0]
        freed = freed_landmarks(changed.roadmap, removed, self._spread_nodes, self.settings, self._rng)
        retracted, added = (
            len(changed.roadmap.add(changed.roadmap.fresh(q, apart))) if len(q) else 0 for q in (back, freed)
        )
        return changed, Update(
            checked=found.checked,
            gained=found.gained,
            lost=found.lost,
            landmarks_dropped=len(found.dropped),
            landmarks_retracted=retracted,
            landmarks_added=added,
        )

    def place(
        self, count: int, seconds_left: Callable[[], float] = _forever, report: Callable[[], object] | None = None
    ) -> None:
        """Spread landmarks over all free space, as many as there is time for; the others the next time."""
        begin = perf_counter()
        placed = spread_landmarks(
            self.roadmap, count, self._rng, self.settings, seconds_left=seconds_left, report=report
        )
        self.to_place = max(0, self.to_place - placed)
        self._spread |= placed == count
        self._spread_nodes = len(self.roadmap)
        self.build_seconds += perf_counter() - begin

    def snapshot(
        self,
        relaxation: Callable[[], Relaxation],
        seconds_left: Callable[[], float] = _forever,
        report: Callable[[], object] | None = None,
    ) -> RoadmapSnapshot:
        """Return the roadmap ready for many queries, as it is now or was not long ago; build one if there is none.

        Args:
            relaxation: makes the relaxed problem's grid, if it is needed.
            seconds_left: asked before each part of the landmarks.
            report: called after each part.
        """
        if (snapshot := self._snapshot) is not None and not self._outgrown(snapshot):
            return snapshot
        with self.lock:
            if self._snapshot is None or self._outgrown(self._snapshot):
                begin, made = perf_counter(), None
                if self.to_place > 0:
                    self.place(self.to_place, seconds_left, report)
                    begin = perf_counter()
                elif not self._spread:
                    _, made, self._spread = grow_general(
                        self.roadmap, relaxation(), self._rng, self.settings, seconds_left=seconds_left, report=report
                    )
                    self._spread_nodes = len(self.roadmap)
                self._snapshot = RoadmapSnapshot(self.roadmap) if made is None else made
                self.learnt = False
                self.build_seconds += perf_counter() - begin
            return self._snapshot

    def _outgrown(self, snapshot: RoadmapSnapshot) -> bool:
        return self.learnt or not self._spread or len(self.roadmap) > OUTGROWN * len(snapshot)


# --- Landmarks where obstacles changed: pushed out of what came, and spread over what went.

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
