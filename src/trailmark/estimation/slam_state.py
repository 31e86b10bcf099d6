# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P
"""The state of a SLAM filter: the robot's pose and features, whose number grows and shrinks."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import ArrayLike, NDArray

from trailmark.estimation.covariance import checked_covariance
from trailmark.estimation.errors import EstimationError
from trailmark.se2 import FloatArray, configurations

__all__ = ["SlamState", "checked_pose"]


class SlamState(ExtendedKalmanFilter):  # type: ignore[misc]  # filterpy ships no type information
    """filterpy's EKF with x = [pose, feature, feature, …] and its covariance P, in which features have ids.

    Args:
        pose: x, y, theta to begin with; metres and radians.
        P: its covariance, shape (3, 3); None for a pose that is certain.

    Raises:
        EstimationError: a covariance that is not symmetric positive semidefinite.
    """

    x: FloatArray
    P: FloatArray

    def __init__(self, pose: ArrayLike = (0.0, 0.0, 0.0), P: ArrayLike | None = None) -> None:
        super().__init__(dim_x=3, dim_z=2)
        self.x = checked_pose(pose)
        self.P = np.zeros((3, 3)) if P is None else checked_covariance(P, 3, "pose")
        self.x_prior = self.P_prior = self.x_post = self.P_post = None
        self._places: dict[int, slice] = {}
        self._kinds: dict[int, str] = {}
        self._points: NDArray[np.intp] | None = None
        self._next_id = 0

    @property
    def pose(self) -> FloatArray:
        """x, y, theta, shape (3,); metres, radians in (−π, π]."""
        return self.x[:3].copy()

    @property
    def pose_covariance(self) -> FloatArray:
        """Shape (3, 3)."""
        return self.P[:3, :3].copy()

    @property
    def features(self) -> Mapping[int, slice]:
        """The features' ids, in the order of the state, and where in x and P each stands."""
        return MappingProxyType(self._places)

    def feature(self, feature_id: int) -> FloatArray:
        """Return a feature's estimate, shape (d,)."""
        return self.x[self._place(feature_id)].copy()

    def feature_covariance(self, feature_id: int) -> FloatArray:
        """Return a feature's covariance, shape (d, d)."""
        place = self._place(feature_id)
        return self.P[place, place].copy()

    def kind(self, feature_id: int) -> str:
        """Return what a feature is: the kind of the sensors that see it."""
        self._place(feature_id)
        return self._kinds[feature_id]

    def add_known_feature(self, feature: ArrayLike, P: ArrayLike | None = None, *, kind: str = "point") -> int:
        """Add a feature of a known map, uncorrelated with the rest; return its id.

        Args:
            feature: shape (d,).
            P: its covariance, shape (d, d); None for one that is certain.
            kind: "point" or "line", as the sensors that see it have it.
        """
        l = np.array(feature, dtype=np.float64)  # noqa: E741 # a feature
        if l.ndim != 1 or not np.isfinite(l).all():
            raise EstimationError(f"add_known_feature: {l.tolist()} given, allowed: finite numbers, shape (d,)")
        block = np.zeros((len(l), len(l))) if P is None else checked_covariance(P, len(l), "feature")
        return self._append(l, block, np.zeros((len(l), len(self.x))), kind)

    def remove_feature(self, feature_id: int) -> None:
        """Take a feature out of the state: exact, since the rest of a Gaussian stays what it was."""
        gone = self._place(feature_id)
        keep = np.r_[0 : gone.start, gone.stop : len(self.x)]
        self.x, self.P = self.x[keep], self.P[np.ix_(keep, keep)]
        del self._places[feature_id], self._kinds[feature_id]
        d = gone.stop - gone.start
        for other, place in self._places.items():
            if place.start > gone.start:
                self._places[other] = slice(place.start - d, place.stop - d)
        self.dim_x, self._points = len(self.x), None

    @property
    def points(self) -> NDArray[np.intp]:
        """Where x and y of the robot and of each feature that is a point stand in the state, shape (k, 2)."""
        if self._points is None:
            starts = [0, *(place.start for i, place in self._places.items() if self._kinds[i] == "point")]
            self._points = np.array(starts, dtype=np.intp)[:, None] + np.arange(2)
        return self._points

    def _append(self, feature: FloatArray, block: FloatArray, cross: FloatArray, kind: str) -> int:
        n, d = len(self.x), len(feature)
        P = np.empty((n + d, n + d))
        P[:n, :n], P[n:, :n], P[:n, n:], P[n:, n:] = self.P, cross, cross.T, block
        self.x, self.P, self.dim_x = np.concatenate([self.x, feature]), P, n + d
        feature_id, self._next_id = self._next_id, self._next_id + 1
        self._places[feature_id], self._kinds[feature_id] = slice(n, n + d), kind
        self._points = None
        return feature_id

    def _place(self, feature_id: int) -> slice:
        if feature_id not in self._places:
            raise EstimationError(f"feature {feature_id!r} given, allowed: one of the {len(self._places)} in the state")
        return self._places[feature_id]


def checked_pose(pose: ArrayLike) -> FloatArray:
    """Return a copy of a pose, shape (3,), its heading in (−π, π], or say what is wrong with it."""
    q = configurations(pose, name="pose")
    if q.ndim != 1:
        raise EstimationError(f"pose: shape {q.shape} given, allowed: (3,)")
    return q
