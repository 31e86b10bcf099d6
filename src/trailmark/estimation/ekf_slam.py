# ruff: noqa: N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""EKF-SLAM over the records of a log: predict, observe, update; trajectory, features, what became of the records."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trailmark.arguments import brief, checked_arguments, real
from trailmark.errors import expected_name
from trailmark.estimation.association import NEW, Associator, Counts, Gates, SlamSettings, repeats
from trailmark.estimation.covariance import Consistency, average
from trailmark.estimation.errors import EstimationError, RecordError
from trailmark.estimation.models import MotionModel, RangeBearing, as_range_bearing
from trailmark.estimation.records import Detection, Increment, Odometry, Pose, Record, Scan
from trailmark.estimation.slam_filter import Innovation, SlamFilter
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
    mean: FloatArray  # Shape (2,).
    covariance: FloatArray  # Shape (2, 2).
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


# By what the mean square of what a linearised reading misses is multiplied to count as its noise. With 0, the filter
# of the books, features are too sure where bearings are coarse, since an error β takes r β²/2 from the range r. 1
# gives right variances. 6 gives a right confidence of 0.99 after one reading as well, though β² has a longer tail
# than a normal deviate: with the quantiles t of χ²₁ and s of χ²₂, c of t + (t/2)² / (0.75 c) = s is 5.7.
CURVATURE = 6.0
TIMEOUT = 60.0  # Seconds without a reading after which a tentative feature is dropped.


