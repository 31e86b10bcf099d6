"""The settings of a run over a log, and what it gives: trajectory, features, what happened to the records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from trailmark.arguments import Count, PositiveOrInfinite, Probability, checked_fields
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.consistency import Consistency, average
from trailmark.estimation.logs.records import Detection
from trailmark.se2 import FloatArray

__all__ = ["Assignment", "AssociationMethod", "Counts", "MapFeature", "SlamResult", "SlamSettings", "Update"]


AssociationMethod = Literal["known", "nearest", "joint"]


@dataclass(frozen=True)
class SlamSettings:
    """How readings find their features, and when a feature counts.

    The choice "auto" is for :func:`trailmark.estimation.map_log`, which reads the whole log before it runs.

    Raises:
        EstimationError: a value that is not allowed.
    """

    association: AssociationMethod | Literal["auto"] = "known"
    """"known": by the identity that the sensor reports; "nearest": gated nearest neighbour; "joint": JCBB; "auto":
    known if any detection of the log has an identity, else joint."""
    gate: Probability = 0.99
    """Probability that a reading passes the gate of its own feature; also of JCBB's joint gate."""
    new_gate: Probability = 0.999999
    """Probability that a reading of a feature passes that feature's second gate: what passes none is new."""
    distinct: bool = False
    """Without identities: whether a reading whose near features all went to others of its instant shows a new one."""
    merge_gate: Probability | None = None
    """Without identities: probability that two estimates of one point pass as one; None merges none."""
    outlier_gate: Probability | Literal["auto"] | None = None
    """With known identities: probability that a reading passes, those that do not are ignored; None lets all pass.
    "auto": 0.9999; where much fails it, the noise is estimated."""
    confirm: Count = 3
    """Readings after which a feature is confirmed. One of known identity is from the first on."""
    timeout: PositiveOrInfinite = 10.0
    """Seconds without a reading after which a tentative feature is dropped."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
        if self.gate > self.new_gate:
            raise EstimationError(f"SlamSettings: expected gate <= new_gate, got {self.gate}, {self.new_gate}")


@dataclass
class Counts:
    """How many records there were, and what became of them."""

    records: int = 0
    """All of them."""
    detections: int = 0
    """Detections."""
    used: int = 0
    """Detections that corrected the state or started a feature."""
    repeated: int = 0
    """Records that say again what one of the same instant said, skipped."""
    ambiguous: int = 0
    """Detections between the two gates, ignored."""
    outliers: int = 0
    """Detections of a known identity too far from what they should have read, ignored."""
    unidentified: int = 0
    """Detections without the identity that the association asks for, ignored."""
    not_estimated_from: int = 0
    """Poses that are truth or a reference, and scans."""
    dropped: int = 0
    """Tentative features that were not seen again in time."""
    merged: int = 0
    """Features that turned out to be another one."""
    cut_short: int = 0
    """Joint associations whose search was cut short."""


class Update(NamedTuple):
    """One correction of the state."""

    t: float
    """Seconds."""
    nis: float
    """Normalised innovation squared; 0 where all readings were new."""
    dof: int
    """Its degrees of freedom."""
    seconds: float
    """Time that association, update and features took."""


class Assignment(NamedTuple):
    """What became of one detection."""

    t: float
    """Seconds."""
    identity: int | None
    """What the log says the feature was, used or not."""
    feature: int | None
    """The feature that it was assigned to; None if it was ignored."""
    detection: Detection
    """What was read."""


class MapFeature(NamedTuple):
    """A feature of the map."""

    id: int
    """Its id in the filter."""
    identity: int | None
    """The number that the sensor gives it, where identities are known."""
    mean: FloatArray
    """Shape (d,)."""
    covariance: FloatArray
    """Shape (d, d)."""
    readings: int
    """How many readings it rests on."""


class SlamResult(NamedTuple):
    """The outcome of a run."""

    trajectory: FloatArray
    """Rows t, x, y, theta, shape (n, 4): the estimate at each instant that had a record."""
    covariances: FloatArray
    """Of x, y, theta, shape (n, 3, 3)."""
    features: tuple[MapFeature, ...]
    """Confirmed features."""
    updates: tuple[Update, ...]
    """Corrections in order."""
    assignments: tuple[Assignment, ...]
    """Detections in order."""
    counts: Counts
    """What happened to the records."""

    def nis(self, probability: float = 0.95) -> Consistency:
        """Return the average NIS per update and its band."""
        updates = [update for update in self.updates if update.dof]
        return average([update.nis for update in updates], [update.dof for update in updates], probability)

    @property
    def seconds_per_update(self) -> float:
        """Mean time of an update; NaN if there was none."""
        return float(np.mean([update.seconds for update in self.updates])) if self.updates else float("nan")
