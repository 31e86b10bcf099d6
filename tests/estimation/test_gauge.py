"""Covariances relative to the map: those of errors after the best rigid alignment."""

from __future__ import annotations

import numpy as np
import pytest
from tests.helpers.alignment import aligned

from trailmark.estimation.landmark_graph import relative_covariance


@pytest.mark.slow
def test_errors_after_alignment() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-5.0, 5.0, (7, 2))
    root = 1e-3 * rng.standard_normal((14, 14))
    joint = root @ root.T
    found = []
    for _ in range(4000):
        wrong = points + (root @ rng.standard_normal(14)).reshape(-1, 2)
        found.append((aligned(wrong, points)(wrong) - points).reshape(-1))
    assert np.cov(np.array(found).T) == pytest.approx(relative_covariance(points, joint), abs=4e-6)


@pytest.mark.parametrize("count", [1, 2, 6])
def test_an_error_of_the_frame_is_none(count: int) -> None:
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (count, 2))
    turn = np.column_stack([-points[:, 1], points[:, 0]]).reshape(-1) + 0.5
    assert np.abs(relative_covariance(points, np.outer(turn, turn))).max() < 1e-9
