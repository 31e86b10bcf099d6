"""Where a robot stands that detects points of a known map."""

from __future__ import annotations

import numpy as np
import pytest

from trailmark.exploration.detection_mapper import aligned
from trailmark.se2 import FloatArray, transform


def detected(pose: FloatArray, places: FloatArray) -> FloatArray:
    """Return places in the robot's frame, by complex numbers."""
    turned = ((places[:, 0] - pose[0]) + 1j * (places[:, 1] - pose[1])) * np.exp(-1j * pose[2])
    return np.column_stack([turned.real, turned.imag])


@pytest.mark.parametrize("identified", [True, False])
@pytest.mark.parametrize("seed", range(5))
def test_the_pose_is_found_among_noise_and_wrong_detections(seed: int, identified: bool) -> None:
    rng = np.random.default_rng(seed)
    places = rng.uniform(0.0, 20.0, (30, 2))
    pose = np.array([*rng.uniform(5.0, 15.0, 2), rng.uniform(-3.0, 3.0)])
    seen = rng.choice(30, 7, replace=False)
    points = detected(pose, places[seen]) + rng.normal(size=(7, 2)) * 0.01
    points[0] += [3.0, -2.0]  # a wrong one
    every = np.arange(30)
    found = aligned(points, places, [np.array([i]) if identified else every for i in seen], 0.05)
    assert found is not None
    assert found.unique
    assert 6 <= found.matched <= 7
    assert found.pose == pytest.approx(pose, abs=0.03)
    assert transform(found.pose, points[1:]) == pytest.approx(places[seen[1:]], abs=0.08)


def test_two_places_that_look_alike_are_not_told_apart() -> None:
    corner = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]])
    places = np.concatenate([corner, corner + np.array([20.0, 5.0])])
    found = aligned(detected(np.array([1.0, 1.0, 0.5]), corner), places, [np.arange(6)] * 3, 0.05)
    assert found is not None
    assert found.matched == 3
    assert not found.unique
