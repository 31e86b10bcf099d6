# ruff: noqa: N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""EKF-SLAM over the records of a log: predict, observe, update; trajectory, features, what became of the records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, checked_arguments, real
from trailmark.errors import expected_name
from trailmark.estimation.association import NEW, Associator, Counts, SlamSettings, repeats
from trailmark.estimation.covariance import Consistency, average, chi_square_quantile, nees
from trailmark.estimation.errors import EstimationError, RecordError
from trailmark.estimation.models import MotionModel, SensorModel
from trailmark.estimation.records import Detection, Increment, Odometry, Pose, Record, Scan
from trailmark.estimation.slam_filter import Mode, SlamFilter
from trailmark.se2 import FloatArray


class Update(NamedTuple):
    """One correction of the state."""

    t: float  # Seconds.
    nis: float  # Normalised innovation squared; 0 where all readings were new.
    dof: int  # Its degrees of freedom.
    seconds: float  # Time that association, update and features took.


class Assignment(NamedTuple):
    """What became of one detection."""

    t: float  # Seconds.
    identity: int | None  # What the log says the feature was, used or not.
    feature: int | None  # The feature that it was assigned to; None if it was ignored.
    detection: Detection  # What was read.


class MapFeature(NamedTuple):
    """A feature of the map."""

    id: int  # Its id in the filter.
    identity: int | None  # The number that the sensor gives it, where identities are known.
    mean: FloatArray  # Shape (d,).
    covariance: FloatArray  # Shape (d, d).
    readings: int  # How many readings it rests on.


class SlamResult(NamedTuple):
    """The outcome of a run."""

    trajectory: FloatArray  #: Rows t, x, y, theta, shape (n, 4): the estimate at each instant that had a record.
    covariances: FloatArray  #: Of x, y, theta, shape (n, 3, 3).
    features: tuple[MapFeature, ...]  #: Confirmed features.
    updates: tuple[Update, ...]  #: Corrections in order.
    assignments: tuple[Assignment, ...]  #: Detections in order.
    counts: Counts  #: What happened to the records.

    def nis(self, probability: float = 0.95) -> Consistency:
        """Return the average NIS per update and its band."""
        updates = [update for update in self.updates if update.dof]
        return average([update.nis for update in updates], [update.dof for update in updates], probability)

    @property
    def seconds_per_update(self) -> float:
        """Mean time of an update; NaN if there was none."""
        return float(np.mean([update.seconds for update in self.updates])) if self.updates else float("nan")


ITERATIONS = 3  # How often at most the filter linearises an update anew: after two steps hardly anything changes.
# By what the mean square of what a linearised reading misses is multiplied to count as its noise. With 0, the filter
# of the books, features are too sure where bearings are coarse, since an error β takes r β²/2 from the range r. 1
# gives right variances. 6 gives a right confidence of 0.99 after one reading as well, though β² has a longer tail
# than a normal deviate: with the quantiles t of χ²₁ and s of χ²₂, c of t + (t/2)² / (0.75 c) = s is 5.7.
CURVATURE = 6.0


@dataclass
class FeatureHistory:
    """What is known of a feature besides its estimate."""

    identity: int | None
    confirmed: bool
    last: float
    readings: int = 1
    seen_with: set[int] = field(default_factory=set)  # features that were read at one instant with it: not the same


