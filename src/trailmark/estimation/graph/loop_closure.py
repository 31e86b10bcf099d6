"""Places that were seen before: loop closures, other visits to a place, and where a lost robot may be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.graph.graph_settings import (
    LOCAL_SCANS,
    LOOP_AMBIGUITY,
    LOOP_SCORE,
    OUTLIER_GATE,
    WINDOW,
    GraphSettings,
)
from trailmark.estimation.graph.pose_graph import MIN_POINTS, KeyScans, Relation, in_frame
from trailmark.estimation.logs.records import Scan
from trailmark.estimation.scans.clouds import PointCloud, relative, surface_cloud, transformed
from trailmark.estimation.scans.correlation import ELSEWHERE, Window, match_covariance, search
from trailmark.estimation.scans.local_map import in_view
from trailmark.estimation.scans.matching import refine
from trailmark.se2 import FloatArray, compose

__all__ = ["LoopFinder", "places_like", "revisit_relations"]

MAX_WINDOW = Window(10.0, math.pi)
"""The largest window that is searched."""

OPEN = 0.01
"""Square metres: what is farther open than that along a corridor is held by odometry, or where that is better, by four
times its variance."""

UNSEEN = 0.5
"""Likelihood of an end point where no scan of the map saw: it tells neither for a match nor against it."""

MAX_CANDIDATES = 6
"""Earlier places, at most, that one scan is compared with."""


SEARCHED = 200
"""End points, at most, that are looked for in the whole map."""

HEADINGS = 8
"""Parts of a full turn in which it is looked for one by one."""

FAR = 1e6
"""Metres: all of a map."""

IntArray = NDArray[np.intp]

MAX_VISITS = 4
"""Earlier and later visits, at most, that one scan is matched against: the nearest ones."""

MAX_SHIFT = 0.3, np.radians(5.0)
"""Metres and radians: what is matched farther from where the optimised graph has it than this is something else."""


class LoopFinder:
    """Finds closures scan by scan; one counts once a second one, of another scan, agrees with it."""

    def __init__(self, keys: KeyScans, settings: GraphSettings) -> None:
        self._keys = keys
        self._s = settings
        self._pending: list[Relation] = []
        self._drift = Drift(settings)
        self._read = 0  # relations
        self._ends = np.empty((0, 2), dtype=np.intp)
        self._gate = float(chi_square_quantile(OUTLIER_GATE, 3))

    def find(self, k: int) -> list[Relation]:
        """Return the closures that scan k confirms, its own among them."""
        away = self._graph_distances(k)
        confirmed = list[Relation]()
        for place in self._candidates(k, away):
            closure = self._match(k, place, away[place])
            if closure is None:
                continue
            partners = [other for other in self._pending if self._agree(closure, other)]
            if partners:
                self._pending = [other for other in self._pending if not any(other is p for p in partners)]
                confirmed += [*partners, closure]
            else:
                self._pending.append(closure)
        recent = self._keys.travel[k] - 3.0 * self._s.local_length
        self._pending = [other for other in self._pending if self._keys.travel[other.b] >= recent]
        return [self._with_errors_of_maps(closure) for closure in confirmed]

    def drifts(self, k: int) -> FloatArray:
        """Return how each scan is related to scan k: metres along relations, and what drifts on them, shape (n, 2)."""
        away = self._graph_distances(k)
        return np.column_stack([away, self._drift.sigma(away)[0]])

    def _graph_distances(self, k: int) -> FloatArray:
        """Return how many metres along relations each scan is away from scan k, shape (n,)."""
        keys, n = self._keys, len(self._keys)
        new = keys.relations[self._read :]
        self._read += len(new)
        for relation in new:
            self._drift.add(relation)
        pairs = np.vstack([self._ends, *([relation.a, relation.b] for relation in new)])
        # Two relations of the same pair would count as one of their lengths' sum.
        _, one = np.unique(pairs[:, 0] * n + pairs[:, 1], return_index=True)
        self._ends = pairs[one]
        a, b = self._ends.T
        lengths = np.hypot(*(keys.poses[a, :2] - keys.poses[b, :2]).T) + 1e-3
        graph = coo_array((lengths, (a, b)), shape=(n, n)).tocsr()
        return np.asarray(dijkstra(graph, directed=False, indices=[k])[0])

    def _candidates(self, k: int, away: FloatArray) -> list[int]:
        """Return the nearest scan of each stretch of the drive that may have seen the same, the likeliest first."""
        keys, s = self._keys, self._s
        sigma, _ = self._drift.sigma(away)
        apart = np.hypot(*(keys.poses[:, :2] - keys.poses[k, :2]).T)
        possible = (away > 2.0 * s.local_length) & (apart <= s.loop_distance + np.minimum(2.0 * sigma, MAX_WINDOW.xy))
        places = np.flatnonzero(possible)
        runs = np.split(places, np.flatnonzero(np.diff(places) > 1) + 1)
        nearest = list[int]()
        for run in runs:
            # A long stretch has several places.
            parts = np.floor(keys.travel[run] / s.local_length)
            for part in np.unique(parts):
                own = run[parts == part]
                nearest.append(int(own[apart[own].argmin()]))
        return sorted(nearest, key=lambda i: float(apart[i]))[:MAX_CANDIDATES]

    def _match(self, k: int, place: int, away: float) -> Relation | None:
        """Return where scan k, with those just before it, lies in the map around a place; None if nowhere for sure."""
        keys, s = self._keys, self._s
        query = keys.query(keys.chain(k, 0.5 * s.local_length, LOCAL_SCANS, before=True), k)
        sigma, sigma_theta = self._drift.sigma(np.array([away]))
        window = Window(
            float(np.clip(3.0 * sigma[0], 2.0 * WINDOW[0], MAX_WINDOW.xy)),
            float(np.clip(3.0 * sigma_theta[0], WINDOW[1], MAX_WINDOW.theta)),
        )
        chain = keys.chain(place, 2.0 * s.local_length, LOCAL_SCANS)
        guess = keys.poses[k]
        area = keys.area(chain, guess, float(np.abs(query.points).max()) * 1.5 + window.xy, window.xy)
        found = search(area, query.points, guess, window, coarseness=2, min_score=LOOP_SCORE)
        if found is None:
            return None
        limit = LOOP_AMBIGUITY * found.score
        if search(area, query.points, guess, window, coarseness=2, min_score=limit, apart_from=found.pose):
            return None
        found, near = refine(area, query, found.pose), refine(area, query, guess)
        apart = np.abs(relative(near.pose, found.pose))
        if np.hypot(*apart[:2]) > ELSEWHERE.xy or apart[2] > ELSEWHERE.theta:
            # Where the graph has the scan, much of it may lie beyond what the map's scans saw.
            known = near.score + UNSEEN * (1.0 - self._seen_share(query, near.pose, chain))
            other = found.score + UNSEEN * (1.0 - self._seen_share(query, found.pose, chain))
            if known > LOOP_AMBIGUITY * other:
                return None
        covariance, is_open = match_covariance(area, keys.clouds[k].points, found.pose, scatter=s.scatter)
        return None if is_open else keys.related(place, k, found.pose, covariance, certain=False)

    def _seen_share(self, query: PointCloud, pose: FloatArray, chain: NDArray[np.intp]) -> float:
        """Return the share of a cloud's points, at a pose, that lie where the scans of a chain saw."""
        keys = self._keys
        seen = [in_view(keys.clouds[i], transformed(query, relative(keys.poses[i], pose)).points) for i in chain]
        return float(np.any(seen, axis=0).mean())

    def _with_errors_of_maps(self, closure: Relation) -> Relation:
        """Return a closure with the errors inside the two maps that it joins; whether two agree is asked without."""
        keys, s = self._keys, self._s
        recent = keys.chain(closure.b, 0.5 * s.local_length, LOCAL_SCANS, before=True)
        spread = keys.spread(recent, closure.b)
        spread = spread + keys.spread(keys.chain(closure.a, 2.0 * s.local_length, LOCAL_SCANS), closure.a)
        return closure._replace(covariance=closure.covariance + in_frame(spread, keys.poses[closure.b, 2]))

    def _agree(self, one: Relation, other: Relation) -> bool:
        """Return whether two closures of different scans say the same, by the graph between their ends."""
        keys, s = self._keys, self._s
        if one.b == other.b:
            return False
        gaps = np.array(
            [abs(keys.travel[one.b] - keys.travel[other.b]), abs(keys.travel[one.a] - keys.travel[other.a])]
        )
        if gaps.max() > 3.0 * s.local_length:
            return False
        # From one's a to the other's a, by it to its b, on to one's b.
        path = compose(relative(keys.poses[one.a], keys.poses[other.a]), other.pose)
        path = compose(path, relative(keys.poses[other.b], keys.poses[one.b]))
        error = relative(one.pose, path)
        sigma, sigma_theta = self._drift.sigma(gaps)
        theta = float((sigma_theta**2).sum())
        own = np.diag([float((sigma**2).sum()), float((sigma**2).sum()), theta])
        # A heading's error acts over the distance between the two.
        lever = float(np.hypot(*relative(keys.poses[other.b], keys.poses[one.b])[:2]))
        own[0, 0] += lever**2 * other.covariance[2, 2]
        own[1, 1] += lever**2 * other.covariance[2, 2]
        total = own + one.covariance + other.covariance
        return bool(error @ np.linalg.solve(total, error) <= self._gate)


