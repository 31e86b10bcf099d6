"""Features are as uncertain as stated where bearings are so coarse that a reading is no straight function of them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from trailmark.estimation import Detection, Log, MapSettings, Odometry, Pose, map_log
from trailmark.estimation.logs.records import Record
from trailmark.estimation.maps.map_settings import MappingSettings

POSTS = np.array([[6.0, 1.0], [4.0, -2.0], [2.0, 3.0], [8.0, 4.0], [5.0, -5.0]])
CERTAIN = MappingSettings(pose_sigma=(0.0, 0.0))


def log(rng: np.random.Generator, count: int, sigma: tuple[float, float], stated: bool) -> Log:
    """Return a straight drive past the posts, by poses or by odometry, with all of them read each second."""
    records: list[Record] = [] if stated else [Odometry(0.0, 0.3, 0.0)]
    for t in range(count):
        x = 0.3 * t
        records += [Pose(float(t), x, 0.0, 0.0)] if stated else []
        dx, dy = (POSTS - [x, 0.0]).T
        z = np.column_stack([np.hypot(dx, dy), np.arctan2(dy, dx)]) + rng.normal(0.0, sigma, (len(POSTS), 2))
        records += [Detection(float(t), z[i], identity=i, covariance=np.square(np.diag(sigma))) for i in range(len(z))]
    return Log("coarse", tuple(records), np.empty((0, 3)))


def nees(count: int, sigma: tuple[float, float], settings: MapSettings, runs: int = 40) -> np.ndarray:
    """Return eᵀ P⁻¹ e of each post in each of the runs."""
    rng, found = np.random.default_rng(0), []
    for _ in range(runs):
        mapped = map_log(log(rng, count, sigma, settings.poses == "log"), settings)
        assert mapped.slam is not None
        for feature in mapped.slam.features:
            error = feature.mean - POSTS[feature.identity or 0]
            found.append(error @ np.linalg.solve(feature.covariance, error))
    return np.array(found)


@pytest.mark.parametrize("sigma", [(0.05, 0.02), (0.05, 0.2), (0.01, 0.1)])
@pytest.mark.parametrize("count", [1, 3, 20])
def test_by_the_poses_of_the_log(count: int, sigma: tuple[float, float]) -> None:
    found = nees(count, sigma, MapSettings(poses="log", mapping=CERTAIN))
    assert 0.5 < found.mean() < 2.6
    # 200 posts, 2 of them expected beyond.
    assert np.count_nonzero(found > chi2.ppf(0.99, 2)) <= 7


@pytest.mark.parametrize("sigma", [(0.05, 0.02), (0.05, 0.3)])
@pytest.mark.parametrize("count", [3, 20])
def test_by_the_filter_of_poses_and_features(count: int, sigma: tuple[float, float]) -> None:
    found = nees(count, sigma, MapSettings(smooth=False), runs=20)
    assert found.mean() < 2.6
    assert np.count_nonzero(found > chi2.ppf(0.99, 2)) <= 4
