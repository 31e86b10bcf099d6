"""SharedRoadmap: a planner's own roadmap, which queries let grow one at a time and many threads read at once.

For many queries landmarks are spread over all free space, as dense as the world asks for; where obstacles changed, they
come back beside what came, and join where something went.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from trailmark import se2
from trailmark.errors import ConfigurationError
from trailmark.landmarks import Relaxation, free_samples, k_means_landmarks
from trailmark.landmarks.retraction import retract_all
from trailmark.landmarks.sampling import draw, farthest_samples
from trailmark.lock import Lock
from trailmark.motion import Motion
from trailmark.planning.result import Update
from trailmark.planning.settings import PlannerSettings
from trailmark.roadmap import Roadmap
from trailmark.roadmap.revalidation import revalidated
from trailmark.roadmap.snapshot import RoadmapSnapshot
from trailmark.se2 import FloatArray

__all__ = ["SharedRoadmap", "grow_general", "spread_landmarks"]

DUPLICATE = 0.05
"""Shares of the inscribed disc's radius: a landmark nearer than that to a joined node is hardly another place."""

LLOYD_STEPS = 3
"""Of K-means: more move the centres by little."""

MANY_REMOVED = 64
"""Obstacles removed at once from which on the roadmap is spread anew when many queries ask for it."""

MOST_FREED = 64
"""Landmarks that one change of the world places: more would hold up who waits for it."""

OUTGROWN = 1.1
"""Times as many nodes as a snapshot has, and another one is made."""

SMALLEST, FIRST = 16, 1_024
"""Landmarks of the first part, and when random queries are asked first: each part doubles them."""

DRAWN, FARTHEST = 2, 0.25
"""Where there are landmarks already: times as many samples are drawn, and which share of them, the farthest, is
clustered. The same number of landmarks then leaves gaps a quarter smaller and answers up to 10 % more queries."""

SPREAD_STEPS = 5
"""Of K-means over all free space: samples are then on the mean at most a thousandth farther from their centres than
where it ends."""

LEAST_GAIN = 0.02
"""Share by which doubling the landmarks must shorten the random queries' paths to be done again."""

NEXT = 2.5
"""Times as long as a part of landmarks the next one may take, twice as large."""


def _forever() -> float:
    return np.inf


