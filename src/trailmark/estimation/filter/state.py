# ruff: noqa: N803, N806 # the names are the filter's own symbols: x, P, R, G, H
"""The state of a SLAM filter: the robot's pose and features, whose number grows and shrinks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import ArrayLike, NDArray

from trailmark.arguments import brief, checked, checked_arguments, number_array, shaped
from trailmark.estimation.errors import EstimationError
from trailmark.estimation.filter.covariance import checked_covariance
from trailmark.estimation.filter.sensors import SensorModel
from trailmark.se2 import FloatArray, configurations

__all__ = ["Mode", "SlamState", "checked_pose"]


Mode = Literal["slam", "mapping"]
"""What an update may change: pose and features, or the features alone."""


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
    mode: Mode = "slam"
    curvature: float = 0.0

    def __init__(self, pose: ArrayLike = (0.0, 0.0, 0.0), P: ArrayLike | None = None) -> None:
        super().__init__(dim_x=3, dim_z=2)
        self.x = checked_pose(pose)
        self.P = np.zeros((3, 3)) if P is None else checked_covariance(P, 3, "pose")
        self.x_prior = self.P_prior = self.x_post = self.P_post = None
        self._places: dict[int, slice] = {}
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

    def add_feature(self, z: ArrayLike, sensor: SensorModel, R: ArrayLike | None = None) -> int:
        """Add the feature that a reading shows, with the correlations that the pose gives it; return its id; O(n²).

        Args:
            z: its first reading, shape (m,).
            sensor: what read it.
            R: covariance of z itself, shape (m, m), where the log states one; None for the sensor's V R Vᵀ.

        Raises:
            EstimationError: a reading that is not finite.
        """
        checked(sensor, SensorModel, "add_feature: sensor", EstimationError)
        reading = number_array(z, "reading", error=EstimationError)
        if reading.shape != (sensor.reading_dim,) or not np.isfinite(reading).all():
            raise EstimationError(f"reading: expected {sensor.reading_dim} finite numbers, got {reading.tolist()}")
        l, G_pose, G_z = sensor.inverse(self.pose, reading)  # noqa: E741 # a feature
        noise = sensor.noise(self.pose, l) if R is None else checked_covariance(R, sensor.reading_dim, "reading")
        noise = noise + self.curvature * sensor.curvature(reading, noise)
        block = G_pose @ self.P[:3, :3] @ G_pose.T + G_z @ noise @ G_z.T
        return self._append(l, 0.5 * (block + block.T), G_pose @ self.P[:3])

    @checked_arguments(EstimationError)
    def add_known_feature(self, feature: Annotated[ArrayLike, shaped(2)], P: ArrayLike | None = None) -> int:
        """Add a feature of a known map, uncorrelated with the rest; return its id.

        Args:
            feature: shape (2,).
            P: its covariance, shape (2, 2); None for one that is certain.
        """
        l = np.asarray(feature)  # noqa: E741 # a feature
        block = np.zeros((len(l), len(l))) if P is None else checked_covariance(P, len(l), "feature")
        return self._append(l, block, np.zeros((len(l), len(self.x))))

    def remove_feature(self, feature_id: int) -> None:
        """Take a feature out of the state: exact, since the rest of a Gaussian stays what it was."""
        gone = self._place(feature_id)
        keep = np.r_[0 : gone.start, gone.stop : len(self.x)]
        self.x, self.P = self.x[keep], self.P[np.ix_(keep, keep)]
        del self._places[feature_id]
        d = gone.stop - gone.start
        for other, place in self._places.items():
            if place.start > gone.start:
                self._places[other] = slice(place.start - d, place.stop - d)
        self.dim_x, self._points = len(self.x), None

    @property
    def points(self) -> NDArray[np.intp]:
        """Where x and y of the robot and of each feature stand in the state, shape (k, 2)."""
        if self._points is None:
            starts = [0, *(place.start for place in self._places.values())]
            self._points = np.array(starts, dtype=np.intp)[:, None] + np.arange(2)
        return self._points

    def places(self, sensor: SensorModel, ids: Sequence[int]) -> NDArray[np.intp]:
        """Return where the features' numbers stand in the state, shape (k, d)."""
        places = [self._place(i) for i in checked(ids, Sequence[Any], "ids", EstimationError)]
        starts = np.array([place.start for place in places], dtype=np.intp)
        return starts[:, None] + np.arange(sensor.feature_dim)

    def checked_readings(
        self, z: ArrayLike, sensor: SensorModel, ids: Sequence[int], R: Sequence[ArrayLike | None] | None
    ) -> tuple[FloatArray, FloatArray]:
        """Return readings of features, shape (k, m), and the covariance of each, shape (k, m, m).

        Args:
            z: the readings, shape (k, m).
            sensor: what read them.
            ids: of which features, no two the same.
            R: covariance of each reading, shape (m, m), or None for the sensor's V R Vᵀ; None for all of them.

        Raises:
            EstimationError: what of this is wrong.
        """
        checked(sensor, SensorModel, "update: sensor", EstimationError)
        places = self.places(sensor, checked(ids, Sequence[Any], "update: ids", EstimationError))
        readings, k, m = number_array(z, "readings", error=EstimationError), len(places), sensor.reading_dim
        if readings.shape != (k, m) or not np.isfinite(readings).all():
            raise EstimationError(f"readings: expected {k} times {m} finite numbers, got {readings.tolist()}")
        if len(set(ids)) < k:
            raise EstimationError("update: expected one reading of each feature, got two of one at once")
        stated = [None] * k if R is None else checked(R, Sequence[Any], "update: R", EstimationError)
        if len(stated) != k:
            raise EstimationError(f"update: expected {k} covariances, one for each reading, got {len(stated)}")
        noise = np.empty((k, m, m))
        if any(covariance is None for covariance in stated):
            noise[:] = sensor.noise(self.pose, self.x[places])
        for i, covariance in enumerate(stated):
            if covariance is not None:
                noise[i] = checked_covariance(covariance, m, "reading")
        return readings, noise

    def _append(self, feature: FloatArray, block: FloatArray, cross: FloatArray) -> int:
        n, d = len(self.x), len(feature)
        P = np.empty((n + d, n + d))
        P[:n, :n], P[n:, :n], P[:n, n:], P[n:, n:] = self.P, cross, cross.T, block
        self.x, self.P, self.dim_x = np.concatenate([self.x, feature]), P, n + d
        feature_id, self._next_id = self._next_id, self._next_id + 1
        self._places[feature_id] = slice(n, n + d)
        self._points = None
        return feature_id

    def _place(self, feature_id: int) -> slice:
        if not isinstance(feature_id, int | np.integer) or feature_id not in self._places:
            ids = f"the id of one of the {len(self._places)} features"
            raise EstimationError(f"feature: expected {ids}, got {brief(feature_id)}")
        return self._places[feature_id]


def checked_pose(pose: ArrayLike) -> FloatArray:
    """Return a copy of a pose, shape (3,), its heading in (−π, π], or say what is wrong with it."""
    q = configurations(pose, name="pose")
    if q.ndim != 1:
        raise EstimationError(f"pose: expected shape (3,), got {q.shape}")
    return q