class Drift:
    """How errors grow along consecutive scans.

    They add up as a random walk: the heading's variance grows with the distance L, and with it the place's by the
    heading's rate times L³/3. The rates are those of the relations that are certain; where odometry and a match relate
    the same two scans, of both together.
    """

    def __init__(self, settings: GraphSettings) -> None:
        self._length, self._place, self._heading = 1e-9, 0.0, 0.0
        self._open = min(OPEN, 4.0 * float(settings.odometry_noise(np.array([settings.key_distance, 0.0, 0.0]))[0, 0]))
        self._last = -1, -1  # the scans of the last relation
        self._own = np.zeros(3)  # what it added

    def add(self, relation: Relation) -> None:
        """Count a relation, if it is certain."""
        if not relation.certain:
            return
        place = 0.5 * float(np.minimum(np.diag(relation.covariance)[:2], self._open).sum())
        own = np.array([float(np.hypot(*relation.pose[:2])), place, float(relation.covariance[2, 2])])
        again = (relation.a, relation.b) == self._last
        if again:
            own[1:] = 1.0 / (1.0 / own[1:] + 1.0 / self._own[1:])
            own -= self._own
        self._length, self._place, self._heading = self._length + own[0], self._place + own[1], self._heading + own[2]
        self._last, self._own = (relation.a, relation.b), own + self._own if again else own

    def sigma(self, distances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the standard deviations of place (metres) and heading (radians) over distances in metres."""
        place, heading = self._place / self._length, self._heading / self._length
        return np.sqrt(place * distances + heading * distances**3 / 3.0), np.sqrt(heading * distances)


def places_like(scan: Scan, keys: KeyScans, settings: GraphSettings) -> FloatArray:
    """Return where a scan may have been taken, shape (k, 3): the best place for each heading.

    Args:
        scan: of the lost robot.
        keys: the map.
        settings: how scans are matched.
    """
    cloud = surface_cloud(scan, settings.max_range)
    if len(cloud.points) < MIN_POINTS or not len(keys):
        return np.empty((0, 3))
    area = keys.area(np.arange(len(keys)), keys.poses[0], FAR, FAR)
    low, high = area.points.min(axis=0), area.points.max(axis=0)
    points = cloud.points[:: -(-len(cloud.points) // SEARCHED)]
    window = Window(0.5 * float((high - low).max()), math.pi / HEADINGS)
    found = list[FloatArray]()
    for heading in 2.0 * math.pi * np.arange(HEADINGS) / HEADINGS:
        guess = np.append(0.5 * (low + high), heading)
        match = search(area, points, guess, window, coarseness=2, min_score=0.5 * LOOP_SCORE)
        if match is not None:
            found.append(refine(area, cloud, match.pose).pose)
    return np.array(found).reshape(-1, 3)


def revisit_relations(keys: KeyScans, settings: GraphSettings) -> list[Relation]:
    """Return where each scan lies in the maps of the other visits to its place, from the poses that it has now."""
    s, found = settings, list[Relation]()
    stretches = np.floor(keys.travel / (0.5 * s.local_length)).astype(np.intp)
    visitors = _visitors(keys, stretches, s)
    for stretch in np.unique(stretches):
        if len(visitors[stretch]) == 0:
            continue
        own = np.flatnonzero(stretches == stretch)
        middle = int(own[len(own) // 2])
        # One map for all scans that see this stretch.
        chain = keys.chain(middle, 1.5 * s.local_length, LOCAL_SCANS)
        area = keys.area(chain, keys.poses[middle], s.max_range + s.loop_distance, 0.0)
        for k in visitors[stretch]:
            cloud = keys.clouds[k]
            match = refine(area, cloud, keys.poses[k])
            shift = relative(keys.poses[k], match.pose)
            if match.score < LOOP_SCORE or np.hypot(*shift[:2]) > MAX_SHIFT[0] or abs(shift[2]) > MAX_SHIFT[1]:
                continue
            covariance, _ = match_covariance(area, cloud.points, match.pose, scatter=s.scatter)
            place = int(own[np.hypot(*(keys.poses[own, :2] - match.pose[:2]).T).argmin()])
            covariance = covariance + keys.spread(chain, place)
            found.append(keys.related(place, k, match.pose, covariance, certain=False))
    return found


def _visitors(keys: KeyScans, stretches: IntArray, s: GraphSettings) -> list[list[int]]:
    """Return for each stretch the scans of other visits that see it: each scan is in the lists of the nearest ones."""
    visitors: list[list[int]] = [[] for _ in range(stretches[-1] + 1)]
    for k, cloud in enumerate(keys.clouds):
        if len(cloud.points) < MIN_POINTS:
            continue
        apart = np.hypot(*(keys.poses[:, :2] - keys.poses[k, :2]).T)
        near = np.flatnonzero(
            (apart <= 0.5 * s.loop_distance) & (np.abs(keys.travel - keys.travel[k]) > s.local_length)
        )
        nearest = near[np.argsort(apart[near], kind="stable")]
        _, first = np.unique(stretches[nearest], return_index=True)
        for at in np.sort(first)[:MAX_VISITS]:
            visitors[stretches[nearest[at]]].append(k)
    return visitors