@dataclass
class FeatureHistory:
    """What is known of a feature besides its estimate."""

    identity: int | None
    confirmed: bool
    last: float
    readings: int = 1


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
    lost; they are confirmed by their third reading (``settings.confirm``), or dropped when none has come for a while.
    Taking a feature out of the state is exact.

    Args:
        sensor: the noise of detections that state none; those by x and y are taken as range and bearing.
        velocity: the model for odometry records, u = (v, ω, dt).
        increment: the model for increments, u = (dx, dy, dθ).
        settings: how readings find their features.
        gates: what their distances are held against; None for the usual ones.
        start: first pose.
        P: its covariance, shape (3, 3); None for a pose that is certain (the origin of the map, in SLAM).
        mode: in "mapping" the poses are those of the log's ``Pose`` records and scans, with ``pose_covariance``;
            odometry is then left out.
        pose_covariance: of each pose in "mapping", by itself, shape (3, 3); None for poses that are certain.
    """

    @checked_arguments(EstimationError)
    def __init__(
        self,
        sensor: RangeBearing,
        *,
        velocity: MotionModel | None = None,
        increment: MotionModel | None = None,
        settings: SlamSettings | None = None,
        gates: Gates | None = None,
        start: ArrayLike = (0.0, 0.0, 0.0),
        P: ArrayLike | None = None,
        mode: Literal["slam", "mapping"] = "slam",
        pose_covariance: ArrayLike | None = None,
    ) -> None:
        self.settings = SlamSettings() if settings is None else settings
        association = self.settings.association
        if association == "auto":
            raise EstimationError("EkfSlam: expected settings without 'auto', which map_log alone can resolve")
        self.filter = SlamFilter(start, P, curvature=CURVATURE)
        self.counts = Counts()
        self.time = -np.inf
        self._sensor, self._gates, self._mapping = sensor, gates or Gates(), mode == "mapping"
        self._velocity_model, self._increment_model = velocity, increment
        self._pose_covariance = pose_covariance
        self._odometry: Odometry | None = None
        self._increment: Increment | None = None
        self._waiting: list[Detection] = []
        self._features, self._ids = dict[int, FeatureHistory](), dict[int, int]()
        self._associator = Associator(self.filter, sensor, association, self._gates, self.counts)
        self._trajectory: list[tuple[float, FloatArray, FloatArray]] = []
        self._updates: list[Update] = []
        self._assignments: list[Assignment] = []

    @checked_arguments(EstimationError)
    def add_landmark(self, feature: ArrayLike, P: ArrayLike | None = None, *, identity: int | None = None) -> int:
        """Add a feature of a known map and return its id in the filter; P None for one that is certain."""
        feature_id = self.filter.add_known_feature(feature, P)
        self._begin(feature_id, FeatureHistory(identity, True, self.time, 0))
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
        if isinstance(record, Pose) and (record.truth or not self._mapping):
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
        detections, self._waiting = self._waiting, []
        assigned = self._associator.assign(detections, self._ids)
        innovation = self._update(detections, assigned)
        self._start_features(detections, assigned)
        self._drop_stale()
        if not self._mapping:
            self._remember()
        self._updates.append(Update(self.time, innovation.nis, innovation.dof, perf_counter() - begin))

    def features(self, *, tentative: bool = False) -> tuple[MapFeature, ...]:
        """Return the features found so far: those that are confirmed, or with ``tentative`` all."""
        return tuple(
            MapFeature(i, history.identity, self.filter.feature(i), self.filter.feature_covariance(i), history.readings)
            for i, history in self._features.items()
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
        if self._odometry is not None and self._velocity_model is not None and not self._mapping:
            self.filter.predict(self._velocity_model, (self._odometry.v, self._odometry.omega, t - self.time))
            self.time = t
            self._remember()
        self.time = t

    def _steer(self, record: Odometry) -> None:
        if self._velocity_model is None and not self._mapping:
            raise RecordError(f"expected velocity=…, the motion model for odometry at {record.t:.6f} s, got none")
        if record == self._odometry:
            self.counts.repeated += 1
        self._odometry = record

    def _move(self, record: Increment) -> None:
        if self._mapping:
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
        if record.pose is not None and self._mapping:
            self.filter.set_pose(record.pose, self._pose_covariance)
            self._remember()
        self.counts.not_estimated_from += 1

    def _collect(self, detection: Detection) -> None:
        """Let a detection wait for the others of its instant."""
        self.counts.detections += 1
        if detection.kind not in ("range-bearing", "cartesian"):
            kinds = expected_name(str(detection.kind), ("range-bearing", "cartesian"))
            raise RecordError(f"Detection at {detection.t:.6f} s: kind: {kinds}")
        detection = as_range_bearing(detection)
        if not isinstance(detection.identity, int | np.integer | None):
            raise RecordError(f"identity: expected a whole number or None, got {brief(detection.identity)}")
        if any(repeats(detection, other) for other in self._waiting):
            self.counts.repeated += 1
        else:
            self._waiting.append(detection)

    def _update(self, detections: Sequence[Detection], assigned: Sequence[int]) -> Innovation:
        """Correct the state by the readings of features that are in it."""
        old = [(detection, i) for detection, i in zip(detections, assigned, strict=True) if i >= 0]
        z = np.array([detection.z for detection, _ in old], dtype=np.float64).reshape(-1, 2)
        R = [detection.covariance for detection, _ in old]
        innovation = self.filter.update_batch(z, self._sensor, [i for _, i in old], R)
        for _, i in old:
            history = self._features[i]
            history.readings, history.last = history.readings + 1, self.time
            history.confirmed = history.confirmed or history.readings >= self.settings.confirm
        return innovation

    def _start_features(self, detections: Sequence[Detection], assigned: Sequence[int]) -> None:
        """Add what is new, and write down what became of each detection."""
        known = self.settings.association == "known"
        for detection, i in zip(detections, assigned, strict=True):
            feature = i if i >= 0 else None
            if i == NEW:
                feature = self.filter.add_feature(detection.z, self._sensor, detection.covariance)
                confirmed = known or self.settings.confirm == 1
                self._begin(feature, FeatureHistory(detection.identity if known else None, confirmed, self.time))
            self.counts.used += feature is not None
            self._assignments.append(Assignment(detection.t, detection.identity, feature, detection))

    def _begin(self, feature: int, history: FeatureHistory) -> None:
        self._features[feature] = history
        if history.identity is not None:
            self._ids[history.identity] = feature

    def _drop_stale(self) -> None:
        """Drop tentative features that were not read for a while."""
        limit = self.time - TIMEOUT
        stale = [i for i, history in self._features.items() if not history.confirmed and history.last < limit]
        for i in stale:
            self.filter.remove_feature(i)
            del self._features[i]
        self.counts.dropped += len(stale)

    def _remember(self) -> None:
        """Write down the pose; of one instant only what it ends with."""
        if self._trajectory and self._trajectory[-1][0] == self.time:
            self._trajectory.pop()
        self._trajectory.append((self.time, self.filter.pose, self.filter.pose_covariance))
