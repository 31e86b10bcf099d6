"""The settings of a run over a log, with every default in sight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from trailmark.checked import Count, PositiveOrInfinite, Probability, checked_fields
from trailmark.estimation.errors import EstimationError

__all__ = ["AssociationMethod", "SlamSettings"]

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