class SharedRoadmap:
    """A roadmap, what it still has to be given, and a snapshot of it for many queries.

    Attributes:
        roadmap: the roadmap itself.
        lock: held by whoever lets the roadmap grow; those who only read a snapshot do without.
        to_place: landmarks asked for that are not placed yet.
        outdated: whether a query added since the last snapshot what the roadmap did not know.
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
        self._spread, self._spread_nodes, self.outdated = False, 0, False

    def edited(self, motion: Motion, removed: FloatArray, added: FloatArray) -> tuple[SharedRoadmap, Update]:
        """Return the roadmap of a world in which obstacles changed, and what changed in it; this one stays as it is.

        Landmarks that are valid no more come back beside the obstacle, if a short push leads there; freed space is
        given landmarks as dense as elsewhere.
        """
        changed, checker = SharedRoadmap(motion, self._rng, self.settings, self.to_place), motion.checker
        found = revalidated(self.roadmap, motion, removed, added)
        changed.roadmap, changed._spread_nodes = found.roadmap, self._spread_nodes
        apart = DUPLICATE * checker.robot.inscribed_disc.radius
        back = found.dropped
        if len(back):
            back = np.asarray(retract_all(checker, back, checker.robot.circumradius))
            back = back[checker.states_free(back)]
        # A roadmap of a few queries' paths is not spread over free space, one in which much changed no longer.
        changed._spread = self._spread and len(removed) <= MANY_REMOVED
        freed = changed._freed_landmarks(removed) if changed._spread else back[:0]
        retracted, placed = (
            len(changed.roadmap.add(changed.roadmap.fresh(q, apart))) if len(q) else 0 for q in (back, freed)
        )
        return changed, Update(
            checked=found.checked,
            gained=found.gained,
            lost=found.lost,
            landmarks_dropped=len(found.dropped),
            landmarks_retracted=retracted,
            landmarks_added=placed,
        )

    def _freed_landmarks(self, removed: FloatArray) -> FloatArray:
        """Return K-means centres of valid configurations where obstacles were, as dense as elsewhere, shape (n, 3)."""
        roadmap, checker, found = self.roadmap, self.motion.checker, [np.empty((0, 3))]
        bounds = np.array(checker.world.bounds)
        density = self._spread_nodes / float(np.prod(bounds[2:] - bounds[:2]))
        for box in removed:
            low = np.maximum(box[:2] - checker.robot.circumradius, bounds[:2])
            high = np.minimum(box[2:] + checker.robot.circumradius, bounds[2:])
            q = roadmap.configurations[:, :2]
            there = int(np.count_nonzero(((q >= low) & (q <= high)).all(axis=1)))
            # Rounded at random: small obstacles that come and go would each leave a landmark behind.
            count = min(MOST_FREED, int(density * float(np.prod(high - low)) + self._rng.random()) - there)
            if (low >= high).any() or count <= 0:
                continue
            samples = draw((*low, *high), self.settings.samples_per_landmark * count, random_state=self._rng)
            if not self.motion.turns:
                samples[:, 2] = 0.0
            samples = samples[checker.states_free(samples)]
            if len(samples):
                radius = self.motion.radius
                found.append(
                    k_means_landmarks(samples, count, radius=radius, steps=LLOYD_STEPS, random_state=self._rng)
                )
        return np.concatenate(found)

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
        """Return the roadmap ready for many queries, as it is now or was not long ago; build one if there is none."""
        if (snapshot := self._snapshot) is not None and not self._outgrown(snapshot):
            return snapshot
        with self.lock:
            if self._snapshot is None or self._outgrown(self._snapshot):
                made = None
                if self.to_place > 0:
                    self.place(self.to_place, seconds_left, report)
                begin = perf_counter()
                if self.to_place == 0 and not self._spread:
                    made, self._spread = grow_general(
                        self.roadmap, relaxation(), self._rng, self.settings, seconds_left=seconds_left, report=report
                    )
                    self._spread_nodes = len(self.roadmap)
                self._snapshot = RoadmapSnapshot(self.roadmap) if made is None else made
                self.outdated = False
                self.build_seconds += perf_counter() - begin
            return self._snapshot

    def _outgrown(self, snapshot: RoadmapSnapshot) -> bool:
        return self.outdated or not self._spread or len(self.roadmap) > OUTGROWN * len(snapshot)


def grow_general(
    roadmap: Roadmap,
    relaxation: Relaxation,
    rng: np.random.Generator,
    settings: PlannerSettings,
    *,
    seconds_left: Callable[[], float] = _forever,
    report: Callable[[], object] | None = None,
) -> tuple[RoadmapSnapshot, bool]:
    """Add landmarks until random queries find their paths, and no much shorter ones when landmarks are doubled.

    Returns:
        The roadmap ready for queries, and whether it is as dense as the world asks for; else the time was up before.

    Raises:
        ConfigurationError: no free place for the robot.
    """
    probes, before = np.empty((0, 2, 3)), np.empty(0)
    placed, part = 0, SMALLEST
    while True:
        begin = perf_counter()
        _spread(roadmap, part, rng, settings)
        placed = part = placed + part
        graph = RoadmapSnapshot(roadmap)
        if report is not None:
            report()
        if placed == FIRST:
            ends = free_samples(roadmap.checker, 2 * settings.probes, random_state=rng)
            probes = ends[: len(ends) // 2 * 2].reshape(-1, 2, 3)
            probes = probes[_joined(relaxation, probes, seconds_left)]
        if placed >= FIRST:
            costs = np.full(len(probes), np.inf)
            for i, (start, goal) in enumerate(probes):
                if seconds_left() <= 0.0:
                    return graph, False
                states = graph.find_path(start, goal)
                costs[i] = np.inf if states is None else graph.motion.cost_of(states)
            solved = np.isfinite(costs)
            if placed > FIRST:
                common = solved & np.isfinite(before)
                shorter = 1.0 - costs[common].sum() / max(before[common].sum(), 1e-9) if common.any() else 0.0
                settled = bool(solved.all()) or solved.sum() == np.isfinite(before).sum()
                if settled and shorter < LEAST_GAIN:
                    return graph, True
            if 2 * len(roadmap) > 1.1 * settings.max_spread_landmarks:
                return graph, True
            before = costs
        if NEXT * (perf_counter() - begin) > seconds_left():
            return graph, False


def spread_landmarks(
    roadmap: Roadmap,
    count: int,
    rng: np.random.Generator,
    settings: PlannerSettings,
    *,
    seconds_left: Callable[[], float] = _forever,
    report: Callable[[], object] | None = None,
) -> int:
    """Add landmarks spread evenly over all free space: K-means centres of a Halton sequence's valid samples.

    They are placed in parts, each as large as all before and clustered from the samples that lie farthest from those.
    Fewer than asked for come back where some centres share their nearest sample.

    Returns:
        How many of ``count`` were dealt with; fewer if the time was up.

    Raises:
        ConfigurationError: no free place for the robot.
    """
    placed, part = 0, SMALLEST
    while placed < count:
        begin = perf_counter()
        part = min(part, count - placed)
        _spread(roadmap, part, rng, settings)
        placed += part
        if report is not None:
            report()
        took, part = (perf_counter() - begin) / part, placed
        if placed < count and 0.5 * NEXT * took * min(part, count - placed) > seconds_left():
            break
    return placed


def _spread(roadmap: Roadmap, count: int, rng: np.random.Generator, settings: PlannerSettings) -> None:
    """Add one part of landmarks."""
    from scipy.spatial import cKDTree  # here, since most plans need none of it

    checker, radius = roadmap.checker, roadmap.motion.radius
    wanted = settings.samples_per_landmark * count
    samples = free_samples(checker, DRAWN * wanted if len(roadmap) else wanted, method="halton", random_state=rng)
    if len(samples) == 0:
        raise ConfigurationError(f"world {checker.world.name!r}: no free place for the robot was found")
    if len(roadmap):
        kept = max(count, int(FARTHEST * len(samples)))
        samples = farthest_samples(samples, roadmap.configurations, kept, radius=radius)
    # Landmarks come in the samples' order, and what is near in space is looked at together from here on.
    samples = samples[cKDTree(se2.embed(samples, radius)).indices]
    roadmap.add(k_means_landmarks(samples, count, radius=radius, steps=SPREAD_STEPS, random_state=rng))


def _joined(relaxation: Relaxation, pairs: FloatArray, seconds_left: Callable[[], float]) -> np.ndarray:
    """Return which of the pairs, shape (n, 2, 3), the relaxed problem may join, shape (n,), as far as there is time."""
    cells = relaxation.cells(relaxation.disc_centers(pairs))
    undecided, joined = np.ones(len(pairs), np.bool_), np.zeros(len(pairs), np.bool_)
    for i in range(len(pairs)):
        if undecided[i] and seconds_left() > 0.0:
            # Pairs of this part are decided at once: hardly any world has more than a few.
            reached = relaxation.component(pairs[i, 0])
            of_part = undecided & reached[cells[:, 0]]
            of_part[i] = True
            joined[of_part] = reached[cells[of_part, 1]]
            undecided &= ~of_part
    return joined