class FeatureHistories:
    """The histories of a filter's features; features that are dropped or merged leave the filter, too."""

    def __init__(self, ekf: SlamFilter, settings: SlamSettings) -> None:
        self._filter, self._settings = ekf, settings
        self.histories: dict[int, FeatureHistory] = {}
        self.ids: dict[int, int] = {}

    def add(self, feature: int, identity: int | None, *, confirmed: bool, time: float, readings: int = 1) -> None:
        """Begin the history of a feature."""
        self.histories[feature] = FeatureHistory(identity, confirmed, time, readings)
        if identity is not None:
            self.ids[identity] = feature

    def read(self, features: list[int], time: float) -> None:
        """Count a reading of each of these features, all of one instant."""
        for feature in features:
            history = self.histories[feature]
            history.readings, history.last = history.readings + 1, time
            history.confirmed = history.confirmed or history.readings >= self._settings.confirm

    def drop_stale(self, time: float) -> int:
        """Drop tentative features that were not read for a while; return how many."""
        limit = time - self._settings.timeout
        stale = [i for i, history in self.histories.items() if not history.confirmed and history.last < limit]
        for i in stale:
            self._filter.remove_feature(i)
            del self.histories[i]
        for history in self.histories.values():
            history.seen_with.difference_update(stale)
        return len(stale)

    def merge(self, features: list[int]) -> dict[int, int]:
        """Merge these features, read at one instant, with others that may be the same; return which became which.

        Two features are one if they were never read at one instant and their difference passes the gate
        ``merge_gate`` by its covariance, which counts all they have in common. The filter then takes them for
        equal, which is exact, and one of them is removed.
        """
        for i in features:
            self.histories[i].seen_with.update(other for other in features if other != i)
        gone: dict[int, int] = {}
        limit = chi_square_quantile(self._settings.merge_gate or 0.0, 2)
        for i in features:
            others = [] if i in gone else [j for j in self.histories if j != i and j not in self.histories[i].seen_with]
            if not others:
                continue
            d2 = self._differences(i, others)
            best = int(d2.argmin())
            if d2[best] <= limit:
                keep, drop = sorted((i, others[best]), key=lambda k: -self.histories[k].readings)
                self._filter.merge_features(keep, drop)
                self._join(keep, drop)
                gone[drop] = keep
        return gone

    def _differences(self, i: int, others: list[int]) -> FloatArray:
        """Return the squared Mahalanobis distance of a point to others, shape (k,)."""
        x, P, places = self._filter.x, self._filter.P, self._filter.features
        own, at = places[i], np.array([places[j].start for j in others])[:, None] + np.arange(2)
        cross = P[at, own]
        D = P[at[:, :, None], at[:, None, :]] + P[own, own] - cross - np.swapaxes(cross, 1, 2)
        delta = x[at] - x[own]
        # Two features of one certain pose may have one and the same error.
        return nees(delta, D + 1e-12 * np.eye(2))

    def _join(self, keep: int, drop: int) -> None:
        merged, other = self.histories[keep], self.histories.pop(drop)
        merged.readings += other.readings
        merged.confirmed, merged.last = merged.confirmed or other.confirmed, max(merged.last, other.last)
        merged.seen_with |= other.seen_with
        for history in self.histories.values():
            if drop in history.seen_with:
                history.seen_with = history.seen_with - {drop} | {keep}
        self.ids = {name: keep if i == drop else i for name, i in self.ids.items()}


