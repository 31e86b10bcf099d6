"""The settings of a run over a log, with every default in sight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from trailmark.errors import did_you_mean
from trailmark.estimation.errors import EstimationError

__all__ = ["AssociationMethod", "ErrorForm", "SlamSettings"]

AssociationMethod = Literal["known", "nearest", "joint"]

ErrorForm = Literal["invariant", "additive"]
"""The error that P is the covariance of: one that no turn of the whole map changes, or estimate − truth."""


@dataclass(frozen=True)
class SlamSettings:
    """How readings find their features, and when a feature counts.

    Raises:
        EstimationError: a value that is not allowed.
    """

    association: AssociationMethod = "known"
    """"known": by the identity that the sensor tells; "nearest": gated nearest neighbour; "joint": JCBB."""
    gate: float = 0.99
    """Probability that a reading passes the gate of its own feature; also of JCBB's joint gate."""
    new_gate: float = 0.999999
    """Probability that a reading of a feature passes that feature's second gate: what passes none is new."""
    margin: float = 0.0
    """Without identities: a reading that fits another free feature nearly as well, by this much of d², is ignored."""
    distinct: bool = False
    """Without identities: whether a reading whose near features all went to others of its instant shows a new one."""
    merge_gate: float | None = None
    """Without identities: probability that two estimates of one point pass as one; None merges none."""
    absences: int | None = None
    """Without identities: how often in a row a feature may not be read though it stands in the middle of the sensor's
    view (:mod:`trailmark.estimation.slam.field_of_view`), before it is dropped, confirmed or not; None drops none."""
    outlier_gate: float | None = None
    """With known identities: probability that a reading passes, those that do not are ignored; None lets all pass."""
    confirm: int = 3
    """Readings after which a feature is confirmed. One of known identity is from the first on."""
    timeout: float = 10.0
    """Seconds without a reading after which a tentative feature is dropped."""
    error: ErrorForm = "invariant"
    """The error that the filter's covariance is of: see :class:`trailmark.estimation.SlamFilter`."""
    iterations: int = 3
    """How often at most the filter linearises an update anew."""
    late: Literal["raise", "skip"] = "raise"
    """What to do with a record older than one already processed; "skip" counts it."""

    def __post_init__(self) -> None:
        if self.association not in get_args(AssociationMethod):
            hint = did_you_mean(str(self.association), get_args(AssociationMethod))
            raise EstimationError(f"association {self.association!r} given, {hint}")
        if not 0.0 < self.gate <= self.new_gate < 1.0:
            raise EstimationError(f"gates {self.gate}, {self.new_gate} given, allowed: 0 < gate <= new_gate < 1")
        if self.outlier_gate is not None and not 0.0 < self.outlier_gate < 1.0:
            raise EstimationError(f"outlier_gate {self.outlier_gate} given, allowed: between 0 and 1, or None")
        if self.absences is not None and self.absences < 1:
            raise EstimationError(f"absences {self.absences} given, allowed: 1 or more, or None")
        if not 0.0 <= self.margin < math.inf:
            raise EstimationError(f"margin {self.margin} given, allowed: 0 or more")
        if self.merge_gate is not None and not 0.0 < self.merge_gate < 1.0:
            raise EstimationError(f"merge_gate {self.merge_gate} given, allowed: between 0 and 1, or None")
        if self.iterations < 1:
            raise EstimationError(f"iterations {self.iterations} given, allowed: 1 or more")
        if self.error not in get_args(ErrorForm):
            hint = did_you_mean(str(self.error), get_args(ErrorForm))
            raise EstimationError(f"error {self.error!r} given, {hint}")
        if self.confirm < 1:
            raise EstimationError(f"confirm {self.confirm} given, allowed: 1 or more")
        if not self.timeout > 0.0:
            raise EstimationError(f"timeout {self.timeout} given, allowed: seconds above 0")
        if self.late not in ("raise", "skip"):
            raise EstimationError(f"late {self.late!r} given, allowed: 'raise' or 'skip'")
