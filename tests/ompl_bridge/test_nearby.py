"""Nearby: landmarks within the distance, boxes and bells as OMPL's own samplers have them, all within the bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from trailmark.collision import StateChecker
from trailmark.ompl_bridge.landmark_source import LandmarkSource
from trailmark.ompl_bridge.nearby import LANDMARKS_NEAR, Nearby
from trailmark.world import Robot, World

CHECKER = StateChecker(World("empty", (0.0, 0.0, 10.0, 10.0)), Robot.rectangle(0.2, 0.1))


def nearby(landmarks: ArrayLike = (), seed: int = 0) -> Nearby:
    return Nearby(
        LandmarkSource(CHECKER, np.asarray(landmarks, dtype=np.float64).reshape(-1, 3)), np.random.default_rng(seed)
    )


def apart(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """OMPL's distance of SE2StateSpace, by complex numbers."""
    turn = abs(np.angle(np.exp(1j * (a[2] - b[2]))))
    return math.dist(a[:2], b[:2]) + 0.5 * float(turn)


def test_landmarks_within_the_distance_take_turns() -> None:
    near = [(5.0, 5.0, 3.0), (5.3, 5.0, -3.0)]
    source = nearby([*near, (8.0, 8.0, 3.0), (5.0, 5.0, 0.0)])
    found = [source.landmark((5.1, 5.0, 3.1), 0.5) for _ in range(4000)]
    hits = [row for row in found if row is not None]
    assert {tuple(row) for row in hits} == set(near)
    assert len(hits) / len(found) == pytest.approx(LANDMARKS_NEAR, abs=0.04)
    assert sum(row == near[0] for row in hits) / len(hits) == pytest.approx(0.5, abs=0.1)


@pytest.mark.slow
@given(
    st.tuples(st.floats(0.5, 9.5), st.floats(0.5, 9.5), st.floats(-math.pi, math.pi)),
    st.floats(0.01, 20.0),
    st.integers(0, 1000),
)
def test_what_is_returned_is_near(q: tuple[float, float, float], distance: float, seed: int) -> None:
    landmarks = np.random.default_rng(seed).uniform((0.5, 0.5, -math.pi), (9.5, 9.5, math.pi), (50, 3))
    source = nearby(landmarks, seed)
    for _ in range(20):
        row = source.landmark(q, distance)
        assert row is None or apart(row, q) <= distance + 1e-9
        x, y, theta = source.uniform(q, distance)
        assert abs(x - q[0]) <= distance * 2.0 / 3.0 + 1e-9
        assert abs(y - q[1]) <= distance * 2.0 / 3.0 + 1e-9
        turn = abs(float(np.angle(np.exp(1j * (theta - q[2])))))
        assert turn <= distance / 3.0 + 1e-9
        assert 0.0 <= x <= 10.0
        assert 0.0 <= y <= 10.0
        assert -math.pi < theta <= math.pi


def test_no_landmarks_at_all() -> None:
    source = nearby()
    assert all(source.landmark((5.0, 5.0, 0.0), 100.0) is None for _ in range(100))