class EkfSlam:
    """Estimates pose and features from records, one after the other.

    Time:
        - Odometry holds from its time on until the next; increments end at their time. Both add up.
        - At one instant motion comes before readings, whatever their order in the log; all readings of an instant
          are associated and used together, once a later record comes or :meth:`finish` is called.
        - A record older than one already processed is an error.
        - A record that repeats one of the same instant is skipped and counted: odometry or an increment with the same
          numbers, a detection with the same identity or the same reading.

    Features that are not of known identity are tentative at first. They are part of the state, so that no reading is
    lost; they are confirmed by their third reading (``settings.confirm``), or dropped when none has come for a while
    (``settings.timeout``). Taking a feature out of the state is exact.

    Args:
        sensors: the sensor model of each kind of detection (``Detection.kind``).
        velocity: the model for odometry records, u = (v, ω, dt).
        increment: the model for increments, u = (dx, dy, dθ).
        settings: how readings find their features.
        start: first pose.
        P: its covariance, shape (3, 3); None for a pose that is certain (the origin of the map, in SLAM).
        mode: see :class:`trailmark.estimation.SlamFilter`. In "mapping" the poses come from the log's ``Pose`` records
            and scans, with ``pose_covariance``; odometry is then left out.
        pose_covariance: of the poses in "mapping", shape (3, 3); None for poses that are certain.
    """

    @checked_arguments(EstimationError)
    def __init__(
        self,
        sensors: Mapping[str, SensorModel],
        *,
        velocity: MotionModel | None = None,
        increment: MotionModel | None = None,
        settings: SlamSettings | None = None,
        start: ArrayLike = (0.0, 0.0, 0.0),
        P: ArrayLike | None = None,
        mode: Mode = "slam",
        pose_covariance: ArrayLike | None = None,
    ) -> None:
        self.settings = SlamSettings() if settings is None else settings
        if "auto" in (self.settings.association, self.settings.outlier_gate):
            raise EstimationError("EkfSlam: expected settings without 'auto', which map_log alone can resolve")
        self.filter = SlamFilter(start, P, mode, iterations=ITERATIONS, curvature=CURVATURE)
        self.counts = Counts()
        self.time = -np.inf
        self._sensors = dict(sensors)
        self._velocity_model, self._increment_model = velocity, increment
        self._pose_covariance = pose_covariance
        self._odometry: Odometry | None = None
        self._increment: Increment | None = None
        self._waiting: list[Detection] = []
        self._features = FeatureHistories(self.filter, self.settings)
        self._associator = Associator(self.filter, self.settings, self.counts)
        self._trajectory: list[tuple[float, FloatArray, FloatArray]] = []
        self._updates: list[Update] = []
        self._assignments: list[Assignment] = []

    @checked_arguments(EstimationError)
    def add_landmark(self, feature: ArrayLike, P: ArrayLike | None = None, *, identity: int | None = None) -> int:
        """Add a feature of a known map and return its id in the filter; P None for one that is certain."""
        feature_id = self.filter.add_known_feature(feature, P)
        self._features.add(feature_id, identity, confirmed=True, time=self.time, readings=0)
        return feature_id

    def run(self, records: Iterable[Record]) -> SlamResult:
        """Process all records and return the result.

        Raises:
            RecordError: a late record, or one of a kind that no model was given for.
        """
        if not isinstance(records, Iterable):
            raise EstimationError(f"run: expected records, got {brief(records)}")
        for record in records:
            self.process(record)
        self.finish()
        return self.result()

    def process(self, record: Record) -> None:
        """Process the next record of the log.

        Raises:
            RecordError: as for :meth:`run`.
        """
        if not isinstance(record, Record) or math.isnan(real(record.t)):
            raise RecordError(f"expected a record with its time, got {brief(record)}")
        self.counts.records += 1
        if isinstance(record, Pose) and (record.truth or self.filter.mode != "mapping"):
            self.counts.not_estimated_from += 1
            return
        if record.t < self.time:
            raise RecordError(
                f"expected records in the order of time, got {type(record).__name__} at {record.t:.6f} s "
                f"after one at {self.time:.6f} s"
            )
        if record.t > self.time:
            self.finish()
            self._advance(record.t)
        match record:
            case Odometry():
                self._steer(record)
            case Increment():
                self._move(record)
            case Detection():
                self._collect(record)
            case Scan():
                self._scan(record)
            case Pose():
                self.filter.set_pose((record.x, record.y, record.theta), self._pose_covariance)
                self._remember()

    def finish(self) -> None:
        """Use the readings that wait for the end of their instant."""
        if not self._waiting:
            return
        begin = perf_counter()
        waiting, self._waiting = self._waiting, []
        nis, dof = 0.0, 0
        for kind in dict.fromkeys(detection.kind for detection in waiting):
            detections = [detection for detection in waiting if detection.kind == kind]
            assigned = self._associator.assign(self._sensors[kind], detections, self._features.ids)
            more_nis, more_dof = self._update(self._sensors[kind], detections, assigned)
            self._start_features(self._sensors[kind], detections, assigned)
            nis, dof = nis + more_nis, dof + more_dof
        self.counts.dropped += self._features.drop_stale(self.time)
        self._remember()
        self._updates.append(Update(self.time, nis, dof, perf_counter() - begin))

    def features(self, *, tentative: bool = False) -> tuple[MapFeature, ...]:
        """Return the features found so far: those that are confirmed, or with ``tentative`` all."""
        return tuple(
            MapFeature(i, history.identity, self.filter.feature(i), self.filter.feature_covariance(i), history.readings)
            for i, history in self._features.histories.items()
            if history.confirmed or tentative
        )

    def result(self) -> SlamResult:
        """Return what was found so far."""
        rows = [(t, *pose) for t, pose, _ in self._trajectory]
        return SlamResult(
            np.array(rows).reshape(-1, 4),
            np.array([P for *_, P in self._trajectory]).reshape(-1, 3, 3),
            self.features(),
            tuple(self._updates),
            tuple(self._assignments),
            replace(self.counts),
        )

    def _advance(self, t: float) -> None:
        """Predict up to a time, by the odometry that holds."""
        if self._odometry is not None and self._velocity_model is not None and self.filter.mode != "mapping":
            self.filter.predict(self._velocity_model, (self._odometry.v, self._odometry.omega, t - self.time))
            self.time = t
            self._remember()
        self.time = t

    def _steer(self, record: Odometry) -> None:
        if self._velocity_model is None and self.filter.mode != "mapping":
            raise RecordError(f"expected velocity=…, the motion model for odometry at {record.t:.6f} s, got none")
        if record == self._odometry:
            self.counts.repeated += 1
        self._odometry = record

    def _move(self, record: Increment) -> None:
        if self.filter.mode == "mapping":
            return
        if self._increment_model is None:
            raise RecordError(f"expected increment=…, the motion model for increments at {record.t:.6f} s, got none")
        if self._increment is not None and record[:4] == self._increment[:4]:
            self.counts.repeated += 1
            return
        self._increment = record
        self.filter.predict(self._increment_model, record[1:4], record.covariance)
        self._remember()

    def _scan(self, record: Scan) -> None:
        if record.pose is not None and self.filter.mode == "mapping":
            self.filter.set_pose(record.pose, self._pose_covariance)
            self._remember()
        self.counts.not_estimated_from += 1

    def _collect(self, detection: Detection) -> None:
        """Let a detection wait for the others of its instant."""
        self.counts.detections += 1
        if not isinstance(detection.kind, str) or detection.kind not in self._sensors:
            raise RecordError(
                f"Detection at {detection.t:.6f} s: kind with a sensor model: "
                f"{expected_name(str(detection.kind), self._sensors)}"
            )
        if not isinstance(detection.identity, int | np.integer | None):
            raise RecordError(f"identity: expected a whole number or None, got {brief(detection.identity)}")
        if any(repeats(detection, other) for other in self._waiting):
            self.counts.repeated += 1
        else:
            self._waiting.append(detection)

    def _update(
        self, sensor: SensorModel, detections: Sequence[Detection], assigned: Sequence[int]
    ) -> tuple[float, int]:
        """Correct the state by the readings of features that are in it; return the NIS and its degrees of freedom."""
        old = [(detection, i) for detection, i in zip(detections, assigned, strict=True) if i >= 0]
        ids = [i for _, i in old]
        R = [detection.covariance for detection, _ in old]
        innovation = self.filter.update_batch(
            np.array([detection.z for detection, _ in old]).reshape(-1, sensor.reading_dim), sensor, ids, R
        )
        self._features.read(ids, self.time)
        return innovation.nis, innovation.dof

    def _start_features(self, sensor: SensorModel, detections: Sequence[Detection], assigned: Sequence[int]) -> None:
        """Add what is new, and write down what became of each detection."""
        known, seen = self.settings.association == "known", list[int]()
        for detection, i in zip(detections, assigned, strict=True):
            feature = i if i >= 0 else None
            if i == NEW:
                feature = self.filter.add_feature(detection.z, sensor, detection.covariance)
                identity = detection.identity if known else None
                confirmed = known or self.settings.confirm == 1
                self._features.add(feature, identity, confirmed=confirmed, time=self.time)
            if feature is not None:
                seen.append(feature)
            self._assignments.append(Assignment(detection.t, detection.identity, feature, detection))
        self.counts.used += len(seen)
        if not known and self.settings.merge_gate is not None and self.filter.mode == "slam":
            self._merge(seen)

    def _merge(self, seen: list[int]) -> None:
        """Merge features that were seen now with others that may be the same, in what was written down, too."""
        gone = self._features.merge(seen)
        self.counts.merged += len(gone)
        if gone:
            self._assignments = [
                a._replace(feature=gone[a.feature]) if a.feature in gone else a for a in self._assignments
            ]

    def _remember(self) -> None:
        """Write down the pose; of one instant only what it ends with."""
        if self._trajectory and self._trajectory[-1][0] == self.time:
            self._trajectory.pop()
        self._trajectory.append((self.time, self.filter.pose, self.filter.pose_covariance))
