"""Scans as nodes of a graph: local maps made of them, loop closures, and the poses that all comes to, by gtsam."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from trailmark.arguments import NonNegative, Positive, checked_fields
from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.landmark_graph import IntArray, LinearSystem, rotations, turned
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_matching import (
    ELSEWHERE,
    LocalMap,
    PointCloud,
    Window,
    in_view,
    joined,
    levels_for,
    local_map,
    match_covariance,
    off_surfaces,
    refine,
    search,
    surface_cloud,
    transformed,
)
from trailmark.se2 import FloatArray, between

# Radians of rotation from one node of the graph to the next: what is seen has hardly changed in between.
KEY_ANGLE = math.radians(15.0)
LOCAL_SCANS = 15  # Scans of a local map, at most.
# Nodes from which on a scan where the graph has one already gets none of its own: memory is bounded by the places
# that were seen, not by the time of the drive.
MAX_NODES = 3000
# How far from what odometry says a match is searched for at least: metres along x and y each, radians.
WINDOW = (0.5, math.radians(20.0))
LOOP_SCORE = 0.55  # Mean likelihood of the end points that a loop closure needs.
LOOP_AMBIGUITY = 0.9  # Share of its likelihood that no other place within the window may have.
ROUNDS = 2  # How often each scan is matched against the maps of all other visits to its place, and the graph optimised.
OUTLIER_GATE = 0.999  # Probability with which a right closure is consistent with the optimised graph.


@dataclass(frozen=True)
class GraphSettings:
    """How scans are matched, and loops closed."""

    # Times the lengths below, for sensors that see, and robots that drive, farther than those of a building.
    scale: Positive = 1.0
    # Metres: end points farther away are not matched. A heading's error of a third of a degree moves them by 0.1
    # m.
    max_range: Positive = 20.0
    # Metres by which end points lie off the surfaces that they belong to, one standard deviation: the scanner's
    # noise, and what moves, leans or is not flat. As sure is a match; in a world of walls it is the scanner's
    # noise alone.
    scatter: Positive = 0.1
    # Standard deviation of odometry: metres for each metre, radians for each radian.
    odometry: tuple[NonNegative, NonNegative] = (0.1, 0.1)
    # The least standard deviation of a step by odometry: metres, radians.
    odometry_floor: tuple[Positive, Positive] = (0.05, 0.05)

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)

    @property
    def filled_gap(self) -> float:
        """Metres between neighbouring end points of one straight surface from which on local maps have the line.

        Without it each of such points would count as a shape of its own, the sooner the less they scatter.
        """
        return max(0.1, 8.0 * self.scatter)

    @property
    def key_distance(self) -> float:
        """Metres of motion from one node of the graph to the next: what is seen has hardly changed in between."""
        return 0.4 * self.scale

    @property
    def local_length(self) -> float:
        """Metres of driving over which the scans before one make its local map: beyond, matching has drifted."""
        return 10.0 * self.scale

    @property
    def loop_distance(self) -> float:
        """Metres between two places from which mostly the same is seen."""
        return 8.0 * self.scale

    def odometry_noise(self, step: FloatArray) -> FloatArray:
        """Return the covariance of a step by odometry, x, y and theta, shape (3,), as of shape (3, 3)."""
        (place, heading), (floor, floor_theta) = self.odometry, self.odometry_floor
        length = float(np.hypot(*step[:2]))
        xy = floor**2 + (place * length) ** 2
        return np.diag([xy, xy, floor_theta**2 + (0.5 * heading * length) ** 2 + (heading * step[2]) ** 2])


BoolArray = NDArray[np.bool_]


MIN_POINTS = 10  # End points that a scan needs to be matched: fewer do not show a shape.
THIN = 0.1  # Metres: a cloud of several scans has one point for each square of this side.
# Metres and radians by which the maps of two visits to a place disagree, each with the errors of its own scans, which
# all matches between the two have in common.
REVISITED = 0.003, 0.001
MAX_POINTS = 300  # Points of such a cloud, at most: more make a search slower, and hardly surer.


class Relation(NamedTuple):
    """Where one pose lies in the frame of another, as it was measured."""

    a: int
    b: int
    pose: FloatArray  # Of b in a's frame, shape (3,).
    covariance: FloatArray  # Of x, y, theta in the frame of b, shape (3, 3).
    certain: bool = True  # Whether it is taken as right: consecutive scans; a loop closure may be wrong as a whole.


def optimise(relations: Sequence[Relation], poses: FloatArray, gate: float = 0.999) -> tuple[FloatArray, BoolArray]:
    """Return the poses that fit the relations best, the first one as given, and which relations count.

    Relations that are not certain may turn out to be wrong: graduated non-convexity (Yang et al. 2020, "Graduated
    non-convexity for robust spatial perception", truncated least squares) drops those whose residual is beyond
    the ``gate`` quantile of chi-square. Poses to begin with have the shape (n, 3).
    """
    import gtsam

    graph, values = _graph(relations, poses)
    params = gtsam.LevenbergMarquardtParams()
    best = gtsam.LevenbergMarquardtOptimizer(graph, values, params).optimize()
    counts = np.ones(len(relations), dtype=bool)
    loose = [i for i, relation in enumerate(relations) if not relation.certain]
    errors = np.array([graph.at(i).error(best) for i in loose])
    limit = 0.5 * float(chi_square_quantile(gate, 3))
    if (errors > limit).any():
        gnc = gtsam.GncLMParams(params)
        gnc.setLossType(gtsam.GncLossType.TLS)
        certain = [i for i, relation in enumerate(relations) if relation.certain]
        gnc.setKnownInliers([*certain, len(relations)])
        optimizer = gtsam.GncLMOptimizer(graph, values, gnc)
        optimizer.setInlierCostThresholds(limit)
        best = optimizer.optimize()
        counts = np.asarray(optimizer.getWeights())[: len(relations)] > 0.5
    return _poses_of(best, len(poses)), counts


def pose_covariances(relations: Sequence[Relation], poses: FloatArray) -> FloatArray:
    """Return the covariance of each pose in the frame of the first one, shape (n, 3, 3), in the world's axes."""
    return _covariances(*_graph(relations, poses), rotations(poses[:, 2]))


def relative_covariances(relations: Sequence[Relation], poses: FloatArray) -> FloatArray:
    """Return the covariance of each pose relative to the places of all, shape (n, 3, 3), at an optimum.

    A graph's frame is that of its first pose, so that an error of the first heading turns everything. Within the map
    nothing is wrong by that: Baarda's S-transformation (:mod:`trailmark.estimation.landmark_graph`) takes it out, here
    without the joint covariance of all poses, which is large.

    Returns:
        Of x, y and theta, in the world's axes.
    """
    n = len(poses)
    graph, values = _graph(relations, poses)
    turn = rotations(poses[:, 2])
    own = _covariances(graph, values, turn)
    # What a shift and a turn of the frame do to each pose, and the ones that align the places best.
    frame = np.zeros((n, 3, 3))
    frame[:, 0, 0] = frame[:, 1, 1] = frame[:, 2, 2] = 1.0
    away = poses[:, :2] - poses[:, :2].mean(axis=0)
    frame[:, 0, 2], frame[:, 1, 2] = -away[:, 1], away[:, 0]
    align = np.zeros((n, 3, 3))
    align[:, :, :2] = np.linalg.pinv(frame[:, :2].reshape(-1, 3)).reshape(3, n, 2).transpose(1, 0, 2)
    rows, columns, entries = graph.linearize(values).sparseJacobian_()
    system = LinearSystem(rows, columns, entries, 3 * n)
    local = (align @ turn).transpose(0, 2, 1).reshape(3 * n, 3)
    shared = turn @ system.factor.solve(local).reshape(n, 3, 3)
    total = np.einsum("nij,njk->ik", align, shared)
    crossed = shared @ frame.transpose(0, 2, 1)
    return np.asarray(own - crossed - crossed.transpose(0, 2, 1) + frame @ total @ frame.transpose(0, 2, 1))


def _covariances(graph: Any, values: Any, turn: FloatArray) -> FloatArray:
    """Return the poses' covariances in the frame of the first one, in the world's axes."""
    import gtsam

    # Not by gtsam.Marginals: its Cholesky factors fail where headings are known to 1e-4 and far places to metres.
    tree = graph.linearize(values).eliminateMultifrontal(function=gtsam.EliminateQR)
    own = np.array([tree.marginalCovariance(i) for i in range(len(turn))])
    return np.asarray(turn @ own @ turn.transpose(0, 2, 1))


def _graph(relations: Sequence[Relation], poses: FloatArray) -> tuple[Any, Any]:
    """Return factors, one for each relation and last the first pose's, and values."""
    import gtsam

    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for i, pose in enumerate(poses):
        values.insert(i, gtsam.Pose2(*pose))
    for relation in relations:
        # Not of the covariance as it is: gtsam leaves out what lies beside its diagonal where it is under 1e-9.
        upper = np.linalg.cholesky(np.linalg.inv(relation.covariance)).T
        noise = gtsam.noiseModel.Gaussian.SqrtInformation(upper, False)
        graph.add(gtsam.BetweenFactorPose2(relation.a, relation.b, gtsam.Pose2(*relation.pose), noise))
    graph.add(gtsam.PriorFactorPose2(0, gtsam.Pose2(*poses[0]), gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)))
    return graph, values


