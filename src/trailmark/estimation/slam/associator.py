"""Which features the detections of an instant are of, by the settings of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trailmark.estimation.filter.consistency import chi_square_quantile
from trailmark.estimation.filter.ekf import SlamFilter
from trailmark.estimation.filter.sensor_model import SensorModel
from trailmark.estimation.logs.records import Detection
from trailmark.estimation.slam.association import (
    IGNORED,
    NEW,
    clear,
    compatibility,
    distinct,
    joint_compatibility,
    nearest,
)
from trailmark.estimation.slam.slam_result import Counts
from trailmark.estimation.slam.slam_settings import SlamSettings

__all__ = ["Associator", "repeats"]


class Associator:
    """Assigns detections to a filter's features, and counts what it leaves out.

    Args:
        ekf: the filter; it is only read.
        settings: by identity, nearest neighbour or joint compatibility, and the gates.
        counts: where detections that are left out are counted.
    """

    def __init__(self, ekf: SlamFilter, settings: SlamSettings, counts: Counts) -> None:
        self._filter, self._settings, self._counts = ekf, settings, counts

    def assign(self, sensor: SensorModel, detections: Sequence[Detection], ids: Mapping[int, int]) -> list[int]:
        """Return the feature's id of each detection, or NEW or IGNORED.

        Args:
            sensor: what read them.
            detections: of one instant and one kind; they are of distinct features.
            ids: the features of known identity.
        """
        if self._settings.association == "known":
            return [self._known(sensor, detection, ids) for detection in detections]
        settings = self._settings
        prediction = self._filter.predict_readings(sensor)
        gate, new_gate = chi_square_quantile([settings.gate, settings.new_gate], sensor.reading_dim)
        z, stated = [detection.z for detection in detections], [detection.covariance for detection in detections]
        fit = compatibility(z, prediction, sensor, stated)
        if settings.association == "nearest":
            assigned = nearest(fit.d2, gate, new_gate)
        else:
            # Features that no reading comes near have no part in it, and would make it slow.
            near = np.flatnonzero((fit.d2 <= new_gate).any(axis=0))
            prediction, fit = prediction.select(near), fit.select(near)
            joint = self._filter.joint_covariance(prediction)
            found = joint_compatibility(fit, joint, gate, new_gate, probability=settings.gate)
            assigned = found.assigned
            self._counts.cut_short += not found.complete
        if settings.margin > 0.0:
            assigned = clear(assigned, fit.d2, settings.margin)
        if settings.distinct:
            assigned = distinct(assigned, fit.d2, new_gate)
        self._counts.ambiguous += int(np.count_nonzero(assigned == IGNORED))
        return [prediction.ids[j] if j >= 0 else int(j) for j in assigned]

    def _known(self, sensor: SensorModel, detection: Detection, ids: Mapping[int, int]) -> int:
        if detection.identity is None:
            self._counts.unidentified += 1
            return IGNORED
        feature = ids.get(detection.identity, NEW)
        if feature != NEW and self._settings.outlier_gate is not None:
            innovation = self._filter.innovation(detection.z, sensor, feature, detection.covariance)
            if innovation.nis > chi_square_quantile(self._settings.outlier_gate, innovation.dof):
                self._counts.outliers += 1
                return IGNORED
        return feature


def repeats(a: Detection, b: Detection) -> bool:
    """Return whether two detections of one instant are one: of the same feature by name, or the same reading."""
    if a.kind != b.kind or a.identity != b.identity:
        return False
    return a.identity is not None or np.array_equal(a.z, b.z)
