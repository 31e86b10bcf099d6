"""The settings of a run over a log, with every default in sight. Tests: tests/estimation/slam/test_ekf_slam.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from trailmark.checked import Count, NonNegative, PositiveOrInfinite, Probability, checked_fields
from trailmark.estimation.errors import EstimationError

__all__ = ["AssociationMethod", "ErrorForm", "SlamSettings"]

AssociationMethod = Literal["known", "nearest", "joint"]

ErrorForm = Literal["invariant", "additive"]
"""The error that P is the covariance of: one that no turn of the whole map changes, or estimate − truth."""


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
    margin: NonNegative = 0.0
    """Without identities: a reading that fits another free feature nearly as well, by this much of d², is ignored."""
    distinct: bool = False
    """Without identities: whether a reading whose near features all went to others of its instant shows a new one."""
    merge_gate: Probability | None = None
    """Without identities: probability that two estimates of one point pass as one; None merges none."""
    absences: Count | None = None
    """Without identities: how often in a row a feature may not be read though it stands in the middle of the sensor's
    view (:mod:`trailmark.estimation.slam.field_of_view`), before it is dropped, confirmed or not; None drops none."""
    outlier_gate: Probability | Literal["auto"] | None = None
    """With known identities: probability that a reading passes, those that do not are ignored; None lets all pass.
    "auto": 0.9999; where much fails it, the noise is estimated."""
    confirm: Count = 3
    """Readings after which a feature is confirmed. One of known identity is from the first on."""
    timeout: PositiveOrInfinite = 10.0
    """Seconds without a reading after which a tentative feature is dropped."""
    error: ErrorForm = "invariant"
    """The error that the filter's covariance is of: see :class:`trailmark.estimation.SlamFilter`."""
    iterations: Count = 3
    """How often at most the filter linearises an update anew."""
    curvature: NonNegative = 0.0
    """By what the mean square of what a linearised reading misses is multiplied to count as its noise. 0: the filter of
    the books, too sure of features where bearings are coarse, since an error β takes r β²/2 from the range r. 1: right
    variances. 6: a right confidence of 0.99 after one reading as well, though β² has a longer tail than a normal
    deviate: with the quantiles t of χ²₁ and s of χ²₂, c of t + (t/2)² / (0.75 c) = s is 5.7."""
    late: Literal["raise", "skip"] = "raise"
    """What to do with a record older than one already processed; "skip" counts it."""

    def __post_init__(self) -> None:
        checked_fields(self, EstimationError)
        if self.gate > self.new_gate:
            raise EstimationError(f"SlamSettings: expected gate <= new_gate, got {self.gate}, {self.new_gate}")
