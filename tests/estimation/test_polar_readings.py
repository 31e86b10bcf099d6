"""Readings of either kind as ranges and bearings, and what calibration takes off them."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.estimation.models import Cartesian, RangeBearing
from trailmark.estimation.odometry import SensorCalibration, polar_readings
from trailmark.estimation.records import Detection


def test_kinds_and_noise() -> None:
    own = np.diag([0.04, 0.01])
    detections = [
        Detection(1.0, np.array([2.0, 0.3])),
        Detection(2.0, np.array([3.0, 4.0]), "cartesian"),
        Detection(2.0, np.array([2.0, 0.3]), covariance=own),
    ]
    found = polar_readings(detections, np.array([1.0, 2.0]), RangeBearing(0.1, 0.02, 0.5), Cartesian(0.2, 0.2))
    assert found.instant.tolist() == [0, 1, 1]
    assert found.z[1] == pytest.approx([5.0, np.arctan2(4.0, 3.0)])
    assert found.covariance[0] == pytest.approx(np.diag([0.2**2, 0.02**2]))
    assert found.covariance[1] == pytest.approx(np.diag([0.2**2, (0.2 / 5.0) ** 2]))
    assert found.covariance[2] == pytest.approx(own)
    assert not found.stated
    assert polar_readings(detections[2:], np.array([2.0]), RangeBearing(0.1, 0.02), Cartesian(1, 1)).stated


def test_a_camera_that_reads_depth_is_set_right() -> None:
    bearings = np.linspace(-0.5, 0.5, 11)
    depth = np.column_stack([3.0 * np.cos(bearings), bearings])
    middle = (0.0, float((bearings**2).mean()))
    corrected = SensorCalibration(projection=-0.5, middle=middle).corrected(depth)
    # All alike; on average they stay as they were.
    assert np.ptp(np.log(corrected[:, 0])) < 0.006
    assert np.log(corrected[:, 0]).mean() == pytest.approx(np.log(depth[:, 0]).mean(), abs=1e-9)
    assert corrected[:, 1] == pytest.approx(bearings)
