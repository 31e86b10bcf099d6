"""The poses of scans by scan matching and a pose graph.

Each scan is matched against a local map of those before it. Places that were seen before close loops, which a second
closure must confirm (:mod:`trailmark.estimation.graph.loop_closure`). At last each scan is matched against the maps
of all the other stretches of the drive that saw the same place, and all relations are optimised together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.estimation.graph.graph_settings import GraphSettings
from trailmark.estimation.graph.loop_closure import LoopFinder
from trailmark.estimation.graph.pose_graph import Relation, optimise, relative_covariances
from trailmark.estimation.graph.revisits import revisit_relations
from trailmark.estimation.graph.submaps import MIN_POINTS, KeyScans
from trailmark.estimation.logs.records import Scan
from trailmark.estimation.scans.clouds import PointCloud, point_cloud, relative
from trailmark.estimation.scans.local_map import LocalMap
from trailmark.estimation.scans.matching import Window, match_covariance, refine, search
from trailmark.se2 import FloatArray, compose

__all__ = ["ScanPoses", "ScanSlam", "match_scans"]

MAX_WINDOW = Window(2.0, np.radians(60.0))
"""The largest window around what odometry says that is searched: beyond, it is no guess."""


class ScanPoses(NamedTuple):
    """Where scans were taken from."""

    poses: FloatArray
    """Shape (m, 3), one for each scan."""
    covariances: FloatArray
    """Shape (m, 3, 3), in the world's axes, relative to the places of all: what turns or shifts all is no error."""
    odometry: FloatArray
    """Where odometry had them, shape (m, 3)."""
    keys: NDArray[np.intp]
    """Which scans are nodes of the graph, shape (n,)."""
    relations: tuple[Relation, ...]
    """Between nodes, those that count."""
    closures: int
    """Loop closures that were confirmed."""
    rejected: int
    """Relations that the optimisation dropped."""


