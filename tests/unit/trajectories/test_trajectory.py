from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from tests.helpers.oracles import SLACK, assert_within_limits

from trailmark import ConfigurationError, CurvePath, Path, Polygon, SpeedZone, Steering

CORNERS = Path(np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 0.0, 2.0], [3.0, 4.0, 2.0], [5.0, 5.0, 3.0]]))
CAR = CurvePath(np.array([[0.0, 0.0, 0.0], [5.0, 3.0, 1.0], [4.0, 1.0, 2.0]]), Steering(1.0))
FORWARD = CurvePath(np.array([[0.0, 0.0, 0.0], [8.0, 3.0, 1.0], [4.0, 1.0, 2.0]]), Steering(0.8, reverse=False))


def path_of(*states: tuple[float, float, float]) -> Path:
    return Path(np.array(states))


@pytest.mark.parametrize("path", [CORNERS, CAR, FORWARD], ids=["straight motions", "Reeds-Shepp", "Dubins"])
@pytest.mark.parametrize("limits", [(1.0, 1.0, 1.0), (1.0, 0.5, 2.0, 3.0), (0.2, 9.0, 0.5, 0.1), (5.0, 0.3, 0.4, 8.0)])
def test_no_limit_is_exceeded(path: Path, limits: Any) -> None:
    trajectory = path.timed(*limits)
    assert_within_limits(trajectory)
    np.testing.assert_array_equal(trajectory.q[[0, -1]], path.states[[0, -1]])
    assert (np.diff(trajectory.t) > 0.0).all()
    assert trajectory.duration >= path.length / limits[0]
    assert trajectory.duration >= path.rotation / limits[2]


def test_a_straight_motion_takes_the_time_of_the_closed_form() -> None:
    # Up to speed v at a, and down: L/v + v/a where the speed is reached, 2·sqrt(L/a) where it is not.
    assert path_of((0, 0, 0), (4, 3, 0)).timed(2.0, 1.0, 1.0).duration == pytest.approx(4.5, rel=1e-12)
    assert path_of((0, 0, 0), (0.3, 0.4, 0)).timed(2.0, 1.0, 1.0).duration == pytest.approx(2.0 * math.sqrt(0.5))
    assert path_of((0, 0, 0), (0, 0, 3)).timed(2.0, 1.0, 0.5).duration == pytest.approx(6.0, rel=1e-12)
    assert path_of((0, 0, 0), (0, 0, 3)).timed(2.0, 1.0, 0.5, 0.5).duration == pytest.approx(7.0, rel=1e-12)


def test_it_stops_at_corners_and_cusps_and_nowhere_else() -> None:
    trajectory = CORNERS.timed(1.0, 1.0, 1.0)
    corners = [np.abs(trajectory.q - state).sum(axis=1).argmin() for state in CORNERS.states]
    speed = np.hypot(*trajectory.dq[:, :2].T)
    assert (speed[corners] == 0.0).all()
    car = CAR.timed(1.0, 1.0, 1.0)
    assert np.count_nonzero(np.abs(car.dq).sum(axis=1) == 0.0) == CAR.cusps + 2


@pytest.mark.parametrize(
    "path",
    [path_of((1, 2, 3)), path_of(*[(1, 2, 3)] * 3), CurvePath(np.array([[1.0, 2.0, 3.0]]), Steering(1.0))],
    ids=["one state", "the same state", "one knot"],
)
def test_a_path_of_no_length_takes_no_time(path: Path) -> None:
    trajectory = path.timed(1.0, 1.0, 1.0)
    assert trajectory.duration == 0.0
    np.testing.assert_array_equal(trajectory.t, [0.0])
    np.testing.assert_array_equal(trajectory.q, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(trajectory.dq, [[0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(trajectory.at([0.0, 7.0]), [[1.0, 2.0, 3.0]] * 2)


def test_segments_of_micrometres() -> None:
    states = np.cumsum(np.random.default_rng(5).normal(scale=1e-6, size=(50, 3)), axis=0)
    assert_within_limits(Path(states).timed(1.0, 1.0, 1.0, 1.0))
    assert_within_limits(path_of((0, 0, 0), (1e-6, 0, 0), (1e-6, 1e-12, 1.0), (1, 0, 0)).timed(1.0, 1.0, 1.0, 1.0))
    assert math.isfinite(path_of((0, 0, 0), (5e-324, 0, 0), (1e-200, 0, 1)).timed(1.0, 1.0, 1.0).duration)


def test_a_speed_zone_holds_wherever_the_reference_point_is_in_it() -> None:
    zone = SpeedZone(Polygon(np.array([[1.0, -1.0], [2.0, -1.0], [2.0, 1.0], [1.0, 1.0]])), 0.25)
    trajectory = path_of((0.0, 0.0, 0.0), (3.0, 0.0, 0.0)).timed(2.0, 1.0, 1.0, zones=[zone])
    t = np.linspace(0.0, trajectory.duration, 100_001)
    x, speed = trajectory.at(t)[:, 0], trajectory.velocity(t)[:, 0]
    assert (speed[(x >= 1.0) & (x <= 2.0)] <= 0.25 * SLACK).all()
    # A metre on either side, from 0 to 0.25 m/s by way of the highest speed that a metre allows, and a metre between.
    peak = math.sqrt(0.5 * (0.25**2 + 2.0))
    assert trajectory.duration == pytest.approx(2.0 * (peak + peak - 0.25) + 4.0, rel=2e-3)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf, "1", None, True])
@pytest.mark.parametrize("name", ["max_speed", "max_acceleration", "max_turn_rate", "max_turn_acceleration"])
def test_limits_are_checked(name: str, value: Any) -> None:
    limits: dict[str, Any] = dict.fromkeys(("max_speed", "max_acceleration", "max_turn_rate"), 1.0) | {name: value}
    if value is None and name == "max_turn_acceleration":
        return
    with pytest.raises(ConfigurationError, match=rf"^timed: {name}: expected a finite number above 0, got"):
        CORNERS.timed(**limits)
