# ruff: noqa: N806 # the filter's own symbols
"""Refined readings: against the filter's equations, the batch optimum, and the obstacles they were taken of."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from trailmark import Disc, Polygon, Rectangle, World
from trailmark.estimation import RangeBearing, refine_points, sense_obstacles

FloatArray = NDArray[np.float64]


def log(b: int, m: int, sensor: RangeBearing, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True points (b, 2), poses (b, m, 3) two to ten metres away from them, and noisy readings (b, m, 2)."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-20.0, 20.0, (b, 2))
    away, way = rng.uniform(2.0, 10.0, (b, m)), rng.uniform(-np.pi, np.pi, (b, m))
    poses = np.empty((b, m, 3))
    poses[..., 0], poses[..., 1] = points[:, :1] + away * np.cos(way), points[:, 1:] + away * np.sin(way)
    poses[..., 2] = rng.uniform(-np.pi, np.pi, (b, m))
    offset = points[:, None] - poses[..., :2]
    readings = np.stack([np.hypot(*np.moveaxis(offset, -1, 0)), np.arctan2(offset[..., 1], offset[..., 0])], axis=-1)
    readings[..., 1] -= poses[..., 2]
    readings += rng.standard_normal(readings.shape) * (sensor.sigma_range, sensor.sigma_bearing)
    readings[..., 1] = np.angle(np.exp(1j * readings[..., 1]))
    return points, poses, readings


def by_recursion(readings: FloatArray, poses: FloatArray, sensor: RangeBearing) -> tuple[FloatArray, FloatArray]:
    """A point feature and its covariance by the filter's equations, written out."""
    point, _, G = sensor.inverse(poses[0], readings[0])
    P = G @ sensor.noise(poses[0], point) @ G.T
    for pose, reading in zip(poses[1:], readings[1:], strict=True):
        H, R = sensor.linearised(pose, point).H_feature, sensor.noise(pose, point)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        point = point + K @ sensor.residual(reading, sensor.h(pose, point))
        I_KH = np.eye(2) - K @ H
        P = I_KH @ P @ I_KH.T + K @ R @ K.T
    return point, P


@pytest.mark.slow
@given(
    m=st.integers(1, 12),
    sigma_range=st.floats(1e-3, 0.5),
    sigma_bearing=st.floats(1e-4, 0.2),
    growth=st.sampled_from([0.0, 0.3]),
    seed=st.integers(0, 9999),
)
def test_many_at_once_are_each_one_by_the_equations(
    m: int, sigma_range: float, sigma_bearing: float, growth: float, seed: int
) -> None:
    sensor = RangeBearing(sigma_range, sigma_bearing, growth)
    _, poses, readings = log(4, m, sensor, seed)
    many = refine_points(readings, poses, sensor)
    for i in range(4):
        point, covariance = by_recursion(readings[i], poses[i], sensor)
        assert np.abs(point - many.points[i]).max() < 1e-9
        assert np.abs(covariance - many.covariances[i]).max() < 1e-9


def test_stated_covariance_is_the_true_one() -> None:
    sensor = RangeBearing(0.1, 0.02)
    truth, poses, readings = log(4000, 6, sensor, 1)
    points, P = refine_points(readings, poses, sensor)
    assert np.array_equal(P, np.swapaxes(P, 1, 2))
    assert np.linalg.eigvalsh(P).min() > 0.0
    error = points - truth
    nees = np.einsum("bi,bij,bj->b", error, np.linalg.inv(P), error)
    # 4,000 draws of chi-square with 2 degrees: mean 2, standard deviation of the mean 0.03.
    assert 1.85 < nees.mean() < 2.15


WORLD = World(
    "readings",
    (0.0, 0.0, 20.0, 10.0),
    (
        Disc((5.0, 5.0), 1.0),
        Rectangle((10.0, 3.0), 2.0, 1.0, 0.4),
        Polygon(np.array([[14.0, 2.0], [18.0, 2.0], [18.0, 8.0], [17.0, 8.0], [17.0, 3.0], [14.0, 3.0]])),
    ),
)


def test_readings_lie_on_the_outlines_and_span_the_boxes() -> None:
    sensor = RangeBearing(0.02, 0.002)
    arrays = sense_obstacles(WORLD, 200, sensor, readings_per_point=20, random_state=4)
    assert len(arrays) == 3
    for points, obstacle in zip(arrays, WORLD.obstacles, strict=True):
        assert points.shape == (28, 2)
        outline = obstacle.polygon(1e-3).shapely().exterior
        assert shapely.distance(outline, shapely.points(points)).max() < 0.06
        box = (*points.min(axis=0), *points.max(axis=0))
        assert np.allclose(box, obstacle.bounding_box(), atol=0.06)


def test_only_what_is_seen_is_read() -> None:
    # From the left the disc shows its left half, and hides nothing else of the far rectangle than its shadow.
    world = World("w", (0.0, 0.0, 20.0, 10.0), (Disc((5.0, 5.0), 1.0), Rectangle((10.0, 5.0), 1.0, 8.0)))
    sensor = RangeBearing(1e-5, 1e-6)
    disc, wall = sense_obstacles(world, [1.0, 5.0, 0.0], sensor, points_per_obstacle=400, random_state=1)
    # Tangents from 4 m away touch a disc of radius 1 m at 0.25 m before its centre.
    assert len(disc) > 100
    assert disc[:, 0].max() < 4.76
    assert np.abs(wall[:, 0] - 9.5).max() < 1e-3
    shadow = 8.5 / np.sqrt(15.0)
    assert np.abs(wall[:, 1] - 5.0).min() == pytest.approx(shadow, abs=0.05)
    near = sense_obstacles(world, [1.0, 5.0, 0.0], sensor, max_range=4.5, random_state=1)
    assert len(near[0]) > 0
    assert near[1].shape == (0, 2)


def test_the_boundary_hides_what_is_outside() -> None:
    inside = Polygon(np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 10.0], [0.0, 10.0]]))
    world = World("w", WORLD.bounds, WORLD.obstacles, boundary=inside)
    read = sense_obstacles(world, 50, RangeBearing(0.01, 0.01), random_state=1)
    assert [len(points) for points in read] == [28, 0, 0]
