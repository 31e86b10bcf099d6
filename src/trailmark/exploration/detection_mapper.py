# ruff: noqa: N806 # the filter's own symbols: P, J
"""The map of a robot with a detector of discs: EKF-SLAM, and cells in which another disc would have been seen."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trailmark.collision.field import distance_transform
from trailmark.errors import ConfigurationError
from trailmark.estimation.covariance import chi_square_quantile
from trailmark.estimation.ekf_slam import AssociationMethod, EkfSlam, MapFeature
from trailmark.estimation.map_settings import MapSettings
from trailmark.estimation.mapping import map_log
from trailmark.estimation.models import as_range_bearing
from trailmark.estimation.records import Detection, Log, Record
from trailmark.estimation.virtual_sensors import Detector, RayCaster
from trailmark.exploration.known_map import FREE, OCCUPIED, UNKNOWN, KnownMap
from trailmark.exploration.mapper import CARRIED, Belief, Mapper
from trailmark.exploration.result import ExplorationSettings
from trailmark.se2 import FloatArray, difference, transform, wrap
from trailmark.shapes import Disc
from trailmark.world import Robot, World

__all__ = ["Alignment", "DetectionMapper", "aligned"]


IntArray = NDArray[np.intp]

NEAREST: Final = 8  # Detections, at most, of which pairs are tried: near ones are the most precise.
APART: Final = 0.5, 0.3  # Metres and radians between two poses that are not the same.
GATE: Final = 1.0 - 1e-6  # Probability with which a reading of a known disc fits it.
# Probability with which all readings of a sweep together are as near to the map.
SURE: Final = 0.999
DISCS: Final = 20  # Discs that a path comes near, over which the risk is spread.


class Alignment(NamedTuple):
    """A pose, and what speaks for it."""

    pose: FloatArray  # Shape (3,).
    matched: int  # Detections that lie on points of the map under it.
    unique: bool  # Whether fewer do under any pose that is not near it.


def aligned(
    detected: FloatArray, places: FloatArray, candidates: Sequence[IntArray], tolerance: float
) -> Alignment | None:
    """Return the pose that puts most detections on points of the map; None if none puts two of them there.

    Each pair of detections is laid on each pair of points as far apart: a pose, under which the others are counted.

    Args:
        detected: in the robot's frame, shape (n, 2), metres.
        places: the map's points, shape (m, 2).
        candidates: for each detection, which points it may be: one where it is identified.
        tolerance: metres by which a detection may lie off its point.
    """
    poses = [np.empty((0, 3))]
    for i, j in combinations(np.argsort(np.hypot(*detected.T), kind="stable")[:NEAREST].tolist(), 2):
        a, b = (grid.ravel() for grid in np.meshgrid(candidates[i], candidates[j], indexing="ij"))
        way, ways = detected[j] - detected[i], places[b] - places[a]
        fits = (a != b) & (np.abs(np.hypot(*ways.T) - np.hypot(*way)) <= 2.0 * tolerance)
        theta = np.asarray(wrap(np.arctan2(ways[fits, 1], ways[fits, 0]) - np.arctan2(way[1], way[0])))
        turned = transform(np.column_stack([np.zeros((len(theta), 2)), theta]), 0.5 * (detected[i] + detected[j])[None])
        poses.append(np.column_stack([0.5 * (places[a[fits]] + places[b[fits]]) - turned[:, 0], theta]))
    tried = np.concatenate(poses)
    if not len(tried):
        return None
    counts = np.array([len(_pairs(pose, detected, places, candidates, tolerance)[0]) for pose in tried])
    best = int(counts.argmax())
    if counts[best] < 2:
        return None
    off = np.abs(difference(tried[best], tried))
    others = (np.hypot(off[:, 0], off[:, 1]) > APART[0]) | (off[:, 2] > APART[1])
    pose = tried[best]
    for _ in range(3):
        own, at = _pairs(pose, detected, places, candidates, tolerance)
        pose = _rigid(detected[own], places[at])
    return Alignment(pose, int(counts[best]), not (counts[others] >= counts[best]).any())


def _pairs(
    pose: FloatArray, detected: FloatArray, places: FloatArray, candidates: Sequence[IntArray], tolerance: float
) -> tuple[list[int], list[int]]:
    """Return which detections lie on points under a pose, and on which."""
    own, at = list[int](), list[int]()
    for i, point in enumerate(transform(pose, detected)):
        if len(candidates[i]):
            away = np.hypot(*(places[candidates[i]] - point).T)
            k = int(away.argmin())
            if away[k] <= tolerance and int(candidates[i][k]) not in at:
                own.append(i)
                at.append(int(candidates[i][k]))
    return own, at


def _rigid(points: FloatArray, places: FloatArray) -> FloatArray:
    """Return the pose that moves points nearest to places, both (k, 2), in the sense of least squares."""
    p, q = points - points.mean(axis=0), places - places.mean(axis=0)
    theta = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
    turned = transform(np.array([0.0, 0.0, theta]), points.mean(axis=0)[None])[0]
    return np.append(places.mean(axis=0) - turned, theta)


class DetectionMapper(Mapper):
    """A mapper for a detector of discs.

    Cells are free where each disc that could reach into them would have been seen: its centre in range, and not behind
    a disc. Discs are taken not to overlap.

    Args:
        start: where the robot stands first, shape (3,).
        known: the cells to fill in, nothing known so far.
        sensor: the detector's range and noise.
        robot: of the world.
        settings: the confidence asked for.
        radii: of the discs, by their identity, metres; where that is not known, all are as large as the sensor's
            ``max_radius``.

    Raises:
        ConfigurationError: no radii, and a sensor that reads discs of any size.
    """

    def __init__(
        self,
        start: FloatArray,
        known: KnownMap,
        sensor: Detector,
        robot: Robot,
        settings: ExplorationSettings,
        radii: Mapping[int, float] | None = None,
    ) -> None:
        super().__init__(start, known, robot, settings, Detection, sensor.max_range)
        self._radii, self._sensor, self._model = dict(radii or {}), sensor, MapSettings()
        self._largest = max(self._radii.values(), default=sensor.max_radius)
        if not math.isfinite(self._largest):
            raise ConfigurationError(
                "sensor: expected a detector with a finite max_radius, got one for discs of any size"
            )
        association: AssociationMethod = "known" if sensor.identities else "joint"
        self._slam = EkfSlam(
            sensor.model,
            velocity=self._model.velocity,
            increment=self._model.increment,
            settings=replace(self._model.slam, association=association),
            start=self._start,
        )
        risk = 0.0 if settings.confidence is None else (1.0 - settings.confidence) / DISCS
        self._spread = math.sqrt(float(chi_square_quantile(1.0 - risk, 2))) if risk else 0.0
        self._growth = dict[int, float]()
        # How often each cell was looked at, up to what is enough, and from how uncertain a place at the least, metres.
        self._looks, self._sigma = np.zeros(known.state.shape, np.uint8), np.full(known.state.shape, np.inf, np.float32)
        rate = sensor.detection_rate
        self._enough = 1 if rate >= 1.0 else min(255, math.ceil(math.log(1e-3) / math.log(1.0 - rate)))
        self._free = np.zeros(known.state.shape, dtype=bool)
        self._unplaced = list[Detection]()

    @property
    def pose(self) -> FloatArray:
        """Where the robot is, shape (3,)."""
        return self._slam.filter.pose

    @property
    def covariance(self) -> FloatArray:
        """Of the pose, shape (3, 3)."""
        return self._slam.filter.pose_covariance

    @property
    def trajectory(self) -> FloatArray:
        """Where it was, shape (n, 4), rows t, x, y, theta."""
        return self._slam.result().trajectory

    @property
    def covariances(self) -> FloatArray:
        """Of the trajectory's poses, shape (n, 3, 3), in the world's axes."""
        return self._slam.result().covariances

    @property
    def features(self) -> tuple[MapFeature, ...]:
        """The discs that are confirmed: their centres, with covariances."""
        return self._slam.features()

    @property
    def margin(self) -> float:
        """0: at the confidence asked for, discs are grown and strips along the bounds are closed."""
        return 0.0

    def take(self, records: Sequence[Record]) -> Belief:
        """Take in what was sensed, and bring pose and map up to date."""
        refused, sweep = list[str](), list[Detection]()
        for record in self._usable(records, refused):
            if isinstance(record, Detection):
                sweep.append(as_range_bearing(record))
            else:
                self._use([record])
        heard = bool(sweep) or not any(isinstance(record, Detection) for record in records)
        if not heard or (not sweep and self._should_see()):
            return self._belief(0, refused)
        if not self._fits(sweep):
            self._strange, self._unplaced = self._strange + 1, sweep
            refused.append(f"detections at {sweep[0].t:.3f} s left out: expected what the map shows here, got others")
            return self._belief(1, refused)
        self._strange = 0
        self._use(sweep)
        self._look(sweep)
        return self._belief(1, refused)

    def relocate(self) -> bool:
        """Look for the robot in the map, after it was lost; return whether it was found."""
        found = self._aligned(self._unplaced)
        if found is None or found.matched < (2 if self._sensor.identities else 3):
            return False
        self._use([self._carry(self._unplaced[0].t, found.pose, 4.0 * CARRIED)])
        return True

    def finished_map(self, log: Log) -> World:
        """Return the world that ``trailmark map`` makes of the log, its discs as large as they are known to be."""
        model = replace(self._model, radius=self._largest)
        mapped = map_log(log, model, robot=self._robot)
        if not self._radii or mapped.slam is None:
            return mapped.world
        radii = [self._radii.get(-1 if f.identity is None else f.identity, self._largest) for f in mapped.slam.features]
        world, discs = mapped.world, []
        for shape, radius in zip(world.obstacles, radii, strict=True):
            discs.append(replace(shape, radius=radius) if isinstance(shape, Disc) else shape)
        estimates = [
            None if estimate is None else replace(estimate, mean=disc)
            for estimate, disc in zip(world.estimates, discs, strict=True)
        ]
        return replace(world, obstacles=tuple(discs), estimates=tuple(estimates))

    def _use(self, records: Sequence[Record]) -> None:
        """Bring the filter up to date."""
        for record in records:
            self._slam.process(record)
            self.records.append(record)
        self._slam.finish()

    def _fits(self, sweep: Sequence[Detection]) -> bool:
        """Return whether a sweep shows what the map has there."""
        features = self._slam.features(tentative=True)
        if len(features) < 2 or len(sweep) < 2:
            return True
        good, readings, nis = self._innovations(sweep, features)
        if nis <= chi_square_quantile(SURE, 2 * max(1, readings)):
            return True
        return good > 0.5 * readings

    def _innovations(self, sweep: Sequence[Detection], features: Sequence[MapFeature]) -> tuple[int, int, float]:
        """Return how many detections of known discs lie where these are, how many there are, and their summed NIS."""
        limit, good, readings, nis = float(chi_square_quantile(GATE, 2)), 0, 0, 0.0
        points, by_name = self._points(sweep), {feature.identity: feature for feature in features}
        places = np.array([feature.mean for feature in features])
        for detection, point in zip(sweep, transform(self.pose, points), strict=True):
            if self._sensor.identities:
                if detection.identity not in by_name:
                    continue
                feature = by_name[detection.identity]
            else:
                feature = features[int(np.hypot(*(places - point).T).argmin())]
            innovation = self._slam.filter.innovation(detection.z, self._sensor.model, feature.id, detection.covariance)
            own = innovation.nis
            good, readings, nis = good + int(own <= limit), readings + 1, nis + own
        return good, readings, nis

    def _aligned(self, sweep: Sequence[Detection]) -> Alignment | None:
        """Return where the robot would have to be to see a sweep in the map as it is."""
        features = self._slam.features()
        if len(features) < 2 or len(sweep) < 2:
            return None
        candidates = [
            np.array(
                [k for k, f in enumerate(features) if not self._sensor.identities or f.identity == detection.identity],
                dtype=np.intp,
            )
            for detection in sweep
        ]
        model = self._sensor.model
        tolerance = 4.0 * math.hypot(model.sigma_range, model.sigma_bearing * self._sensor.max_range)
        found = aligned(self._points(sweep), np.array([f.mean for f in features]), candidates, tolerance)
        return found if found is not None and found.unique else None

    def _points(self, sweep: Sequence[Detection]) -> FloatArray:
        """Return where detections lie in the robot's frame, shape (n, 2)."""
        z = np.array([detection.z for detection in sweep], dtype=np.float64).reshape(-1, 2)
        return self._sensor.model.inverse(np.zeros(3), z).feature

    def _should_see(self) -> bool:
        """Return whether a disc stands so near that it would be seen."""
        features = self._slam.features()
        if not features:
            return False
        offset, theta = np.array([feature.mean for feature in features]) - self.pose[:2], -self.pose[2]
        ahead = transform(np.array([0.0, 0.0, theta]), offset)
        inside = np.abs(np.arctan2(ahead[:, 1], ahead[:, 0])) <= 0.4 * self._sensor.field_of_view
        near = inside & (np.hypot(*ahead.T) <= 0.8 * self._sensor.max_range)
        # The nearest of those in view is hidden by none.
        return bool(near.any())

    def _look(self, sweep: Sequence[Detection]) -> None:
        """Enter what a sweep showed: discs, and around the robot the cells into which no other one reaches."""
        known, reach, discs = self.known, self._sensor.max_range, self._discs(sweep)
        sigma = math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1])))
        # What was looked at from places less sure than now by a cell or more may be elsewhere.
        drifted = (self._looks > 0) & (self._sigma > sigma + known.cell)
        self._looks[drifted], self._sigma[drifted] = 0, np.inf
        wide, near = self._window(reach + self._largest + 2.0 * known.cell), self._window(reach)
        rows, columns = np.mgrid[wide]
        centres = known.centres(rows.ravel(), columns.ravel())
        at = np.unravel_index(np.flatnonzero(self._in_sight(centres, discs)), rows.shape)
        self._looks[wide][at] = np.minimum(self._looks[wide][at] + 1, self._enough)
        self._sigma[wide][at] = np.minimum(self._sigma[wide][at], sigma)
        if drifted.any():
            self._free = self._away(np.s_[:, :], discs) > self._largest + known.cell
        else:
            away = np.zeros(self._free.shape, np.float32)
            away[wide] = self._away(wide, discs)
            self._free[near] |= away[near] > self._largest + known.cell
        state = np.where(self._free, FREE, UNKNOWN).astype(np.uint8)
        for disc in discs:
            part = self._window(disc.radius + known.cell, disc.center)
            state[part][self._off(part, disc, 0.5 * known.cell) <= disc.radius] = OCCUPIED
        # The bounds are known in the frame that the robot began in, and no detection tells where they are. Not the root
        # of squares: an error of the heading and the one of the place that it has led to are correlated.
        x, y, heading = np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).tolist()
        for axis, sigma in ((1, x), (0, y)):
            strip = math.ceil(self._spread * (sigma + heading * self._robot.sweep_radius) / known.cell - 1e-9)
            if strip > 0:
                along = np.moveaxis(state, axis, 0)
                along[:strip] = along[-strip:] = OCCUPIED
        known.set_state(state)

    def _away(self, part: tuple[slice, slice], discs: Sequence[Disc]) -> FloatArray:
        """Return how far the cells of a part are from the nearest of them that may hold the centre of a disc."""
        clear = self._looks[part] >= self._enough
        for disc in discs:
            clear |= self._off(part, disc, 0.0) <= disc.radius
        return np.asarray(distance_transform(~clear, self.known.cell))

    def _off(self, part: tuple[slice, slice], disc: Disc, half: float) -> FloatArray:
        """Return how far the squares, of half a side, about the middles of a part's cells are from a disc's centre."""
        rows, columns = (np.arange(size)[at] for size, at in zip(self.known.state.shape, part, strict=True))
        dx = np.abs(self.known.origin[0] + self.known.cell * (columns + 0.5) - disc.center[0])
        dy = np.abs(self.known.origin[1] + self.known.cell * (rows + 0.5) - disc.center[1])
        return np.asarray(np.hypot(np.maximum(dx - half, 0.0)[None, :], np.maximum(dy - half, 0.0)[:, None]))

    def _in_sight(self, points: FloatArray, discs: Iterable[Disc]) -> NDArray[np.bool_]:
        """Return which points, shape (n, 2), are in range and in view, and not behind a disc."""
        pose, reach = self.pose, self._sensor.max_range
        count = math.ceil(2.0 * math.pi * reach / self.known.cell)
        angles = 2.0 * math.pi * np.arange(count) / count
        rays = RayCaster(World("known", self.known.bounds, tuple(discs)), bounds=False)
        lengths = np.minimum(rays.distances(pose[:2], angles, reach), reach)
        lengths = np.minimum(lengths, np.roll(lengths, -1))  # between two rays, what the shorter one reaches
        dx, dy = (points - pose[:2]).T
        direction = np.arctan2(dy, dx)
        ray = (direction % (2.0 * math.pi) * (count / (2.0 * math.pi))).astype(np.intp) % count
        ahead = np.abs(np.asarray(wrap(direction - pose[2]))) <= 0.5 * self._sensor.field_of_view
        return np.asarray(ahead & (np.hypot(dx, dy) <= lengths[ray]))

    def _window(self, reach: float, middle: Sequence[float] | None = None) -> tuple[slice, slice]:
        """Return the cells within a distance of a place, by default the robot's, along each axis."""
        x, y = self.pose[:2] if middle is None else middle
        rows, columns = self.known.cells_of(np.array([[x - reach, y - reach], [x + reach, y + reach]]))
        return slice(int(rows[0]), int(rows[1]) + 1), slice(int(columns[0]), int(columns[1]) + 1)

    def _discs(self, sweep: Sequence[Detection]) -> list[Disc]:
        """Return the discs, grown for the confidence by what is not certain of their place from the robot's."""
        ekf, features = self._slam.filter, self._slam.features(tentative=True)
        seen = {detection.identity for detection in sweep}
        cos, sin = math.cos(self.pose[2]), math.sin(self.pose[2])
        turn = np.array([[cos, sin], [-sin, cos]])
        discs = list[Disc]()
        for feature in features:
            if self._spread and (feature.id not in self._growth or feature.identity in seen):
                dx, dy = feature.mean - self.pose[:2]
                J = np.hstack([-turn, turn @ np.array([[dy], [-dx]]), turn])
                at = np.r_[0:3, ekf.features[feature.id]]
                P = J @ ekf.P[np.ix_(at, at)] @ J.T
                self._growth[feature.id] = self._spread * math.sqrt(max(0.0, float(np.linalg.eigvalsh(P)[-1])))
            radius = self._radii.get(-1 if feature.identity is None else feature.identity, self._largest)
            centre = float(feature.mean[0]), float(feature.mean[1])
            discs.append(Disc(centre, radius + self._growth.get(feature.id, 0.0)))
        return discs
