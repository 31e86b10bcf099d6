# ruff: noqa: N806 # the filter's own symbols: P, D
"""What is known of features besides their estimates: names, readings, and which of them may be one and the same."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.filter.ekf import SlamFilter
from trailmark.estimation.slam.slam_settings import SlamSettings

__all__ = ["FeatureHistories", "FeatureHistory"]


@dataclass
class FeatureHistory:
    """What is known of a feature besides its estimate."""

    identity: int | None
    confirmed: bool
    last: float
    readings: int = 1
    seen_with: set[int] = field(default_factory=set)
    """Features that were read at one instant with it: they are not the same."""


class FeatureHistories:
    """The histories of a filter's features; features that are dropped or merged leave the filter, too.

    Args:
        ekf: the filter.
        settings: when a feature counts, and when two are one.
    """

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

    def separate(self, features: list[int]) -> None:
        """Note that these features were read at one instant: they are different ones."""
        for feature in features:
            self.histories[feature].seen_with.update(other for other in features if other != feature)

    def drop_stale(self, time: float) -> int:
        """Drop tentative features that were not read for a while; return how many."""
        stale = [
            i
            for i, history in self.histories.items()
            if not history.confirmed and time - history.last > self._settings.timeout
        ]
        for i in stale:
            self._remove(i)
        return len(stale)

    def merge(self, features: list[int]) -> dict[int, int]:
        """Merge these features with others that may be the same; return which became which.

        Two features are one if they were never read at one instant and their difference passes the gate
        ``merge_gate`` by its covariance, which counts all they have in common. The filter then takes them for
        equal, which is exact, and one of them is removed.
        """
        gone: dict[int, int] = {}
        limit = chi_square_quantile(self._settings.merge_gate or 0.0, 2)
        for i in features:
            if i in gone:
                continue
            history = self.histories[i]
            others = [j for j in self.histories if j != i and j not in history.seen_with]
            if not others:
                continue
            d2 = self._differences(i, others)
            best = int(d2.argmin())
            if d2[best] > limit:
                continue
            keep, drop = sorted((i, others[best]), key=lambda k: -self.histories[k].readings)
            self._filter.merge_features(keep, drop)
            self._join(keep, drop)
            gone[drop] = keep
        return gone

    def _differences(self, i: int, others: list[int]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        """Return the squared Mahalanobis distance of a point to others, shape (k,)."""
        x, P, places = self._filter.x, self._filter.P, self._filter.features
        own, at = places[i], np.array([places[j].start for j in others])[:, None] + np.arange(2)
        cross = P[at, own]
        D = P[at[:, :, None], at[:, None, :]] + P[own, own] - cross - np.swapaxes(cross, 1, 2)
        # Two features of one certain pose may have one and the same error.
        D = D + 1e-12 * np.eye(2)
        delta = x[at] - x[own]
        return np.asarray((delta[:, None, :] @ np.linalg.solve(D, delta[..., None]))[:, 0, 0])

    def _join(self, keep: int, drop: int) -> None:
        merged, other = self.histories[keep], self.histories.pop(drop)
        merged.readings += other.readings
        merged.confirmed, merged.last = merged.confirmed or other.confirmed, max(merged.last, other.last)
        merged.seen_with |= other.seen_with
        for history in self.histories.values():
            if drop in history.seen_with:
                history.seen_with.discard(drop)
                history.seen_with.add(keep)
        self.ids = {name: keep if i == drop else i for name, i in self.ids.items()}

    def _remove(self, feature: int) -> None:
        self._filter.remove_feature(feature)
        del self.histories[feature]
        for history in self.histories.values():
            history.seen_with.discard(feature)
