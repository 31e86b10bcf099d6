# ruff: noqa: N803, N806 # the names are those of the literature: x, P, F, W, Q, H, R, S, K
"""EKF-SLAM over the records of a log: predict, associate, update; trajectory, features, what became of the records.

Readings of one instant are assigned by the squared Mahalanobis distance d² = yᵀ S⁻¹ y to what each feature should read,
which has a chi-square distribution where reading and feature belong together. There are two thresholds: under the
first a reading may be of the feature, above the second of all features it shows a new one. In between it may be
either, and is ignored: a wrong feature, or one feature as two, harms a filter more than a reading less.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import Count, brief, checked_arguments, checked_fields, real
from trailmark.errors import expected_name
from trailmark.estimation.covariance import Consistency, average, chi_square_quantile
from trailmark.estimation.errors import EstimationError, RecordError
from trailmark.estimation.models import MotionModel, RangeBearing, as_range_bearing
from trailmark.estimation.records import Detection, Increment, Odometry, Pose, Record, Scan
from trailmark.estimation.slam_filter import Innovation, Prediction, SlamFilter
from trailmark.se2 import FloatArray

AssociationMethod = Literal["known", "joint"]
IntArray = NDArray[np.intp]

NEW = -1  # Stands for a feature not seen before.
IGNORED = -2  # Stands for no feature: the reading is ambiguous.


@dataclass(frozen=True)
class SlamSettings:
    """How readings find their features, and when a feature counts.

    Raises:
        EstimationError: a value that is not allowed.
    """

    #: "known": by the identity that the sensor reports; "joint": by joint compatibility (JCBB); "auto": known if any
    #: detection of the log has an identity, else joint, which :func:`trailmark.estimation.map_log` alone can tell.
    association: AssociationMethod | Literal["auto"] = "known"
    confirm: Count = 3  #: Readings after which a feature is confirmed. One of known identity is from the first on.

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)


class Gates(NamedTuple):
    """What the distances of readings and features are held against, as probabilities that good ones pass.

    Real readings have more outliers than Gaussian ones, so that what is a little too far off counts as new.
    """

    own: float = 0.99  # of a reading at its own feature; of JCBB's joint gate, too
    new: float = 0.9999  # of a reading at a feature: what passes none is new
    known: float | None = None  # of a reading with an identity, others are ignored; None lets all pass


@dataclass
class Counts:
    """How many records there were, and what became of them."""

    records: int = 0  # All of them.
    detections: int = 0  # Detections.
    used: int = 0  # Detections that corrected the state or started a feature.
    repeated: int = 0  # Records that say again what one of the same instant said, skipped.
    ambiguous: int = 0  # Detections between the two gates, ignored.
    outliers: int = 0  # Detections of a known identity too far from what they should have read, ignored.
    unidentified: int = 0  # Detections without the identity that the association asks for, ignored.
    not_estimated_from: int = 0  # Poses that are truth or a reference, and scans.
    dropped: int = 0  # Tentative features that were not seen again in time.
    cut_short: int = 0  # Joint associations whose search was cut short.


class Compatibility(NamedTuple):
    """How well each of r readings fits each of k features by itself."""

    y: FloatArray  # z − ẑ, shape (r, k, 2).
    R: FloatArray  # Covariance of each reading, were it of that feature, shape (r, k, 2, 2).
    d2: FloatArray  # yᵀ S⁻¹ y, shape (r, k).


class JointAssociation(NamedTuple):
    """The readings and features that fit together best, as a whole."""

    assigned: IntArray  # For each reading the number of its feature in the prediction, or NEW or IGNORED, shape (r,).
    nis: float  # Joint d² of all pairs.
    complete: bool  # False if the search was cut short: then there may be a better one.


def compatibility(
    z: FloatArray, prediction: Prediction, sensor: RangeBearing, stated: Sequence[FloatArray | None]
) -> Compatibility:
    """Return how well each reading, shape (r, 2), fits each of k features by itself; O(r k).

    ``stated`` holds for each reading its covariance (2, 2) where the log states one, else None.
    """
    y = sensor.residual(z[:, None], prediction.z_hat[None])
    R = np.repeat(prediction.R[None], len(z), axis=0)
    for own, covariance in zip(R, stated, strict=True):
        if covariance is not None:
            own[:] = covariance
    d2 = (y[..., None, :] @ np.linalg.inv(prediction.S - prediction.R + R) @ y[..., None])[..., 0, 0]
    return Compatibility(y, R, d2)


def distinct(assigned: ArrayLike, d2: FloatArray, new_gate: float) -> IntArray:
    """Return the association, shape (r,), in which an ignored reading is new if it can be of no feature known so far.

    The readings of an instant are of distinct features. A reading near features that all went to other readings of
    its instant is therefore of none of them, however near it is.

    Args:
        assigned: for each reading its feature's number, or NEW or IGNORED, shape (r,).
        d2: squared Mahalanobis distances, shape (r, k).
        new_gate: least d² of a reading of a new feature to all features that are left.
    """
    result = np.array(assigned, dtype=np.intp)
    left = np.ones(d2.shape[1], dtype=bool)
    left[result[result >= 0]] = False
    near = (d2[:, left] <= new_gate).any(axis=1)
    result[(result == IGNORED) & ~near] = NEW
    return result


def joint_compatibility(
    compatible: Compatibility,
    joint: FloatArray,
    gates: Gates,
    *,
    node_limit: int = 20_000,
) -> JointAssociation:
    """Return the largest set of pairs that fit together: Neira & Tardós 2001's JCBB (IEEE T-RA 17(6), 890–897).

    Pairs that fit one by one may not fit together, since the readings share the error of the pose. The readings are
    gone through in order, each with its compatible features, the nearest first, or with none; a set is followed as
    long as it is jointly compatible, d² of all its pairs under the chi-square quantile of their number, and as long
    as it may still have more pairs than the best one found, or as many and a smaller d².

    Args:
        compatible: of r readings and k features.
        joint: H P Hᵀ of the features' readings together, shape (k, 2, k, 2).
        gates: of single readings and of all together.
        node_limit: how many sets to consider; the number grows exponentially where many features are close together.
    """
    (r, k), rows = compatible.d2.shape, compatible.d2
    gate, new_gate = chi_square_quantile([gates.own, gates.new], 2)
    candidates = [np.flatnonzero(row <= gate)[np.argsort(row[row <= gate], kind="stable")].tolist() for row in rows]
    limits = np.concatenate([[0.0], chi_square_quantile(gates.own, 2 * np.arange(1, r + 1))])
    best, nodes = _Pairs((), np.zeros((0, 0)), np.zeros(0), 0.0), 0

    def may_win(found: _Pairs, i: int) -> bool:
        """Whether more pairs than the best set has, or as many with a smaller d², can still come of it."""
        possible = len(found.pairs) + sum(1 for row in candidates[i:] if row)
        return possible > len(best.pairs) or (possible == len(best.pairs) and found.d2 < best.d2)

    def extend(found: _Pairs, i: int) -> None:
        """Try all assignments of the readings i, i + 1 and so on."""
        nonlocal best, nodes
        if i == r:
            best = found if may_win(found, i) else best
            return
        assigned = {j for _, j in found.pairs}
        for j in candidates[i]:
            if j in assigned:
                continue
            nodes += 1
            if nodes > node_limit:
                break
            more = _extended(found, i, j, compatible, joint)
            if more.d2 <= limits[len(more.pairs)] and may_win(more, i + 1):
                extend(more, i + 1)
        if may_win(found, i + 1):
            extend(found, i + 1)

    extend(best, 0)
    assigned = np.full(r, NEW, dtype=np.intp)
    if k:
        assigned[rows.min(axis=1) <= new_gate] = IGNORED
    for i, j in best.pairs:
        assigned[i] = j
    return JointAssociation(assigned, best.d2, nodes <= node_limit)


def repeats(a: Detection, b: Detection) -> bool:
    """Return whether two detections of one instant are one: of the same feature by name, or the same reading."""
    if a.kind != b.kind or a.identity != b.identity:
        return False
    return a.identity is not None or np.array_equal(a.z, b.z)


class _Pairs(NamedTuple):
    """Pairs, with L⁻¹ of their joint S = L Lᵀ and L⁻¹ y, which grow by rows as pairs are added."""

    pairs: tuple[tuple[int, int], ...]
    L_inverse: FloatArray
    scaled: FloatArray
    d2: float


def _extended(found: _Pairs, i: int, j: int, compatible: Compatibility, joint: FloatArray) -> _Pairs:
    """Return the pairs with reading i as one of feature j, too."""
    y, R, _ = compatible
    size = len(found.scaled)
    others = [other for _, other in found.pairs]
    cross = joint[j][:, others].reshape(2, size)
    # Cholesky by blocks: S = [S₁, Cᵀ; C, S₂], L = [L₁, 0; C L₁⁻ᵀ, L₂].
    C = cross @ found.L_inverse.T
    corner = np.linalg.inv(np.linalg.cholesky(joint[j, :, j] + R[i, j] - C @ C.T))
    tail = corner @ (y[i, j] - C @ found.scaled)
    L_inverse = np.zeros((size + 2, size + 2))
    L_inverse[:size, :size], L_inverse[size:, size:] = found.L_inverse, corner
    L_inverse[size:, :size] = -corner @ C @ found.L_inverse
    scaled = np.concatenate([found.scaled, tail])
    return _Pairs((*found.pairs, (i, j)), L_inverse, scaled, found.d2 + float(tail @ tail))


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
        if self.settings.association == "auto":
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
        known = self.settings.association == "known"
        assigned = [self._known(detection) for detection in detections] if known else self._joint(detections)
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
        if not isinstance(detection.kind, str) or detection.kind not in ("range-bearing", "cartesian"):
            kinds = expected_name(str(detection.kind), ("range-bearing", "cartesian"))
            raise RecordError(f"Detection at {detection.t:.6f} s: kind: {kinds}")
        detection = as_range_bearing(detection)
        if not isinstance(detection.identity, int | np.integer | None):
            raise RecordError(f"identity: expected a whole number or None, got {brief(detection.identity)}")
        if any(repeats(detection, other) for other in self._waiting):
            self.counts.repeated += 1
        else:
            self._waiting.append(detection)

    def _known(self, detection: Detection) -> int:
        """Return the id of the feature that a detection names, or NEW or IGNORED."""
        if detection.identity is None:
            self.counts.unidentified += 1
            return IGNORED
        feature = self._ids.get(detection.identity, NEW)
        if feature != NEW and self._gates.known is not None:
            innovation = self.filter.innovation(detection.z, self._sensor, feature, detection.covariance)
            if innovation.nis > chi_square_quantile(self._gates.known, 2):
                self.counts.outliers += 1
                return IGNORED
        return feature

    def _joint(self, detections: Sequence[Detection]) -> list[int]:
        """Return the id of the feature of each detection by joint compatibility, or NEW or IGNORED."""
        prediction, new_gate = self.filter.predict_readings(self._sensor), chi_square_quantile(self._gates.new, 2)
        z = np.array([detection.z for detection in detections], dtype=np.float64)
        fit = compatibility(z, prediction, self._sensor, [detection.covariance for detection in detections])
        # Features that no reading comes near have no part in it, and would make it slow.
        near = np.flatnonzero((fit.d2 <= new_gate).any(axis=0))
        prediction, fit = prediction.select(near), Compatibility(*(part[:, near] for part in fit))
        found = joint_compatibility(fit, self.filter.joint_covariance(prediction), self._gates)
        assigned = distinct(found.assigned, fit.d2, new_gate)
        self.counts.cut_short += not found.complete
        self.counts.ambiguous += int(np.count_nonzero(assigned == IGNORED))
        return [prediction.ids[j] if j >= 0 else int(j) for j in assigned]

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
