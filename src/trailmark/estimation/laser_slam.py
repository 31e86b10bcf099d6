"""The poses of scans by scan matching and a pose graph.

Each scan is matched against a local map of those before it, from odometry on. Places that were seen before close loops.
At last each scan is matched against the maps of all earlier visits to its place, and all relations are optimised
together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.pose_graph import (
    KEY_ANGLE,
    LOCAL_SCANS,
    LOOP_AMBIGUITY,
    LOOP_SCORE,
    MAX_NODES,
    MIN_POINTS,
    OUTLIER_GATE,
    ROUNDS,
    WINDOW,
    GraphSettings,
    KeyScans,
    LoopFinder,
    Relation,
    Revisits,
    judge_revisits,
    optimise,
    places_like,
    pose_covariances,
    relative_covariances,
    revisit_relations,
    stretches_of,
)
from trailmark.estimation.records import Scan
from trailmark.estimation.scan_matching import (
    SIGMA,
    LocalMap,
    Match,
    PointCloud,
    Window,
    match_covariance,
    refine,
    refine_by_faces,
    search,
    surface_cloud,
)
from trailmark.se2 import FloatArray, between, compose, difference

# The largest window around what odometry says that is searched: beyond, it is no guess.
MAX_WINDOW = Window(2.0, np.radians(60.0))
# Times the distance between nodes from which on a step that does not fit what was seen before it is none of driving:
# the robot was carried, or the log jumps.
CARRIED = 5.0
# Share of a loop closure's score below which a scan does not fit where odometry has it, however much of it is new.
UNFIT = 0.5
# Where a scan is searched for that does not surely fit where odometry has it: near the last one, at every heading.
ALL_ROUND = Window(2.0, np.pi)
# Metres and radians per second that no robot is faster than: where odometry is missing, time alone bounds the motion.
FASTEST = 2.0, 3.0
# Score from which on a match near odometry's guess is right: of 180 scans of four logs that were turned by 25 degrees
# or more beside the guess, none that was matched more than 10 degrees off had more than 0.73.
SURE = 0.8
# Score that a match away from odometry's guess needs, with no other place that is nearly as good, to count as found;
# also the share of that score from which on the match near the guess stands against it. Right guesses had 0.6 and
# more, wrong ones 0.75 at most.
DECISIVE = 0.7
# Times what a match leaves unexplained that any other place leaves, beside what LOOP_AMBIGUITY asks: one suffices.
UNEXPLAINED = 2.5
CONFIRMED = 3  # Loop closures between what lies before and after a step that confirm it.
# End points, at most, that are searched for in a local map: a scanner with more beams shows no more shapes.
MATCHED = 400


class ScanPoses(NamedTuple):
    """Where scans were taken from."""

    poses: FloatArray  # Shape (m, 3), one for each scan.
    # Shape (m, 3, 3), in the world's axes, relative to the places of all: what turns or shifts all is no error.
    covariances: FloatArray
    odometry: FloatArray  # Where odometry had them, shape (m, 3).
    keys: NDArray[np.intp]  # Which scans are nodes of the graph, shape (n,).
    relations: tuple[Relation, ...]  # Between nodes, those that count.
    closures: int  # Loop closures that were confirmed.
    rejected: int  # Relations that the optimisation dropped.
    # Scans that lie where they fit and not where odometry had them: it is missing before them, or wrong.
    relocated: tuple[int, ...] = ()
    # Scans before which odometry is missing or wrong, and that fit nowhere, or in several places: how what
    # follows lies beside what came before is not known.
    unplaced: tuple[int, ...] = ()
    revisits: Revisits | None = None  # How the map agrees with itself where places were seen again.


def match_scans(
    scans: Sequence[Scan],
    odometry: FloatArray,
    settings: GraphSettings | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    missing: NDArray[np.bool_] | None = None,
) -> ScanPoses:
    """Return where scans were taken from, by matching them; the first pose is odometry's.

    Args:
        scans: in the order of time, one or more.
        odometry: where they were taken by odometry, shape (m, 3).
        settings: how to go about it.
        on_progress: called with the number of scans done and their total.
        missing: whether the log lacks odometry from the scan before to each, shape (m,); None where it never does.
    """
    slam = ScanSlam(settings)
    lacking = np.zeros(len(scans), dtype=bool) if missing is None else missing
    for i, (scan, pose, lacks) in enumerate(zip(scans, odometry, lacking, strict=True), start=1):
        slam.add(scan, pose, missing=bool(lacks))
        if on_progress is not None:
            on_progress(i, len(scans))
    return slam.finish(odometry)


class _Found(NamedTuple):
    """Where a scan lies beside the last node."""

    pose: FloatArray  # Shape (3,).
    step: FloatArray  # What is taken for the odometry, shape (3,).
    noise: FloatArray  # Its covariance, shape (3, 3).
    sure: bool = True  # Whether scan or odometry tell the pose at all.
    fits: bool = True  # Whether the scan may be matched to those before it.


class ScanSlam:
    """Poses of scans, one after the other, while the robot drives.

    Attributes:
        corrections: how often loops that were closed have moved the poses of the past.
    """

    def __init__(self, settings: GraphSettings | None = None) -> None:
        self._s = settings = settings or GraphSettings()
        self.corrections = 0
        # Of a guess, among end points that are taken to scatter by SIGMA; the errors of neighbouring ones are alike.
        self._weight = settings.scatter / SIGMA
        self._keys = KeyScans(settings.filled_gap)
        self._loops = LoopFinder(self._keys, settings)
        self._area: LocalMap | None = None
        self._covariance = np.zeros((3, 3))
        self._odometry = np.zeros(3)  # at the node that the robot was last at
        self._last = 0  # that node
        self._seen = 0.0  # when the last scan was taken, seconds
        self._chain = np.empty(0, dtype=np.intp)  # the nodes whose scans make the local map
        self._scans: list[tuple[int, FloatArray]] = []  # key and pose in its frame
        self._spreads: list[FloatArray] = []  # covariance of each beside its key's
        self._own: list[int] = []
        self._closures = 0
        self._relocated: list[int] = []
        self._unplaced: list[int] = []  # nodes

    @property
    def poses(self) -> FloatArray:
        """Where the scans were taken, as far as is known now, shape (m, 3)."""
        own = np.array([key for key, _ in self._scans], dtype=np.intp)
        return compose(self._keys.poses[own], np.array([pose for _, pose in self._scans]).reshape(-1, 3))

    @property
    def pose(self) -> FloatArray:
        """Where the last scan was taken, shape (3,)."""
        key, pose = self._scans[-1]
        return compose(self._keys.poses[key], pose)

    @property
    def covariance(self) -> FloatArray:
        """Of the last scan's pose in the map around it, shape (3, 3), in the world's axes."""
        return self._covariance

    def covariances(self) -> FloatArray:
        """Return the covariances of the scans' poses, shape (m, 3, 3), in the world's axes; the first is certain."""
        keys, own = self._keys, np.array([key for key, _ in self._scans], dtype=np.intp)
        return pose_covariances(keys.relations, keys.poses)[own] + np.array(self._spreads)

    def drifts(self) -> FloatArray:
        """Return how each scan is related to the last one, shape (m, 2).

        Metres driven from one to the next, loops that were closed taken into account, and the standard deviation of the
        place, metres, that this comes to.
        """
        return self._loops.drifts(self._last)[[key for key, _ in self._scans]]

    def add(self, scan: Scan, odometry: FloatArray, *, missing: bool = False) -> None:
        """Take in the next scan.

        Args:
            scan: the scan.
            odometry: its pose by odometry, shape (3,); the first one's is taken as it is.
            missing: whether odometry from the scan before to this one is missing.
        """
        s, keys, area, cloud = self._s, self._keys, self._area, surface_cloud(scan, self._s.max_range)
        since, self._seen = scan.t - self._seen, scan.t
        if area is None:
            self._add_key(odometry, cloud, odometry)
            return
        last, own, step = self._last, len(keys), between(self._odometry, odometry)
        noise = s.odometry_noise(step)
        little = np.hypot(*step[:2]) < s.key_distance and abs(step[2]) < KEY_ANGLE
        if little and not missing and self._hold_beside(area, cloud, step):
            return
        if len(cloud.points) < MIN_POINTS:
            self._add_unmatched(compose(keys.poses[last], step), cloud, odometry, np.eye(3) if missing else noise)
            return
        found = self._search(area, cloud, step, noise, since if missing else None)
        if found is None:
            self._relocated.append(len(self._scans))
            self.place(scan, compose(keys.poses[last], step), odometry)
            return
        start, step, noise, sure, fits = found
        if not sure:
            self._unplaced.append(own)
        if not fits:
            self._add_unmatched(start, cloud, odometry, noise, follows=sure)
            return
        guess, information = compose(keys.poses[last], step), self._weight * _inverse(noise)
        pose = refine_by_faces(area, cloud, start, guess, information).pose
        if own >= MAX_NODES and self._return_to_node(pose, cloud, odometry):
            return
        # Odometry held the match, and is not counted again beside it.
        self._covariance = _combined(self._covariance_of(area, cloud, pose), noise)
        keys.relations.append(keys.related(last, own, pose, self._covariance, certain=True))
        self._add_key(pose, cloud, odometry)
        self._close_loops(own)

    def _hold_beside(self, area: LocalMap, cloud: PointCloud, step: FloatArray) -> bool:
        """Hold a scan by the last node, as too little has changed for one of its own, unless odometry hides more."""
        s, here, noise = self._s, self._keys.poses[self._last], self._s.odometry_noise(step)
        match = refine(area, cloud, compose(here, step), information=self._weight * _inverse(noise))
        pose = between(here, match.pose)
        fits = match.score >= 0.5 * LOOP_SCORE and np.hypot(*(pose - step)[:2]) < 0.5 * s.key_distance
        if len(cloud.points) >= MIN_POINTS and not fits:
            return False
        self._covariance = _combined(self._covariance_of(area, cloud, match.pose), noise)
        self._hold(self._last, pose)
        return True

    def _search(
        self, area: LocalMap, cloud: PointCloud, step: FloatArray, noise: FloatArray, lost: float | None
    ) -> _Found | None:
        """Return a scan's pose, found around where odometry has it, and what is taken for the odometry.

        Where that is missing, ``lost`` is the time since the last scan, seconds.
        """
        s, here = self._s, self._keys.poses[self._last]
        guess, driven = compose(here, step), np.hypot(*step[:2])
        points = _some(cloud)
        if lost is not None:
            return self._search_alone(area, points, here, lost)
        window = Window(
            min(MAX_WINDOW.xy, max(WINDOW[0], 3.0 * float(np.sqrt(noise[0, 0])))),
            min(MAX_WINDOW.theta, max(WINDOW[1], 3.0 * float(np.sqrt(noise[2, 2])))),
        )
        found = search(area, points, guess, window, information=_inverse(noise))
        score, start = (0.0, guess) if found is None else (found.score, found.pose)
        if score >= SURE:
            return _Found(start, step, noise)
        unfit = score < UNFIT * LOOP_SCORE
        carried = unfit and driven > max(MAX_WINDOW.xy, CARRIED * s.key_distance)
        if carried and np.hypot(*(self._keys.poses - guess)[:, :2].T).min() < MAX_WINDOW.xy:
            return None
        # A jump in the log, a part of it that is missing, wheels that slipped in a turn, or a push: the robot is still
        # near where it was. Where odometry explains anything, no turn beyond it counts: the way around a corner shows
        # new things, and what was seen last may fit better at the heading before.
        around = ALL_ROUND if unfit else MAX_WINDOW
        other = search(area, points, here, around, coarseness=2, min_score=max(LOOP_SCORE, score / DECISIVE))
        if other is None:
            return _Found(start, step, noise, sure=not carried)
        turned = abs(difference(guess, other.pose)[2]) > window.theta
        # That it has hardly moved is not believed: from there all looks as it did, along a corridor most of all.
        farther = unfit and np.hypot(*between(here, other.pose)[:2]) > driven
        if not (carried or farther or turned):
            return _Found(start, step, noise)
        near = abs(difference(here, other.pose)[2]) < MAX_WINDOW.theta
        alone = self._is_alone(area, points, other, here, MAX_WINDOW if near else ALL_ROUND)
        if not (alone or unfit):
            return _Found(start, step, noise)  # of several places the one that odometry says
        self._relocated.append(len(self._scans))
        return _Found(other.pose, between(here, other.pose), np.eye(3), sure=alone or not carried)

    def _search_alone(self, area: LocalMap, points: FloatArray, here: FloatArray, lost: float) -> _Found:
        """Return a scan's pose where the odometry is missing: the scan alone decides, or nothing does."""
        around, (speed, turning) = self.pose, FASTEST
        window = Window(min(ALL_ROUND.xy, speed * lost), min(ALL_ROUND.theta, turning * lost))
        best = search(area, points, around, window, coarseness=2, min_score=DECISIVE)
        if best is None:
            return _Found(here, np.zeros(3), np.eye(3), sure=False, fits=False)
        _, is_open = match_covariance(area, points, best.pose, scatter=self._s.scatter)
        sure = not is_open and self._is_alone(area, points, best, around, window)
        if sure:
            self._relocated.append(len(self._scans))
        return _Found(best.pose, between(here, best.pose), np.eye(3), sure=sure, fits=sure)

    def _is_alone(self, area: LocalMap, points: FloatArray, match: Match, around: FloatArray, window: Window) -> bool:
        """Return whether a match is good and no other place of a window is nearly as good."""
        limit = max(LOOP_AMBIGUITY * match.score, 1.0 - UNEXPLAINED * (1.0 - match.score))
        rival = search(area, points, around, window, coarseness=2, min_score=limit, apart_from=match.pose)
        return match.score >= DECISIVE and rival is None

    def _close_loops(self, own: int) -> None:
        """Take in the loop closures that a node confirms."""
        closures = self._loops.find(own)
        self._closures += len(closures)
        self._keys.relations += closures
        # What agrees with the poses as they are can wait.
        if any(_surprise(closure, self._keys.poses) > 1.0 for closure in closures):
            self._keys.poses, _ = optimise(self._keys.relations, self._keys.poses, OUTLIER_GATE)
            self._renew_area()
            self.corrections += 1

    def match(self, scan: Scan, odometry: FloatArray) -> FloatArray:
        """Return where a scan, with its pose by odometry, fits best what was seen just before, and leave it out."""
        cloud = surface_cloud(scan, self._s.max_range)
        if self._area is None:
            return odometry
        guess = compose(self._keys.poses[self._last], between(self._odometry, odometry))
        found = search(self._area, cloud.points, guess, Window(*WINDOW), coarseness=2)
        return guess if found is None else refine(self._area, cloud, found.pose).pose

    def place(self, scan: Scan, pose: FloatArray, odometry: FloatArray) -> None:
        """Go on from elsewhere in the map with the next scan, taken near ``pose``: the robot was carried there."""
        s, keys, own = self._s, self._keys, len(self._keys)
        node = int(np.hypot(*(keys.poses[:, :2] - pose[:2]).T).argmin())
        self._chain, self._last = keys.chain(node, 2.0 * s.local_length, LOCAL_SCANS), node
        cloud, area = surface_cloud(scan, s.max_range), self._renew_area()
        pose = refine(area, cloud, pose).pose
        self._covariance = self._covariance_of(area, cloud, pose)
        keys.relations.append(keys.related(node, own, pose, self._covariance, certain=True))
        self._add_key(pose, cloud, odometry)

    def candidates(self, scan: Scan) -> FloatArray:
        """Return where in the whole map a scan may have been taken, shape (k, 3): the best place for each heading."""
        return places_like(scan, self._keys, self._s)

    def finish(self, odometry: FloatArray) -> ScanPoses:
        """Return the poses of all scans; more of them may be taken in afterwards as if nothing had been asked."""
        keys, s = copy(self._keys), self._s
        held, stretches = list(keys.relations), stretches_of(keys, s)
        keys.poses, counts = optimise(held, keys.poses, OUTLIER_GATE)
        # Loop closures were searched for. What revisits say begins with the poses as they are, and confirms any.
        closures = [r for r, count in zip(held, counts, strict=True) if count and not r.certain]
        unplaced = [
            self._own[k]
            for k in self._unplaced
            if sum(min(r.a, r.b) < k <= max(r.a, r.b) for r in closures) < CONFIRMED
        ]
        for _ in range(ROUNDS):
            revisits = revisit_relations(keys, s)
            # A closure and a revisit of one scan to one place say the same.
            again = {(stretches[r.a], r.b) for r in revisits}
            keys.relations = [r for r in held if r.certain or (stretches[r.a], r.b) not in again] + revisits
            keys.poses, counts = optimise(keys.relations, keys.poses, OUTLIER_GATE)
        relations = [r for r, count in zip(keys.relations, counts, strict=True) if count]
        covariances = relative_covariances(relations, keys.poses)
        own = np.array([key for key, _ in self._scans])
        rejected = int((~counts).sum())
        poses = compose(keys.poses[own], np.array([pose for _, pose in self._scans]).reshape(-1, 3))
        return ScanPoses(
            poses, covariances[own], odometry, np.array(self._own), tuple(relations), self._closures, rejected,
            tuple(self._relocated), tuple(unplaced), judge_revisits(keys, relations, s) if relations else None,
        )  # fmt: skip

    def _covariance_of(self, area: LocalMap, cloud: PointCloud, pose: FloatArray) -> FloatArray:
        """Return the covariance of a pose at which a cloud was matched, shape (3, 3); of few points next to nothing."""
        if len(cloud.points) < MIN_POINTS:
            return np.eye(3)
        return match_covariance(area, _some(cloud), pose, scatter=self._s.scatter)[0]

    def _add_unmatched(
        self, pose: FloatArray, cloud: PointCloud, odometry: FloatArray, noise: FloatArray, *, follows: bool = True
    ) -> None:
        """Add a node that only odometry, or nothing at all, relates to the last one."""
        keys = self._keys
        step = between(keys.poses[self._last], pose)
        keys.relations.append(Relation(self._last, len(keys), step, noise))
        self._covariance = noise
        self._add_key(pose, cloud, odometry, follows=follows)

    def _add_key(self, pose: FloatArray, cloud: PointCloud, odometry: FloatArray, *, follows: bool = True) -> None:
        s, own = self._s, len(self._keys)
        if not follows:
            # Nothing says how this scan lies beside those before it: none of them is in its local map.
            self._chain = self._chain[:0]
        # After a node that is not the one before, the drive begins anew.
        follows = follows and (own == 0 or self._last == own - 1)
        self._keys.add(cloud, pose, self._covariance, 0.0 if follows else 4.0 * s.local_length)
        recent = self._keys.chain(own, s.local_length, LOCAL_SCANS, before=True)
        self._chain = recent if len(recent) > LOCAL_SCANS // 2 else np.union1d(self._chain[-LOCAL_SCANS:], recent)
        self._last, self._odometry = own, odometry
        self._own.append(len(self._scans))
        self._hold(own, np.zeros(3))
        self._renew_area()

    def _return_to_node(self, pose: FloatArray, cloud: PointCloud, odometry: FloatArray) -> bool:
        """Hold a scan by a node that stands where it does, and return whether there is one whose map it fits."""
        keys, s = self._keys, self._s
        apart = between(keys.poses, pose)
        near = (np.hypot(*apart[:, :2].T) < s.key_distance) & (np.abs(apart[:, 2]) < KEY_ANGLE)
        near[self._last] = False
        if not near.any():
            return False
        node = int(np.flatnonzero(near)[np.hypot(*apart[near, :2].T).argmin()])
        chain = keys.chain(node, 2.0 * s.local_length, LOCAL_SCANS)
        area = keys.area(chain, keys.poses[node], s.max_range + 2.0, WINDOW[0])
        match = refine(area, cloud, pose)
        if match.score < LOOP_SCORE or np.hypot(*between(pose, match.pose)[:2]) > 0.5 * s.key_distance:
            return False
        self._area, self._chain, self._last = area, chain, node
        self._covariance = self._covariance_of(area, cloud, match.pose)
        self._hold(node, between(keys.poses[node], match.pose))
        # Odometry is known at the scan, which stands beside the node.
        self._odometry = compose(odometry, between(match.pose, keys.poses[node]))
        return True

    def _hold(self, key: int, pose: FloatArray) -> None:
        """Hold the next scan by a node, at a pose in its frame."""
        self._scans.append((key, pose))
        self._spreads.append(self._covariance if pose.any() else np.zeros((3, 3)))

    def _renew_area(self) -> LocalMap:
        """Make the local map of the last scans."""
        s, keys = self._s, self._keys
        self._area = keys.area(self._chain, keys.poses[self._last], s.max_range + 2.0, WINDOW[0])
        return self._area


def _surprise(relation: Relation, poses: FloatArray) -> float:
    """Return how far poses are from a relation: squared, by its covariance, a number."""
    error = between(relation.pose, between(poses[relation.a], poses[relation.b]))
    return float(error @ np.linalg.solve(relation.covariance, error)) / 3.0


def _combined(matched: FloatArray, odometry: FloatArray) -> FloatArray:
    """Return the covariance of a pose that a match and odometry tell, shape (3, 3)."""
    return np.asarray(np.linalg.inv(np.linalg.inv(matched) + np.linalg.inv(odometry)))


def _some(cloud: PointCloud) -> FloatArray:
    """Return at most MATCHED of a cloud's points, shape (n, 2)."""
    return cloud.points[:: -(-len(cloud.points) // MATCHED)]


def _inverse(covariance: FloatArray) -> FloatArray:
    return np.diag(1.0 / np.diag(covariance))