def match_scans(
    scans: Sequence[Scan],
    odometry: FloatArray,
    settings: GraphSettings | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> ScanPoses:
    """Return where scans were taken from, by matching them; the first pose is odometry's.

    Args:
        scans: in the order of time, one or more.
        odometry: where they were taken by odometry, shape (m, 3).
        settings: how to go about it.
        on_progress: called with the number of scans done and their total.
    """
    slam = ScanSlam(settings)
    for i, (scan, pose) in enumerate(zip(scans, odometry, strict=True), start=1):
        slam.add(scan, pose)
        if on_progress is not None:
            on_progress(i, len(scans))
    return slam.finish(odometry)


class ScanSlam:
    """Poses of scans, one after the other, while the robot drives.

    Attributes:
        corrections: how often loops that were closed have moved the poses of the past.

    Args:
        settings: how to go about it.
    """

    def __init__(self, settings: GraphSettings | None = None) -> None:
        self._s = settings = settings or GraphSettings()
        self.corrections = 0
        self._keys = KeyScans()
        self._loops = LoopFinder(self._keys, settings)
        self._area: LocalMap | None = None
        self._odometry = np.zeros(3)  # at the node that the robot was last at
        self._last = 0  # that node
        self._chain = np.empty(0, dtype=np.intp)  # the nodes whose scans make the local map
        self._scans: list[tuple[int, FloatArray]] = []  # key and pose in its frame
        self._own: list[int] = []
        self._closures = 0

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

    def add(self, scan: Scan, odometry: FloatArray) -> None:
        """Take in the next scan, with its pose by odometry, shape (3,): the first one's is taken as it is."""
        s, cloud = self._s, point_cloud(scan, self._s.max_range)
        step = relative(self._odometry, odometry)
        if self._area is None:
            self._add_key(odometry, cloud, odometry)
            return
        last = self._last
        if np.hypot(*step[:2]) < s.key_distance and abs(step[2]) < s.key_angle:
            # Too little has changed for a node of its own.
            guess = compose(self._keys.poses[last], step)
            pose = refine(self._area, cloud, guess, information=_inverse(self._noise(step))).pose
            self._scans.append((last, relative(self._keys.poses[last], pose)))
            return
        guess, noise = compose(self._keys.poses[last], step), self._noise(step)
        information = _inverse(noise)
        own = len(self._keys)
        if len(cloud.points) < MIN_POINTS:
            self._keys.relations.append(Relation(last, own, step, noise))
            self._add_key(guess, cloud, odometry)
            return
        window = Window(
            min(MAX_WINDOW.xy, max(s.window[0], 3.0 * float(np.sqrt(noise[0, 0])))),
            min(MAX_WINDOW.theta, max(s.window[1], 3.0 * float(np.sqrt(noise[2, 2])))),
        )
        found = search(self._area, cloud.points, guess, window, information=information)
        if found is None or found.score < s.loop_score:
            # Wheels that slipped, or a jump in the log: perhaps the robot is still near where it was.
            here, floor = self._keys.poses[last], s.loop_score if found is None else max(s.loop_score, found.score)
            if other := search(self._area, cloud.points, here, MAX_WINDOW, coarseness=2, min_score=floor):
                found, guess, noise = other, other.pose, np.eye(3)
                step, information = relative(here, guess), _inverse(noise)
        self._keys.relations.append(Relation(last, own, step, noise))
        start = guess if found is None else found.pose
        pose = refine(self._area, cloud, start, information=information, guess=guess).pose
        if own >= s.max_nodes and self._return_to_node(pose, cloud, odometry):
            self._keys.relations.pop()
            return
        covariance, _ = match_covariance(self._area, cloud.points, pose)
        self._keys.relations.append(self._keys.related(last, own, pose, covariance, certain=True))
        self._add_key(pose, cloud, odometry)
        closures = self._loops.find(own)
        if closures:
            self._closures += len(closures)
            self._keys.relations += closures
            # What agrees with the poses as they are can wait.
            if max(_surprise(closure, self._keys.poses) for closure in closures) > 1.0:
                self._keys.poses, _ = optimise(self._keys.relations, self._keys.poses, s.outlier_gate)
                self._renew_area()
                self.corrections += 1

    def finish(self, odometry: FloatArray) -> ScanPoses:
        """Return the poses of all scans."""
        keys, s = self._keys, self._s
        keys.poses, _ = optimise(keys.relations, keys.poses, s.outlier_gate)
        held = len(keys.relations)
        for _ in range(s.rounds):
            keys.relations[held:] = revisit_relations(keys, s)
            keys.poses, counts = optimise(keys.relations, keys.poses, s.outlier_gate)
        relations = [r for r, count in zip(keys.relations, counts, strict=True) if count]
        covariances = relative_covariances(relations, keys.poses)
        own = np.array([key for key, _ in self._scans])
        rejected = int((~counts).sum())
        return ScanPoses(
            self.poses, covariances[own], odometry, np.array(self._own), tuple(relations), self._closures, rejected
        )

    def _noise(self, step: FloatArray) -> FloatArray:
        """Return the covariance of a step by odometry, shape (3, 3)."""
        (place, heading), (floor, floor_theta) = self._s.odometry, self._s.odometry_floor
        length = float(np.hypot(*step[:2]))
        xy = floor**2 + (place * length) ** 2
        return np.diag([xy, xy, floor_theta**2 + (0.5 * heading * length) ** 2 + (heading * step[2]) ** 2])

    def _add_key(self, pose: FloatArray, cloud: PointCloud, odometry: FloatArray) -> None:
        s, own = self._s, len(self._keys)
        # After a node that is not the one before, the drive begins anew.
        follows = own == 0 or self._last == own - 1
        self._keys.add(cloud, pose, 0.0 if follows else 4.0 * s.local_length)
        recent = self._keys.chain(own, s.local_length, s.local_scans, before=True)
        self._chain = recent if len(recent) > s.local_scans // 2 else np.union1d(self._chain[-s.local_scans :], recent)
        self._last, self._odometry = own, odometry
        self._own.append(len(self._scans))
        self._scans.append((own, np.zeros(3)))
        self._renew_area()

    def _return_to_node(self, pose: FloatArray, cloud: PointCloud, odometry: FloatArray) -> bool:
        """Hold a scan by a node that stands where it does, and return whether there is one whose map it fits."""
        keys, s = self._keys, self._s
        apart = relative(keys.poses, pose)
        near = (np.hypot(*apart[:, :2].T) < s.key_distance) & (np.abs(apart[:, 2]) < s.key_angle)
        near[self._last] = False
        if not near.any():
            return False
        node = int(np.flatnonzero(near)[np.hypot(*apart[near, :2].T).argmin()])
        chain = keys.chain(node, 2.0 * s.local_length, s.local_scans)
        area = keys.area(chain, keys.poses[node], s.max_range + 2.0, s.window[0])
        match = refine(area, cloud, pose)
        if match.score < s.loop_score or np.hypot(*relative(pose, match.pose)[:2]) > 0.5 * s.key_distance:
            return False
        self._area, self._chain, self._last = area, chain, node
        self._scans.append((node, relative(keys.poses[node], match.pose)))
        # Odometry is known at the scan, which stands beside the node.
        self._odometry = compose(odometry, relative(match.pose, keys.poses[node]))
        return True

    def _renew_area(self) -> None:
        """Make the local map of the last scans."""
        s, keys = self._s, self._keys
        self._area = keys.area(self._chain, keys.poses[self._last], s.max_range + 2.0, s.window[0])


def _surprise(relation: Relation, poses: FloatArray) -> float:
    """Return how far poses are from a relation: squared, by its covariance, a number."""
    error = relative(relation.pose, relative(poses[relation.a], poses[relation.b]))
    return float(error @ np.linalg.solve(relation.covariance, error)) / 3.0


def _inverse(covariance: FloatArray) -> FloatArray:
    return np.diag(1.0 / np.diag(covariance))