def _poses_of(values: Any, n: int) -> FloatArray:
    return np.array([(p.x(), p.y(), p.theta()) for p in (values.atPose2(i) for i in range(n))])


class KeyScans:
    """Scans with their poses, in the order of time, and the relations between them.

    Args:
        gap: metres between neighbouring end points of a surface from which on local maps have the line between them.
    """

    def __init__(self, gap: float) -> None:
        self._gap = gap
        self.clouds: list[PointCloud] = []  # of each, in the robot's frame
        self.poses = np.empty((0, 3))
        self.travel = np.empty(0)  # metres driven before each
        self.steps = np.empty((0, 3, 3))  # covariance of each pose beside the one before, in the world's axes
        self.relations: list[Relation] = []

    def __len__(self) -> int:
        return len(self.clouds)

    def add(self, cloud: PointCloud, pose: FloatArray, step: FloatArray, gap: float = 0.0) -> None:
        """Add a scan after the others, ``gap`` metres further on than its place says.

        ``step`` is the covariance of its pose beside the last scan's, shape (3, 3), in the world's axes.
        """
        way = 0.0 if not self.clouds else self.travel[-1] + float(np.hypot(*(pose - self.poses[-1])[:2])) + gap
        self.clouds.append(cloud)
        self.poses, self.travel = np.vstack([self.poses, pose]), np.append(self.travel, way)
        self.steps = np.concatenate([self.steps, step[None]])

    def chain(self, middle: int, length: float, count: int, *, before: bool = False) -> IntArray:
        """Return the scans around one: at most ``count`` of them, at most half of ``length`` metres driven from it.

        With ``before``, the scans up to that one, at most ``length`` metres before it.
        """
        reach = length if before else 0.5 * length
        first = int(np.searchsorted(self.travel, self.travel[middle] - reach))
        last = middle + 1 if before else int(np.searchsorted(self.travel, self.travel[middle] + reach, side="right"))
        half = count - 1 if before else count // 2
        return np.arange(max(first, middle - half), min(last, middle + half + 1))

    def area(self, chosen: IntArray, centre: FloatArray, reach: float, window: float) -> LocalMap:
        """Return the local map that some scans make, within ``reach`` metres of a place along each axis.

        It has the resolutions that a search over ``window`` metres to either side needs.
        """
        cloud = joined([self.clouds[i] for i in chosen], self.poses[chosen])
        x, y = float(centre[0]), float(centre[1])
        return local_map(cloud, (x - reach, y - reach, x + reach, y + reach), levels_for(window), self._gap)

    def spread(self, chain: IntArray, middle: int) -> FloatArray:
        """Return the mean covariance of a chain's scans beside one of them, shape (3, 3), in the world's axes.

        Along a corridor, where odometry alone holds each scan by the one before, the map that they make is no surer.
        """
        first, last = int(chain[0]), int(chain[-1])
        step = np.arange(first + 1, last + 1)
        beyond = np.where(step > middle, last - step + 1, step - first)  # scans that lie on its other side
        return np.asarray(np.einsum("n,nij->ij", beyond / len(chain), self.steps[step]))

    def seen_by(self, chain: IntArray, cloud: PointCloud, pose: FloatArray) -> BoolArray:
        """Return which of a cloud's points, at a pose, lie where the scans of a chain saw, shape (m,)."""
        seen = [in_view(self.clouds[i], transformed(cloud, between(self.poses[i], pose)).points) for i in chain]
        return np.asarray(np.any(seen, axis=0))

    def query(self, chosen: IntArray, frame: int) -> PointCloud:
        """Return what some scans show, in the frame of one of them, thinned."""
        cloud = joined([self.clouds[i] for i in chosen], between(self.poses[frame], self.poses[chosen]))
        place = np.floor(cloud.points / THIN).astype(np.int64)
        _, one = np.unique(place[:, 0] * 2**31 + place[:, 1], return_index=True)
        one = one[:: -(-len(one) // MAX_POINTS)]
        return PointCloud(*(array[one] for array in cloud))

    def related(self, a: int, b: int, pose: FloatArray, covariance: FloatArray, *, certain: bool) -> Relation:
        """Return the relation that the pose of b, found in the world where a lies as it does now, stands for.

        The covariance of that pose, shape (3, 3), is in the world's axes.
        """
        if not certain:
            covariance = covariance + np.diag([REVISITED[0] ** 2, REVISITED[0] ** 2, REVISITED[1] ** 2])
        return Relation(a, b, between(self.poses[a], pose), in_frame(covariance, pose[2]), certain)


def in_frame(covariance: FloatArray, heading: float) -> FloatArray:
    """Return a covariance of x, y, theta in the world's axes, shape (3, 3), in those of a frame with that heading."""
    return np.asarray(turned(covariance[None], np.array([-heading]))[0])


LOOP_WINDOW = Window(10.0, math.pi)  # The largest window that is searched.
# Square metres: what is farther open than that along a corridor is held by odometry, or where that is better, by four
# times its variance.
OPEN = 0.01
UNSEEN = 0.5  # Likelihood of an end point where no scan of the map saw: it tells neither for a match nor against it.
MAX_CANDIDATES = 6  # Earlier places, at most, that one scan is compared with.
SEARCHED = 200  # End points, at most, that are looked for in the whole map.
HEADINGS = 8  # Parts of a full turn in which it is looked for one by one.
FAR = 1e6  # Metres: all of a map.

MAX_VISITS = 4  # Earlier visits, at most, that one scan is matched against: the nearest ones.
# Metres and radians: what is matched farther from where the optimised graph has it than this is something else.
MAX_SHIFT = 0.3, np.radians(5.0)


class LoopFinder:
    """Finds loop closures scan by scan, by how errors grow along consecutive ones.

    They add up as a random walk: the heading's variance grows with the distance L, and with it the place's by the
    heading's rate times L³/3. The rates are those of the relations that are certain.
    """

    def __init__(self, keys: KeyScans, settings: GraphSettings) -> None:
        self._keys, self._s = keys, settings
        self._read = 0  # relations
        self._ends = np.empty((0, 2), dtype=np.intp)
        self._length, self._errors = 1e-9, np.zeros(2)  # of relations that are certain: metres, variances added up
        step = np.array([settings.key_distance, 0.0, 0.0])
        self._open = min(OPEN, 4.0 * float(settings.odometry_noise(step)[0, 0]))

    def find(self, k: int) -> list[Relation]:
        """Return where scan k, with those just before it, surely lies in the maps of places that were seen before."""
        away = self._graph_distances(k)
        found = [self._match(k, place, away[place]) for place in self._candidates(k, away)]
        return [closure for closure in found if closure is not None]

    def drifts(self, k: int) -> FloatArray:
        """Return how each scan is related to scan k: metres along relations, and what drifts on them, shape (n, 2)."""
        away = self._graph_distances(k)
        return np.column_stack([away, self._sigma(away)[0]])

    def _graph_distances(self, k: int) -> FloatArray:
        """Return how many metres along relations each scan is away from scan k, shape (n,)."""
        keys, n = self._keys, len(self._keys)
        new = keys.relations[self._read :]
        self._read += len(new)
        for relation in (relation for relation in new if relation.certain):
            x, y, theta = np.diag(relation.covariance)
            self._length += float(np.hypot(*relation.pose[:2]))
            self._errors += 0.5 * (min(x, self._open) + min(y, self._open)), theta
        pairs = np.vstack([self._ends, *([relation.a, relation.b] for relation in new)])
        # Two relations of the same pair would count as one of their lengths' sum.
        _, one = np.unique(pairs[:, 0] * n + pairs[:, 1], return_index=True)
        self._ends = pairs[one]
        a, b = self._ends.T
        lengths = np.hypot(*(keys.poses[a, :2] - keys.poses[b, :2]).T) + 1e-3
        graph = coo_array((lengths, (a, b)), shape=(n, n)).tocsr()
        return np.asarray(dijkstra(graph, directed=False, indices=[k])[0])

    def _sigma(self, distances: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the standard deviations of place (metres) and heading (radians) over distances in metres."""
        place, heading = self._errors / self._length
        return np.sqrt(place * distances + heading * distances**3 / 3.0), np.sqrt(heading * distances)

    def _candidates(self, k: int, away: FloatArray) -> list[int]:
        """Return the nearest scan of each stretch of the drive that may have seen the same, the likeliest first."""
        keys, s = self._keys, self._s
        sigma, _ = self._sigma(away)
        apart = np.hypot(*(keys.poses[:, :2] - keys.poses[k, :2]).T)
        possible = (away > 2.0 * s.local_length) & (apart <= s.loop_distance + np.minimum(2.0 * sigma, LOOP_WINDOW.xy))
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
        recent = keys.chain(k, 0.5 * s.local_length, LOCAL_SCANS, before=True)
        query = keys.query(recent, k)
        sigma, sigma_theta = self._sigma(np.array([away]))
        window = Window(
            float(np.clip(3.0 * sigma[0], 2.0 * WINDOW[0], LOOP_WINDOW.xy)),
            float(np.clip(3.0 * sigma_theta[0], WINDOW[1], LOOP_WINDOW.theta)),
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
        apart = np.abs(between(near.pose, found.pose))
        if np.hypot(*apart[:2]) > ELSEWHERE.xy or apart[2] > ELSEWHERE.theta:
            # Where the graph has the scan, much of it may lie beyond what the map's scans saw.
            unseen = [float((~keys.seen_by(chain, query, match.pose)).mean()) for match in (near, found)]
            known, other = near.score + UNSEEN * unseen[0], found.score + UNSEEN * unseen[1]
            if known > LOOP_AMBIGUITY * other:
                return None
        covariance, is_open = match_covariance(area, keys.clouds[k].points, found.pose, scatter=s.scatter)
        if is_open:
            return None
        # The errors inside the two maps that it joins.
        covariance = covariance + keys.spread(recent, k) + keys.spread(chain, place)
        return keys.related(place, k, found.pose, covariance, certain=False)


def places_like(scan: Scan, keys: KeyScans, settings: GraphSettings) -> FloatArray:
    """Return where a scan may have been taken, shape (k, 3): the best place for each heading."""
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


def stretches_of(keys: KeyScans, settings: GraphSettings) -> IntArray:
    """Return which stretch of the drive each scan belongs to, shape (n,)."""
    return np.floor(keys.travel / (0.5 * settings.local_length)).astype(np.intp)


class _Visit(NamedTuple):
    """A stretch of the drive, and scans of later visits to it."""

    own: IntArray  # Its scans.
    chain: IntArray  # Those that its local map is made of.
    area: LocalMap
    later: list[int]


def _visits(
    keys: KeyScans, s: GraphSettings, low: float, high: float, without: Collection[tuple[int, int]] = ()
) -> Iterator[_Visit]:
    """Yield each stretch with the scans of later visits that were taken from ``low`` to ``high`` metres away.

    Each scan is with the nearest stretches; pairs of stretch and scan that are in ``without`` are left out.
    """
    stretches = stretches_of(keys, s)
    visitors: list[list[int]] = [[] for _ in range(stretches[-1] + 1)]
    for k, cloud in enumerate(keys.clouds):
        if len(cloud.points) < MIN_POINTS:
            continue
        apart = np.hypot(*(keys.poses[:, :2] - keys.poses[k, :2]).T)
        # Of earlier visits alone: what each of two visits says of the other is the same.
        near = np.flatnonzero((apart >= low) & (apart <= high) & (keys.travel[k] - keys.travel > s.local_length))
        nearest = near[np.argsort(apart[near], kind="stable")]
        _, first = np.unique(stretches[nearest], return_index=True)
        for stretch in stretches[nearest[np.sort(first)[:MAX_VISITS]]].tolist():
            if (stretch, k) not in without:
                visitors[stretch].append(k)
    for stretch, later in enumerate(visitors):
        if later:
            own = np.flatnonzero(stretches == stretch)
            middle = int(own[len(own) // 2])
            # One map for all scans that see this stretch.
            chain = keys.chain(middle, 1.5 * s.local_length, LOCAL_SCANS)
            area = keys.area(chain, keys.poses[middle], s.max_range + s.loop_distance, 0.0)
            yield _Visit(own, chain, area, later)


def revisit_relations(keys: KeyScans, settings: GraphSettings) -> list[Relation]:
    """Return where each scan lies in the maps of earlier visits to its place, from the poses that it has now."""
    s, found = settings, list[Relation]()
    for own, chain, area, later in _visits(keys, s, 0.0, 0.5 * s.loop_distance):
        for k in later:
            cloud = keys.clouds[k]
            match = refine(area, cloud, keys.poses[k])
            shift = between(keys.poses[k], match.pose)
            if match.score < LOOP_SCORE or np.hypot(*shift[:2]) > MAX_SHIFT[0] or abs(shift[2]) > MAX_SHIFT[1]:
                continue
            covariance, _ = match_covariance(area, cloud.points, match.pose, scatter=s.scatter)
            place = int(own[np.hypot(*(keys.poses[own, :2] - match.pose[:2]).T).argmin()])
            covariance = covariance + keys.spread(chain, place)
            found.append(keys.related(place, k, match.pose, covariance, certain=False))
    return found


OFF = 0.25  # Metres from all surfaces that were seen before from which on an end point contradicts them.
IN_VIEW = 0.5  # Share of a scan's end points, at least, that must lie where the earlier visit saw.


class Revisits(NamedTuple):
    """How scans agree with what was seen of their places long before, where no relation of the graph joins the two."""

    scans: int  # Pairs of a scan and an earlier visit.
    off: float | None  # Share of the end points that lie OFF what was seen before; at most that in nine of ten pairs.
    worst: FloatArray | None  # Where most of them do, shape (2,).
    chi_square: tuple[float | None, ...]  # Mean by its expectation, of consecutive scans and of closures.

    def figures(self) -> dict[str, Any]:
        """Return them as plain data that JSON can hold."""
        steps, closures = self.chi_square
        return {"scans": self.scans, "off": self.off, "chi_square": {"steps": steps, "closures": closures}}


def judge_revisits(keys: KeyScans, relations: Sequence[Relation], settings: GraphSettings) -> Revisits:
    """Return how right poses are by what did not make them; see :class:`Revisits`."""
    s, stretches, shares, places = settings, stretches_of(keys, settings), list[float](), list[FloatArray]()
    joined = {(int(stretches[r.a]), r.b) for r in relations}
    # Farther apart than scans are matched, and where much of the same is still seen.
    for _, chain, area, later in _visits(keys, s, 0.5 * s.loop_distance, s.loop_distance, joined):
        for k in later:
            seen = keys.seen_by(chain, keys.clouds[k], keys.poses[k])
            if seen.mean() >= IN_VIEW:
                points = transformed(keys.clouds[k], keys.poses[k]).points[seen]
                shares.append(float((off_surfaces(area, points) > OFF).mean()))
                places.append(keys.poses[k, :2])
    a, b, sure = (np.array(column) for column in zip(*((r.a, r.b, r.certain) for r in relations), strict=True))
    error = between(np.array([r.pose for r in relations]), between(keys.poses[a], keys.poses[b]))
    squares = np.einsum("ni,nij,nj->n", error, np.linalg.inv([r.covariance for r in relations]), error) / 3.0
    chi_square = tuple(float(squares[kind].mean()) if kind.any() else None for kind in (sure, ~sure))
    if not shares:
        return Revisits(0, None, None, chi_square)
    return Revisits(len(shares), float(np.quantile(shares, 0.9)), places[int(np.argmax(shares))], chi_square)
