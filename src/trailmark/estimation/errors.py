"""The exceptions of the estimators; all are :class:`trailmark.errors.TrailmarkError`."""

from __future__ import annotations

from trailmark.errors import TrailmarkError


class EstimationError(TrailmarkError, ValueError):
    """Noise, readings or features that an estimator cannot use: a wrong shape, not finite, not there."""


class NotCertifiedError(EstimationError):
    """A confidence that was asked of a map whose estimates are not to be relied on."""


class RecordError(EstimationError):
    """A record of a log that an estimator cannot use: late, repeated, without the identity that is asked for."""
